"""Arms that slew: positions in space and in their plane, and what their files may say."""

import math

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from tests.support.motions import inverse_dynamics

from mhsb_model.errors import MachineFileError, OutOfWorkspaceError
from mhsb_model.goal import Goal
from mhsb_model.machine import load_machine

angles = st.floats(-2.0, 2.0)


@given(angles, st.floats(0.1, 1.0), st.floats(-1.0, 1.0))
def test_a_position_in_the_plane_comes_back_from_space(slewing_machine, slew, ahead, up):
    position = slewing_machine.convert_to_base(np.array([ahead, up]), slew)
    tip, found = slewing_machine.convert_to_plane(tuple(position), 0.0)
    assert tip == pytest.approx((ahead, up))
    assert found == pytest.approx(slew)


def test_the_tip_in_space_is_that_of_the_plane_turned_about_the_slews_axis(slewing_machine):
    a = slewing_machine.arrays
    for q in np.random.default_rng(0).uniform(a.joint_min, a.joint_max, (50, 4)):
        x, z = slewing_machine.planar_arm.tip_position(q[1:])
        turned = (0.1 + x) * np.exp(1j * q[0])
        assert slewing_machine.tip_in_base(q) == pytest.approx([turned.real, turned.imag, z])
        assert slewing_machine.tip_position(q) == pytest.approx([x, z], abs=1e-15)
        assert slewing_machine.end_link_angle(q) == pytest.approx(q[1:].sum())
    many = np.linspace(a.joint_min, a.joint_max, 5)
    each = [slewing_machine.tip_in_base(q) for q in many]
    assert slewing_machine.tip_in_base(many) == pytest.approx(np.array(each))


def test_of_two_ways_around_the_nearer_one_is_taken(load_slewing):
    machine = load_slewing(lambda joint: joint["limits"].update(lower=-4.0, upper=4.0))
    behind = (-0.5, 0.0, 0.3)
    assert machine.convert_to_plane(behind, 1.0).slew == pytest.approx(math.pi)
    assert machine.convert_to_plane(behind, -1.0).slew == pytest.approx(-math.pi)
    left = (0.0, 0.5, 0.3)
    assert machine.convert_to_plane(left, -4.0).slew == pytest.approx(math.pi / 2)


def test_a_position_that_no_slew_reaches_is_refused(slewing_machine):
    with pytest.raises(OutOfWorkspaceError, match=r"3\.142 rad, within -2 … 2 rad it can"):
        slewing_machine.convert_to_plane((-0.5, 0.0, 0.3), 0.0)
    with pytest.raises(OutOfWorkspaceError, match=r"slew's axis must be at least 0\.1 m"):
        slewing_machine.check_in_workspace((0.05, 0.0, 0.5))
    with pytest.raises(OutOfWorkspaceError, match=r"distance 2\.\d+ m from joint 2"):
        slewing_machine.check_in_workspace((1.5, 1.5, 0.3))


def test_arms_that_do_not_slew_are_in_their_plane_wherever_they_are(machine):
    assert machine.planar_arm is machine
    assert machine.convert_to_plane((0.5, 0.3), 0.0) == ((0.5, 0.3), None)
    q = np.array([0.3, -0.9, -0.7])
    assert machine.tip_in_base(q).tolist() == machine.tip_position(q).tolist()


def test_the_arm_in_its_plane_is_the_one_without_the_turntable(machine, slewing_machine):
    plane = slewing_machine.planar_arm
    assert plane.config.joints == slewing_machine.config.joints[1:]
    assert plane.kept_joints == machine.kept_joints
    leaks = machine.arrays.leakage_flow
    assert plane.arrays.main_pump_flow == pytest.approx(machine.arrays.main_pump_flow - leaks)
    assert slewing_machine.changed(payload=3.0).planar_arm.arrays.payload == 3.0
    q = np.array([0.3, -0.9, -0.7])
    held = slewing_machine.piston_forces(np.append(0.7, q))
    assert held.tolist() == [0.0, *machine.piston_forces(q)]


def test_a_motor_counts_as_a_piston_on_the_ring_gears_pitch_circle(load_slewing):
    def with_motor(joint):
        joint["linkage"] = {
            "kind": "motor", "displacement": 4e-6, "gear_ratio": 30.0, "pitch_radius": 0.2
        }  # fmt: skip

    machine = load_slewing(with_motor)
    q = np.append(0.5, machine.config.simulation.start_posture[1:])
    area, arm = machine.arrays.cap_area[0], machine.moment_arms(q)[0]
    assert arm == 0.2
    assert area == machine.arrays.rod_area[0]
    assert area * arm == pytest.approx(4e-6 * 30.0)  # oil by radian
    assert machine.cylinder_lengths(q)[0] == pytest.approx(0.2 * (0.5 + 2.0))


def test_spinning_evenly_pulls_the_arm_outwards_and_asks_nothing_of_the_slew(slewing_machine):
    q, w = np.array([0.0, 0.3, -0.9, -0.7]), 1.5
    torque = inverse_dynamics(slewing_machine, q, np.array([w, 0.0, 0.0, 0.0]), np.zeros(4))
    assert torque[0] == pytest.approx(0.0, abs=1e-12)
    step = 1e-6 * np.eye(4)[1]
    inertia = [slewing_machine.mass_matrix(q + side * step)[0, 0] for side in (1, -1)]
    pull = 0.5 * w * w * (inertia[0] - inertia[1]) / 2e-6
    assert torque[1] == pytest.approx(slewing_machine.gravity_torque(q)[1] - pull, rel=1e-6)


@pytest.fixture
def load_slewing(slewing_content, tmp_path):
    """Function that loads the file after a change to its slew."""

    def load(change):
        change(slewing_content["joints"][0])
        file = tmp_path / "machine.yaml"
        file.write_text(yaml.safe_dump(slewing_content), encoding="utf-8")
        return load_machine(file)

    return load


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda c: c["joints"].append(c["joints"][0]), r"joints\.4\.kind: joint 1 alone can slew"),
        (lambda c: c.update(schema_version=1), "schema_version: slew joints need version 2"),
        (
            lambda c: c["joints"].pop() and c["workspace"].update(max_radius=0.8),
            r"plans are made for 4 or more: the tip takes three",
        ),
        (
            lambda c: c.update(keep_out={"circles": [{"x": 0.5, "z": 0.2, "radius": 0.1}]}),
            r"keep_out\.circles: joint 1 slews, and zones are in space; give cylinders or spheres",
        ),
        (
            lambda c: c["motion"].update(kept_joints=[1]),
            r"motion\.kept_joints: \[1\] must be 1 different ones of the joints 2 to 4",
        ),
        (
            lambda c: c["joints"][0]["linkage"].update(kind="belt"),
            r"joints\.0\.linkage: there is no kind 'belt'; give one of 'rack_and_pinion', 'motor'",
        ),
    ],
)
def test_what_a_slew_cannot_be_is_told_by_its_path(slewing_content, tmp_path, change, sentence):
    change(slewing_content)
    slewing_content["simulation"]["start_posture"] = [0.0] + [-0.5] * (
        len(slewing_content["joints"]) - 1
    )
    file = tmp_path / "machine.yaml"
    file.write_text(yaml.safe_dump(slewing_content), encoding="utf-8")
    with pytest.raises(MachineFileError, match=sentence):
        load_machine(file)


def test_goals_in_space_are_one_where_no_coordinate_differs():
    goal = Goal(3, 0.5, 0.3, 0.2)
    assert goal.position == (0.5, 0.2, 0.3)
    assert Goal.at(4, goal.position).is_at_same_position(goal)
    assert not goal.moved_to((0.5, 0.21, 0.3)).is_at_same_position(goal)
    assert Goal(3, 0.5, 0.3).position == (0.5, 0.3)
