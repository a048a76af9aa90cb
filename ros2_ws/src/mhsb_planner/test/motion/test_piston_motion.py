"""Joint motions of piston motions, against roots found by bisection and against differences."""

import numpy as np
import pytest
from scipy.optimize import brentq

from mhsb_model.linkages.linkage import cylinder_lengths
from mhsb_planner.motion.piston_motion import convert_to_joints

BETWEEN = 1e-3  # s


def pistons(machine, time):
    """Cylinders that swing within their strokes: slowly, fast, and with a rest."""
    m = machine.arrays
    ends = np.sort(cylinder_lengths(m.linkage, np.array([m.joint_min, m.joint_max])), axis=0)
    middle, swing = ends.mean(axis=0), 0.48 * np.diff(ends, axis=0)[0]
    phase = np.array([0.3, 2.0, 0.0]) * np.maximum(time - 0.2, 0.0)[:, None]
    rate = np.array([0.3, 2.0, 0.0]) * (time > 0.2)[:, None]
    return (
        middle + swing * np.sin(phase),
        swing * np.cos(phase) * rate,
        -swing * np.sin(phase) * rate**2,
    )


def angle_of(machine, j, length):
    """The joint angle of a cylinder length, by bisection."""
    m = machine.arrays

    def miss(angle):
        return cylinder_lengths(m.linkage, np.full((1, 3), angle))[0, j] - length

    return brentq(miss, m.joint_min[j], m.joint_max[j], xtol=1e-14)


@pytest.mark.parametrize("spacing", [1e-3, 0.02, 0.7])
def test_angles_are_those_of_the_lengths_however_far_instants_are_apart(machine, spacing):
    time = np.arange(0.0, 8.0, spacing)
    motion = pistons(machine, time)
    q, _, _ = convert_to_joints(machine.arrays, *motion, 0.5 * machine.arrays.joint_max)
    for k in range(0, len(time), max(1, len(time) // 40)):
        expected = [angle_of(machine, j, motion[0][k, j]) for j in range(3)]
        assert q[k] == pytest.approx(expected, abs=1e-11)


def test_speeds_and_accelerations_are_those_of_the_angles(machine):
    time = np.arange(0.3, 5.0, BETWEEN)
    start = 0.5 * (machine.arrays.joint_min + machine.arrays.joint_max)
    q, qd, qdd = convert_to_joints(machine.arrays, *pistons(machine, time), start)
    assert qd[1:-1] == pytest.approx((q[2:] - q[:-2]) / (2 * BETWEEN), abs=1e-4)
    assert qdd[1:-1] == pytest.approx((qd[2:] - qd[:-2]) / (2 * BETWEEN), abs=1e-3)


def test_beyond_a_joint_limit_a_linkage_goes_on_as_straight_as_it_is_there(machine):
    m = machine.arrays
    edge = cylinder_lengths(m.linkage, m.joint_max[None])[0]
    arm = machine.moment_arms(m.joint_max)
    way = np.linspace(-0.05, 0.05, 30)[:, None]
    length = edge + way * arm
    still = np.zeros_like(length)
    q, _, _ = convert_to_joints(m, length, still, still, m.joint_max)
    beyond = way[:, 0] > 0.0
    assert q[beyond] == pytest.approx((m.joint_max + way)[beyond], abs=1e-9)
    assert np.all(q[~beyond] < m.joint_max)
