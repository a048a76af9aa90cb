import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.motions import inverse_dynamics

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine, load_machine
from mhsb_model.types import FloatArray
from mhsb_sim.mechanics.mujoco_model import build_model, set_payload

MACHINE = load_machine()
MODEL = build_model(MACHINE)
shares = st.tuples(*MACHINE.joint_count * [st.floats(0.0, 1.0)]).map(np.array)


def posture(machine: Machine, share: FloatArray) -> FloatArray:
    lower, upper = machine.arrays.joint_min, machine.arrays.joint_max
    return lower + share * (upper - lower)


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


@given(shares)
def test_mass_matrix_and_gravity_equal_the_analytic_ones(
    four_bar_machine: Machine, share: FloatArray
) -> None:
    for machine, model in ((MACHINE, MODEL), (four_bar_machine, build_model(four_bar_machine))):
        q = posture(machine, share)
        data = at_rest(model, q)
        np.testing.assert_allclose(mass_matrix(model, data), machine.mass_matrix(q), atol=1e-9)
        np.testing.assert_allclose(data.qfrc_bias, machine.gravity_torque(q), atol=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_the_torques_of_a_motion_equal_those_of_mujoco(seed: int) -> None:
    random = np.random.default_rng(seed)
    q = random.uniform(MACHINE.arrays.joint_min, MACHINE.arrays.joint_max)
    qd, qdd = random.normal(size=3), random.normal(size=3)
    data = mujoco.MjData(MODEL)
    data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
    mujoco.mj_inverse(MODEL, data)
    torque = inverse_dynamics(MACHINE, q, qd, qdd)
    np.testing.assert_allclose(torque, data.qfrc_inverse, rtol=1e-9, atol=1e-9)


@given(shares)
def test_the_tip_is_where_kinematics_says_and_positive_angles_raise_it(share: FloatArray) -> None:
    q = posture(MACHINE, share)
    data = at_rest(MODEL, q)
    x, y, z = data.site("tip").xpos
    np.testing.assert_allclose((x, z), MACHINE.tip_position(q), atol=1e-9)
    assert y == pytest.approx(0.0, abs=1e-12)


def test_pins_are_where_the_machine_file_puts_them(four_bar_machine: Machine) -> None:
    q = posture(four_bar_machine, np.array([0.3, 0.5, 0.8]))
    data = at_rest(build_model(four_bar_machine), q)
    bars = four_bar_machine.config.joints[1].linkage
    elbow = 0.45 * np.array([np.cos(q[0]), np.sin(q[0])])
    for name, turned in (("rocker_pivot", q[0]), ("parent_pin", q[0]), ("child_pin", q[0] + q[1])):
        pin = getattr(bars, name)
        angle = pin.angle + turned
        expected = elbow + pin.radius * np.array([np.cos(angle), np.sin(angle)])
        np.testing.assert_allclose(data.site(f"actuator_2_{name}").xpos[[0, 2]], expected)


def test_controls_are_torques_on_the_joints(machine: Machine) -> None:
    data = at_rest(MODEL, posture(machine, np.full(3, 0.5)))
    data.ctrl[:] = 10.0, -20.0, 30.0
    mujoco.mj_fwdActuation(MODEL, data)
    np.testing.assert_allclose(data.qfrc_actuator, [10.0, -20.0, 30.0])


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
    before = machine.cylinder_lengths(data.qpos)
    pushed = machine.piston_forces(data.qpos) + np.array([2e3, 0.0, 0.0])
    data.ctrl[:] = machine.moment_arms(data.qpos) * pushed
    for _ in range(20):
        mujoco.mj_step(model, data)
    assert machine.cylinder_lengths(data.qpos)[0] > before[0] + 1e-4


def test_joint_limits_are_end_stops(machine: Machine) -> None:
    model = build_model(machine)
    upper = machine.arrays.joint_max
    data = at_rest(model, upper - 0.01)
    data.ctrl[:] = machine.gravity_torque(data.qpos) + np.array([0.0, 0.0, 10.0])
    for _ in range(500):
        mujoco.mj_step(model, data)
    assert upper[2] - 0.02 < data.qpos[2] < upper[2] + 0.02


def test_a_bad_state_stays_visible_instead_of_being_reset(machine: Machine) -> None:
    model = build_model(machine)
    data = at_rest(model, np.array([0.4, -1.0, -0.7]))
    data.qvel[0] = np.nan
    mujoco.mj_step(model, data)
    assert not np.all(np.isfinite(data.qvel))


@pytest.mark.parametrize("seed", range(10))
def test_a_telescope_moves_as_the_analytic_chain_does(seed: int) -> None:
    machine = load_machine(find_config_file("telescope_arm.yaml"))
    model, random = build_model(machine), np.random.default_rng(seed)
    q = random.uniform(machine.arrays.joint_min, machine.arrays.joint_max)
    qd, qdd = random.normal(size=3), random.normal(size=3)
    still = at_rest(model, q)
    np.testing.assert_allclose(still.site("tip").xpos[[0, 2]], machine.tip_position(q), atol=1e-12)
    np.testing.assert_allclose(mass_matrix(model, still), machine.mass_matrix(q), atol=1e-9)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
    mujoco.mj_inverse(model, data)
    torque = inverse_dynamics(machine, q, qd, qdd)
    np.testing.assert_allclose(torque, data.qfrc_inverse, rtol=1e-9, atol=1e-9)
