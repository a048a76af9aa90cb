"""Gravity torques and mass matrix, against energies of point masses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model import kinematics
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray

postures = st.tuples(st.floats(-0.8, 1.5), st.floats(-2.0, 0.1), st.floats(-2.1, 0.1)).map(np.array)


def mass_points(machine: Machine, q: FloatArray) -> list[tuple[float, FloatArray]]:
    """Each link as two half masses about its centre with the link's inertia, and the payload."""
    arrays = machine.arrays
    joints = kinematics.joint_positions(arrays, q)
    points = []
    for i, angle in enumerate(np.cumsum(q)):
        along = np.array([np.cos(angle), np.sin(angle)])
        center = joints[i] + arrays.link_center[i] * along
        radius = np.sqrt(arrays.link_inertia[i] / arrays.link_mass[i])
        points += [(arrays.link_mass[i] / 2, center + s * radius * along) for s in (-1, 1)]
    return [*points, (arrays.payload, joints[-1])]


def potential_energy(machine: Machine, q: FloatArray) -> float:
    return sum(m * machine.arrays.gravity * p[1] for m, p in mass_points(machine, q))


@given(postures)
def test_gravity_torque_is_the_derivative_of_the_potential_energy(machine, q):
    h = 1e-6
    for j, step in enumerate(h * np.eye(3)):
        rise = potential_energy(machine, q + step) - potential_energy(machine, q - step)
        assert machine.gravity_torque(q)[j] == pytest.approx(rise / (2 * h), abs=1e-6)


@given(postures, st.tuples(*[st.floats(-1, 1)] * 3).map(np.array))
def test_mass_matrix_gives_the_kinetic_energy(machine, q, qd):
    h = 1e-6
    ahead, behind = mass_points(machine, q + h * qd), mass_points(machine, q - h * qd)
    energy = sum(
        0.5 * m * np.sum(((a - b) / (2 * h)) ** 2)
        for (m, a), (_, b) in zip(ahead, behind, strict=True)
    )
    assert 0.5 * qd @ machine.mass_matrix(q) @ qd == pytest.approx(energy, abs=1e-6)


def mass_matrix_slopes(machine: Machine, q: FloatArray, step: float = 1e-6) -> FloatArray:
    """∂M/∂q_k by central differences, float64[n, n, n] with k last."""
    ends = [(q + step * e, q - step * e) for e in np.eye(len(q))]
    slopes = [(machine.mass_matrix(a) - machine.mass_matrix(b)) / (2 * step) for a, b in ends]
    return np.stack(slopes, axis=-1)


@given(postures, *[st.tuples(*[st.floats(-1, 1)] * 3).map(np.array)] * 2)
def test_a_motions_torques_are_what_gravity_the_mass_matrix_and_its_slopes_give(
    machine, q, qd, qdd
):
    slope = mass_matrix_slopes(machine, q)
    coriolis = np.einsum("ijk,j,k->i", slope, qd, qd)
    coriolis -= 0.5 * np.einsum("jki,j,k->i", slope, qd, qd)
    expected = machine.mass_matrix(q) @ qdd + coriolis + machine.gravity_torque(q)
    assert machine.inverse_dynamics(q, qd, qdd) == pytest.approx(expected, rel=1e-6, abs=1e-6)


@given(postures)
def test_at_rest_they_are_the_gravity_torques(machine, q):
    rest = np.zeros(3)
    assert machine.inverse_dynamics(q, rest, rest).tolist() == machine.gravity_torque(q).tolist()


@given(postures)
def test_piston_forces_do_the_work_of_the_torques(machine, q):
    force = machine.piston_forces(q)
    assert force * machine.moment_arms(q) == pytest.approx(machine.gravity_torque(q))


def test_gravity_asks_of_the_stretched_arm_what_a_hand_calculation_gives(machine):
    assert machine.gravity_torque(np.zeros(3)) == pytest.approx([157.3, 75.7, 19.8], abs=0.05)
