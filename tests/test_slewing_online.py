"""An arm that slews over real DDS: goals in space and in its plane, verdicts and refusals."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, PoseStamped
from nav_msgs.msg import Path
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from mhsb_model.files.config_files import config_file
from mhsb_model.machine import load_machine
from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import stamps, topics

FILE = config_file("excavator.yaml")
AHEAD, ASIDE = (2.2, 0.3, 0.2), (1.9, 0.9, -0.4)


@pytest.fixture
def excavator(observer, start_simulator, start_planner):
    """Both nodes of an excavator, running and heard."""
    observer.machine = load_machine(FILE)
    for start in (start_simulator, start_planner):
        start("--ros-args", "-p", f"machine:={FILE}")
    observer.until(lambda: observer.matched and len(observer.references) > 2)
    return observer


def in_work_plane(stamp_ns: int, x: float, height: float) -> PoseStamped:
    header = Header(frame_id="work_plane", stamp=stamps.to_time(stamp_ns))
    return PoseStamped(header=header, pose=Pose(position=Point(x=x, y=height)))


def test_an_excavator_goes_to_goals_in_space_and_in_the_plane_in_which_it_is(excavator):
    arm, paths = excavator, []
    flat = topics.PLANNED_PATH
    arm.create_subscription(Path, flat.name, paths.append, flat.qos)
    verdict = arm.ask(*AHEAD)
    assert verdict.code is Verdict.OK, verdict.sentence
    assert verdict.goal.position == AHEAD
    arm.until_in_force(verdict)
    arm.until(lambda: paths and len(paths[-1].poses) > 2)
    end = paths[-1].poses[-1].pose.position
    assert (end.x, end.y, end.z) == pytest.approx(AHEAD, abs=1e-4)

    # While it moves, to the side: the new plan goes on from the old one.
    verdict = arm.ask(*ASIDE)
    assert verdict.code is Verdict.OK, verdict.sentence
    arm.until(lambda: verdict.goal_stamp_ns in arm.executions, 30.0)
    assert arm.executions[verdict.goal_stamp_ns].outcome is Outcome.REACHED
    arm.until(lambda: not arm.references[-1].state.velocity.any())
    tip = arm.machine.tip_in_base(arm.references[-1].state.position)
    assert math.dist(tip, ASIDE) < 1e-4
    assert arm.largest_reference_step() < 1e-3

    # In its plane as it now stands: the slew stays.
    slew = math.atan2(ASIDE[1], ASIDE[0])
    verdict = arm.ask_message(in_work_plane(7, 1.8, -0.2))
    assert verdict.code is Verdict.OK, verdict.sentence
    expected = arm.machine.in_base(np.array([1.8, -0.2]), slew)
    assert verdict.goal.position == pytest.approx(expected.tolist(), abs=1e-3)

    # What such an arm does not take is refused with its reason.
    assert arm.ask(0.5, 0.1, 0.0).code is Verdict.OUT_OF_WORKSPACE
    behind = arm.ask(-2.0, 0.01, 0.0)
    assert behind.code is Verdict.OUT_OF_WORKSPACE
    assert "joint 1 would have to slew to 3.137 rad" in behind.sentence
    taken, reason = arm.set_parameter("mhsb_planner", "goal_via", (1.5, 0.1))
    assert not taken
    assert "know no points on the way yet" in reason
    taken, reason = arm.set_parameter("mhsb_planner", "zone_boxes", (1.0, 0.1, 1.5, 0.3))
    assert not taken
    assert "zone_boxes takes 6 for each, x y z x y z [m]" in reason
    taken, reason = arm.set_parameter("mhsb_planner", "zone_circles", (1.0, 0.1, 0.3))
    assert not taken
    assert "give zone_boxes or zone_cylinders or zone_spheres" in reason

    # Zones in space are shown where they stand.
    shown = []
    markers = topics.MARKERS
    arm.create_subscription(MarkerArray, markers.name, shown.append, markers.qos)
    for name, value in (
        ("zone_boxes", (0.5, -2.5, -1.0, 1.0, -2.0, 0.0)),
        ("zone_cylinders", (-1.0, -2.0, -1.0, 1.0, 0.2)),
        ("tip_zone_spheres", (0.0, -2.5, 1.0, 0.3)),
    ):
        taken, reason = arm.set_parameter("mhsb_planner", name, value)
        assert taken, reason
    arm.until(lambda: shown and len(zones_in(shown[-1])) == 3)
    assert zones_in(shown[-1]) == {
        Marker.CUBE: (0.75, -2.25, -0.5),
        Marker.CYLINDER: (-1.0, -2.0, 0.0),
        Marker.SPHERE: (0.0, -2.5, 1.0),
    }
    arm.set_parameters_back()
    arm.until(lambda: not zones_in(shown[-1]))


def zones_in(message: MarkerArray) -> dict[int, tuple[float, float, float]]:
    """Kinds and places of the obstacles that are shown."""
    return {
        each.type: (each.pose.position.x, each.pose.position.y, each.pose.position.z)
        for each in message.markers
        if each.ns.startswith("obstacles")
    }
