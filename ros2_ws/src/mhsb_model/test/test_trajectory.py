"""Trajectories, against SciPy's Hermite interpolation."""

import numpy as np
import pytest
from scipy.interpolate import BPoly
from tests.support.motions import sample_intervals

from mhsb_model.trajectory import (
    SECOND_NS,
    MotionState,
    Trajectory,
    sample_midpoint_states,
)

START = 1_700_000_000 * SECOND_NS


def example(points: int = 6, joints: int = 3) -> Trajectory:
    rng = np.random.default_rng(1)
    offset = np.concatenate([[0], np.cumsum(rng.integers(5_000_000, 30_000_000, points - 1))])
    q, qd, qdd = (rng.normal(size=(points, joints)) for _ in range(3))
    return Trajectory(START, offset, q, qd, qdd)


def test_samples_equal_scipys_quintic_through_the_same_points():
    trajectory = example()
    seconds = trajectory.offset_ns / SECOND_NS
    ends = np.stack([trajectory.position, trajectory.velocity, trajectory.acceleration], axis=1)
    oracle = BPoly.from_derivatives(seconds, ends)
    times = np.linspace(0, trajectory.duration_ns, 333).astype(np.int64)
    q, qd, qdd = trajectory.sample_many(START + times)
    assert q == pytest.approx(oracle(times / SECOND_NS), abs=1e-10)
    assert qd == pytest.approx(oracle.derivative()(times / SECOND_NS), abs=1e-8)
    assert qdd == pytest.approx(oracle.derivative(2)(times / SECOND_NS), abs=1e-5)


def test_states_inside_intervals_are_those_of_the_same_curve():
    trajectory = example()
    rows, shares = np.array([0, 3]), np.array([0.0, 0.25, 1.0])
    q, qd, _ = sample_intervals(trajectory, rows, shares)
    begin, end = trajectory.offset_ns[rows], trajectory.offset_ns[rows + 1]
    times = (begin[:, None] + shares * (end - begin)[:, None]).ravel()
    expected, expected_rate, _ = trajectory.sample_many(START + np.rint(times).astype(np.int64))
    assert q == pytest.approx(expected, abs=1e-7)  # times are rounded to nanoseconds
    assert qd == pytest.approx(expected_rate, abs=1e-5)


def test_states_half_way_between_points_are_those_of_the_same_curve():
    trajectory = example()
    intervals = np.arange(len(trajectory.offset_ns) - 1)
    expected = sample_intervals(trajectory, intervals, np.array([0.5]))
    found = sample_midpoint_states(trajectory.offset_ns / SECOND_NS, *trajectory.points)
    for one, other, digits in zip(found, expected, (1e-13, 1e-11, 1e-9), strict=True):
        assert one == pytest.approx(other, abs=digits)


def test_states_at_offsets_are_those_at_these_times():
    trajectory = example()
    points, end = trajectory.offset_ns, trajectory.duration_ns
    offsets = np.union1d(points, np.linspace(0, end, 333).astype(np.int64))
    found, expected = trajectory.sample_offsets(offsets), trajectory.sample_many(START + offsets)
    for one, other, digits in zip(found, expected, (1e-10, 1e-8, 1e-5), strict=True):
        assert one == pytest.approx(other, abs=digits)


def test_after_the_end_the_last_position_is_held_at_rest():
    trajectory = example()
    state = trajectory.sample(trajectory.end_ns + 1)
    assert state.position == pytest.approx(trajectory.position[-1])
    assert not state.velocity.any()
    assert not state.acceleration.any()
    assert trajectory.sample(trajectory.end_ns).velocity == pytest.approx(trajectory.velocity[-1])


def test_before_the_start_the_first_point_stands():
    trajectory = example()
    assert trajectory.sample(START - SECOND_NS).position == pytest.approx(trajectory.position[0])


def test_a_single_point_is_a_hold():
    hold = Trajectory(0, [0], [[1.0, 2.0]], [[0.0, 0.0]], [[0.0, 0.0]])
    assert hold.sample(123).position.tolist() == [1.0, 2.0]
    assert hold.duration_ns == 0


def test_shifting_moves_the_curve_in_time():
    trajectory = example()
    later = trajectory.shifted(777)
    assert later.sample(START + 1_000_777).position == pytest.approx(
        trajectory.sample(START + 1_000_000).position, abs=0
    )


def test_the_arrays_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        example().position[0, 0] = 1.0


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"offset_ns": []}, "at least one point"),
        ({"offset_ns": [1, 2]}, "start at 0"),
        ({"offset_ns": [0, 0]}, "increase strictly"),
        ({"position": [[0.0]]}, "one row of joints for each point"),
        ({"velocity": [[0.0, 0.0], [0.0, 0.0]]}, "as many joints as position"),
        ({"acceleration": [[0.0], [np.nan]]}, "finite"),
    ],
)
def test_a_malformed_trajectory_is_refused_with_a_sentence(change, sentence):
    good = {
        "stamp_ns": 0,
        "offset_ns": [0, 10],
        "position": [[0.0], [1.0]],
        "velocity": [[0.0], [0.0]],
        "acceleration": [[0.0], [0.0]],
    }
    Trajectory(**good)
    with pytest.raises(ValueError, match=sentence):
        Trajectory(**{**good, **change})


def test_a_state_at_rest_has_neither_velocity_nor_acceleration():
    state = MotionState.at_rest(np.array([1.0, 2.0]))
    assert not state.velocity.any()
    assert not state.acceleration.any()


def test_a_rest_follows_the_same_motion():
    trajectory = example()
    rested = trajectory.with_rest(310_000_000)
    assert rested.end_ns == trajectory.end_ns + 310_000_000
    assert np.max(np.diff(rested.offset_ns[len(trajectory.offset_ns) - 1 :])) <= 20_000_000
    moving, end = START + trajectory.duration_ns // 2, rested.sample(rested.end_ns)
    assert rested.sample(moving).velocity.tolist() == trajectory.sample(moving).velocity.tolist()
    assert end.position.tolist() == trajectory.position[-1].tolist()
    assert not end.velocity.any()
