"""Forces and torques of chains with telescopes, against energies of point masses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray

vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)
ranges = ((-1.6, 2.4), (-2.5, -0.2), (0.0, 0.25))
postures = st.tuples(*[st.floats(*each) for each in ranges]).map(np.array)


def mass_points(machine: Machine, q: FloatArray) -> list[tuple[float, FloatArray]]:
    """Each link as two half masses about its centre with the link's inertia, and the payload."""
    points, end, heading = [], np.zeros(2), 0.0
    for joint, at in zip(machine.config.joints, q, strict=True):
        out = at if joint.kind == "prismatic" else 0.0
        heading += at - out
        along = np.array([np.cos(heading), np.sin(heading)])
        link = joint.link
        radius = np.sqrt(link.inertia / link.mass)
        center = end + (link.center_of_mass + out) * along
        points += [(link.mass / 2, center + side * radius * along) for side in (-1, 1)]
        end = end + (link.length + out) * along
    return [*points, (machine.config.payload.mass, end)]


def potential_energy(machine: Machine, q: FloatArray) -> float:
    return sum(m * machine.config.gravity * p[1] for m, p in mass_points(machine, q))


@given(postures)
def test_what_gravity_asks_is_the_derivative_of_the_potential_energy(telescope_machine, q):
    h = 1e-6
    for j, step in enumerate(h * np.eye(3)):
        rise = potential_energy(telescope_machine, q + step)
        rise -= potential_energy(telescope_machine, q - step)
        assert telescope_machine.gravity_torque(q)[j] == pytest.approx(rise / (2 * h), abs=1e-6)


@given(postures, vectors)
def test_the_mass_matrix_gives_the_kinetic_energy(telescope_machine, q, qd):
    h = 1e-6
    ahead, behind = (mass_points(telescope_machine, q + s * h * qd) for s in (1, -1))
    energy = sum(
        0.5 * m * np.sum(((a - b) / (2 * h)) ** 2)
        for (m, a), (_, b) in zip(ahead, behind, strict=True)
    )
    assert 0.5 * qd @ telescope_machine.mass_matrix(q) @ qd == pytest.approx(energy, abs=1e-6)


@given(postures, vectors, vectors)
def test_a_motions_torques_are_what_gravity_the_mass_matrix_and_its_slopes_give(
    telescope_machine, q, qd, qdd
):
    h, mass = 1e-6, telescope_machine.mass_matrix
    slope = np.stack([(mass(q + s) - mass(q - s)) / (2 * h) for s in h * np.eye(3)], axis=-1)
    coriolis = np.einsum("ijk,j,k->i", slope, qd, qd)
    coriolis -= 0.5 * np.einsum("jki,j,k->i", slope, qd, qd)
    expected = mass(q) @ qdd + coriolis + telescope_machine.gravity_torque(q)
    torque = telescope_machine.inverse_dynamics(q, qd, qdd)
    assert torque == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_upright_the_telescope_carries_what_slides_and_the_payload(telescope_machine):
    upright = np.array([np.pi / 2 + 1.0, -1.0, 0.1])
    weight = 9.81 * (telescope_machine.config.joints[2].link.mass + 8.0)
    assert telescope_machine.piston_forces(upright)[2] == pytest.approx(weight)
    assert telescope_machine.piston_forces_in(upright[None])[0, 2] == pytest.approx(weight)
