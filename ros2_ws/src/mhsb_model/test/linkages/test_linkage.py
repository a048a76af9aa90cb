"""Length and moment arm of the slider-crank, and what holds for every kind of linkage."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.linkages import linkage
from mhsb_model.schema import Direct, Pin, SliderCrank

radii = st.floats(0.01, 1.0)
angles = st.floats(-3.0, 3.0)


def crank(u: float, parent_angle: float, v: float, child_angle: float) -> SliderCrank:
    return SliderCrank(
        kind="slider_crank",
        parent_pin=Pin(radius=u, angle=parent_angle),
        child_pin=Pin(radius=v, angle=child_angle),
    )


@given(radii, angles, radii, angles, angles)
def test_length_is_the_distance_between_the_pins(u, parent_angle, v, child_angle, q):
    row = linkage.build_linkage_row(crank(u, parent_angle, v, child_angle))
    parent = u * np.array([math.cos(parent_angle), math.sin(parent_angle)])
    child = v * np.array([math.cos(child_angle + q), math.sin(child_angle + q)])
    distance = float(np.linalg.norm(child - parent))
    assert linkage.cylinder_length(row, q) == pytest.approx(distance, rel=1e-9, abs=1e-7)


def test_lengths_of_many_postures_are_those_of_each_joint():
    rows = np.array([
        linkage.build_linkage_row(each)
        for each in (crank(0.25, 0.1, 0.05, 1.3), Direct(kind="direct", retracted_length=0.33))
    ])  # fmt: skip
    postures = np.random.default_rng(1).uniform(-0.5, 0.5, (7, 2))
    expected = [[linkage.cylinder_length(rows[j], q[j]) for j in range(2)] for q in postures]
    assert linkage.cylinder_lengths(rows, postures).tolist() == expected


@pytest.mark.parametrize("child_angle", [1.2, -1.2])
@pytest.mark.parametrize("q", [-0.9, -0.3, 0.0, 0.4, 0.9])
def test_moment_arm_and_its_slope_are_derivatives_of_the_length(child_angle, q):
    row = linkage.build_linkage_row(crank(0.25, 0.1, 0.05, child_angle + 0.1))
    h = 1e-5
    length = [linkage.cylinder_length(row, q + d) for d in (-h, 0.0, h)]
    arm = linkage.moment_arm(row, q)
    assert arm == pytest.approx((length[2] - length[0]) / (2 * h), abs=1e-10)
    slope = (linkage.moment_arm(row, q + h) - linkage.moment_arm(row, q - h)) / (2 * h)
    assert linkage.evaluate_linkage(row, q)[2] == pytest.approx(slope, abs=1e-9)


def test_extension_turns_the_joint_positively_only_where_the_child_pin_is_ahead():
    ahead = linkage.build_linkage_row(crank(0.25, -0.5, 0.05, 0.8))
    behind = linkage.build_linkage_row(crank(0.25, 0.8, 0.05, -0.5))
    assert linkage.moment_arm(ahead, 0.0) > 0.0
    assert linkage.moment_arm(behind, 0.0) < 0.0


def test_moment_arm_range_spans_the_arms_between_the_limits():
    row = linkage.build_linkage_row(crank(0.25, -1.57, 0.05, -0.26))
    least, largest = linkage.moment_arm_range(row, -0.84, 1.52)
    sampled = [linkage.moment_arm(row, q) for q in np.linspace(-0.84, 1.52, 7777)]
    assert least == pytest.approx(min(sampled), abs=1e-7)
    assert largest == pytest.approx(max(sampled), abs=1e-7)


@pytest.mark.parametrize("child_angle", [1.2, -1.2])
@pytest.mark.parametrize("guess", [-0.9, 0.9])
def test_the_joint_angle_of_a_length_is_found_from_either_end(child_angle, guess):
    row = linkage.build_linkage_row(crank(0.25, 0.1, 0.05, child_angle + 0.1))
    for q in np.linspace(-0.9, 0.9, 19):
        length = linkage.cylinder_length(row, q)
        assert linkage.find_joint_angle(row, length, -0.9, 0.9, guess) == pytest.approx(
            q, abs=1e-12
        )


def test_the_joint_angle_of_a_length_beyond_the_limits_is_the_limit():
    row = linkage.build_linkage_row(crank(0.25, 0.1, 0.05, 1.3))
    too_long = linkage.cylinder_length(row, 0.9) + 1e-3
    assert linkage.find_joint_angle(row, too_long, -0.9, 0.9, 0.0) == 0.9


def test_the_joint_angle_is_found_where_the_moment_arm_changes_much():
    """Newton's steps alone would jump to and fro between the flanks."""
    row = linkage.build_linkage_row(crank(0.25, -1.57, 0.05, -0.26))
    lower, upper = -1.25, 1.75
    for q in np.linspace(lower, upper, 41):
        for guess in (lower, 0.0, upper):
            length = linkage.cylinder_length(row, q)
            found = linkage.find_joint_angle(row, length, lower, upper, guess)
            assert linkage.cylinder_length(row, found) == pytest.approx(length, abs=1e-14)


def test_a_direct_cylinder_is_as_much_longer_as_its_joint_is_extended():
    row = linkage.build_linkage_row(Direct(kind="direct", retracted_length=0.33))
    extension = np.linspace(0.0, 0.25, 11)
    found = linkage.evaluate_linkage_at_angles(row, extension)
    assert found[:, 0].tolist() == (0.33 + extension).tolist()
    assert found[:, 1:].tolist() == [[1.0, 0.0]] * 11
    assert linkage.find_joint_angle(row, 0.43, 0.0, 0.25, 0.2) == pytest.approx(0.1, abs=1e-15)
