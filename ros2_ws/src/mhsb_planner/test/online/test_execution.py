"""An accepted goal ends once its plan is in force, and in the right way."""

import numpy as np
import pytest

from mhsb_model.command import Command
from mhsb_model.goal import Goal
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory
from mhsb_model.verdict import Outcome, PlanSummary
from mhsb_planner.online.arm_view import NO_PLAN, ArmView, Heard
from mhsb_planner.online.execution import Execution
from mhsb_planner.online.goal_in_hand import GoalInHand
from mhsb_planner.online.settings import Settings
from mhsb_planner.planner import PlanOptions

START, END = np.array([0.2, -0.8, -0.3]), np.array([0.4, -0.6, -0.3])
STAMP = 100 * SECOND_NS
HALFWAY = STAMP + 2 * SECOND_NS
FINISH = STAMP + 5 * SECOND_NS


@pytest.fixture
def ending(machine):
    rows = np.array([START, END])
    trajectory = Trajectory(STAMP, [0, 5 * SECOND_NS], rows, 0 * rows, 0 * rows)
    command = Command(trajectory, ModeSchedule(STAMP, [0], [[0, 0, 0]]))
    x, z = machine.tip_position(END)
    plan = PlanSummary(STAMP, 100.0, 90.0, 5.0, 0, 20.0, 80.0)
    settings = Settings(machine, PlanOptions())
    goal = Goal(1, x, z)
    execution = Execution(GoalInHand(goal, 0.0, 0.0), command, goal, plan, settings, 0)
    return lambda view, now_ns: execution.ending(machine, view, now_ns)


def view(in_force: int | None, posture=START, fault="") -> ArmView:
    state = Heard(MotionState.at_rest(posture), STAMP, 0.0)
    return ArmView(3, reference=state, measured=state, in_force_ns=in_force, fault=fault)


def test_it_goes_on_while_its_plan_is_in_force(ending):
    assert ending(view(STAMP), HALFWAY) is None


def test_a_plan_that_ends_at_the_goal_is_reached_and_the_distance_told(ending):
    assert ending(view(NO_PLAN, END), FINISH).outcome is Outcome.REACHED
    beside = ending(view(STAMP, END + [0.001, 0, 0]), FINISH)
    assert beside.outcome is Outcome.REACHED
    assert "mm from the goal" in beside.sentence


def test_an_arm_that_ends_elsewhere_is_given_a_second_and_then_aborted(ending):
    assert ending(view(STAMP), FINISH + SECOND_NS // 2) is None
    assert ending(view(STAMP), FINISH + SECOND_NS).outcome is Outcome.ABORTED


def test_an_arm_stopped_on_its_way_is_stopped_and_one_that_is_elsewhere_is_aborted(ending):
    halfway = START + 0.4 * (END - START)
    assert ending(view(NO_PLAN, halfway), HALFWAY).outcome is Outcome.STOPPED
    assert ending(view(NO_PLAN, START - 0.5), HALFWAY).outcome is Outcome.ABORTED


def test_an_arm_at_a_fault_is_aborted_with_its_sentence(ending):
    assert ending(view(NO_PLAN, START, "a pump failed"), HALFWAY) == (
        Outcome.ABORTED,
        "a pump failed",
    )


def test_another_planners_plan_replaces_ours(ending):
    assert ending(view(77), HALFWAY).outcome is Outcome.REPLACED


def test_an_arm_that_does_not_report_plans_is_taken_to_obey(ending):
    assert ending(view(None), HALFWAY) is None
    assert ending(view(None, END), FINISH).outcome is Outcome.REACHED
