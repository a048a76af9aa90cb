"""Plans of arms that slew among zones in space, looked at by distances of the tests' own."""

import math
from functools import cache

import numpy as np
import pytest

from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import MotionState
from mhsb_planner.errors import NoPathError, RequestError, ZoneError
from mhsb_planner.planner import PlanOptions

PLANNERS = ("table", "fixed", "integrated")
BY_TABLE = PlanOptions(planner="table")
GOAL = (2.0, 1.8, -0.5)
SCENES = {
    "a post": Zones(cylinders=((2.6, 0.2, -2.0, 3.0, 0.15),)),
    "a low wall": Zones(boxes=((1.2, -0.1, -2.0, 3.5, 0.1, 0.3),)),
    "a high wall": Zones(boxes=((1.8, -0.1, -2.0, 4.5, 0.1, 3.0),)),
    "a sphere": Zones(spheres=((2.5, 0.0, -0.5, 0.5),)),
    "a sphere for the tip": Zones(tip_spheres=((2.8, 0.0, -0.6, 0.4),)),
}


def beyond(faces):
    outside = np.maximum(faces, 0.0)
    return np.where((faces > 0.0).any(axis=1), np.linalg.norm(outside, axis=1), faces.max(axis=1))


def distance(zones, points):
    """Signed distance of the nearest of `points` to the only zone."""
    for x1, y1, z1, x2, y2, z2 in zones.boxes:
        return beyond(np.maximum([x1, y1, z1] - points, points - [x2, y2, z2])).min()
    for x, y, low, high, radius in zones.cylinders:
        across = np.hypot(points[:, 0] - x, points[:, 1] - y) - radius
        along = np.maximum(low - points[:, 2], points[:, 2] - high)
        return beyond(np.column_stack([across, along])).min()
    ((x, y, z, radius),) = zones.spheres or zones.tip_spheres
    return (np.linalg.norm(points - [x, y, z], axis=1) - radius).min()


def clearance(machine, zones, q):
    plane = machine.joint_positions(q)[1:]
    ahead = machine.arrays.slew_offset + plane[:, 0]
    joints = np.column_stack([ahead * math.cos(q[0]), ahead * math.sin(q[0]), plane[:, 1]])
    if zones.tip_spheres:
        return distance(zones, joints[-1:])
    share = np.linspace(0.0, 1.0, 120)[:, None]
    links = zip(joints[:-1], joints[1:], machine.config.keep_out.link_radii, strict=True)
    return min(distance(zones, a + share * (b - a)) - radius for a, b, radius in links)


def least_clearance(machine, zones, plan):
    trajectory = plan.motion.trajectory
    at = np.arange(trajectory.stamp_ns, trajectory.end_ns, 10_000_000)
    return min(clearance(machine, zones, q) for q in trajectory.sample_many(at)[0])


@pytest.fixture
def among(digging, excavator):
    """Function that puts the planner among zones, until the end of the test."""

    def put(zones):
        digging.change_machine(excavator.changed(zones=zones))
        return digging

    yield put
    digging.change_machine(excavator)


@pytest.fixture(scope="module")
def plan_among(digging, excavator, begin):
    """Function (scene, kind of planner) that plans from BEGIN to GOAL; each plan is made once."""

    @cache
    def plan(scene, kind):
        digging.change_machine(excavator.changed(zones=SCENES[scene] if scene else Zones()))
        options = PlanOptions(planner=kind)
        try:
            return digging.plan(GOAL, MotionState.at_rest(begin), options=options)
        finally:
            digging.change_machine(excavator)

    return plan


@pytest.mark.parametrize("kind", PLANNERS)
@pytest.mark.parametrize("scene", SCENES)
def test_every_planner_gets_past_every_zone_without_touching_it(plan_among, excavator, scene, kind):
    plan = plan_among(scene, kind)
    assert least_clearance(excavator, SCENES[scene], plan) > 0.0
    end = excavator.tip_in_base(plan.motion.trajectory.position[-1])
    assert end == pytest.approx(GOAL, abs=1e-6)
    assert least_clearance(excavator, SCENES[scene], plan_among(None, kind)) < 0.0


@pytest.mark.parametrize("scene", SCENES)
def test_among_zones_too_the_integrated_planner_is_never_dearer_than_the_others(plan_among, scene):
    cost = {kind: plan_among(scene, kind).cost(PlanOptions(planner=kind)) for kind in PLANNERS}
    assert cost["integrated"] <= min(cost.values()) * (1.0 + 1e-9)


def test_a_zone_that_is_nowhere_near_leaves_the_plan_as_it_is(among, begin):
    start = MotionState.at_rest(begin)
    alone = among(Zones()).plan(GOAL, start, options=BY_TABLE)
    beside = among(Zones(spheres=((-3.0, 0.0, 0.0, 0.3),))).plan(GOAL, start, options=BY_TABLE)
    assert beside.motion.trajectory.position == pytest.approx(alone.motion.trajectory.position)


def test_a_goal_in_a_zone_is_refused_by_the_zones_name_and_where_it_is(among, begin):
    zone = Zones(cylinders=((2.0, 1.7, -1.0, 0.0, 0.3),))
    sentence = (
        r"at \(2, 1\.8, -0\.5\) m the tip is (0\.\d+ m|[\d.]+ mm) deep in the keep-out cylinder"
    )
    with pytest.raises(ZoneError, match=sentence):
        among(zone).plan(GOAL, MotionState.at_rest(begin), options=BY_TABLE)


def test_where_no_way_leads_past_a_zone_the_sentence_names_it(among, begin):
    all_around = Zones(boxes=((0.7, -0.1, -4.0, 6.0, 0.1, 6.0),))
    sentence = r"from \(2\.6, -1\.5, -0\.8\) m to \(2, 1\.8, -0\.5\) m clear of the keep-out box"
    with pytest.raises(NoPathError, match=sentence):
        among(all_around).plan(GOAL, MotionState.at_rest(begin), options=BY_TABLE)


@pytest.mark.parametrize("kind", PLANNERS)
def test_points_on_the_way_are_passed_in_space(among, begin, kind):
    via = ((2.4, -0.6, 0.2), (2.4, 0.9, 0.3))
    options = PlanOptions(planner=kind, via=via, via_tolerance=0.05)
    planner = among(Zones())
    plan = planner.plan(GOAL, MotionState.at_rest(begin), options=options)
    trajectory = plan.motion.trajectory
    at = np.arange(trajectory.stamp_ns, trajectory.end_ns, 2_000_000)
    tips = planner.machine.tip_in_base(trajectory.sample_many(at)[0])
    nearest = [np.linalg.norm(tips - point, axis=1) for point in via]
    assert all(away.min() <= 0.05 for away in nearest)
    assert nearest[0].argmin() < nearest[1].argmin()
    assert tips[-1] == pytest.approx(GOAL, abs=1e-3)


def test_a_point_on_the_way_of_an_arm_that_slews_has_three_numbers(among, begin):
    planner, options = among(Zones()), PlanOptions(planner="table", via=((2.4, 0.2),))
    with pytest.raises(RequestError, match=r"via must be three numbers, x y z \[m\]"):
        planner.plan(GOAL, MotionState.at_rest(begin), options=options)
