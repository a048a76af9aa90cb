"""Zones in space: distances of arms that slew against SciPy and points along their links."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from mhsb_model.errors import MachineFileError
from mhsb_model.obstacles.clearance import (
    bound_travel,
    clearances,
    move_is_clear,
    tip_clearance_in_space,
)
from mhsb_model.obstacles.shadows import compute_shadows
from mhsb_model.obstacles.zones import Zones
from mhsb_model.types import frozen

BOX = (0.4, 0.2, -0.3, 0.6, 0.5, 0.2)
CYLINDER = (0.5, -0.4, -0.6, 0.5, 0.08)
SPHERE = (0.3, 0.3, 0.6, 0.15)
TIP_SPHERE = (0.7, 0.1, 0.2, 0.2)
ZONES = Zones(boxes=(BOX,), cylinders=(CYLINDER,), spheres=(SPHERE,), tip_spheres=(TIP_SPHERE,))
RADII = (0.04, 0.03, 0.02)


@pytest.fixture(scope="module")
def crowded(slewing_machine):
    content = slewing_machine.with_values({"keep_out.link_radii": list(RADII)})
    return content.changed(zones=ZONES)


def beyond(faces):
    """Signed distance of a point that is so far beyond each pair of faces."""
    faces = np.array(faces)
    return np.linalg.norm(np.maximum(faces, 0.0)) if (faces > 0.0).any() else faces.max()


def to_box(p):
    low, high = np.array(BOX[:3]), np.array(BOX[3:])
    return beyond(np.abs(p - 0.5 * (low + high)) - 0.5 * (high - low))


def to_cylinder(p):
    x, y, low, high, radius = CYLINDER
    across = math.hypot(p[0] - x, p[1] - y) - radius
    return beyond([across, abs(p[2] - 0.5 * (low + high)) - 0.5 * (high - low)])


def to_sphere(p, sphere=SPHERE):
    return math.dist(p, sphere[:3]) - sphere[3]


def joints_in_space(machine, q):
    """Joint 2 to the tip, by turning the plane's points about the vertical."""
    plane = machine.joint_positions(q)[1:]
    ahead = machine.arrays.slew_offset + plane[:, 0]
    return np.column_stack([ahead * np.cos(q[0]), ahead * np.sin(q[0]), plane[:, 1]])


def least_along(distance, a, b):
    """Of a convex function on a line, by SciPy."""
    found = minimize_scalar(
        lambda s: distance(a + s * (b - a)), bounds=(0.0, 1.0), options={"xatol": 1e-9}
    )
    return min(found.fun, distance(a), distance(b))


def random_postures(machine, count, seed):
    a = machine.arrays
    return np.random.default_rng(seed).uniform(a.joint_min, a.joint_max, (count, len(a.turns)))


def test_clearances_in_space_are_those_of_scipy_and_of_the_nearest_obstacle(crowded):
    names = set()
    for q in random_postures(crowded, 300, 1):
        joints = joints_in_space(crowded, q)
        found = {"sphere of 0.2": to_sphere(joints[-1], TIP_SPHERE)}
        for distance, name in ((to_box, "box"), (to_cylinder, "cylinder"), (to_sphere, "0.15 m")):
            links = zip(joints[:-1], joints[1:], RADII, strict=True)
            found[name] = min(least_along(distance, a, b) - radius for a, b, radius in links)
        nearest = min(found, key=found.get)
        clearance, name = crowded.clearance(q)
        assert clearance == pytest.approx(found[nearest], abs=1e-5)
        if sorted(found.values())[1] - found[nearest] > 1e-4:
            assert nearest in name
        names.add(name)
    assert len(names) == 4


def test_the_tip_alone_is_as_far_from_zones_as_its_point(crowded):
    rows, n = crowded.obstacles.rows, crowded.joint_count
    for p in np.random.default_rng(2).uniform(-1.0, 1.0, (200, 3)):
        least, _ = tip_clearance_in_space(rows, n, *p)
        to_link = min(to_box(p), to_cylinder(p), to_sphere(p)) - RADII[-1]
        assert least == pytest.approx(min(to_link, to_sphere(p, TIP_SPHERE)), abs=1e-12)


def test_no_point_of_the_arm_moves_farther_than_travel_says(crowded):
    postures = random_postures(crowded, 200, 3)
    for start, end in itertools.pairwise(postures):
        way = joints_in_space(crowded, end) - joints_in_space(crowded, start)
        moved = np.linalg.norm(way, axis=1)
        assert moved.max() <= bound_travel(crowded.arrays, start, end, False) + 1e-12


def test_a_move_that_is_clear_meets_nothing_on_its_way(crowded):
    rows, judged = crowded.obstacles.path_rows, {True: 0, False: 0}
    postures = random_postures(crowded, 400, 4)
    for start, end in zip(postures[:-1], 0.7 * postures[:-1] + 0.3 * postures[1:], strict=True):
        way = frozen(start + np.linspace(0.0, 1.0, 200)[:, None] * (end - start))
        least = clearances(crowded.arrays, rows, way)[0]
        if least[0] < 0.0:
            continue
        clear = move_is_clear(crowded.arrays, rows, start, end, False)
        judged[clear] += 1
        assert least.min() >= -6e-4 if clear else least.min() < 5e-3
    assert min(judged.values()) > 20


slews = st.floats(-1.9, 1.9)


@given(slews, slews, st.floats(0.0, 1.0), st.integers(0, 2**32 - 1))
@settings(max_examples=300)
def test_what_keeps_clear_of_all_shadows_keeps_clear_of_the_zones(crowded, one, other, share, seed):
    plane = crowded.make_planar_arm_with_shadows(one, other)
    q = random_postures(crowded, 1, seed)[0]
    q[0] = one + share * (other - one)
    if plane.clearance(q[1:])[0] >= 0.0:
        assert crowded.clearance(q)[0] >= -1e-5


def test_a_shadow_is_no_larger_than_what_its_zone_takes_while_the_plane_turns(crowded):
    # points of the plane, turned through the sector in small steps, that meet a zone without
    # thickness: as many as lie in its shadow, but for those at its edges
    thin = crowded.with_values({"keep_out.link_radii": [], "keep_out.margin": 0.0})
    began, ended = 0.3, 0.9
    shadows = compute_shadows(thin.obstacles, thin.arrays.slew_offset, began, ended)
    plane = thin.make_planar_arm_with_shadows(began, ended)
    assert len(shadows.rows) == len(plane.obstacles.rows) > 0
    rng, turns = np.random.default_rng(5), np.linspace(began, ended, 400)
    shadowed = met = 0
    for x, z in rng.uniform([-0.1, -0.6], [1.0, 0.8], (500, 2)):
        ahead = thin.arrays.slew_offset + x
        points = np.column_stack([ahead * np.cos(turns), ahead * np.sin(turns), np.full(400, z)])
        met += (in_box(points) | in_sphere(points)).any()
        ends = [shadow for shadow in shadows.rows if shadow[1] == 0]  # of one link each
        shadowed += any(_holds(shadow, x, z) for shadow in ends)
    assert 30 < met <= shadowed <= met + 8


def in_box(points):
    low, high = np.array(BOX[:3]), np.array(BOX[3:])
    return ((low < points) & (points < high)).all(axis=1)


def in_sphere(points):
    return np.linalg.norm(points - SPHERE[:3], axis=1) < SPHERE[3]


def _holds(shadow, x, z):
    kind, shape = shadow[0], shadow[2:]
    if kind == 1:
        return math.hypot(x - shape[0], z - shape[1]) < shape[2]
    return shape[0] < x < shape[2] and shape[1] < z < shape[3]


def test_where_the_plane_does_not_get_to_there_is_no_shadow(crowded):
    assert (
        crowded.make_planar_arm_with_shadows(1.5, 1.8)
        .obstacles.names[-1]
        .startswith("the keep-out sphere")
    )
    assert len(crowded.make_planar_arm_with_shadows(-1.8, -1.5).obstacles.rows) == 0
    assert len(crowded.planar_arm.obstacles.rows) == 0


def test_zones_come_back_from_a_machine_file_as_they_were_given(crowded):
    assert crowded.zones == ZONES
    turned = Zones(boxes=((0.6, 0.5, 0.2, 0.4, 0.2, -0.3),))  # corners in any order
    assert crowded.changed(zones=turned).zones == Zones(boxes=(BOX,))
    more = ZONES.with_added(spheres=[TIP_SPHERE])
    assert more.spheres == (SPHERE, TIP_SPHERE)
    assert more.boxes == ZONES.boxes


@pytest.mark.parametrize(
    ("zones", "sentence"),
    [
        (
            {"boxes": [{"x_min": 0.4, "z_min": 0.0, "x_max": 0.6, "z_max": 0.2}]},
            r"keep_out\.boxes\.0: joint 1 slews, and zones are in space; give y_min and y_max, too",
        ),
        (
            {"circles": [{"x": 0.4, "z": 0.0, "radius": 0.1}]},
            r"keep_out\.circles: joint 1 slews, and zones are in space; give cylinders or spheres",
        ),
        (
            {"cylinders": [{"x": 0.4, "y": 0.0, "z_min": 0.3, "z_max": 0.2, "radius": 0.1}]},
            r"keep_out\.cylinders\.0\.z_min: 0\.3 m must be below z_max 0\.2 m",
        ),
        (
            {
                "boxes": [
                    {"x_min": 0.4, "y_min": 0.2, "z_min": 0, "x_max": 0.6, "y_max": 0.1, "z_max": 1}
                ]
            },
            r"keep_out\.boxes\.0\.y_min: 0\.2 m must be below y_max 0\.1 m",
        ),
    ],
)
def test_zones_that_make_no_sense_for_an_arm_that_slews_are_refused(
    slewing_machine, zones, sentence
):
    with pytest.raises(MachineFileError, match=sentence):
        slewing_machine.with_values({f"keep_out.{name}": value for name, value in zones.items()})


def test_zones_in_space_are_refused_for_an_arm_in_a_plane(machine):
    with pytest.raises(MachineFileError, match=r"boxes\.0: this arm moves in x and z"):
        machine.changed(zones=Zones(boxes=(BOX,)))
    with pytest.raises(MachineFileError, match=r"spheres: this .* alone; give circles"):
        machine.changed(zones=Zones(spheres=(SPHERE,)))
