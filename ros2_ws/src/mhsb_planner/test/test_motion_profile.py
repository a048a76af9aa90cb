"""Piston speeds, forces and tip positions along a motion."""

import numpy as np
import pytest

from mhsb_planner.motion_profile import motion_profile


def test_a_profile_agrees_with_the_machine_row_by_row(machine):
    random = np.random.default_rng(0)
    limits = machine.arrays
    q = random.uniform(limits.joint_min, limits.joint_max, (50, 3))
    qd = random.normal(size=(50, 3))
    profile = motion_profile(machine, q, qd)
    for k in range(50):
        assert profile.speed[k] == pytest.approx(machine.moment_arms(q[k]) * qd[k], rel=1e-12)
        assert profile.force[k] == pytest.approx(machine.piston_forces(q[k]), rel=1e-12)
        assert profile.tip[k] == pytest.approx(machine.tip_position(q[k]), abs=1e-12)
    assert profile[20:].speed == pytest.approx(profile.speed[20:], abs=0)
