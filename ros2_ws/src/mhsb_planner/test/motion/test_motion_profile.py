"""Piston speeds, forces and tip positions along a motion."""

import numpy as np
import pytest

from mhsb_model.trajectory import Trajectory
from mhsb_planner.motion.motion_profile import compute_middle_profile, compute_motion_profile


def test_a_profile_agrees_with_the_machine_row_by_row(machine):
    random = np.random.default_rng(0)
    limits = machine.arrays
    q = random.uniform(limits.joint_min, limits.joint_max, (50, 3))
    qd = random.normal(size=(50, 3))
    profile = compute_motion_profile(machine, q, qd)
    for k in range(50):
        assert profile.speed[k] == pytest.approx(machine.moment_arms(q[k]) * qd[k], rel=1e-12)
        assert profile.force[k] == pytest.approx(machine.piston_forces(q[k]), rel=1e-12)
        assert profile.tip[k] == pytest.approx(machine.tip_position(q[k]), abs=1e-12)
    assert profile[20:].speed == pytest.approx(profile.speed[20:], abs=0)


def mass_matrix_slopes(machine, q, step=1e-6):
    """∂M/∂q_k by central differences, float64[n, n, n] with k last."""
    return np.stack(
        [
            (machine.mass_matrix(q + step * e) - machine.mass_matrix(q - step * e)) / (2 * step)
            for e in np.eye(len(q))
        ],
        axis=-1,
    )


def test_inertia_is_what_the_mass_matrix_and_its_slopes_make_of_the_motion(machine):
    random = np.random.default_rng(1)
    limits = machine.arrays
    q = random.uniform(limits.joint_min, limits.joint_max, (20, 3))
    qd, qdd = random.normal(size=(2, 20, 3))
    profile = compute_motion_profile(machine, q, qd, qdd)
    for k in range(20):
        slope = mass_matrix_slopes(machine, q[k])
        coriolis = np.einsum("ijk,j,k->i", slope, qd[k], qd[k])
        coriolis -= 0.5 * np.einsum("jki,j,k->i", slope, qd[k], qd[k])
        torque = machine.mass_matrix(q[k]) @ qdd[k] + coriolis
        expected = torque / machine.moment_arms(q[k])
        assert profile.inertia[k] == pytest.approx(expected, rel=1e-6, abs=1e-3)
    assert not compute_motion_profile(machine, q, qd).inertia.any()


def test_the_profile_between_the_points_is_that_of_the_states_there(machine):
    random, limits = np.random.default_rng(2), machine.arrays
    q = np.sort(random.uniform(limits.joint_min, limits.joint_max, (9, 3)), axis=0)
    qd, qdd = random.normal(size=(2, 9, 3))
    offset_ns = np.concatenate([[0], np.cumsum(2 * random.integers(1_000_000, 10_000_000, 8))])
    trajectory = Trajectory(0, offset_ns, q, qd, qdd)
    middle_ns = (offset_ns[1:] + offset_ns[:-1]) // 2
    expected = compute_motion_profile(machine, *trajectory.sample_many(middle_ns))
    profile = compute_middle_profile(machine, trajectory)
    for name in ("speed", "force", "tip", "inertia", "position"):
        assert getattr(profile, name) == pytest.approx(getattr(expected, name), rel=1e-6), name
