"""Limit of the joint positions, between the points and from a start beyond it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.motions import sample_intervals

from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.workspace import compute_joint_excess
from mhsb_planner.motion.limits import joint_range
from mhsb_planner.motion.limits.joint_range import JOINT_LIMIT
from mhsb_planner.motion.s3_limits import find_first_violation


def test_a_joint_limit_is_seen_between_the_points(machine):
    upper = machine.arrays.joint_max
    q = np.array([[0.3, -1.4, upper[2] - 1e-6]] * 2)
    qd = np.array([[0.0, 0.0, 0.01], [0.0, 0.0, -0.01]])
    motion = Trajectory(0, [0, 20_000_000], q, qd, np.zeros((2, 3)))
    violation = find_first_violation(machine, motion, ModeSchedule(0, [0], [(0, 0, 0)]))
    assert violation.limit == JOINT_LIMIT
    assert 0 < violation.time < 0.02
    assert "joint limit" in str(violation)


def test_a_joint_beyond_its_limits_may_come_back_but_go_no_farther(machine):
    m = machine.arrays
    inside = 0.5 * (m.joint_min + m.joint_max)

    def way_out(*beyond):  # of joint 2, past its lower limit
        position = np.array([[inside[0], m.joint_min[1] - each, inside[2]] for each in beyond])
        return joint_range.compute_outward_excess(m.joint_min, m.joint_max, position)

    assert way_out(0.03, 0.02, -0.1) == 0.0
    assert way_out(0.03, 0.01, 0.015) == pytest.approx(0.005)
    assert way_out(0.03, -0.1, 0.002) == pytest.approx(0.002)
    assert way_out(-0.1, -0.2) == pytest.approx(-0.1)


@given(st.integers(0, 2**32))
def test_no_quintic_leaves_the_bound_on_its_joints(machine, seed):
    random = np.random.default_rng(seed)
    m = machine.arrays
    q = random.uniform(m.joint_min, m.joint_max, (2, 3))
    motion = Trajectory(
        0, [0, 20_000_000], q, random.uniform(-9, 9, (2, 3)), random.uniform(-900, 900, (2, 3))
    )
    bound = joint_range.bound_joint_excess(
        m, motion.offset_ns / SECOND_NS, motion.position, motion.velocity, motion.acceleration
    )
    inside, _, _ = sample_intervals(motion, np.array([0]), np.linspace(0, 1, 200))
    assert compute_joint_excess(m, inside).max() <= bound[0] + 1e-12
