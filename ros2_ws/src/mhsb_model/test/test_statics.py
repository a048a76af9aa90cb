"""Gravity torques and mass matrix, against energies of point masses; with telescopes and slews."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.motions import inverse_dynamics

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray

shares = st.tuples(*[st.floats(0.0, 1.0)] * 4).map(np.array)
vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 4).map(np.array)


@pytest.fixture(scope="module", params=["machine", "telescope_machine", "slewing_machine"])
def arm(request) -> Machine:
    return request.getfixturevalue(request.param)


def posture(machine: Machine, share: FloatArray) -> FloatArray:
    lower, upper = machine.arrays.joint_min, machine.arrays.joint_max
    return lower + share[: len(lower)] * (upper - lower)


def mass_points(machine: Machine, q: FloatArray) -> list[tuple[float, FloatArray]]:
    """Each link as two half masses about its centre with the link's inertia, and the payload."""
    points, end, heading, slew = [], np.zeros(3), 0.0, 0.0
    for joint, at in zip(machine.config.joints, q, strict=True):
        out = at if joint.kind == "prismatic" else 0.0
        slew += at if joint.kind == "slew" else 0.0
        heading += at if joint.kind == "revolute" else 0.0
        ahead = np.array([np.cos(slew), np.sin(slew), 0.0])
        along = np.cos(heading) * ahead + [0.0, 0.0, np.sin(heading)]
        link = joint.link
        radius = np.sqrt(link.inertia / link.mass)
        center = end + (link.center_of_mass + out) * along
        points += [(link.mass / 2, center + side * radius * along) for side in (-1, 1)]
        end = end + (link.length + out) * along
    return [*points, (machine.config.payload.mass, end)]


def potential_energy(machine: Machine, q: FloatArray) -> float:
    return sum(m * machine.arrays.gravity * p[2] for m, p in mass_points(machine, q))


@given(shares)
def test_gravity_torque_is_the_derivative_of_the_potential_energy(arm, share):
    q = posture(arm, share)
    h = 1e-6
    for j, step in enumerate(h * np.eye(len(q))):
        rise = potential_energy(arm, q + step) - potential_energy(arm, q - step)
        assert arm.gravity_torque(q)[j] == pytest.approx(rise / (2 * h), abs=1e-6)


@given(shares, vectors)
def test_mass_matrix_gives_the_kinetic_energy(arm, share, qd):
    q = posture(arm, share)
    h, qd = 1e-6, qd[: len(q)]
    ahead, behind = mass_points(arm, q + h * qd), mass_points(arm, q - h * qd)
    energy = sum(
        0.5 * m * np.sum(((a - b) / (2 * h)) ** 2)
        for (m, a), (_, b) in zip(ahead, behind, strict=True)
    )
    assert 0.5 * qd @ arm.mass_matrix(q) @ qd == pytest.approx(energy, abs=1e-6)


def mass_matrix_slopes(machine: Machine, q: FloatArray, step: float = 1e-6) -> FloatArray:
    """∂M/∂q_k by central differences, float64[n, n, n] with k last."""
    ends = [(q + step * e, q - step * e) for e in np.eye(len(q))]
    slopes = [(machine.mass_matrix(a) - machine.mass_matrix(b)) / (2 * step) for a, b in ends]
    return np.stack(slopes, axis=-1)


@given(shares, vectors, vectors)
def test_a_motions_torques_are_what_gravity_the_mass_matrix_and_its_slopes_give(
    arm, share, qd, qdd
):
    q = posture(arm, share)
    qd, qdd = qd[: len(q)], qdd[: len(q)]
    slope = mass_matrix_slopes(arm, q)
    coriolis = np.einsum("ijk,j,k->i", slope, qd, qd)
    coriolis -= 0.5 * np.einsum("jki,j,k->i", slope, qd, qd)
    expected = arm.mass_matrix(q) @ qdd + coriolis + arm.gravity_torque(q)
    assert inverse_dynamics(arm, q, qd, qdd) == pytest.approx(expected, rel=1e-6, abs=1e-6)


@given(shares)
def test_at_rest_they_are_the_gravity_torques(arm, share):
    q = posture(arm, share)
    rest = np.zeros(len(q))
    assert inverse_dynamics(arm, q, rest, rest).tolist() == arm.gravity_torque(q).tolist()


@given(shares)
def test_piston_forces_do_the_work_of_the_torques(arm, share):
    q = posture(arm, share)
    force = arm.piston_forces(q)
    assert force * arm.moment_arms(q) == pytest.approx(arm.gravity_torque(q))


def test_gravity_asks_of_the_stretched_arm_what_a_hand_calculation_gives(machine):
    assert machine.gravity_torque(np.zeros(3)) == pytest.approx([157.3, 75.7, 19.8], abs=0.05)


def test_upright_the_telescope_carries_what_slides_and_the_payload(telescope_machine):
    upright = np.array([np.pi / 2 + 1.0, -1.0, 0.1])
    weight = 9.81 * (telescope_machine.config.joints[2].link.mass + 8.0)
    assert telescope_machine.piston_forces(upright)[2] == pytest.approx(weight)
    assert telescope_machine.piston_forces_in(upright[None])[0, 2] == pytest.approx(weight)
