"""Motions made of ramps, and paths followed by them, against numerical convolution."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mhsb_model.linkages.linkage import cylinder_length
from mhsb_planner.motion.s3_following import (
    PistonPath,
    compute_followed_path,
    find_highest_speed,
    smooth_path,
)
from mhsb_planner.motion.s3_ramps import Ramp

FINE = 1e-4  # s


def lengths(machine, q):
    rows = machine.arrays.linkage
    found = [[cylinder_length(row, each) for each in q[:, j]] for j, row in enumerate(rows)]
    return np.column_stack(found)


def convolved(machine, path, motion, ramp):
    """Lengths of the discrete path smoothed with box(T₁) * box(T₂), every FINE seconds."""
    due = motion.node_time - 0.5 * ramp.duration
    time = np.arange(-ramp.duration, motion.end + FINE, FINE)
    nodes = lengths(machine, path.posture)
    polygon = np.column_stack([np.interp(time, due, nodes[:, j]) for j in range(3)])
    boxes = [np.full(round(part / FINE), FINE / part) for part in (ramp.rise, ramp.blend)]
    kernel = np.convolve(*boxes)
    smooth = [np.convolve(polygon[:, j], kernel, "valid") for j in range(3)]
    return time[len(kernel) - 1 :] + FINE, np.column_stack(smooth)


def test_a_followed_path_is_the_discrete_path_smoothed_by_the_ramps(machine, walk):
    path, ramp = walk(np.random.default_rng(0), 6), Ramp(0.08, 0.038)
    motion = smooth_path(PistonPath.create(machine, path, 1.0), ramp)
    time, expected = convolved(machine, path, motion, ramp)
    assert np.abs(motion.sample_pistons(time)[0] - expected).max() <= 2e-7
    q, qd, qdd = motion.sample(time)
    assert np.abs(lengths(machine, q) - expected).max() <= 2e-7
    assert np.abs(np.diff(q, axis=0) / FINE - 0.5 * (qd[1:] + qd[:-1])).max() <= 1e-5
    assert np.abs(np.diff(qd, axis=0) / FINE - 0.5 * (qdd[1:] + qdd[:-1])).max() <= 1e-3


@settings(max_examples=15)
@given(st.integers(0, 2**32), st.sampled_from([1.0, 2.0, 4.0]))
def test_following_keeps_joint_limits_speeds_and_flow_of_the_discrete_path(
    machine, walk, seed, slower
):
    path = walk(np.random.default_rng(seed), 8)
    motion = compute_followed_path(machine, path, slower, None, 1.0)
    t = np.linspace(0, motion.end, 2000)
    q, qd, _ = motion.sample(t)
    assert np.all(q >= path.posture.min(axis=0) - 1e-12)
    assert np.all(q <= path.posture.max(axis=0) + 1e-12)
    discrete = np.diff(lengths(machine, path.posture), axis=0) / path.duration[:, None]
    speed = np.array([machine.moment_arms(row) for row in q]) * qd
    assert np.abs(speed).max() <= np.abs(discrete).max() + 1e-12

    def flow(v):
        inlet = np.where(v > 0, machine.arrays.cap_area, machine.arrays.rod_area)
        return (inlet * np.abs(v)).sum(axis=1).max()

    assert flow(speed) <= flow(discrete) + 1e-15


@settings(max_examples=15)
@given(st.integers(0, 2**32))
def test_acceleration_and_jerk_stay_within_their_limits(machine, walk, seed):
    path = walk(np.random.default_rng(seed), 8, leap=0.5)
    motion, m = compute_followed_path(machine, path, 1.0, None, 1.0), machine.arrays
    t = np.arange(0, motion.end, 1e-4)
    acceleration = motion.sample_pistons(t)[2]
    assert np.abs(acceleration).max() <= m.max_piston_acceleration * (1 + 1e-6)
    assert np.abs(np.diff(acceleration, axis=0)).max() <= m.max_piston_jerk * 1e-4 * (1 + 1e-6)


def test_the_peaks_of_a_motion_are_those_of_its_samples(machine, walk):
    path, m = walk(np.random.default_rng(6), 8, leap=0.5), machine.arrays
    motion = smooth_path(PistonPath.create(machine, path, 1.0), Ramp(0.02, 0.01))
    acceleration = motion.sample_pistons(np.arange(0.0, motion.end, 1e-5))[2]
    jerk = np.abs(np.diff(acceleration, axis=0)).max() / 1e-5
    expected = np.abs(acceleration).max() / m.max_piston_acceleration, jerk / m.max_piston_jerk
    assert motion.peaks == pytest.approx(expected, rel=1e-3)


def test_the_highest_speed_of_a_path_is_that_of_the_longest_stroke_in_its_time():
    random = np.random.default_rng(7)
    length, duration = random.uniform(0.2, 0.4, (9, 3)), random.uniform(0.1, 2.0, 8)
    expected = (np.abs(np.diff(length, axis=0)).max(axis=1) / duration).max()
    assert find_highest_speed(length, duration) == pytest.approx(expected)


def test_a_followed_path_lasts_one_ramp_longer_than_the_discrete_one(machine, walk):
    path, ramp = walk(np.random.default_rng(2), 7), Ramp(0.08, 0.038)
    motion = smooth_path(PistonPath.create(machine, path, 1.0), ramp)
    longer = motion.end - path.duration.sum()
    assert 0.118 - 1e-9 <= longer <= 0.118 + 1e-3 * path.steps


def test_a_followed_path_starts_and_ends_at_rest_in_the_end_postures(machine, walk):
    path = walk(np.random.default_rng(2), 7)
    motion = compute_followed_path(machine, path, 1.0, None, 1.0)
    q, qd, qdd = motion.sample(motion.breaks[[0, -1]])
    assert q == pytest.approx(path.posture[[0, -1]], abs=1e-12)
    assert qd == pytest.approx(np.zeros((2, 3)), abs=1e-10)
    assert qdd == pytest.approx(np.zeros((2, 3)), abs=1e-8)


def test_a_shorter_last_ramp_ends_sooner_in_the_same_posture_and_changes_nothing_before(
    machine, walk
):
    path = walk(np.random.default_rng(5), 3, leap=3.0)
    even, brisk = (
        compute_followed_path(machine, path, 1.0, None, 1.0, last) for last in (1.0, 0.72)
    )
    sooner = even.end - brisk.end
    ramp = even.rise[-1] + even.blend[-1]
    assert sooner == pytest.approx(0.5 * (1.0 - 0.72) * ramp, abs=2.5e-3)
    t = np.linspace(0.0, even.ramp_begin[-1], 300)
    assert brisk.sample_pistons(t)[0] == pytest.approx(even.sample_pistons(t)[0], abs=1e-12)
    q, qd, _ = brisk.sample(np.array([0.0, brisk.end]))
    assert q == pytest.approx(path.posture[[0, -1]], abs=1e-12)
    assert qd == pytest.approx(np.zeros((2, 3)), abs=1e-10)


def test_corners_lie_between_breaks_that_are_a_millisecond_apart(machine, walk):
    motion = compute_followed_path(machine, walk(np.random.default_rng(3), 9), 1.0, None, 1.0)
    assert np.diff(motion.breaks).min() > 0.999e-3
    assert motion.breaks[[0, -1]] == pytest.approx([0.0, motion.end])


def test_shorter_ramps_come_closer_to_the_nodes(machine, walk):
    path = walk(np.random.default_rng(4), 10)
    worst = []
    for slower in (8.0, 2.0, 1.0):
        motion = compute_followed_path(machine, path, slower, None, 1.0)
        worst.append(np.abs(motion.sample(motion.node_time)[0] - path.posture).max())
    assert worst[0] > worst[1] > worst[2]
    assert worst[2] < 0.02
