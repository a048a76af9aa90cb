"""The URDF is the arm: MuJoCo reads it, and finds the machine's kinematics and masses."""

from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from mhsb_model.files.config_files import find_config_file
from mhsb_model.linkages.linkage import evaluate_linkage_at_angles
from mhsb_model.machine import Machine, load_machine
from mhsb_sim.mechanics.robot_description import build_robot_description


@pytest.fixture(scope="module")
def arm(machine):
    return read_by_mujoco(machine)


def read_by_mujoco(machine: Machine) -> mujoco.MjModel:
    """MuJoCo's arm, with bodies where the URDF has fixed joints."""
    text = build_robot_description(machine)
    keep = '<mujoco><compiler fusestatic="false" balanceinertia="true"/></mujoco></robot>'
    return mujoco.MjModel.from_xml_string(text.replace("</robot>", keep))


@pytest.mark.parametrize("file", ["mhsb_arm3.yaml", "telescope_arm.yaml"])
def test_tip_and_mass_matrix_are_the_machines(file):
    machine = load_machine(find_config_file(file))
    arm = read_by_mujoco(machine)
    rng, data = np.random.default_rng(0), mujoco.MjData(arm)
    limits = machine.arrays
    for q in rng.uniform(limits.joint_min, limits.joint_max, (50, 3)):
        data.qpos[:] = q
        mujoco.mj_forward(arm, data)
        x, y, z = data.body("tip").xpos
        np.testing.assert_allclose((x, z), machine.tip_position(q), atol=1e-7)
        assert abs(y) < 1e-9
        inertia = np.zeros((3, 3))
        mujoco.mj_fullM(arm, data, inertia)
        np.testing.assert_allclose(inertia, machine.mass_matrix(q), rtol=1e-6, atol=1e-7)


def test_in_the_work_plane_y_is_up_and_x_forward(arm):
    data = mujoco.MjData(arm)
    mujoco.mj_forward(arm, data)
    axes = data.body("work_plane").xmat.reshape(3, 3)
    np.testing.assert_allclose(axes[:, 0], [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(axes[:, 1], [0, 0, 1], atol=1e-9)


def test_limits_and_names_are_the_machines(machine):
    joints = ElementTree.fromstring(build_robot_description(machine)).findall(
        "joint[@type='revolute']"
    )
    assert [joint.get("name") for joint in joints] == list(machine.joint_names)
    for j, joint in enumerate(joints):
        limit = {key: float(value) for key, value in joint.find("limit").attrib.items()}
        assert limit["lower"] == pytest.approx(machine.arrays.joint_min[j])
        assert limit["upper"] == pytest.approx(machine.arrays.joint_max[j])
        assert limit["effort"] > 0.0


@pytest.mark.parametrize(
    "name", ["mhsb_arm3", "mhsb_arm4", "telescope_arm", "excavator", "forestry_crane"]
)
def test_at_the_velocity_limit_no_piston_is_faster_than_its_v_max_anywhere(name):
    """Piston speeds by differences of cylinder lengths, at 20,001 places of each joint's range."""
    machine = load_machine(find_config_file(f"{name}.yaml"))
    a = machine.arrays
    joints = ElementTree.fromstring(build_robot_description(machine)).findall("joint")
    moving = [joint for joint in joints if joint.get("type") != "fixed"]
    assert len(moving) == machine.joint_count
    for j, joint in enumerate(moving):
        q = np.linspace(a.joint_min[j], a.joint_max[j], 20_001)
        length = evaluate_linkage_at_angles(a.linkage[j], q)[:, 0]
        limit = float(joint.find("limit").get("velocity"))
        fastest = limit * np.abs(np.diff(length) / np.diff(q)).max()
        assert fastest <= a.max_piston_speed[j] * (1 + 1e-9)
        assert fastest >= 0.999 * a.max_piston_speed[j]
