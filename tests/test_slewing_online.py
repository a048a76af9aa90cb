"""An arm that slews over real DDS: goals in space and in its plane, verdicts and refusals."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, PoseStamped
from nav_msgs.msg import Path
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import stamps, topics

FILE = find_config_file("excavator.yaml")
AHEAD, ASIDE = (2.2, 0.3, 0.2), (1.9, 0.9, -0.4)


@pytest.fixture
def excavator(observer, start_simulator, start_planner):
    """Both nodes of an excavator, running and heard; its time runs three times as fast as real."""
    observer.machine = load_machine(FILE)
    machine = "--ros-args", "-p", f"machine:={FILE}"
    start_simulator(*machine, "-p", "publish_clock:=true", "-p", "real_time_factor:=3.0")
    start_planner(*machine, "-p", "use_sim_time:=true")
    observer.until(lambda: observer.is_matched and len(observer.references) > 2)
    return observer


def in_work_plane(stamp_ns: int, x: float, height: float) -> PoseStamped:
    header = Header(frame_id="work_plane", stamp=stamps.to_time(stamp_ns))
    return PoseStamped(header=header, pose=Pose(position=Point(x=x, y=height)))


def test_an_excavator_goes_to_goals_in_space_and_in_the_plane_in_which_it_is(excavator):
    arm, paths = excavator, []
    flat = topics.PLANNED_PATH
    arm.create_subscription(Path, flat.name, paths.append, flat.qos)
    verdict = arm.request_verdict(*AHEAD)
    assert verdict.code is Verdict.OK, verdict.sentence
    assert verdict.goal.position == AHEAD
    arm.until_in_force(verdict)
    arm.until(lambda: paths and len(paths[-1].poses) > 2)
    end = paths[-1].poses[-1].pose.position
    assert (end.x, end.y, end.z) == pytest.approx(AHEAD, abs=1e-4)

    # While it moves, to the side: the new plan goes on from the old one.
    verdict = arm.request_verdict(*ASIDE)
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
    expected = arm.machine.convert_to_base(np.array([1.8, -0.2]), slew)
    assert verdict.goal.position == pytest.approx(expected.tolist(), abs=1e-3)

    # What such an arm does not take is refused with its reason.
    assert arm.request_verdict(0.5, 0.1, 0.0).code is Verdict.OUT_OF_WORKSPACE
    behind = arm.request_verdict(-2.0, 0.01, 0.0)
    assert behind.code is Verdict.OUT_OF_WORKSPACE
    assert "joint 1 would have to slew to 3.137 rad" in behind.sentence
    taken, reason = arm.set_parameter("mhsb_planner", "goal_via", (1.5, 0.1))
    assert not taken
    assert "goal_via takes 3 for each, x y z [m] of a point (is 2 numbers)" in reason
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


def test_an_excavator_replans_past_a_post_that_is_set_up_while_it_runs(excavator):
    arm, right, left = excavator, (2.4, -1.2, -0.4), (2.2, 1.4, -0.4)
    assert arm.request_verdict(*right).code is Verdict.OK
    arm.until(lambda: len(arm.executions) == 1, 30.0)
    post = Zones(cylinders=((2.4, 0.2, -2.0, 3.0, 0.15),))
    taken, reason = arm.set_parameter("mhsb_planner", "zone_cylinders", post.cylinders[0])
    assert taken, reason

    # What lies in the post is refused by its name.
    verdict = arm.request_verdict(2.3, 0.2, 0.0)
    assert verdict.code is Verdict.ZONE
    assert "deep in the keep-out cylinder of 0.15 m around (2.4, 0.2) m" in verdict.sentence

    # Past it to the left; on the way, to another place behind it.
    arm.references.clear()
    verdict = arm.request_verdict(*left)
    assert verdict.code is Verdict.OK, verdict.sentence
    arm.until_in_force(verdict)
    arm.until(lambda: any(each.state.velocity.any() for each in arm.references))
    verdict = arm.request_verdict(1.9, 1.6, 0.3)
    assert verdict.code is Verdict.OK, verdict.sentence
    assert arm.ending_of(verdict).outcome is Outcome.REACHED
    machine = arm.machine.changed(zones=post)
    assert min(machine.clearance(each.state.position)[0] for each in arm.references) > 0.0
    assert arm.largest_reference_step() < 1e-3

    # Over a point on the way, past the post again.
    over = (1.5, 1.0, 0.6)
    for name, value in (("goal_via", over), ("goal_via_tolerance", 0.05)):
        taken, reason = arm.set_parameter("mhsb_planner", name, value)
        assert taken, reason
    arm.references.clear()
    verdict = arm.request_verdict(*right)
    assert verdict.code is Verdict.OK, verdict.sentence
    assert arm.ending_of(verdict).outcome is Outcome.REACHED
    postures = [each.state.position for each in arm.references]
    assert min(machine.clearance(q)[0] for q in postures) > 0.0
    tips = np.array([machine.tip_in_base(q) for q in postures])
    assert np.linalg.norm(tips - over, axis=1).min() < 0.051
    arm.set_parameters_back()


def zones_in(message: MarkerArray) -> dict[int, tuple[float, float, float]]:
    """Kinds and places of the obstacles that are shown."""
    return {
        each.type: (each.pose.position.x, each.pose.position.y, each.pose.position.z)
        for each in message.markers
        if each.ns.startswith("obstacles")
    }
