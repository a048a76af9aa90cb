"""The order of work among proposers, with scripted proposers and no hydraulics."""

import numpy as np
import pytest

from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.errors import NoPathError
from mhsb_planner.planners.path_planner import PathProposal
from mhsb_planner.planners.schedule import (
    Proposer,
    schedule_in_turn,
    schedule_proposers,
    take_turns,
)
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics

FAILS = "fails"
"""Entry of a script at which the proposer fails."""


def path_of(duration):
    """A path of one step that lasts for a duration."""
    return DiscretePath(
        tip=np.zeros((2, 2)),
        posture=np.zeros((2, 3)),
        modes=np.zeros((1, 3), dtype=np.uint8),
        duration=np.array([duration]),
        energy=np.ones(1),
        energy_series=np.ones(1),
        cost=1.0,
        start_modes=np.zeros(3, dtype=np.uint8),
        statistics=SearchStatistics(0, 0, 0.0),
    )


def scripted(name, *script):
    """A proposer that does as scripted: a path's duration, None for a pause, or FAILS."""

    def proposals():
        for each in script:
            if each == FAILS:
                raise NoPathError((0.0, 0.0), (1.0, 1.0))
            yield None if each is None else PathProposal(path_of(each))

    return Proposer(name, proposals())


def turns(schedule, progress, main=None, motion_at=None):
    """Names of the proposals in their order; a motion is there from the numbered one on."""
    names = []
    for proposal in take_turns(schedule, progress, main):
        names.append(proposal.proposer)
        progress.has_motion = motion_at is not None and len(names) >= motion_at
    return " ".join(names)


def scheduled(own, progress, *, leak_free=(), slew_time=0.0, early_count=1):
    """The schedule of scripted proposers, and the first of them."""
    first = scripted("own", *own)
    others = [scripted("table", 1, 1), scripted("fixed", 1)]
    leakfree = scripted("leakfree", *leak_free)
    limits = {"slew_time": slew_time, "early_count": early_count}
    return schedule_proposers(first, leakfree, others, progress, **limits), first


@pytest.mark.parametrize(
    ("own", "early_count", "order"),
    [
        ((1, 1, 1, 1), 1, "own own table own own table fixed"),
        ((1, None, 1), 1, "own table own table fixed"),
        ((1,), 1, "own table table fixed"),
        ((1, 1, 1), 2, "own own table fixed own table"),
    ],
    ids=["usual", "own search pauses", "own search ends early", "own search takes long"],
)
def test_baselines_have_a_turn_after_two_of_the_own_search_and_the_rest_after_its_end(
    own, early_count, order
):
    progress = PlanProgress(NO_DEADLINE)
    schedule, _ = scheduled(own, progress, early_count=early_count)
    assert turns(schedule, progress, motion_at=1) == order


@pytest.mark.parametrize(
    ("seconds", "order"),
    [
        (3600.0, "own own table own own table fixed"),
        (-1.0, "own table table own own own fixed"),
    ],
    ids=["with time", "with half of the time gone"],
)
def test_with_half_of_the_time_gone_baselines_propose_until_there_is_a_motion(seconds, order):
    progress = PlanProgress(Deadline.after(seconds))
    schedule, _ = scheduled((1, 1, 1, 1), progress)
    assert turns(schedule, progress, motion_at=3) == order


def test_leakage_is_left_out_after_the_first_own_path_that_is_shorter_than_the_slew():
    progress = PlanProgress()
    schedule, _ = scheduled((3, 1, 1), progress, leak_free=(1, 1), slew_time=2.0)
    order = turns(schedule, progress, motion_at=1)
    assert order == "own own leakfree leakfree table own table fixed"


def test_zones_give_the_quick_ones_every_turn_until_there_is_a_motion_and_then_every_second():
    progress = PlanProgress()
    quick = [scripted("quick", 1, 1, 1, 1)]
    others = [scripted("slow", 1, 1), scripted("last", 1)]
    schedule = schedule_in_turn(scripted("direct", 1, 1, 1), quick, others, progress)
    order = turns(schedule, progress, motion_at=3)
    assert order == "direct quick quick quick slow quick last direct slow direct"


def test_a_failure_is_logged_with_its_reason_and_others_go_on():
    progress = PlanProgress()
    every = [scripted("one", 1, FAILS, 1), scripted("two", 1)]
    schedule = schedule_in_turn(every[0], [], every[1:], progress)
    assert turns(schedule, progress) == "one two"
    [entry] = progress.log.entries
    assert (entry.proposer, entry.outcome) == ("one", "no path")
    assert "no sequence of admissible steps" in entry.reason
    assert every[0].error is not None
    assert every[1].error is None


def test_the_main_proposer_s_failure_ends_the_plan():
    progress = PlanProgress()
    schedule, own = scheduled((1, FAILS), progress)
    with pytest.raises(NoPathError):
        turns(schedule, progress, own)
    assert [entry.proposer for entry in progress.log.entries] == ["own"]
