"""The curves that stay close to the discrete path."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from mhsb_planner.motion.s3_piecewise import smoothed_path, stepped_path


def lengths(machine, q):
    return np.array([machine.cylinder_lengths(row) for row in q])


def piston_speeds(machine, q, qd):
    return np.array([machine.moment_arms(row) for row in q]) * qd


def test_the_smoothed_path_is_the_b_spline_of_its_control_points(machine, walk):
    path = walk(np.random.default_rng(0), 6)
    curve = smoothed_path(machine, path, 0.8, 1.0)
    knots = curve.knots * np.arange(-3, len(curve.control) + 1)
    spline = BSpline(knots, curve.control, 3)
    t = np.linspace(0, curve.breaks[-1], 200)
    q, qd, qdd = curve.sample(t)
    assert lengths(machine, q) == pytest.approx(spline(t), abs=1e-12)
    assert piston_speeds(machine, q, qd) == pytest.approx(spline(t, 1), abs=1e-10)
    before, after = curve.sample(t[1:-1] - 1e-5)[1], curve.sample(t[1:-1] + 1e-5)[1]
    assert qdd[1:-1] == pytest.approx((after - before) / 2e-5, abs=1e-3)


@settings(max_examples=15)
@given(st.integers(0, 2**32), st.sampled_from([0.8, 0.4, 0.2]))
def test_smoothing_keeps_joint_limits_speeds_and_flow_of_the_discrete_path(
    machine, walk, seed, window
):
    path = walk(np.random.default_rng(seed), 8)
    curve = smoothed_path(machine, path, window, 1.0)
    t = np.linspace(0, curve.breaks[-1], 2000)
    q, qd, _ = curve.sample(t)
    assert np.all(q >= path.posture.min(axis=0) - 1e-12)
    assert np.all(q <= path.posture.max(axis=0) + 1e-12)
    discrete = np.diff(lengths(machine, path.posture), axis=0) / path.duration[:, None]
    speed = piston_speeds(machine, q, qd)
    assert np.abs(speed).max() <= np.abs(discrete).max() + 1e-12

    def flow(v):
        inlet = np.where(v > 0, machine.arrays.cap_area, machine.arrays.rod_area)
        return (inlet * np.abs(v)).sum(axis=1).max()

    assert flow(speed) <= flow(discrete) + 1e-15


def test_the_smoothed_path_starts_and_ends_at_rest_in_the_end_postures(machine, walk):
    path = walk(np.random.default_rng(2), 7)
    curve = smoothed_path(machine, path, 0.4, 1.0)
    q, qd, qdd = curve.sample(curve.breaks[[0, -1]])
    assert q == pytest.approx(path.posture[[0, -1]], abs=1e-12)
    assert qd == pytest.approx(np.zeros((2, 3)), abs=1e-10)
    assert qdd == pytest.approx(np.zeros((2, 3)), abs=1e-8)


def test_a_shorter_window_comes_closer_to_the_nodes(machine, walk):
    path = walk(np.random.default_rng(4), 10)
    worst = []
    for window in (0.8, 0.2, 0.05):
        curve = smoothed_path(machine, path, window, 1.0)
        worst.append(np.abs(curve.sample(curve.node_time)[0] - path.posture).max())
    assert worst[0] > worst[1] > worst[2]
    assert worst[2] < 0.02


def test_the_stepped_path_rests_at_every_node_and_is_straight_between_them(walk):
    path = walk(np.random.default_rng(6), 5)
    curve = stepped_path(path, 1.0)
    q, qd, qdd = curve.sample(curve.node_time)
    assert q == pytest.approx(path.posture, abs=1e-12)
    assert qd == pytest.approx(np.zeros_like(q), abs=1e-12)
    assert qdd == pytest.approx(np.zeros_like(q), abs=1e-9)
    middle = curve.sample(0.5 * (curve.node_time[:-1] + curve.node_time[1:]))[0]
    assert middle == pytest.approx(0.5 * (path.posture[:-1] + path.posture[1:]), abs=1e-12)


def test_the_stepped_path_takes_so_long_that_no_joint_exceeds_the_steps_mean_speed(walk):
    path = walk(np.random.default_rng(7), 5)
    curve = stepped_path(path, 1.0)
    speed = np.abs(curve.sample(np.linspace(0, curve.breaks[-1], 4000))[1]).max(axis=0)
    mean = np.abs(np.diff(path.posture, axis=0) / path.duration[:, None]).max(axis=0)
    assert np.all(speed <= mean * (1 + 1e-9))
