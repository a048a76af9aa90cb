import mujoco
import numpy as np
import pytest

from mhsb_control.natural_frequency import (
    compute_joint_frequencies,
    compute_oil_stiffness,
    find_joint_frequency_ranges,
)
from mhsb_model.machine import Machine
from mhsb_sim.mechanics.mujoco_model import build_model

POSTURE = np.array([0.3, -1.0, -0.8])


def test_the_stiffness_is_that_of_two_columns_of_oil(machine: Machine) -> None:
    m, oil = machine.arrays, machine.config.circuit
    found = compute_oil_stiffness(machine, machine.arrays.joint_max)
    ends = [machine.cylinder_lengths(q) for q in (m.joint_min, m.joint_max)]
    stroke = np.abs(ends[1] - ends[0])
    extended = ends[1] > ends[0]
    cap = oil.chamber_dead_volume + np.where(extended, m.cap_area * stroke, 0.0)
    rod = oil.chamber_dead_volume + np.where(extended, 0.0, m.rod_area * stroke)
    expected = oil.bulk_modulus * (m.cap_area**2 / cap + m.rod_area**2 / rod)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_frequencies_are_those_of_mujocos_arm_with_a_spring_in_one_joint(machine: Machine) -> None:
    model = build_model(machine)
    data = mujoco.MjData(model)
    data.qpos[:] = POSTURE
    mujoco.mj_forward(model, data)
    stiffness = machine.moment_arms(POSTURE) ** 2 * compute_oil_stiffness(machine, POSTURE)
    found = compute_joint_frequencies(machine, POSTURE)
    for j in range(machine.joint_count):
        turned, moment = np.eye(machine.joint_count)[j], np.zeros(machine.joint_count)
        mujoco.mj_mulM(model, data, moment, turned)
        assert found[j] == pytest.approx(np.sqrt(stiffness[j] / moment[j]), rel=1e-9)


def test_joints_swing_slower_under_a_heavier_payload_inner_ones_slowest(machine: Machine) -> None:
    light, heavy = (
        find_joint_frequency_ranges(machine.changed(payload=kg))[0] for kg in (0.0, 13.0)
    )
    assert np.all(heavy < light)
    assert np.all(np.diff(heavy) > 0.0)
    assert heavy[0] > 1.0


def test_hardly_any_posture_has_a_frequency_outside_the_range(machine: Machine) -> None:
    limits = machine.arrays.joint_min, machine.arrays.joint_max
    postures = np.random.default_rng(5).uniform(*limits, (100, machine.joint_count))
    found = np.array([compute_joint_frequencies(machine, q) for q in postures])
    lowest, highest = find_joint_frequency_ranges(machine)
    assert np.all(found >= 0.95 * lowest)
    assert np.mean(found > 1.05 * highest) < 0.05
