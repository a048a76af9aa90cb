"""Promises about goals and plans, each broken on purpose."""

from __future__ import annotations

import math
import signal
from dataclasses import replace

import numpy as np
import pytest
from tests.soak import goal_promises
from tests.soak.events import PLANNER, SIM, ActionKind

from mhsb_model.goal import Goal
from mhsb_model.obstacles.zones import Zones
from mhsb_model.verdict import GoalVerdict, Verdict

FENCE = Zones(
    tip_circles=tuple(
        (0.458 + 0.06 * math.cos(angle), -0.316 + 0.06 * math.sin(angle), 0.035)
        for angle in np.arange(8) * math.pi / 4
    )
)
"""A closed ring of tip zones around the tip in the posture FOLDED [m]."""


def test_a_goal_without_a_verdict_or_with_two_is_told(events, spoilt):
    first, ending, second = events.recording.reports
    without = goal_promises.check_one_verdict(spoilt(recording={"reports": (ending, second)}))
    assert without.violations == ("the goal sent at 10.40 s got 0 verdicts",)
    twice = goal_promises.check_one_verdict(
        spoilt(recording={"reports": (first, first, ending, second)})
    )
    assert twice.violations == ("the goal sent at 10.40 s got 2 verdicts",)


@pytest.mark.parametrize("how", ["killed", "frozen", "not yet ready"])
def test_a_planner_that_cannot_hear_owes_no_verdict_but_never_gives_two(events, spoilt, make, how):
    sim, planner = events.lives
    changes = {
        "killed": {"lives": (sim, make.life(PLANNER, 1, 0.5, 12.0, signal=signal.SIGKILL))},
        "frozen": {"actions": (*events.actions, make.deed(ActionKind.FREEZE, PLANNER, 10.0, 11.5))},
        "not yet ready": {"lives": (sim, replace(planner, ready_ns=make.ns(10.41)))},
    }[how]
    first, ending, second = events.recording.reports
    silent = goal_promises.check_one_verdict(spoilt(recording={"reports": (second,)}, **changes))
    assert silent.is_kept
    twice = {"reports": (first, first, ending, second)}
    assert not goal_promises.check_one_verdict(spoilt(recording=twice, **changes)).is_kept


def test_an_execution_without_an_end_or_with_two_is_told(events, spoilt):
    first, ending, second = events.recording.reports
    assert not goal_promises.check_one_execution_report(
        spoilt(recording={"reports": (first, second)})
    ).is_kept
    twice = goal_promises.check_one_execution_report(
        spoilt(recording={"reports": (first, ending, ending)})
    )
    assert twice.violations == ("the goal that was answered OK at 10.50 s got 2 ends",)


def test_a_planner_that_was_killed_owes_no_end(events, spoilt, make):
    lives = (events.lives[0], make.life(PLANNER, 1, 0.5, 12.0, signal=signal.SIGKILL))
    first, _, second = events.recording.reports
    kept = goal_promises.check_one_execution_report(
        spoilt(recording={"reports": (first, second)}, lives=lives)
    )
    assert kept.is_kept
    assert kept.tested == 0


def test_a_goal_lost_without_a_disturbance_is_told_with_its_reason(spoilt, make):
    never = {"plans_in_force": (make.heard(0.0, 0),)}
    goal_alone = (make.deed(ActionKind.GOAL, PLANNER, 10.4, 10.4, 1),)
    kept = goal_promises.check_no_goal_lost(spoilt(recording=never, actions=goal_alone))
    assert "sent at 10.40 s: it was accepted, but no plan" in kept.violations[0]
    disturbed = (*goal_alone, make.deed(ActionKind.RESET, SIM, 10.6, 10.7))
    assert goal_promises.check_no_goal_lost(spoilt(recording=never, actions=disturbed)).is_kept


@pytest.mark.parametrize(
    ("deeds", "lost"),
    [
        ([("ZONES", 5.0, FENCE)], False),
        ([("ZONES", 5.0, FENCE), ("ZONES", 6.0, Zones())], True),
        ([("ZONES", 5.0, FENCE), ("START", 6.0, None)], True),
    ],
)
def test_a_goal_not_found_in_time_is_lost_only_if_a_path_leads_to_it(
    events, spoilt, make, deeds, lost
):
    place = Goal(1, 0.5, 0.1)
    never = {
        "goals": (make.heard(10.4, place),),
        "plans_in_force": (make.heard(0.0, 0),),
        "reports": (make.heard(11.0, GoalVerdict(Verdict.NOT_FOUND, "not in time", place)),),
    }
    actions = (
        *(make.deed(ActionKind[kind], PLANNER, at, at, value) for kind, at, value in deeds),
        make.deed(ActionKind.GOAL, PLANNER, 10.4, 10.4, 1),
    )
    judged = goal_promises.check_no_goal_lost(spoilt(recording=never, actions=actions))
    assert judged.tested == len(judged.violations) == lost


def test_a_goal_is_disturbed_until_it_ends_whatever_goals_are_sent_meanwhile(spoilt, make):
    deeds = (
        make.deed(ActionKind.GOAL, PLANNER, 10.4, 10.4, 1),
        make.deed(ActionKind.GOAL, PLANNER, 12.0, 12.0, 2),
        make.deed(ActionKind.STOP, SIM, 14.0, 14.1),
    )
    never = {"plans_in_force": (make.heard(0.0, 0),)}
    assert goal_promises.check_no_goal_lost(spoilt(recording=never, actions=deeds)).is_kept
    assert not goal_promises.check_no_goal_lost(spoilt(recording=never, actions=deeds[:2])).is_kept


@pytest.mark.parametrize(("healed", "counts"), [(6.0, True), (12.0, False)])
def test_a_goal_counts_only_where_nothing_fails_be_it_found_or_not(spoilt, make, healed, counts):
    deeds = (
        make.deed(ActionKind.FAULT, SIM, 4.0, 4.1, "valve_stuck:actuator_1"),
        make.deed(ActionKind.GOAL, PLANNER, 10.4, 10.4, 1),
        make.deed(ActionKind.HEAL, SIM, healed, healed + 0.1, "valve_stuck:actuator_1"),
    )
    never = {"plans_in_force": (make.heard(0.0, 0),)}
    kept = goal_promises.check_no_goal_lost(spoilt(recording=never, actions=deeds))
    assert kept.is_kept is not counts


def test_a_plan_of_which_nothing_or_too_much_is_told(events, spoilt):
    assert not goal_promises.check_one_hand_over_report(
        spoilt(recording={"hand_overs": ()})
    ).is_kept
    twice = {"hand_overs": 2 * events.recording.hand_overs}
    kept = goal_promises.check_one_hand_over_report(spoilt(recording=twice))
    assert kept.violations == ("of the plan stamped 10.500 s it told 2 times",)


def test_a_stamp_that_does_not_increase_is_told(events, spoilt):
    twice = {"trajectories": 2 * events.recording.trajectories}
    assert goal_promises.check_stamps_increase(spoilt(recording=twice)).violations


def test_a_goal_accepted_or_refused_otherwise_under_a_fault_is_told(events, spoilt, make):
    first, ending, second = events.recording.reports
    other = replace(second, value=replace(second.value, code=Verdict.NO_STATE))
    kept = goal_promises.check_refused_at_faults(
        spoilt(recording={"reports": (first, ending, other)})
    )
    assert kept.violations == ("the goal sent at 42.00 s got NO_STATE",)
    assert kept.tested == 1
