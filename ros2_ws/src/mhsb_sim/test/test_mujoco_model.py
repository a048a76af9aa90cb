import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.machine import Machine, load_machine
from mhsb_model.types import FloatArray
from mhsb_sim.mujoco_model import build_model, set_payload

MACHINE = load_machine()
MODEL = build_model(MACHINE)
postures = st.tuples(
    *(
        st.floats(lower, upper)
        for lower, upper in zip(MACHINE.arrays.joint_min, MACHINE.arrays.joint_max, strict=True)
    )
).map(np.array)


def at_rest(model: mujoco.MjModel, q: FloatArray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    return data


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    """Column by column, as the torque of a unit acceleration: the same in all MuJoCo versions."""
    columns = np.zeros((model.nv, model.nv))
    for j in range(model.nv):
        mujoco.mj_mulM(model, data, columns[j], np.eye(model.nv)[j])
    return columns.T


def moment_arms(model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    data.ctrl[:] = 1.0
    mujoco.mj_fwdActuation(model, data)
    return data.qfrc_actuator.copy()


@given(postures)
def test_mass_matrix_and_gravity_equal_the_analytic_ones(q: FloatArray) -> None:
    data = at_rest(MODEL, q)
    np.testing.assert_allclose(mass_matrix(MODEL, data), MACHINE.mass_matrix(q), atol=1e-9)
    np.testing.assert_allclose(data.qfrc_bias, MACHINE.gravity_torque(q), atol=1e-9)


@given(postures)
def test_cylinders_have_the_analytic_lengths_and_moment_arms(q: FloatArray) -> None:
    data = at_rest(MODEL, q)
    np.testing.assert_allclose(data.ten_length, MACHINE.cylinder_lengths(q), atol=1e-9)
    np.testing.assert_allclose(moment_arms(MODEL, data), MACHINE.moment_arms(q), atol=1e-9)


@given(postures)
def test_the_tip_is_where_kinematics_says_and_positive_angles_raise_it(q: FloatArray) -> None:
    data = at_rest(MODEL, q)
    x, y, z = data.site("tip").xpos
    np.testing.assert_allclose((x, z), MACHINE.tip_position(q), atol=1e-9)
    assert y == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("payload", [0.0, 3.0, 13.0])
def test_another_payload_takes_effect_at_run_time(payload: float) -> None:
    model = build_model(MACHINE)
    set_payload(model, payload)
    heavier = MACHINE.changed(payload=payload)
    q = np.array([0.4, -1.0, -0.7])
    data = at_rest(model, q)
    np.testing.assert_allclose(mass_matrix(model, data), heavier.mass_matrix(q), atol=1e-9)
    np.testing.assert_allclose(data.qfrc_bias, heavier.gravity_torque(q), atol=1e-9)


def test_a_cylinder_force_extends_its_cylinder(machine: Machine) -> None:
    model = build_model(machine)
    data = at_rest(model, np.array([0.4, -1.0, -0.7]))
    before = data.ten_length.copy()
    data.ctrl[:] = machine.piston_forces(data.qpos) + np.array([2e3, 0.0, 0.0])
    for _ in range(20):
        mujoco.mj_step(model, data)
    assert data.ten_length[0] > before[0] + 1e-4


def test_joint_limits_are_end_stops(machine: Machine) -> None:
    model = build_model(machine)
    upper = machine.arrays.joint_max
    data = at_rest(model, upper - 0.01)
    data.ctrl[:] = machine.piston_forces(data.qpos) + np.array([0.0, 0.0, 500.0])
    for _ in range(500):
        mujoco.mj_step(model, data)
    assert upper[2] - 0.02 < data.qpos[2] < upper[2] + 0.02


def test_a_bad_state_stays_visible_instead_of_being_reset(machine: Machine) -> None:
    model = build_model(machine)
    data = at_rest(model, np.array([0.4, -1.0, -0.7]))
    data.qvel[0] = np.nan
    mujoco.mj_step(model, data)
    assert not np.all(np.isfinite(data.qvel))
