"""What viewers are shown of plans and obstacles."""

import numpy as np
import pytest
from visualization_msgs.msg import Marker

from mhsb_model.command import Command
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine, load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_planner.ros import views

ZONES = Zones(boxes=((0.7, -0.2, 0.9, 0.1),), tip_circles=((0.6, 0.5, 0.15),))


@pytest.fixture(scope="module")
def crowded(machine) -> Machine:
    content = machine.config.model_dump()
    content["keep_out"] |= {"ground": -0.5, "self_collision": True} | ZONES.content()
    return Machine.from_config(type(machine.config).model_validate(content))


def shown(machine, command=None):
    markers = views.make_markers(machine, command, "", 5).markers
    assert markers[0].action == Marker.DELETEALL
    keys = [(marker.ns, marker.id) for marker in markers]
    assert len(set(keys)) == len(keys)
    return markers[1:]


def test_obstacles_are_shown_where_they_are_in_both_frames(crowded):
    box, circle, ground = (m for m in shown(crowded) if m.header.frame_id == "base_link")
    assert (box.type, circle.type) == (Marker.CUBE, Marker.CYLINDER)
    place, size = box.pose.position, box.scale
    assert (place.x, place.y, place.z) == pytest.approx((0.8, 0.0, -0.05))
    assert (size.x, size.z) == pytest.approx((0.2, 0.3))
    assert (circle.pose.position.x, circle.pose.position.z) == pytest.approx((0.6, 0.5))
    assert circle.scale.x == circle.scale.y == pytest.approx(0.3)
    assert turned_z(circle.pose.orientation) == pytest.approx((0, -1, 0))
    assert ground.pose.position.z + ground.scale.z / 2 == pytest.approx(-0.5)
    assert box.color != circle.color  # for the whole arm, for the tip

    box, circle, _ = (m for m in shown(crowded) if m.header.frame_id == "work_plane")
    place, size = box.pose.position, box.scale
    assert (place.x, place.y, place.z) == pytest.approx((0.8, -0.05, 0.0))
    assert (size.x, size.y) == pytest.approx((0.2, 0.3))
    assert turned_z(circle.pose.orientation) == pytest.approx((0, 0, 1))


def turned_z(q):
    """The z axis turned by a quaternion."""
    return (
        2 * (q.x * q.z + q.w * q.y),
        2 * (q.y * q.z - q.w * q.x),
        1 - 2 * (q.x**2 + q.y**2),
    )


def test_a_plan_is_shown_beside_the_obstacles(crowded, machine):
    command = Command.hold(7, np.array([0.3, -1.4, -1.5]), np.zeros(3, dtype=np.uint8))
    assert len(shown(crowded, command)) == len(shown(crowded)) + len(shown(machine, command))
    assert shown(machine) == []


def test_zones_in_space_are_shown_in_the_frame_in_which_they_stand():
    machine = load_machine(find_config_file("excavator.yaml"))
    zones = Zones(
        boxes=((1.0, 0.5, -1.0, 2.0, 1.5, 0.2),),
        cylinders=((0.5, -2.0, -1.0, 100.0, 0.25),),  # as high as is shown at all
        tip_spheres=((0.0, 2.0, 1.0, 0.5),),
    )
    content = machine.config.model_dump()
    content["keep_out"] |= {"ground": -1.0} | zones.content()
    crowded = Machine.from_config(type(machine.config).model_validate(content))
    found = shown(crowded)
    assert [m.type for m in found if m.header.frame_id == "work_plane"] == [Marker.CUBE]  # ground
    box, pole, ball, ground = (m for m in found if m.header.frame_id == "base_link")
    assert (box.type, pole.type, ball.type) == (Marker.CUBE, Marker.CYLINDER, Marker.SPHERE)
    assert triple(box.pose.position) == pytest.approx((1.5, 1.0, -0.4))
    assert triple(box.scale) == pytest.approx((1.0, 1.0, 1.2))
    assert triple(pole.pose.position)[:2] == pytest.approx((0.5, -2.0))
    assert pole.pose.position.z - pole.scale.z / 2 == pytest.approx(-1.0)
    assert 3.15 < pole.pose.position.z + pole.scale.z / 2 < 10.0
    assert (pole.scale.x, pole.scale.y) == pytest.approx((0.5, 0.5))
    assert turned_z(pole.pose.orientation) == pytest.approx((0, 0, 1))
    assert triple(ball.pose.position) == pytest.approx((0.0, 2.0, 1.0))
    assert triple(ball.scale) == pytest.approx((1.0, 1.0, 1.0))
    assert box.color == pole.color != ball.color
    assert all(m.frame_locked for m in found)
    assert ground.pose.position.z + ground.scale.z / 2 == pytest.approx(-1.0)


def triple(vector):
    """Its three numbers."""
    return vector.x, vector.y, vector.z
