"""The planning loop, with scripted proposals and motions, without any hydraulics."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from mhsb_planner.deadline import NO_DEADLINE
from mhsb_planner.errors import NoPathError, RequestError
from mhsb_planner.motion.energy import Energy
from mhsb_planner.motion.s3_trajectory import FitMethod
from mhsb_planner.plan_log import PlanLog
from mhsb_planner.planners.options import PlanOptions
from mhsb_planner.planners.path_planner import PathProposal
from mhsb_planner.planning import loop as loop_module
from mhsb_planner.planning.loop import PlanningLoop
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.manipulability_loss import WITHOUT_AREA
from mhsb_planner.search.s2_search import Weights

OPTIONS = PlanOptions(planner="integrated", weights=Weights(1.0, 0.0, 10.0))
ERRORS = [
    (NoPathError((0.0, 0.0), (1.0, 1.0)), "no path", "no sequence of admissible steps"),
    (RequestError("speed", 1, "must be 2"), "failed", "speed must be 2 (is 1)"),
    (ZeroDivisionError("division by zero"), "failed", "ZeroDivisionError: division by zero"),
]
"""Errors of a planner, with outcome and reason in the log."""


def path_of(energy, holding_switches=0):
    """A path of one step in N; its cost counts switches that hold the arm at the end."""
    return DiscretePath(
        tip=np.zeros((2, 2)),
        posture=np.zeros((2, 3)),
        modes=np.zeros((1, 3), dtype=np.uint8),
        duration=np.ones(1),
        energy=np.array([energy]),
        energy_series=np.array([energy]),
        cost=energy + OPTIONS.weights.switches * holding_switches,
        start_modes=np.zeros(3, dtype=np.uint8),
        statistics=SearchStatistics(0, 0, 0.0),
        holding_switches=holding_switches,
    )


def motion_along(machine, path, *_):
    """A motion with the path's energy that never switches a mode."""
    energy = float(path.energy.sum())
    return SimpleNamespace(
        trajectory=SimpleNamespace(duration_ns=10**9),
        scheduled=SimpleNamespace(switch_count=0),
        energy=Energy(energy, energy, 0.0, 0.0, 0.0, 0.0, 0.0),
        method=FitMethod.RAMPED,
        stretch=1.0,
        speed_excess=0.0,
        refused=(),
    )


@pytest.fixture
def loop(monkeypatch):
    """A loop whose motions cost what their paths cost without mode switches."""
    monkeypatch.setattr(loop_module, "fit_trajectory", motion_along)
    monkeypatch.setattr(loop_module, "list_variant_rules", lambda *_, **__: [])
    monkeypatch.setattr(loop_module, "find_cavitations", lambda *_: ())
    task = SimpleNamespace(options=OPTIONS, start=None, modes=None, brake=None, area=WITHOUT_AREA)
    return PlanningLoop(None, task, NO_DEADLINE, PlanLog())


def proposals(*steps):
    """Proposals of paths; an error among them is raised."""
    for step in steps:
        if isinstance(step, Exception):
            raise step
        yield PathProposal(step, proposer="scripted")


def test_switches_after_the_last_step_are_no_reason_to_skip_a_path(loop):
    dear, cheap = path_of(100.0), path_of(80.0, holding_switches=3)
    plan = loop.choose_best(proposals(dear, cheap))
    assert plan.path.cost == cheap.cost
    assert [each.outcome for each in plan.log.entries] == ["taken", "taken"]


def test_a_path_that_costs_more_than_the_incumbent_without_its_switches_is_skipped(loop):
    dear, cheap = path_of(100.0, holding_switches=3), path_of(80.0)
    plan = loop.choose_best(proposals(cheap, dear))
    assert plan.path.cost == cheap.cost
    assert [each.outcome for each in plan.log.entries] == ["taken", "skipped"]


def test_the_loop_skips_the_paths_that_cost_more_than_it_tells_the_searches(loop):
    def around_the_limit():
        assert loop.progress.max_path_cost == math.inf
        yield PathProposal(path_of(100.0))
        limit = loop.progress.max_path_cost
        yield PathProposal(path_of(0.999 * limit))
        yield PathProposal(path_of(1.001 * limit))

    plan = loop.choose_best(around_the_limit())
    assert [each.outcome for each in plan.log.entries] == ["taken", "dearer", "skipped"]


@pytest.mark.usefixtures("planner_may_fail")
@pytest.mark.parametrize(("error", "outcome", "reason"), ERRORS)
def test_an_error_after_the_first_motion_keeps_the_motion_and_is_logged(
    loop, error, outcome, reason
):
    plan = loop.choose_best(proposals(path_of(100.0), error))
    assert plan.path.cost == 100.0
    taken, failed = plan.log.entries
    assert taken.outcome == "taken"
    assert (failed.proposer, failed.outcome) == ("integrated", outcome)
    assert reason in failed.reason


@pytest.mark.parametrize("error", [each for each, *_ in ERRORS])
def test_an_error_before_the_first_motion_is_raised(loop, error):
    with pytest.raises(type(error)):
        loop.choose_best(proposals(error))
