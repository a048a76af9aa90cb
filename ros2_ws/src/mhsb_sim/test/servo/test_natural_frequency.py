import mujoco
import numpy as np

from mhsb_model.machine import Machine
from mhsb_sim.mechanics.mujoco_model import build_model
from mhsb_sim.servo.natural_frequency import (
    joint_natural_frequencies,
    natural_frequencies,
    oil_stiffness,
)

POSTURE = np.array([0.3, -1.0, -0.8])


def test_the_stiffness_is_that_of_two_columns_of_oil(machine: Machine) -> None:
    m, oil = machine.arrays, machine.config.circuit
    found = oil_stiffness(machine, machine.arrays.joint_max)
    ends = [machine.cylinder_lengths(q) for q in (m.joint_min, m.joint_max)]
    stroke = np.abs(ends[1] - ends[0])
    extended = ends[1] > ends[0]
    cap = oil.chamber_dead_volume + np.where(extended, m.cap_area * stroke, 0.0)
    rod = oil.chamber_dead_volume + np.where(extended, 0.0, m.rod_area * stroke)
    expected = oil.bulk_modulus * (m.cap_area**2 / cap + m.rod_area**2 / rod)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_frequencies_are_those_of_mujoco_with_springs_in_the_joints(machine: Machine) -> None:
    model = build_model(machine)
    data = mujoco.MjData(model)
    data.qpos[:] = POSTURE
    mujoco.mj_forward(model, data)
    inverse = np.zeros((machine.joint_count, machine.joint_count))
    mujoco.mj_solveM(model, data, inverse, np.eye(machine.joint_count))
    stiffness = machine.moment_arms(POSTURE) ** 2 * oil_stiffness(machine, POSTURE)
    squares = np.linalg.eigvals(inverse * stiffness)
    np.testing.assert_allclose(
        natural_frequencies(machine, POSTURE), np.sqrt(np.sort(squares.real)), rtol=1e-6
    )


def test_joints_swing_slower_under_a_heavier_payload_inner_ones_slowest(machine: Machine) -> None:
    light, heavy = (joint_natural_frequencies(machine.changed(payload=kg)) for kg in (0.0, 13.0))
    assert np.all(heavy < light)
    assert np.all(np.diff(heavy) > 0.0)
    assert heavy[0] > 1.0


def test_a_joint_with_the_others_locked_is_never_slower_than_its_lowest(machine: Machine) -> None:
    lowest = joint_natural_frequencies(machine)
    mass = machine.mass_matrix(POSTURE)
    stiffness = machine.moment_arms(POSTURE) ** 2 * oil_stiffness(machine, POSTURE)
    for j in range(machine.joint_count):
        assert np.sqrt(stiffness[j] / mass[j, j]) >= 0.99 * lowest[j]
