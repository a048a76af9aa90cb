from collections.abc import Callable

import numpy as np
import pytest

from mhsb_control.reference import PREVIEW_POINT, ReferencePreview
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, standstill

START = np.array([0.3, -1.4, -1.5])
GOAL = np.array([0.6, -1.1, -1.2])
MS = SECOND_NS // 1000
POINTS = 2 * PREVIEW_POINT + 1


@pytest.fixture
def plan(motion: Callable[..., tuple[Trajectory, ModeSchedule]]) -> tuple[Trajectory, ModeSchedule]:
    return motion(MotionState.at_rest(START), GOAL, stamp_ns=7 * SECOND_NS)


def test_it_is_the_trajectory_within_rounding(
    plan: tuple[Trajectory, ModeSchedule],
) -> None:
    trajectory, schedule = plan
    values = np.zeros((POINTS, 3, 3))
    reference = ReferencePreview(values, preview=0.1)
    reference.follow(trajectory, schedule, planned=True)
    for time in range(trajectory.stamp_ns - 10 * MS, trajectory.end_ns + 200 * MS, 7 * MS + 123):
        reference.update(time)
        for row in range(POINTS):
            expected = trajectory.sample(time + row * SECOND_NS // 20)
            np.testing.assert_allclose(values[row, 0], expected.position, atol=1e-12)
            np.testing.assert_allclose(values[row, 1], expected.velocity, atol=1e-10)
            np.testing.assert_allclose(values[row, 2], expected.acceleration, atol=1e-8)
        np.testing.assert_array_equal(reference.modes, schedule.modes_at(time))
        np.testing.assert_array_equal(
            reference.modes_ahead, schedule.modes_at(time + SECOND_NS // 10)
        )


def test_states_at_command_times_are_those_of_the_trajectory(
    plan: tuple[Trajectory, ModeSchedule],
) -> None:
    trajectory, schedule = plan
    states, times = np.zeros((2, 3, 3)), np.array([0.0, 0.023])
    reference = ReferencePreview(np.zeros((POINTS, 3, 3)), 0.1, states, times)
    reference.follow(trajectory, schedule, planned=True)
    for time in range(trajectory.stamp_ns - 10 * MS, trajectory.end_ns + 20 * MS, 7 * MS + 123):
        reference.update(time)
        for state, ahead in zip(states, times, strict=True):
            expected = trajectory.sample(time + round(ahead * SECOND_NS))
            np.testing.assert_allclose(state[0], expected.position, atol=1e-12)
            np.testing.assert_allclose(state[1], expected.velocity, atol=1e-10)
            np.testing.assert_allclose(state[2], expected.acceleration, atol=1e-8)


def test_it_says_when_the_modes_change(plan: tuple[Trajectory, ModeSchedule]) -> None:
    trajectory, _ = plan
    schedule = ModeSchedule(
        trajectory.stamp_ns, np.array([0, SECOND_NS]), np.array([[0, 0, 0], [1, 0, 0]])
    )
    reference = ReferencePreview(np.zeros((POINTS, 3, 3)), preview=0.0)
    reference.follow(trajectory, schedule, planned=True)
    assert reference.update(trajectory.stamp_ns)
    assert not reference.update(trajectory.stamp_ns + SECOND_NS - 1)
    assert reference.update(trajectory.stamp_ns + SECOND_NS)
    assert not reference.update(trajectory.stamp_ns + SECOND_NS + 1)


def test_a_plan_is_executed_until_its_end(plan: tuple[Trajectory, ModeSchedule]) -> None:
    trajectory, schedule = plan
    reference = ReferencePreview(np.zeros((POINTS, 3, 3)), preview=0.1)
    reference.follow(standstill(START, 0), schedule, planned=False)
    assert not reference.executes_plan(5)
    reference.follow(trajectory, schedule, planned=True)
    assert reference.executes_plan(trajectory.end_ns)
    assert not reference.executes_plan(trajectory.end_ns + 1)
    reference.follow(trajectory, schedule, planned=False)
    assert not reference.executes_plan(trajectory.stamp_ns + 1)
