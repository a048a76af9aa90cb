"""The last resort: from node to node, at rest at each."""

import numpy as np
import pytest

from mhsb_planner.motion.s3_candidates import compute_stepped_path


def test_the_stepped_path_rests_at_every_node_and_is_straight_between_them(machine, walk):
    path = walk(np.random.default_rng(6), 5)
    curve = compute_stepped_path(machine, path, 1.0)
    q, qd, qdd = curve.sample(curve.node_time)
    assert q == pytest.approx(path.posture, abs=1e-12)
    assert qd == pytest.approx(np.zeros_like(q), abs=1e-12)
    assert qdd == pytest.approx(np.zeros_like(q), abs=1e-9)
    middle = curve.sample(0.5 * (curve.node_time[:-1] + curve.node_time[1:]))[0]
    assert middle == pytest.approx(0.5 * (path.posture[:-1] + path.posture[1:]), abs=1e-12)


def test_the_stepped_path_takes_so_long_that_no_joint_exceeds_the_steps_mean_speed(machine, walk):
    path = walk(np.random.default_rng(7), 5)
    curve = compute_stepped_path(machine, path, 1.0)
    speed = np.abs(curve.sample(np.linspace(0, curve.breaks[-1], 4000))[1]).max(axis=0)
    mean = np.abs(np.diff(path.posture, axis=0) / path.duration[:, None]).max(axis=0)
    assert np.all(speed <= mean * (1 + 1e-9))


def test_steps_of_a_short_time_are_no_jerkier_than_others(machine, walk):
    path = walk(np.random.default_rng(8), 5)
    curve = compute_stepped_path(machine, path, 0.1 * 1.0)
    slow = compute_stepped_path(machine, path, 1.0)
    assert curve.node_time == pytest.approx(0.1 * slow.node_time)
    q, qd, qdd = slow.sample(np.linspace(0, slow.breaks[-1], 9000))
    arms = np.array([machine.moment_arms(row) for row in q])
    bend = 1e-5 * qd
    slopes = np.array([machine.moment_arms(row) for row in q + bend]) - arms
    acceleration = arms * qdd + slopes / 1e-5 * qd
    assert np.abs(acceleration).max() <= 1.2 * machine.arrays.max_piston_acceleration
