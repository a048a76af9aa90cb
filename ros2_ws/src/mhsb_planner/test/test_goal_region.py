"""Where a motion may end: regions and ranges of angles."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_planner.errors import RequestError
from mhsb_planner.goal_region import (
    BoxRegion,
    Disc,
    Segment,
    angle_range,
    check_angle,
    is_goal_met,
    tip_positions,
)

REGIONS = [Disc(0.004), Disc(0.2), Segment(0.1, -0.05), Segment(0.0, 0.0), BoxRegion(0.02, 0.3)]
offset = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))


@pytest.mark.parametrize("region", REGIONS)
def test_the_goal_is_the_first_of_its_points_and_all_lie_inside(region):
    points = tip_positions((0.5, 0.2), region)
    assert points[0].tolist() == [0.5, 0.2]
    assert len(points) <= 25
    assert all(region.distance(tuple(point - points[0])) <= 1e-12 for point in points)


def sampled(region):
    """Points of a region by its definition, float64[k, 2], no further apart than 5 mm."""
    u, v = (each.ravel() for each in np.meshgrid(np.linspace(-1, 1, 201), np.linspace(-1, 1, 201)))
    match region:
        case Disc(radius):
            return radius * np.column_stack([u, v])[np.hypot(u, v) <= 1.0]
        case Segment(x, z):
            return 0.5 * (u[:, None] + 1.0) * [x, z]
        case BoxRegion(half_x, half_z):
            return np.column_stack([half_x * u, half_z * v])


@given(offset, st.sampled_from(REGIONS))
def test_the_distance_from_a_region_is_that_from_its_nearest_point(outside, region):
    nearest = float(np.hypot(*(sampled(region) - outside).T).min())
    assert region.distance(outside) == pytest.approx(nearest, abs=5e-3)
    assert region.distance(outside) <= nearest + 1e-12


@pytest.mark.parametrize("region", REGIONS)
def test_its_size_is_the_distance_of_its_farthest_point(region):
    assert region.size == pytest.approx(np.hypot(*sampled(region).T).max(), abs=1e-12)


def test_a_range_of_angles_is_taken_by_whole_turns():
    def met(psi, angle):
        return is_goal_met((0.5, 0.2), None, psi, np.array([0.5, 0.2]), angle, 1e-6, 1e-6)

    for turn in (-2 * math.pi, 0.0, 2 * math.pi):
        assert met((-0.5, 0.25), 0.25 + turn)
        assert met((-0.5, 0.25), -0.5 + turn)
        assert met(0.3, 0.3 + turn)
        assert not met((-0.5, 0.25), 0.26 + turn)
        assert not met(0.3, 0.301 + turn)
    assert met(None, 17.0)
    assert met((0.0, 2 * math.pi), 4.0)
    assert angle_range((0.0, 6.3)) is None


def test_a_tip_outside_of_a_region_does_not_meet_it():
    tip = np.array([0.52, 0.2])
    assert is_goal_met((0.5, 0.2), Disc(0.021), None, tip, 0.0, 1e-6, 1e-6)
    assert not is_goal_met((0.5, 0.2), Disc(0.019), None, tip, 0.0, 1e-6, 1e-6)
    assert is_goal_met((0.5, 0.2), Disc(0.019), None, tip, 0.0, 2e-3, 1e-6)
    assert not is_goal_met((0.5, 0.2), None, None, tip, 0.0, 1e-6, 1e-6)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Disc(0.0), "radius must be above 0 m"),
        (lambda: Disc(math.nan), "radius must be above 0 m"),
        (lambda: BoxRegion(0.1, -0.1), "half_z must be above 0 m"),
        (lambda: Segment(math.inf, 0.0), "x must be finite"),
        (lambda: check_angle(math.nan), "goal_psi must be a finite angle in rad"),
        (lambda: check_angle((0.5, 0.2)), "the least first"),
        (lambda: Disc(1e308), r"goal region's radius must be at most 100 m \(is 1e\+308\)"),
        (lambda: BoxRegion(0.1, 1e300), r"half_z must be at most 100 m"),
        (lambda: Segment(-1e308, 0.0), r"x must be at most 100 m"),
        (lambda: check_angle(1e300), r"goal_psi must be from -15 to 15 rad \(is 1e\+300\)"),
        (lambda: check_angle((-1e9, 0.0)), r"goal_psi must be from -15 to 15 rad"),
        (lambda: check_angle(91.0), r"15 rad; in degrees\? 91 degrees are 1\.588 rad \(is 91\.0\)"),
    ],
)
def test_what_is_no_region_or_angle_is_refused_with_a_sentence(make, sentence):
    with pytest.raises(RequestError, match=sentence):
        make()
