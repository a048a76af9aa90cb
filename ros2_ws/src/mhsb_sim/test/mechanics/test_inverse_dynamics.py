import mujoco
import numpy as np
import pytest

from mhsb_model.machine import Machine
from mhsb_sim.mechanics.inverse_dynamics import (
    SCRATCH_WIDTH,
    gravity_torques,
    inverse_dynamics,
    link_records,
)
from mhsb_sim.mechanics.mujoco_model import build_model


@pytest.mark.parametrize("seed", range(10))
def test_torques_equal_those_of_mujoco(machine: Machine, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = rng.uniform(machine.arrays.joint_min, machine.arrays.joint_max)
    qd, qdd = rng.normal(size=3), rng.normal(size=3)
    model = build_model(machine)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
    mujoco.mj_inverse(model, data)
    torque = np.empty(3)
    scratch = np.empty((3, SCRATCH_WIDTH))
    inverse_dynamics(link_records(machine), machine.config.gravity, q, qd, qdd, scratch, torque)
    np.testing.assert_allclose(torque, data.qfrc_inverse, rtol=1e-9, atol=1e-9)


def test_at_rest_they_are_the_gravity_torques(machine: Machine) -> None:
    q = np.array([0.5, -1.1, -0.4])
    zero, torque = np.zeros(3), np.empty(3)
    scratch = np.empty((3, SCRATCH_WIDTH))
    inverse_dynamics(link_records(machine), machine.config.gravity, q, zero, zero, scratch, torque)
    np.testing.assert_allclose(torque, machine.gravity_torque(q), rtol=1e-12)


def test_gravitys_part_of_a_motion_is_what_holds_its_posture(machine: Machine) -> None:
    q, links = np.array([0.5, -1.1, -0.4]), link_records(machine)
    scratch, torque = np.empty((3, SCRATCH_WIDTH)), np.empty(3)
    moving = np.array([1.0, -2.0, 3.0])
    inverse_dynamics(links, machine.config.gravity, q, moving, moving, scratch, torque)
    gravity_torques(links, machine.config.gravity, scratch, torque)
    np.testing.assert_allclose(torque, machine.gravity_torque(q), rtol=1e-12)
