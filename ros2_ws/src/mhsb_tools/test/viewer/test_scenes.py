"""What the scenes are told, by a server without a browser."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from mhsb_model.figure_style import MODE_COLOR, rgb
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_model.modes import Mode
from mhsb_model.obstacles.zones import Zones
from mhsb_planner.ros.views import make_markers
from mhsb_tools.viewer.arm_scene import ArmScene
from mhsb_tools.viewer.marker_scene import MarkerScene
from mhsb_tools.viewer.server import open_server
from mhsb_tools.viewer.shapes import bytes_of


@pytest.fixture(scope="module")
def server():
    opened = open_server("127.0.0.1", 0)
    yield opened
    opened.stop()


@pytest.mark.parametrize("file", ["mhsb_arm3.yaml", "telescope_arm.yaml"])
def test_the_load_hangs_at_the_tip_and_barrels_have_the_colour_of_their_mode(server, file):
    machine = load_machine(find_config_file(file))
    arm = ArmScene(server.scene, machine)
    posture = machine.arrays.joint_min + 0.3 * (machine.arrays.joint_max - machine.arrays.joint_min)
    arm.show(posture, np.array([Mode.N, Mode.DB, Mode.SB], dtype=np.uint8))
    x, z = machine.tip_position(posture)
    np.testing.assert_allclose(arm._load.position, [x, 0.0, z])
    last, angle = arm._links[machine.joint_count - 1], machine.end_link_angle(posture)
    half = last.dimensions[0] / 2 * np.array([np.cos(angle), 0.0, np.sin(angle)])
    np.testing.assert_allclose(last.position + half, [x, 0.0, z], atol=1e-12)
    shown = [tuple(arm._bars[barrel].color) for barrel in arm._barrels]
    assert shown == [bytes_of(rgb(MODE_COLOR[mode])) for mode in Mode]


@pytest.mark.parametrize("file", ["excavator.yaml", "forestry_crane.yaml"])
def test_an_arm_that_slews_hangs_in_its_plane_which_turns(server, file):
    machine = load_machine(find_config_file(file))
    arm = ArmScene(server.scene, machine)
    posture = machine.arrays.joint_min + 0.3 * (machine.arrays.joint_max - machine.arrays.joint_min)
    arm.show(posture, np.array([Mode.SB, Mode.N, Mode.DB, Mode.SB], dtype=np.uint8))
    w, *axis = arm._plane.wxyz
    turn = Rotation.from_quat([*axis, w])
    load = turn.apply(arm._load.position) + arm._plane.position
    np.testing.assert_allclose(load, machine.tip_in_base(posture), atol=1e-12)
    shown = [tuple(arm._bars[barrel].color) for barrel in arm._barrels]
    assert shown == [bytes_of(rgb(MODE_COLOR[mode])) for mode in Mode]


def test_markers_of_the_arms_frame_are_shown_until_they_are_deleted(server):
    scene = MarkerScene(server.scene, "base_link")
    cube = Marker(header=Header(frame_id="base_link"), ns="zones", id=3, type=Marker.CUBE)
    flat = Marker(header=Header(frame_id="work_plane"), ns="zones", id=4, type=Marker.CUBE)
    scene.show(MarkerArray(markers=[cube, flat]))
    assert list(scene._shown) == ["/plan/zones/3"]
    scene.show(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
    assert scene._shown == {}


def test_zones_in_space_are_shown_upright_where_they_stand(server):
    machine = load_machine(find_config_file("excavator.yaml"))
    zones = Zones(cylinders=((2.0, -1.2, -1.0, 1.0, 0.15),), tip_spheres=((0.5, 2.5, 1.0, 0.4),))
    scene = MarkerScene(server.scene, "base_link")
    scene.show(make_markers(machine.changed(zones=zones), None, "", 0))
    pole, ball = scene._shown.values()
    np.testing.assert_allclose(pole.position, (2.0, -1.2, 0.0))
    np.testing.assert_allclose(pole.wxyz, (1.0, 0.0, 0.0, 0.0))  # along z, as the server draws it
    assert (pole.radius, pole.height) == (0.15, 2.0)
    np.testing.assert_allclose(ball.position, (0.5, 2.5, 1.0))
    assert ball.radius == 0.4
    scene.show(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
