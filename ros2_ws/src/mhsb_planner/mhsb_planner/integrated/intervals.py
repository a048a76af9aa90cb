"""Interval arithmetic of planar chains: ranges of distances, directions and cylinder lengths.

Every function returns an enclosure: all possible values lie in the range, which may be too wide.
"""

import math

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.types import FloatArray

INTERVAL_ROUNDING = 1e-9
"""Rounding error by which intervals are widened [rad or m] and cosines may pass ±1."""

Interval = tuple[float, float]
"""Lower and upper end of a range."""


@kernel
def cosine_range(low: float, high: float) -> Interval:
    """Return the least and greatest cosine over an interval of angles.

    Args:
        low: Lower end of the interval [rad], at most `high`.
        high: Upper end of the interval [rad].

    Returns:
        Least and greatest cosine.
    """
    a, b = math.cos(low), math.cos(high)
    least, most = min(a, b), max(a, b)
    turn = 2.0 * math.pi
    if math.floor(high / turn) > math.floor(low / turn) or low % turn == 0.0:
        most = 1.0
    if math.floor((high - math.pi) / turn) > math.floor((low - math.pi) / turn):
        least = -1.0
    return least, most


@kernel
def _wrist_direction_range(low: float, high: float, radius: float, link: float) -> Interval:
    """Return the range of the wrist's direction α over link directions, at one tip distance.

    A link of length L leads from the wrist to the tip, and the tip is at distance R from the
    origin. All directions are relative to the direction of the tip. The link has the direction u,
    and the wrist has the direction α:

        α = atan2(−L sin u, R − L cos u)

    For R > L, α has its extremes ±asin(L/R) at cos u = L/R. For R ≤ L, α grows with u and is not
    wrapped at ±π.

    Args:
        low: Lower end of the interval of u [rad]; at least 0 if R ≤ L.
        high: Upper end of the interval of u [rad].
        radius: Distance R of the tip from the origin [m].
        link: Length L of the link [m].

    Returns:
        Least and greatest α [rad].
    """
    if radius <= link:
        return _unwrapped_wrist_direction(low, radius, link), _unwrapped_wrist_direction(
            high, radius, link
        )
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
def _unwrapped_wrist_direction(u: float, radius: float, link: float) -> float:
    """Return the wrist's direction α for a tip nearer to the origin than the link is long.

    A link of length L leads from the wrist to the tip at distance R ≤ L. All directions are
    relative to the direction of the tip. The link has the direction u, and the wrist has the
    direction

        α = atan2(−L sin u, R − L cos u)

    α is continued over whole turns, so that it grows with u. For R < L it is −π at u = 0 and grows
    by 2π with every turn. For R = L and a whole turn, the wrist is at the origin and has no
    direction, which the caller must exclude. There α jumps by π, such as from π/2 to 3π/2 at u =
    2π.

    Args:
        u: Direction of the link relative to the tip's direction [rad].
        radius: Distance R of the tip from the origin [m].
        link: Length L of the link [m].

    Returns:
        Direction α of the wrist relative to the tip's direction [rad].
    """
    turns = math.floor(u / (2.0 * math.pi))
    w = min(math.pi, max(-math.pi, u - (2.0 * turns + 1.0) * math.pi))
    around = math.atan2(link * math.sin(w), radius + link * math.cos(w))
    return around + 2.0 * math.pi * turns


@kernel
def _intersect_modulo_turns(low: float, high: float, least: float, most: float) -> Interval:
    """Intersect a range of angles with an interval and its copies, shifted by whole turns.

    Args:
        low: Lower end of the interval [rad].
        high: Upper end of the interval [rad].
        least: Lower end of the range [rad].
        most: Upper end of the range [rad].

    Returns:
        Smallest interval that contains the intersections for all shifts by −2 to 2 turns [rad].
        (inf, −inf) means that there is no intersection. Intervals with a gap of at most
        INTERVAL_ROUNDING count as touching.
    """
    found_low, found_high = math.inf, -math.inf
    for turns in range(-2, 3):
        a = max(low + 2.0 * math.pi * turns, least)
        b = min(high + 2.0 * math.pi * turns, most)
        if a <= b + INTERVAL_ROUNDING:
            found_low, found_high = min(found_low, a), max(found_high, b)
    return found_low, found_high


@kernel
def tip_relative_to_link_end(
    radius: Interval, direction: Interval, link: float, low: float, high: float
) -> tuple[Interval, Interval]:
    """Compute intervals of the tip's polar coordinates relative to the end of a link.

    The link begins at the origin; it has the length L and the direction θ. The tip is at distance R
    in direction φ. With u = θ − φ, the tip seen from the link's end has the distance D and the
    direction φ + α:

        D² = R² + L² − 2 R L cos u
        direction = φ + α(u),  α = atan2(−L sin u, R − L cos u)

    Args:
        radius: Range of the tip's distance R from the origin [m].
        direction: Range of the tip's direction φ [rad].
        link: Length L of the link [m].
        low: Lower end of the range of the link's direction θ [rad].
        high: Upper end of the range of θ [rad].

    Returns:
        Range of the distance D [m], and range of the direction φ + α [rad], measured from the same
        axis as θ and φ. Both contain all possible values, but the range of the direction may be
        shifted by a multiple of 2π.
    """
    cosine = cosine_range(low - direction[1], high - direction[0])
    nearest = min(max(link * cosine[1], radius[0]), radius[1])
    least = nearest * nearest + link * link - 2.0 * nearest * link * cosine[1]
    most = 0.0
    for r in radius:
        most = max(most, r * r + link * link - 2.0 * r * link * cosine[0])
    alpha = wrist_direction_range(low - direction[1], high - direction[0], radius, link)
    distances = math.sqrt(max(0.0, least)), math.sqrt(most)
    return distances, (direction[0] + alpha[0], direction[1] + alpha[1])


@kernel
def wrist_direction_range(low: float, high: float, radius: Interval, link: float) -> Interval:
    """Return the range of the wrist's direction α over link directions and tip distances.

    A link of length L leads from the wrist to the tip, and the tip is at distance R from the
    origin. All directions are relative to the direction of the tip. The link has the direction u,
    and the wrist has the direction

        α = atan2(−L sin u, R − L cos u)

    α is monotone in R, so both ends of the range of R suffice. If the wrist may lie at the origin
    (R = L, u a whole turn), the result is (−π, π).

    Args:
        low: Lower end of the interval of u [rad].
        high: Upper end of the interval of u [rad].
        radius: Range of the tip's distance R from the origin [m].
        link: Length L of the link [m].

    Returns:
        Least and greatest α [rad]. Both may be shifted by the same whole number of turns, so they
        need not lie in −π … π.
    """
    if radius[0] - INTERVAL_ROUNDING < link:
        turn = 2.0 * math.pi
        shift = turn * math.floor(low / turn)
        low, high = low - shift, high - shift
        if link < radius[1] + INTERVAL_ROUNDING and (
            low < INTERVAL_ROUNDING or high > turn - INTERVAL_ROUNDING
        ):
            return -math.pi, math.pi
    one = _wrist_direction_range(low, high, radius[0], link)
    other = _wrist_direction_range(low, high, radius[1], link)
    return min(one[0], other[0]), max(one[1], other[1])


@kernel(borrows=True)
def enclose_lengths(m: MachineArrays, j: int, low: float, high: float, box: FloatArray) -> bool:
    """Compute the range of cylinder length j for an interval of its joint's positions.

    The interval is first widened by INTERVAL_ROUNDING and clipped to the joint limits. For a
    turning joint, copies of the interval shifted by up to 2 whole turns are included.

    Args:
        m: Arrays of the machine.
        j: Index of the joint.
        low: Lower end of the interval [rad or m].
        high: Upper end of the interval [rad or m].
        box: Written in place, shape (2, n): box[0, j] shortest and box[1, j] longest length [m].

    Returns:
        False if no position of the interval is within the joint limits; `box` is then unchanged.
    """
    low, high = low - INTERVAL_ROUNDING, high + INTERVAL_ROUNDING
    if m.slides[j]:
        inside = max(low, m.joint_min[j]), min(high, m.joint_max[j])
    else:
        inside = _intersect_modulo_turns(low, high, m.joint_min[j], m.joint_max[j])
    if inside[0] > inside[1] + INTERVAL_ROUNDING:
        return False
    a = cylinder_length(m.linkage[j], inside[0])
    b = cylinder_length(m.linkage[j], inside[1])
    box[0, j], box[1, j] = min(a, b), max(a, b)
    return True
