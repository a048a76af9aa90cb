"""Clearance of the arm, against points sampled densely on links and in obstacles."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.obstacles import clearance
from mhsb_model.obstacles.clearance import (
    MIN_PART_TRAVEL,
    BoxInPlane,
    LineSegment,
    move_is_clear,
    segment_to_box,
    segment_to_segment,
)
from mhsb_model.obstacles.zones import Zones

coordinates = st.floats(-1.0, 1.0)
points = st.tuples(coordinates, coordinates)
boxes = st.tuples(points, st.tuples(st.floats(0.01, 1.0), st.floats(0.01, 1.0))).map(
    lambda box: (*box[0], box[0][0] + box[1][0], box[0][1] + box[1][1])
)
SAMPLES = 400


def along(a, b, count=SAMPLES):
    return a + np.linspace(0, 1, count)[:, None] * (np.array(b) - a)


def box_distance(p, box):
    """Signed distance of points float64[k, 2] to a box (x_min, z_min, x_max, z_max)."""
    x_min, z_min, x_max, z_max = box
    d = np.maximum([x_min, z_min] - p, p - [x_max, z_max])
    return np.hypot(*np.maximum(d, 0.0).T) + np.minimum(d.max(axis=1), 0.0)


def measured(machine, zones, q, keep_out):
    """Least clearance in a posture by sampling: every link, every zone and link, the ground."""
    joints = np.vstack([np.zeros(2), joints_in(machine, q)])
    links = [along(a, b) for a, b in itertools.pairwise(joints)]
    tip, radii = joints[-1:], keep_out["link_radii"]
    found = [box_distance(tip, box).min() for box in zones.tip_boxes]
    found += [np.hypot(*(tip - c[:2]).T).min() - c[2] for c in zones.tip_circles]
    for link, radius in zip(links, radii, strict=True):
        found += [box_distance(link, box).min() - radius for box in zones.boxes]
        found += [np.hypot(*(link - c[:2]).T).min() - c[2] - radius for c in zones.circles]
        found.append(link[:, 1].min() - keep_out["ground"] - radius)
    for link, radius in zip(links[1:], radii[1:], strict=True):
        found.append(box_distance(link, tuple(keep_out["base"].values())).min() - radius)
    first, third = links[0], links[2]
    between = np.hypot(*(first[:, None, :] - third[None, ::3, :]).transpose(2, 0, 1))
    found.append(between.min() - radii[0] - radii[2])
    return min(found)


ZONES = Zones(
    boxes=((0.7, -0.2, 0.9, 0.1),),
    circles=((0.5, 0.8, 0.1),),
    tip_boxes=((0.2, 0.5, 0.4, 0.9),),
    tip_circles=((0.6, -0.5, 0.15),),
)
KEEP_OUT = {
    "link_radii": (0.04, 0.03, 0.02),
    "ground": -0.8,
    "base": {"x_min": -0.1, "z_min": -0.8, "x_max": 0.1, "z_max": -0.1},
    "self_collision": True,
}


@pytest.fixture(scope="module", params=["machine", "telescope_machine"])
def arm(request):
    """The suite's arm, and one with a telescope."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module")
def crowded(arm):
    """An arm among obstacles of every kind."""
    content = arm.config.model_dump()
    content["keep_out"] |= KEEP_OUT | ZONES.content()
    return Machine.from_config(type(arm.config).model_validate(content))


def postures(machine, count, seed=0):
    m = machine.arrays
    return np.random.default_rng(seed).uniform(m.joint_min, m.joint_max, (count, 3))


@given(points, points, boxes)
def test_a_segment_is_as_far_from_a_box_as_its_nearest_or_deepest_point(a, b, box):
    sampled = box_distance(along(a, b), box).min()
    exact = segment_to_box(LineSegment(*a, *b), BoxInPlane(*box))
    assert sampled - math.dist(a, b) / SAMPLES <= exact <= sampled + 1e-12


@given(points, points, points, points)
def test_two_segments_are_as_far_apart_as_their_nearest_points(a, b, c, d):
    one, other = along(a, b, 150), along(c, d, 150)
    sampled = np.hypot(*(one[:, None, :] - other[None, :, :]).transpose(2, 0, 1)).min()
    exact = segment_to_segment(LineSegment(*a, *b), LineSegment(*c, *d))
    assert sampled - (math.dist(a, b) + math.dist(c, d)) / 150 <= exact <= sampled + 1e-12


def test_the_clearance_is_that_of_the_nearest_of_all_obstacles(crowded):
    nearest = set()
    for q in postures(crowded, 150):
        distance, name = crowded.clearance(q)
        assert distance == pytest.approx(measured(crowded, ZONES, q, KEEP_OUT), abs=1.5e-3)
        nearest.add(name)
    assert nearest == set(crowded.obstacles.names)
    assert "the ground at z = -0.8 m" in nearest
    assert "itself, link 3 to link 1" in nearest


def is_clear(machine, start, end, along_cylinders=False):
    rows = machine.obstacles.path_rows
    return move_is_clear(machine.arrays, rows, start, end, along_cylinders)


def test_without_obstacles_nothing_is_near_and_every_move_is_clear(machine):
    start, end = postures(machine, 2)
    assert machine.clearance(start) == (math.inf, "")
    assert is_clear(machine, start, end)


def test_no_posture_has_more_clearance_than_the_place_of_its_tip(crowded):
    for q in postures(crowded, 200, seed=1):
        most, _ = clearance.tip_clearance(crowded.obstacles.rows, 3, *crowded.tip_position(q))
        assert crowded.clearance(q)[0] <= most + 1e-12


def way_between(machine, start, end, along_cylinders, count=300):
    """Postures on a move that is straight in joint angles or in cylinder lengths."""
    if not along_cylinders:
        return along(start, end, count)
    m = machine.arrays
    lengths = along(machine.cylinder_lengths(start), machine.cylinder_lengths(end), count)
    angles = []
    for j in range(3):
        grid = np.linspace(m.joint_min[j], m.joint_max[j], 201)
        table = np.array([cylinder_length(m.linkage[j], q) for q in grid])
        order = np.argsort(table)
        angles.append(np.interp(lengths[:, j], table[order], grid[order]))
    return np.column_stack(angles)


@pytest.mark.parametrize("along_cylinders", [False, True])
def test_moves_are_clear_where_no_posture_on_the_way_comes_near(crowded, along_cylinders):
    margin = crowded.config.keep_out.margin
    clear = blocked = 0
    starts = postures(crowded, 400, seed=2)
    for start, other in zip(starts, postures(crowded, 400, seed=3), strict=True):
        if crowded.clearance(start)[0] < margin:
            continue
        end = start + 0.3 * (other - start)
        way = way_between(crowded, start, end, along_cylinders)
        least = clearance.clearances(crowded.arrays, crowded.obstacles.rows, way)[0].min()
        if is_clear(crowded, start, end, along_cylinders):
            assert (
                least >= margin - MIN_PART_TRAVEL / 2 - 1e-3 * along_cylinders
            )  # interpolated angles
            clear += 1
        else:
            assert least < margin + 2e-3  # of 300 looks
            blocked += 1
    assert clear > 20
    assert blocked > 20


def test_a_long_move_does_not_pass_through_a_thin_box(machine):
    thin = machine.changed(zones=Zones(tip_boxes=((0.0, 0.0, 1.1, 1e-4),)))
    start, end = np.array([0.5, -0.5, 0.0]), np.array([-0.9, -0.5, 0.0])
    assert machine.tip_position(start)[1] > 0 > machine.tip_position(end)[1]
    assert not is_clear(thin, start, end)
    assert is_clear(thin, start, start + 0.1)


def test_a_start_in_a_zone_may_leave_it_but_not_go_deeper_or_into_another(machine):
    q = np.array([0.4, -1.0, 0.2])
    x, z = machine.tip_position(q)
    inside = (x - 0.3, z - 0.3, x + 0.02, z + 0.3)  # the way out is forward
    one = machine.changed(zones=Zones(tip_boxes=(inside,)))
    jacobian = machine.jacobian(q)[:, :2]
    forward = np.append(np.linalg.solve(jacobian, [0.1, 0.0]), 0.0)
    assert is_clear(one, q, q + forward)
    assert not is_clear(one, q, q - forward)
    beyond = (x + 0.05, z - 0.3, x + 0.3, z + 0.3)
    both = machine.changed(zones=Zones(tip_boxes=(inside, beyond)))
    assert is_clear(both, q, q + 0.25 * forward)
    assert not is_clear(both, q, q + forward)


@given(st.integers(0, 10_000), st.booleans())
def test_no_point_moves_farther_than_the_bound(arm, seed, along_cylinders):
    start, end = postures(arm, 2, seed)
    shares = np.linspace(0, 1, 50)[:, None] ** ([1.0, 2.0, 0.5] if along_cylinders else 1.0)
    way = np.array([joints_in(arm, q) for q in start + shares * (end - start)])
    moved = np.hypot(*np.moveaxis(np.diff(way, axis=0), -1, 0)).sum(axis=0)
    bound = clearance.bound_travel(arm.arrays, start, end, along_cylinders)
    assert moved.max() <= bound + 1e-12


def joints_in(machine, q):
    """Ends of all links, float64[n, 2] m."""
    slides = machine.arrays.slides
    angle = np.cumsum(np.where(slides, 0.0, q))
    length = machine.arrays.link_length + np.where(slides, q, 0.0)
    return np.cumsum(length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]), axis=0)
