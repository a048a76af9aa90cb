"""Accepted goals end exactly once, and in the right way."""

import numpy as np
import pytest

from mhsb_model.command import Command
from mhsb_model.goal import Goal
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory
from mhsb_model.verdict import Outcome
from mhsb_planner.online.departure import NO_PLAN, ArmView, Received
from mhsb_planner.online.executions import Executions

START, END = np.array([0.2, -0.8, -0.3]), np.array([0.4, -0.6, -0.3])
STAMP = 100 * SECOND_NS
CHANGE = STAMP + SECOND_NS // 10
FINISH = STAMP + 5 * SECOND_NS


def command(stamp: int = STAMP) -> Command:
    rows = np.array([START, END])
    trajectory = Trajectory(stamp, [0, 5 * SECOND_NS], rows, 0 * rows, 0 * rows)
    return Command(trajectory, ModeSchedule(stamp, [0], [[0, 0, 0]]))


@pytest.fixture
def executions(machine):
    followed = Executions(machine)
    x, z = machine.tip_position(END)
    followed.add(Goal(1, x, z), command(), CHANGE)
    return followed


def view(in_force: int | None, posture=START) -> ArmView:
    state = Received(MotionState.at_rest(posture), 0)
    return ArmView(3, reference=state, measured=state, in_force_ns=in_force)


def outcomes(reports) -> list[Outcome]:
    return [report.outcome for report in reports]


def test_a_plan_that_ends_at_the_goal_is_reached_once(executions):
    assert executions.update(view(STAMP), CHANGE) == []
    assert outcomes(executions.update(view(NO_PLAN, END), FINISH + 1)) == [Outcome.REACHED]
    assert executions.update(view(NO_PLAN, END), FINISH + 2) == []


def test_the_report_gives_the_distance_that_is_left(executions):
    executions.update(view(STAMP), CHANGE)
    report = executions.update(view(STAMP, END + [0.001, 0, 0]), FINISH)[0]
    assert "0." in report.sentence
    assert report.goal_stamp_ns == 1
    assert report.plan_stamp_ns == STAMP


def test_an_arm_that_ends_elsewhere_is_given_a_second_and_then_aborted(executions):
    executions.update(view(STAMP), CHANGE)
    assert executions.update(view(STAMP), FINISH + SECOND_NS // 2) == []
    assert outcomes(executions.update(view(STAMP), FINISH + SECOND_NS)) == [Outcome.ABORTED]


def test_a_plan_that_is_never_confirmed_is_aborted(executions):
    assert executions.awaits_confirmation(STAMP, CHANGE)
    assert executions.update(view(NO_PLAN), CHANGE) == []
    assert outcomes(executions.update(view(NO_PLAN), CHANGE + SECOND_NS)) == [Outcome.ABORTED]


def test_a_later_plan_in_force_replaces_the_earlier_one(executions):
    executions.update(view(STAMP), CHANGE)
    later = STAMP + SECOND_NS
    executions.add(Goal(2, 0.5, 0.5), command(later), later + SECOND_NS // 10)
    assert executions.update(view(STAMP), later) == []
    assert not executions.awaits_confirmation(STAMP, later)
    reports = executions.update(view(later), later + SECOND_NS // 5)
    assert outcomes(reports) == [Outcome.REPLACED]
    assert reports[0].goal_stamp_ns == 1


def test_a_later_plan_that_is_refused_leaves_the_earlier_one_going(executions):
    executions.update(view(STAMP), CHANGE)
    later = STAMP + SECOND_NS
    executions.add(Goal(2, 0.5, 0.5), command(later), later + SECOND_NS // 10)
    reports = executions.update(view(STAMP), later + SECOND_NS)
    assert [report.goal_stamp_ns for report in reports] == [2]
    assert outcomes(executions.update(view(NO_PLAN, END), FINISH)) == [Outcome.REACHED]


def test_an_arm_stopped_on_its_way_is_stopped_and_one_that_is_elsewhere_is_aborted(
    executions, machine
):
    executions.update(view(STAMP), CHANGE)
    halfway = command().trajectory.sample(STAMP + 2 * SECOND_NS).position
    stopped = executions.update(view(NO_PLAN, halfway), STAMP + 2 * SECOND_NS)
    assert outcomes(stopped) == [Outcome.STOPPED]
    again = Executions(machine)
    again.add(Goal(1, 0.5, 0.5), command(), CHANGE)
    again.update(view(STAMP), CHANGE)
    elsewhere = again.update(view(NO_PLAN, START - 0.5), STAMP + 2 * SECOND_NS)
    assert outcomes(elsewhere) == [Outcome.ABORTED]


def test_another_planners_plan_replaces_ours(executions):
    executions.update(view(STAMP), CHANGE)
    assert outcomes(executions.update(view(77), CHANGE + 1)) == [Outcome.REPLACED]


def test_an_arm_that_does_not_report_plans_is_taken_to_obey(executions):
    assert executions.update(view(None), CHANGE + SECOND_NS) == []
    assert outcomes(executions.update(view(None, END), FINISH)) == [Outcome.REACHED]


def test_stopping_and_aborting_close_everything(executions):
    assert outcomes(executions.stop_all("asked to")) == [Outcome.STOPPED]
    assert executions.abort_all("the clock went back") == []


def test_an_arm_that_is_heard_late_is_not_taken_to_have_stopped(executions):
    assert executions.update(view(None), STAMP) == []
    assert executions.update(view(NO_PLAN), STAMP + 1) == []
    assert executions.update(view(STAMP), CHANGE) == []
    assert outcomes(executions.update(view(NO_PLAN, END), FINISH)) == [Outcome.REACHED]
