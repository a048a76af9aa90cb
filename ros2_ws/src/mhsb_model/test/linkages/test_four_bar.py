"""The four-bar against an independent closure of its loop and finite differences."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import brentq

from mhsb_model.linkages import four_bar, linkage
from mhsb_model.linkages.linkage_rules import SMALLEST_TRANSMISSION_ANGLE
from mhsb_model.schema import FourBar, Pin


def pins(least: float, largest: float) -> st.SearchStrategy[Pin]:
    return st.builds(Pin, radius=st.floats(least, largest), angle=st.floats(-3.0, 3.0))


four_bars = st.builds(
    FourBar,
    kind=st.just("four_bar"),
    rocker_pivot=pins(0.03, 0.20),
    rocker_length=st.floats(0.03, 0.15),
    rocker_side=st.sampled_from(["left", "right"]),
    coupler_length=st.floats(0.03, 0.15),
    child_pin=pins(0.03, 0.10),
    parent_pin=pins(0.15, 0.40),
)
angles = st.floats(-2.0, 2.0)


def place(pin: Pin, turned: float = 0.0) -> np.ndarray:
    angle = pin.angle + turned
    return pin.radius * np.array([math.cos(angle), math.sin(angle)])


def cross(a: np.ndarray, b: np.ndarray) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def assembled(linkage_: FourBar, q: float) -> np.ndarray:
    """Row of the four-bar, of which only those are looked at that close well and have a length."""
    row = linkage.build_linkage_row(linkage_)
    assume(abs(four_bar.cos_transmission_angle(row, q)) < math.cos(SMALLEST_TRANSMISSION_ANGLE))
    assume(linkage.cylinder_length(row, q) > 0.05)
    return row


@given(four_bars, angles)
def test_rocker_and_coupler_keep_their_lengths_and_the_tip_its_side(bars, q):
    row = assembled(bars, q)
    pivot, child = place(bars.rocker_pivot), place(bars.child_pin, q)
    x, z, length, *_ = four_bar.evaluate_four_bar(row, math.cos(q), math.sin(q))
    tip = pivot + np.array([x, z])
    assert np.linalg.norm(tip - pivot) == pytest.approx(bars.rocker_length, rel=1e-12)
    assert np.linalg.norm(tip - child) == pytest.approx(bars.coupler_length, rel=1e-9)
    assert np.linalg.norm(tip - place(bars.parent_pin)) == pytest.approx(length, rel=1e-12)
    assert (cross(child - pivot, tip - pivot) > 0) == (bars.rocker_side == "left")


@given(four_bars, angles)
def test_the_length_is_that_of_the_closed_loop(bars, q):
    """The rocker is turned, on its side, until its tip is the coupler's length off the pin."""
    row = assembled(bars, q)
    pivot, child = place(bars.rocker_pivot), place(bars.child_pin, q)
    towards = math.atan2(*(child - pivot)[::-1])
    side = 1.0 if bars.rocker_side == "left" else -1.0

    def tip(turned: float) -> np.ndarray:
        angle = towards + side * turned
        return pivot + bars.rocker_length * np.array([math.cos(angle), math.sin(angle)])

    def gap(turned: float) -> float:
        return float(np.linalg.norm(tip(turned) - child)) - bars.coupler_length

    closed = tip(brentq(gap, 0.0, math.pi, xtol=1e-14))
    length = float(np.linalg.norm(closed - place(bars.parent_pin)))
    assert linkage.cylinder_length(row, q) == pytest.approx(length, rel=1e-9)


@given(four_bars, angles)
def test_moment_arm_and_its_slope_are_derivatives_of_the_length(bars, q):
    row = assembled(bars, q)
    h = 1e-5
    length = [linkage.cylinder_length(row, q + d) for d in (-h, h)]
    arm = [linkage.moment_arm(row, q + d) for d in (-h, 0.0, h)]
    assert arm[1] == pytest.approx((length[1] - length[0]) / (2 * h), rel=1e-6, abs=1e-7)
    slope = (arm[2] - arm[0]) / (2 * h)
    assert linkage.evaluate_linkage(row, q)[2] == pytest.approx(slope, rel=1e-5, abs=1e-6)


@given(four_bars, angles)
def test_a_mirrored_four_bar_has_the_opposite_arm(bars, q):
    row = assembled(bars, q)

    def mirrored(pin: Pin) -> Pin:
        return Pin(radius=pin.radius, angle=-pin.angle)

    other = linkage.build_linkage_row(
        bars.model_copy(
            update={
                "rocker_pivot": mirrored(bars.rocker_pivot),
                "child_pin": mirrored(bars.child_pin),
                "parent_pin": mirrored(bars.parent_pin),
                "rocker_side": "left" if bars.rocker_side == "right" else "right",
            }
        )
    )
    assert linkage.cylinder_length(other, -q) == pytest.approx(linkage.cylinder_length(row, q))
    assert linkage.moment_arm(other, -q) == pytest.approx(-linkage.moment_arm(row, q), abs=1e-12)


def test_a_parallelogram_passes_the_joints_turn_on_unchanged():
    """With equal opposite bars the rocker turns like the joint: a slider-crank about its pivot."""
    pivot, a = 0.10, 0.05
    bars = FourBar(
        kind="four_bar",
        rocker_pivot=Pin(radius=pivot, angle=0.0),
        rocker_length=a,
        rocker_side="right",
        coupler_length=pivot,
        child_pin=Pin(radius=a, angle=0.0),
        parent_pin=Pin(radius=0.3, angle=-0.5),
    )
    row = linkage.build_linkage_row(bars)
    base = place(bars.parent_pin) - [pivot, 0.0]
    for q in (0.7, 1.2, 1.9):
        tip = a * np.array([math.cos(q), math.sin(q)])
        length = np.linalg.norm(tip - base)
        assert linkage.cylinder_length(row, q) == pytest.approx(length, rel=1e-12)
        arm = cross(tip, tip - base) / length
        assert linkage.moment_arm(row, q) == pytest.approx(arm, rel=1e-12)


@given(four_bars, st.floats(-7.0, 7.0))
def test_kernels_stay_finite_where_no_linkage_can_be(bars, q):
    row = linkage.build_linkage_row(bars)
    assert all(
        math.isfinite(value) for value in four_bar.evaluate_four_bar(row, math.cos(q), math.sin(q))
    )


def test_the_joint_angle_of_a_length_is_found_from_either_end(four_bar_machine):
    arrays = four_bar_machine.arrays
    for row, lower, upper in zip(arrays.linkage, arrays.joint_min, arrays.joint_max, strict=True):
        for guess in (lower, upper):
            for q in np.linspace(lower, upper, 23):
                length = linkage.cylinder_length(row, q)
                found = linkage.find_joint_angle(row, length, lower, upper, guess)
                assert found == pytest.approx(q, abs=1e-12)


def test_a_four_bar_keeps_its_arm_nearly_constant_over_wide_limits(four_bar_machine):
    arrays = four_bar_machine.arrays
    for j, (ratio, spread) in enumerate([(0.65, 220), (0.9, 150), (0.9, 150)]):
        lower, upper = arrays.joint_min[j], arrays.joint_max[j]
        least, largest = linkage.moment_arm_range(arrays.linkage[j], lower, upper)
        assert math.degrees(upper - lower) == pytest.approx(spread, abs=0.1)
        assert least / largest > ratio
