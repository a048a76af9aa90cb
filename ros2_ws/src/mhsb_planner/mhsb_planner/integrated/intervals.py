"""Interval arithmetic of planar chains: what distances, directions and lengths may be.

Every function encloses the range of what it is named for: no value lies outside, some inside may
never be met.
"""

from __future__ import annotations

import math

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.types import FloatArray

ROUNDING = 1e-9

Interval = tuple[float, float]


@kernel
def cosine_over(low: float, high: float) -> Interval:
    """Range of cos over [low, high] rad."""
    a, b = math.cos(low), math.cos(high)
    least, most = min(a, b), max(a, b)
    turn = 2.0 * math.pi
    if math.floor(high / turn) > math.floor(low / turn) or low % turn == 0.0:
        most = 1.0
    if math.floor((high - math.pi) / turn) > math.floor((low - math.pi) / turn):
        least = -1.0
    return least, most


@kernel
def _wrist_direction(low: float, high: float, radius: float, link: float) -> Interval:
    """Range of α over u ∈ [low, high] rad; where R ≤ L₃, u in the first turn or beyond it.

    For R > L₃ it turns where cos u = L₃/R; otherwise the wrist goes round the origin with u.
    """
    if radius <= link:
        return _around_origin(low, radius, link), _around_origin(high, radius, link)
    a = math.atan2(-link * math.sin(low), radius - link * math.cos(low))
    b = math.atan2(-link * math.sin(high), radius - link * math.cos(high))
    least, most = min(a, b), max(a, b)
    extreme = math.asin(link / radius)
    turn = 2.0 * math.pi
    for side in (-1.0, 1.0):
        at = side * math.acos(link / radius)
        if math.floor((high - at) / turn) > math.floor((low - at) / turn):
            least = min(least, -side * extreme)
            most = max(most, -side * extreme)
    return least, most


@kernel
def _around_origin(u: float, radius: float, link: float) -> float:
    """α where R ≤ L₃, continuous and growing with u ≥ 0, −π at u = 0 and 2π more every turn."""
    turns = math.floor(u / (2.0 * math.pi))
    w = min(math.pi, max(-math.pi, u - (2.0 * turns + 1.0) * math.pi))
    around = math.atan2(link * math.sin(w), radius + link * math.cos(w))
    return around + 2.0 * math.pi * turns


@kernel
def _within(low: float, high: float, least: float, most: float) -> Interval:
    """The part of an interval of angles, taken by whole turns, that lies within [least, most]."""
    found_low, found_high = math.inf, -math.inf
    for turns in range(-2, 3):
        a = max(low + 2.0 * math.pi * turns, least)
        b = min(high + 2.0 * math.pi * turns, most)
        if a <= b + ROUNDING:
            found_low, found_high = min(found_low, a), max(found_high, b)
    return found_low, found_high


@kernel
def without_link(
    radius: Interval, direction: Interval, link: float, low: float, high: float
) -> tuple[Interval, Interval]:
    """Distances and directions of the tip as the end of a link sees it that points to [low, high].

    D² = R² + L² − 2 R L cos u, direction φ + α(u), u the link's angle less φ: as of the wrist.
    """
    cosine = cosine_over(low - direction[1], high - direction[0])
    nearest = min(max(link * cosine[1], radius[0]), radius[1])
    least = nearest * nearest + link * link - 2.0 * nearest * link * cosine[1]
    most = 0.0
    for r in radius:
        most = max(most, r * r + link * link - 2.0 * r * link * cosine[0])
    alpha = directions(low - direction[1], high - direction[0], radius, link)
    distances = math.sqrt(max(0.0, least)), math.sqrt(most)
    return distances, (direction[0] + alpha[0], direction[1] + alpha[1])


@kernel
def directions(low: float, high: float, radius: Interval, link: float) -> Interval:
    """Range of α over u ∈ [low, high] rad and distances in `radius`: α is monotone in these.

    Any, where the wrist may be at the origin: R = L₃ and u = 0.
    """
    if radius[0] - ROUNDING < link:
        turn = 2.0 * math.pi
        shift = turn * math.floor(low / turn)
        low, high = low - shift, high - shift
        if link < radius[1] + ROUNDING and (low < ROUNDING or high > turn - ROUNDING):
            return -math.pi, math.pi
    one = _wrist_direction(low, high, radius[0], link)
    other = _wrist_direction(low, high, radius[1], link)
    return min(one[0], other[0]), max(one[1], other[1])


@kernel
def enclose_lengths(
    m: MachineArrays, j: int, low: float, high: float, box: FloatArray
) -> bool:
    """Lengths of cylinder j with its joint in [low, high] rad or m, angles by whole turns, to
    box[:, j] [m]; False where none is within limits."""
    low, high = low - ROUNDING, high + ROUNDING
    if m.slides[j]:
        inside = max(low, m.joint_min[j]), min(high, m.joint_max[j])
    else:
        inside = _within(low, high, m.joint_min[j], m.joint_max[j])
    if inside[0] > inside[1] + ROUNDING:
        return False
    a = cylinder_length(m.linkage[j], inside[0])
    b = cylinder_length(m.linkage[j], inside[1])
    box[0, j], box[1, j] = min(a, b), max(a, b)
    return True
