"""Boxes of cylinder lengths that enclose the goal postures of a chain with telescopes.

The last two joints that turn, i < j, close the chain; a cell holds intervals of all others. No
joint turns between i and j, nor beyond j: the links there lie in two lines, D₁ and D₂ long. With
the tip at distance R from joint i, in direction φ, the cosine rule gives

    cos|qⱼ| = (R² − D₁² − D₂²)/(2 D₁ D₂)      cos β = (R² + D₁² − D₂²)/(2 R D₁)
    θᵢ = φ − sgn(qⱼ) β

θᵢ the direction of link i. Intervals of D₁ and D₂ come from those of the extensions, R and φ from
the links before joint i (`intervals.without_link`): a link that is longer or shorter by h than its
middle length puts its end no farther than h from where that would have it, so that R changes by h
at most, and φ by asin(h/R).
"""

from __future__ import annotations

import math

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.tip_postures import closing_joints
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray
from mhsb_planner.integrated.intervals import ROUNDING, Interval, enclose_lengths, without_link

LEAST = 1e-12
"""Denominators below this are taken for this: the angle may then be any."""


@kernel
def enclose_with_telescopes(
    m: MachineArrays, tip: tuple[float, float], side: int, cell: FloatArray, box: FloatArray
) -> bool:
    """`certificate.enclose` of a chain with telescopes.

    side  of `tip_postures.close_chain`
    cell  float64[n - 2, 2], from and to, of all joints but the two that close the chain
    """
    i, j = closing_joints(m)
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
            radius, direction = _without_telescope(radius, direction, length, heading)
        elif k < j:
            line = ((line[0][0] + length[0], line[0][1] + length[1]), line[1])
        else:
            line = (line[0], (line[1][0] + length[0], line[1][1] + length[1]))
    bend, beta = _bend(radius, line[0], line[1]), _beside(radius, line[0], line[1])
    if bend[0] > bend[1]:
        return False
    if side > 0:
        qi, qj = (direction[0] - beta[1], direction[1] - beta[0]), bend
    else:
        qi, qj = (direction[0] + beta[0], direction[1] + beta[1]), (-bend[1], -bend[0])
    found = enclose_lengths(m, i, qi[0] - heading[1], qi[1] - heading[0], box)
    return found and enclose_lengths(m, j, qj[0], qj[1], box)


@kernel
def _without_telescope(
    radius: Interval, direction: Interval, length: Interval, heading: Interval
) -> tuple[Interval, Interval]:
    """`without_link` of a link whose length is an interval [m]."""
    middle, half = 0.5 * (length[0] + length[1]), 0.5 * (length[1] - length[0])
    radius, direction = without_link(radius, direction, middle, heading[0], heading[1])
    if half == 0.0:
        return radius, direction
    off = math.pi if half >= radius[0] else math.asin(half / radius[0])
    radius = max(0.0, radius[0] - half), radius[1] + half
    return radius, (direction[0] - off, direction[1] + off)


@kernel
def _bend(radius: Interval, d1: Interval, d2: Interval) -> Interval:
    """Range of |qⱼ| [rad]; from above to below where there is none."""
    above = radius[1] ** 2 - d1[0] ** 2 - d2[0] ** 2
    below = radius[0] ** 2 - d1[1] ** 2 - d2[1] ** 2
    return _arc_cosines((below, above), (2.0 * d1[0] * d2[0], 2.0 * d1[1] * d2[1]))


@kernel
def _beside(radius: Interval, d1: Interval, d2: Interval) -> Interval:
    """Range of β [rad]."""
    above = radius[1] ** 2 + d1[1] ** 2 - d2[0] ** 2
    below = radius[0] ** 2 + d1[0] ** 2 - d2[1] ** 2
    return _arc_cosines((below, above), (2.0 * radius[0] * d1[0], 2.0 * radius[1] * d1[1]))


@kernel
def _arc_cosines(over: Interval, under: Interval) -> Interval:
    """Range of acos(over/under), under > 0 [rad]; π, 0 where no such cosine is within ±1."""
    small, large = max(LEAST, under[0]), max(LEAST, under[1])
    low = over[0] / (small if over[0] < 0.0 else large) - ROUNDING
    high = over[1] / (large if over[1] < 0.0 else small) + ROUNDING
    if low > 1.0 or high < -1.0:
        return math.pi, 0.0
    return math.acos(min(1.0, high)), math.acos(max(-1.0, low))
