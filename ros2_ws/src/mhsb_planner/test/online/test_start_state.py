"""Which command a new plan continues, case by case."""

import numpy as np
import pytest

from mhsb_model.command import Command
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory
from mhsb_planner.online.arm_state import ArmState, ReceivedState
from mhsb_planner.online.start_state import MovingError, NoStateError, find_start_command

NOW = 1000 * SECOND_NS
WALL = 50.0
REST = MotionState.at_rest(np.array([0.1, -0.5, -0.2]))
MOVING = MotionState(REST.position, np.array([0.0, 0.02, 0.0]), np.zeros(3))


def heard(state: MotionState, age: float = 0.0) -> ReceivedState:
    return ReceivedState(state, WALL - age)


def own_command(stamp: int = NOW - SECOND_NS) -> Command:
    rows = np.array([[0.1, -0.5, -0.2], [0.2, -0.4, -0.2]])
    trajectory = Trajectory(stamp, [0, 5 * SECOND_NS], rows, 0 * rows, 0 * rows)
    return Command(trajectory, ModeSchedule(stamp, [0], [[1, 0, 0]]))


def test_a_plan_in_force_is_continued():
    own = own_command()
    view = ArmState(3, reference=heard(MOVING), plan_in_force_ns=own.stamp_ns, own_command=own)
    assert find_start_command(view, WALL, NOW) is own


def test_a_plan_not_in_force_is_not_continued_but_the_reference_is():
    view = ArmState(3, reference=heard(REST), plan_in_force_ns=0, own_command=own_command())
    begun = find_start_command(view, WALL, NOW)
    assert begun.trajectory.position[0] == pytest.approx(REST.position, abs=0)
    assert begun.trajectory.duration_ns == 0


def test_the_modes_in_force_are_those_that_the_arm_reports():
    view = ArmState(3, reference=heard(REST), modes=np.array([2, 0, 1], dtype=np.uint8))
    assert find_start_command(view, WALL, NOW).schedule.modes[0].tolist() == [2, 0, 1]


def test_a_reference_moved_by_somebody_else_is_refused_with_its_speed():
    view = ArmState(3, reference=heard(MOVING), plan_in_force_ns=7)
    with pytest.raises(MovingError, match=r"did not give, at 0\.02 rad/s"):
        find_start_command(view, WALL, NOW)


def test_without_reference_and_hand_over_the_own_plan_is_continued():
    own = own_command()
    view = ArmState(3, measured=heard(REST), own_command=own)
    assert find_start_command(view, WALL, NOW) is own


def test_measured_joints_at_rest_are_enough_for_a_first_plan():
    slow = MotionState(REST.position, np.array([0.0, 0.005, 0.0]), np.zeros(3))
    begun = find_start_command(ArmState(3, measured=heard(slow)), WALL, NOW)
    assert begun.trajectory.position[0] == pytest.approx(REST.position)
    assert not begun.trajectory.velocity.any()


def test_measured_joints_in_motion_are_not():
    with pytest.raises(MovingError, match=r"needs less than 0\.01 rad/s"):
        find_start_command(ArmState(3, measured=heard(MOVING)), WALL, NOW)


def test_a_stale_state_is_no_state():
    view = ArmState(3, reference=heard(REST, 1.0), measured=heard(REST, 1.0))
    assert view.get_fresh_state(WALL) is None
    with pytest.raises(NoStateError, match=r"in the last 0\.5 s"):
        find_start_command(view, WALL, NOW)


@pytest.mark.parametrize("reported", [True, False])
def test_the_own_plan_of_an_arm_that_is_silent_is_not_continued(reported):
    own = own_command()
    stamp = own.stamp_ns if reported else None
    for age, found in ((1.9, True), (2.1, False)):
        view = ArmState(3, measured=heard(MOVING, age), plan_in_force_ns=stamp, own_command=own)
        if found:
            assert find_start_command(view, WALL, NOW) is own
        else:
            with pytest.raises(NoStateError, match="start the arm"):
                find_start_command(view, WALL, NOW)


def test_forgetting_leaves_nothing_behind():
    view = ArmState(3, reference=heard(REST), plan_in_force_ns=0, own_command=own_command())
    view.forget()
    with pytest.raises(NoStateError):
        find_start_command(view, WALL, NOW)
