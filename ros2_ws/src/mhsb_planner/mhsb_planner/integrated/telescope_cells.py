"""Boxes of cylinder lengths that enclose the goal postures of a chain with telescopes.

The last two turning joints, i < j, close the chain; a cell holds intervals of all other joints.
Joints between i and j, and beyond j, slide. So the links from i to j form a line of length D₁, and
the links beyond j a line of length D₂. With the tip at distance R from joint i, in direction φ, the
cosine rule gives

    cos|qⱼ| = (R² − D₁² − D₂²)/(2 D₁ D₂)      cos β = (R² + D₁² − D₂²)/(2 R D₁)
    θᵢ = φ − sgn(qⱼ) β

with θᵢ the direction of link i. Intervals of D₁ and D₂ follow from those of the extensions.
Intervals of R and φ follow from the links before joint i (`intervals.tip_relative_to_link_end`). If
a link is longer or shorter by h than its middle length, its end moves by at most h. R then changes
by at most h, and φ by at most asin(h/R).
"""

import math

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.tip_postures import find_closing_joints
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray
from mhsb_planner.integrated.intervals import (
    INTERVAL_ROUNDING,
    Interval,
    enclose_lengths,
    tip_relative_to_link_end,
)

MIN_DENOMINATOR = 1e-12
"""Smallest denominator of a cosine [m²]; smaller denominators are raised to it, so that the range
of the angle stays an enclosure.
"""


@kernel
def enclose_with_telescopes(
    m: MachineArrays, tip: tuple[float, float], side: int, cell: FloatArray, box: FloatArray
) -> bool:
    """Compute the range of each cylinder length in a cell of postures, for a telescopic arm.

    A cell holds an interval for each joint except the last two turning joints, whose angles follow
    from the other joints and the tip position. Interval arithmetic gives ranges that may be too
    wide, but never too narrow.

    Args:
        m: Arrays of the machine.
        tip: Tip position (x, z) [m].
        side: Sign of the last turning joint's angle, −1 or 1.
        cell: Lower and upper end of the interval of each other joint, shape (n - 2, 2) [rad or m].
        box: Written in place, shape (2, n): shortest and longest length of each cylinder [m].

    Returns:
        False if the cell certainly holds no posture within the joint limits; `box` is then
        incomplete.
    """
    i, j = find_closing_joints(m)
    distance, phi = math.hypot(tip[0], tip[1]), math.atan2(tip[1], tip[0])
    radius, direction, heading = (distance, distance), (phi, phi), (0.0, 0.0)
    line = ((0.0, 0.0), (0.0, 0.0))  # D₁, D₂
    at = 0
    for k in range(len(m.slides)):
        length = m.link_length[k], m.link_length[k]
        if k not in (i, j):
            low, high = cell[at, 0], cell[at, 1]
            at += 1
            if not enclose_lengths(m, k, low, high, box):
                return False
            if m.slides[k]:
                length = length[0] + low, length[1] + high
            else:
                heading = heading[0] + low, heading[1] + high
        if k < i:
            radius, direction = _tip_relative_to_telescope_end(radius, direction, length, heading)
        elif k < j:
            line = ((line[0][0] + length[0], line[0][1] + length[1]), line[1])
        else:
            line = (line[0], (line[1][0] + length[0], line[1][1] + length[1]))
    bend, beta = (
        _elbow_angle_range(radius, line[0], line[1]),
        _shoulder_angle_range(radius, line[0], line[1]),
    )
    if bend[0] > bend[1]:
        return False
    if side > 0:
        qi, qj = (direction[0] - beta[1], direction[1] - beta[0]), bend
    else:
        qi, qj = (direction[0] + beta[0], direction[1] + beta[1]), (-bend[1], -bend[0])
    found = enclose_lengths(m, i, qi[0] - heading[1], qi[1] - heading[0], box)
    return found and enclose_lengths(m, j, qj[0], qj[1], box)


@kernel
def _tip_relative_to_telescope_end(
    radius: Interval, direction: Interval, length: Interval, heading: Interval
) -> tuple[Interval, Interval]:
    """Compute ranges of the tip's polar coordinates relative to the end of a telescopic link.

    All directions are measured from the arm's x axis.

    Args:
        radius: Range of the tip's distance from the start of the link [m].
        direction: Range of the tip's direction, seen from the start of the link [rad].
        length: Range of the link's length [m].
        heading: Range of the link's direction [rad].

    Returns:
        Range of the tip's distance [m] and range of its direction [rad], both seen from the end of
        the link.
    """
    middle, half = 0.5 * (length[0] + length[1]), 0.5 * (length[1] - length[0])
    radius, direction = tip_relative_to_link_end(radius, direction, middle, heading[0], heading[1])
    if half == 0.0:
        return radius, direction
    off = math.pi if half >= radius[0] else math.asin(half / radius[0])
    radius = max(0.0, radius[0] - half), radius[1] + half
    return radius, (direction[0] - off, direction[1] + off)


@kernel
def _elbow_angle_range(radius: Interval, d1: Interval, d2: Interval) -> Interval:
    """Return the range of the elbow angle |qⱼ| [rad] over ranges of the triangle's sides.

    The corners are joint i, joint j (the elbow) and the tip. The angle |qⱼ| is π minus the angle
    between the sides D₁ and D₂: 0 for a straight arm.

    Args:
        radius: Range of the distance R between joint i and the tip [m].
        d1: Range of the distance D₁ between the joints i and j [m].
        d2: Range of the distance D₂ between joint j and the tip [m].

    Returns:
        Interval that contains the range of |qⱼ| and may be wider. It is (π, 0), which is empty, if
        intervals show that no triangle is possible.
    """
    above = radius[1] ** 2 - d1[0] ** 2 - d2[0] ** 2
    below = radius[0] ** 2 - d1[1] ** 2 - d2[1] ** 2
    return _arc_cosine_range((below, above), (2.0 * d1[0] * d2[0], 2.0 * d1[1] * d2[1]))


@kernel
def _shoulder_angle_range(radius: Interval, d1: Interval, d2: Interval) -> Interval:
    """Return the range of the angle β [rad] at joint i, from the direction of joint j to the tip's.

    Args:
        radius: Range of the distance R between joint i and the tip [m].
        d1: Range of the distance D₁ between the joints i and j [m].
        d2: Range of the distance D₂ between joint j and the tip [m].

    Returns:
        Range of the angle; the empty range (π, 0) if no triangle is possible.
    """
    above = radius[1] ** 2 + d1[1] ** 2 - d2[0] ** 2
    below = radius[0] ** 2 + d1[0] ** 2 - d2[1] ** 2
    return _arc_cosine_range((below, above), (2.0 * radius[0] * d1[0], 2.0 * radius[1] * d1[1]))


@kernel
def _arc_cosine_range(over: Interval, under: Interval) -> Interval:
    """Return the range of acos(over / under) over ranges of numerator and denominator.

    Args:
        over: Range of the numerator.
        under: Range of the denominator, not negative. Ends below MIN_DENOMINATOR are raised to
            MIN_DENOMINATOR.

    Returns:
        Range of the angle [rad]; the empty range (π, 0) if no quotient lies within ±1.
    """
    small, large = max(MIN_DENOMINATOR, under[0]), max(MIN_DENOMINATOR, under[1])
    low = over[0] / (small if over[0] < 0.0 else large) - INTERVAL_ROUNDING
    high = over[1] / (large if over[1] < 0.0 else small) + INTERVAL_ROUNDING
    if low > 1.0 or high < -1.0:
        return math.pi, 0.0
    return math.acos(min(1.0, high)), math.acos(max(-1.0, low))
