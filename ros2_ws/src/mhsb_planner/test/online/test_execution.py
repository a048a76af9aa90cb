"""An accepted goal ends once its plan is in force, and in the right way."""

from dataclasses import replace

import numpy as np
import pytest

from mhsb_model.circuit.dead_time import compute_dead_time, compute_settling_time
from mhsb_model.command import Command
from mhsb_model.goal import Goal
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory
from mhsb_model.verdict import Outcome, Verdict
from mhsb_planner.online.arm_state import NO_PLAN, ArmState, ReceivedState
from mhsb_planner.online.execution import STAY_TIME_NS, Execution
from mhsb_planner.online.pending_goal import PendingGoal
from mhsb_planner.online.replanning import Replan
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
    replan = Replan(command, command, plan=None, change_ns=0)
    settings = Settings(machine, PlanOptions(planner="table"))
    goal = Goal(1, x, z)

    def judge(view, now_ns, is_last=False, **changes):
        made_with = replace(settings, **changes)
        execution = Execution(PendingGoal(goal, 0.0, 0.0, 0.0), replan, goal, made_with)
        executions.setdefault(made_with.reached_tolerance, execution)
        same = executions[made_with.reached_tolerance]
        return same.judge(made_with.machine, view, now_ns, is_last=is_last)

    executions = {}
    return judge


def view(in_force: int | None, posture=START, fault="") -> ArmState:
    state = ReceivedState(MotionState.at_rest(posture), 0.0)
    return ArmState(3, reference=state, measured=state, plan_in_force_ns=in_force, fault=fault)


def test_it_goes_on_while_its_plan_is_in_force(ending):
    assert ending(view(STAMP), HALFWAY) is None


def test_the_end_is_counted_after_the_dead_time(ending, machine):
    blind = {"imperfections.sensors.pressure": "none", "imperfections.computing_delay": 0.3}
    slow = machine.with_values(blind)
    late_ns, settled_ns = (
        round(compute(slow) * SECOND_NS) for compute in (compute_dead_time, compute_settling_time)
    )
    assert settled_ns > late_ns + SECOND_NS
    for since_ns, place, outcome in (
        (late_ns - 1, END, None),
        (late_ns, END, None),
        (3 * late_ns + STAY_TIME_NS - 1, END, None),
        (3 * late_ns + STAY_TIME_NS, END, Outcome.REACHED),
        (settled_ns - 1, START, None),
        (settled_ns, START, Outcome.ABORTED),
    ):
        result = ending(view(NO_PLAN, place), FINISH + since_ns, machine=slow)
        assert (result and result.outcome) == outcome


def test_a_plan_that_ends_at_the_goal_is_reached_and_the_distance_told(ending):
    assert ending(view(NO_PLAN, END), FINISH) is None
    assert ending(view(NO_PLAN, END), FINISH + STAY_TIME_NS) == (
        Outcome.REACHED,
        "the tip is 0.00 mm from the goal",
        None,
    )


def test_the_largest_distance_while_the_tip_stays_is_told(ending, machine):
    beside = END + [0.001, 0, 0]
    away = np.hypot(*(machine.tip_position(beside) - machine.tip_position(END)))
    assert ending(view(STAMP, END), FINISH) is None
    assert ending(view(STAMP, beside), FINISH + STAY_TIME_NS // 2) is None
    result = ending(view(STAMP, END), FINISH + STAY_TIME_NS)
    assert result.outcome is Outcome.REACHED
    assert result.sentence == f"the tip is {1e3 * away:.2f} mm from the goal"


def test_a_tip_that_swings_through_the_goal_and_rests_elsewhere_has_not_reached_it(ending):
    aside = END + [0.06, 0.0, 0.0]
    for at, place in enumerate((aside, END, aside, END, aside)):
        assert ending(view(STAMP, place), FINISH + at * STAY_TIME_NS) is None
    assert ending(view(STAMP, aside), FINISH + SECOND_NS).outcome is Outcome.ABORTED


def test_a_tip_that_comes_late_and_stays_has_reached_the_goal(ending):
    for at in range(4):
        assert ending(view(STAMP, START), FINISH + at * STAY_TIME_NS) is None
    assert ending(view(STAMP, END), FINISH + 4 * STAY_TIME_NS) is None
    assert ending(view(STAMP, END), FINISH + 5 * STAY_TIME_NS).outcome is Outcome.REACHED


def test_a_stop_judges_by_the_distances_so_far(ending):
    assert ending(view(STAMP, END), FINISH) is None
    judged = ending(view(STAMP, END), FINISH + 1, is_last=True)
    assert judged.outcome is Outcome.REACHED
    judged = ending(view(STAMP, START), FINISH + 2, is_last=True)
    assert judged.outcome is Outcome.ABORTED


def test_an_arm_that_ends_elsewhere_is_given_a_second_and_then_aborted(ending):
    assert ending(view(STAMP), FINISH + SECOND_NS // 2) is None
    assert ending(view(STAMP), FINISH + SECOND_NS).outcome is Outcome.ABORTED


def test_how_near_the_tip_must_come_is_a_setting_and_judged_within_a_second(ending, machine):
    beside = END + [0.02, 0.0, 0.0]
    away = np.hypot(*(machine.tip_position(beside) - machine.tip_position(END)))
    for tolerance, outcome in ((1.01 * away, Outcome.REACHED), (0.99 * away, Outcome.ABORTED)):
        judged = ending(view(STAMP, beside), FINISH + SECOND_NS, reached_tolerance=tolerance)
        assert judged.outcome is outcome


@pytest.mark.parametrize(
    ("posture", "outcome"),
    [(START + 0.4 * (END - START), Outcome.STOPPED), (START - 0.5, Outcome.ABORTED)],
)
def test_an_arm_that_holds_early_is_judged_by_its_place_when_no_reason_came_for_a_second(
    ending, posture, outcome
):
    assert ending(view(NO_PLAN, posture), HALFWAY) is None
    assert ending(view(NO_PLAN, posture), HALFWAY + SECOND_NS - 1) is None
    assert ending(view(NO_PLAN, posture), HALFWAY + SECOND_NS).outcome is outcome


def test_a_fault_is_the_reason_whenever_it_is_heard_within_a_second(ending):
    assert ending(view(NO_PLAN, START), HALFWAY) is None
    assert ending(view(NO_PLAN, START, "a pump failed"), HALFWAY + 4 * SECOND_NS // 5) == (
        Outcome.ABORTED,
        "a pump failed",
        Verdict.FAULT,
    )


def test_another_planners_plan_replaces_ours(ending):
    assert ending(view(77), HALFWAY).outcome is Outcome.REPLACED


def test_an_arm_that_does_not_report_plans_is_taken_to_obey(ending):
    assert ending(view(None), HALFWAY) is None
    assert ending(view(None, END), FINISH) is None
    assert ending(view(None, END), FINISH + STAY_TIME_NS).outcome is Outcome.REACHED
