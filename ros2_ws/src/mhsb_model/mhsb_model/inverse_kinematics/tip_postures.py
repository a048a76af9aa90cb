"""Postures with the tip at a point, for planar chains with three or more joints.

A tip position leaves n − 2 degrees of freedom. If all joints are revolute, the free variables are
the angles of the inner joints and the end-link angle:

    free = (q₁ … q₍ₙ₋₃₎, ψ),  ψ = Σ q

With the inner joints held, the last three joints have a closed-form solution with two elbow
branches (`closed_form_3r`).

In general, two joints close the chain while all others are held (`close_chain`). Any two joints can
be chosen, so a posture with a joint at its limit is found with this joint held. With telescopes in
the chain, the last two revolute joints close it, and the free variables are the positions of all
other joints.

All functions work in the arm's plane, with the origin at its first joint. For an arm that slews,
they take the arrays of `Machine.planar_arm`, which leave out the slew.
"""

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.closed_form_3r import (
    is_within_limits,
    solve_last_three_joints,
    wrap_near,
)
from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import add_extension, get_turn_angle
from mhsb_model.types import FloatArray

LEAST_JOINTS = 3
"""Least number of joints; with fewer, a tip position leaves planners no angle to choose."""

INNER_SAMPLES = 24
"""Number of samples of each inner joint's angle and of each held telescope's extension."""

COSINE_TOLERANCE = 1e-12
"""Excess of a cosine over ±1 that counts as rounding, as in a stretched-out triangle."""


@kernel(borrows=True)
def transform_tip_to_outer_frame(
    link_length: FloatArray, x: float, z: float, q: FloatArray
) -> tuple[float, float, float]:
    """Transform the tip position into the frame of the link before the last three joints.

    This frame has its origin at the third-last joint. Its first axis is along the link before that
    joint.

    Args:
        link_length: Length of each link, float64[n], [m].
        x: Tip position forward in the arm's plane [m].
        z: Tip position up [m].
        q: Posture of a chain of revolute joints, float64[n], [rad]. Only the first n − 3 angles are
            read.

    Returns:
        Tip position along the frame's first and second axis [m], and the angle of its first axis
        from the x axis [rad]. With three joints: x, z and 0.
    """
    heading = 0.0
    inner = len(q) - 3
    for i in range(inner):
        heading += q[i]
        x -= link_length[i] * math.cos(heading)
        z -= link_length[i] * math.sin(heading)
    if inner == 0:
        return x, z, heading
    cosine, sine = math.cos(heading), math.sin(heading)
    return x * cosine + z * sine, z * cosine - x * sine, heading


@kernel(borrows=True)
def solve_posture(
    m: MachineArrays, x: float, z: float, free: FloatArray, elbow: int, q: FloatArray
) -> bool:
    """Compute the posture for a tip position and given free variables, and check its limits.

    A tip position fixes two of n joints. The free variables give the others.

    Args:
        m: Planar machine (without a slewing joint), with n joints.
        x: Tip position forward [m].
        z: Tip position up [m].
        free: Free variables, float64[n - 2], [rad or m]. Without telescopes: the first n − 3 joint
            angles, then the end-link angle ψ (the sum of all angles). With telescopes: the
            positions, in joint order, of all joints except the last two revolute joints.
        elbow: Branch of the solution, −1 or 1. Without telescopes: the sign of the second-last
            joint's angle. With telescopes: 1 if the tip is to the left of the line from the first
            to the second of the last two revolute joints, else −1.
        q: Posture, float64[n], written in place [rad or m]; partly overwritten if there is none.

    Returns:
        True if there is such a posture and it is within the joint limits.
    """
    if has_prismatic_joint(m):
        return solve_posture_with_held_joints(m, x, z, find_closing_joints(m), free, elbow, q)
    inner = len(q) - 3
    for i in range(inner):
        q[i] = free[i]
    ahead, up, heading = transform_tip_to_outer_frame(m.link_length, x, z, q)
    return solve_last_three_joints(
        m, ahead, up, free[inner] - heading, elbow, q
    ) and is_within_limits(m, q)


@kernel(borrows=True)
def write_inner_angles(m: MachineArrays, combination: int, samples: int, q: FloatArray) -> None:
    """Write one sample of the inner joints' angles into a posture.

    The inner joints are all but the last three. Each has `samples` evenly spaced angles from limit
    to limit. All combinations of these angles are numbered; the first joint's angle changes fastest
    with the number.

    Args:
        m: Machine with the joint limits.
        combination: Number of the combination, 0 … samples^(n − 3) − 1.
        samples: Number of angles of each inner joint, at least 2.
        q: Posture, float64[n]; the first n − 3 angles are written in place [rad].
    """
    for i in range(len(q) - 3):
        share = (combination % samples) / (samples - 1)
        combination //= samples
        q[i] = (1.0 - share) * m.joint_min[i] + share * m.joint_max[i]


@kernel
def find_postures(m: MachineArrays, x: float, z: float, psi: FloatArray) -> FloatArray:
    """Find postures within limits for a tip position and given end-link angles.

    With three joints the result is complete. With more, the angles of all but the last three joints
    are sampled: each takes INNER_SAMPLES evenly spaced values, in all combinations.

    Args:
        m: Planar machine (without a slewing joint), with n revolute joints.
        x: Tip position forward [m].
        z: Tip position up [m].
        psi: End-link angles ψ to look at (sums of all joint angles), float64[k], [rad].

    Returns:
        Postures in the order of `psi`, float64[found, n], [rad]; each ψ can have no posture, one or
        several.
    """
    n = len(m.link_length)
    inner = INNER_SAMPLES ** (n - 3)
    found = np.empty((2 * len(psi) * inner, n))
    count = 0
    q = np.empty(n)
    for angle in psi:
        for number in range(inner):
            write_inner_angles(m, number, INNER_SAMPLES, q)
            ahead, up, heading = transform_tip_to_outer_frame(m.link_length, x, z, q)
            for elbow in (-1, 1):
                if solve_last_three_joints(
                    m, ahead, up, angle - heading, elbow, q
                ) and is_within_limits(m, q):
                    copy_row(found[count], q)
                    count += 1
    return found[:count]


@kernel(borrows=True)
def _combine_links(
    m: MachineArrays, q: FloatArray, first: int, last: int
) -> tuple[float, float, float]:
    """Compute the straight line from the beginning of a link to the end of a later link.

    All joints after joint `first` are held at q. Directions are relative to link `first`, so the
    angle of joint `first` has no influence.

    Args:
        m: Planar machine (without a slewing joint).
        q: Posture, float64[n], [rad or m].
        first: Index of the first link.
        last: Index after the last link.

    Returns:
        Length of the line [m], its direction [rad], and the direction of the last link, whose index
        is `last` − 1 [rad].
    """
    heading, ahead, across = 0.0, 0.0, 0.0
    for k in range(first, last):
        if k > first:
            heading += get_turn_angle(m.turns, q, k)
        length = add_extension(m.slides, m.link_length, q, k)
        ahead += length * math.cos(heading)
        across += length * math.sin(heading)
    return math.hypot(ahead, across), math.atan2(across, ahead), heading


class OuterTip(NamedTuple):
    """Tip position seen from a joint of the chain.

    Attributes:
        x: Tip position forward of the joint, in the base frame [m].
        z: Tip position above the joint [m].
        heading: Direction of the link before the joint [rad].
    """

    x: float
    z: float
    heading: float


@kernel(borrows=True)
def close_chain(
    m: MachineArrays, x: float, z: float, i: int, j: int, side: int, q: FloatArray
) -> bool:
    """Move joints i and j so that the tip is at a point, and keep all other joints.

    There are up to two solutions; `side` selects one. Joint limits are not checked. Whole turns are
    added to each angle, so that it is within half a turn of the middle of its joint's range.

    Tested against SciPy's root finder on the forward kinematics.

    Args:
        m: Planar machine (without a slewing joint).
        x: Tip position forward [m].
        z: Tip position up [m].
        i: Index of the first joint that moves.
        j: Index of the second joint that moves, j > i.
        side: Solution, −1 or 1. `find_closure_side` returns the side of a given posture. If both
            joints slide, only 1 is valid.
        q: Posture, float64[n], [rad or m]. q[i] and q[j] are written in place; they may be
            overwritten even if there is no solution.

    Returns:
        True if there is a solution.
    """
    heading = 0.0
    for k in range(i):
        heading += get_turn_angle(m.turns, q, k)
        length = add_extension(m.slides, m.link_length, q, k)
        x -= length * math.cos(heading)
        z -= length * math.sin(heading)
    tip = OuterTip(x, z, heading)
    if not m.slides[i] and not m.slides[j]:
        return _close_with_revolute_joints(m, tip, i, j, side, q)
    return _close_with_prismatic_joints(m, tip, i, j, side, q)


@kernel(borrows=True)
def _close_with_revolute_joints(
    m: MachineArrays, tip: OuterTip, i: int, j: int, side: int, q: FloatArray
) -> bool:
    """Move two revolute joints so that the tip is at a point.

    All other joints stay where they are. There are up to two solutions.

    The links from joint i to joint j form a rigid body of the length D₁. The links from joint j to
    the tip form a second rigid body, of the length D₂. t is the distance from joint i to the tip,
    and γ the angle between both bodies:

        cos γ = (t² − D₁² − D₂²)/(2 D₁ D₂),   γ = side · acos(cos γ)

    Whole turns are added to each angle, so that it is within half a turn of the middle of its
    joint's range.

    Args:
        m: Planar machine (without a slewing joint).
        tip: Tip position relative to joint i, and direction of the link before joint i.
        i: Index of the first joint that moves.
        j: Index of the second joint that moves.
        side: Solution, −1 or 1: the sign of γ.
        q: Posture, float64[n]. q[i] and q[j] are written in place if there is a solution [rad].

    Returns:
        True if there is a solution. False if the point is out of reach, or D₁ or D₂ is 0.
    """
    x, z, heading = tip
    d1, beta1, turn = _combine_links(m, q, i, j)
    d2, beta2, _ = _combine_links(m, q, j, len(q))
    if d1 == 0.0 or d2 == 0.0:
        return False
    cosine = (x * x + z * z - d1 * d1 - d2 * d2) / (2.0 * d1 * d2)
    if abs(cosine) > 1.0 + COSINE_TOLERANCE:
        return False
    gamma = side * math.acos(min(1.0, max(-1.0, cosine)))
    qi = math.atan2(z, x) - math.atan2(d2 * math.sin(gamma), d1 + d2 * math.cos(gamma))
    q[i] = wrap_near(qi - beta1 - heading, 0.5 * (m.joint_min[i] + m.joint_max[i]))
    q[j] = wrap_near(gamma - beta2 + beta1 - turn, 0.5 * (m.joint_min[j] + m.joint_max[j]))
    return True


@kernel(borrows=True)
def _close_with_prismatic_joints(
    m: MachineArrays, tip: OuterTip, i: int, j: int, side: int, q: FloatArray
) -> bool:
    """Move two joints, at least one of them prismatic, so that the tip is at a point.

    All other joints stay where they are. There are up to two solutions.

    The vectors are in the base frame. t leads from joint i to the point. With qᵢ = qⱼ = 0, a leads
    from joint i to joint j, and b from joint j to the tip. e and f are unit vectors along which
    joints i and j slide:

        j slides, i turns   |a + b + qⱼ f| = |t|, then qᵢ turns a + b + qⱼ f to t
        i slides, j turns   |t − a − qᵢ e| = |b|, then qⱼ turns b to t − a − qᵢ e
        both slide          qᵢ e + qⱼ f = t − a − b

    Whole turns are added to an angle, so that it is within half a turn of the middle of its joint's
    range.

    Args:
        m: Planar machine (without a slewing joint).
        tip: Tip position relative to joint i, and direction of the link before joint i.
        i: Index of the first joint that moves.
        j: Index of the second joint that moves.
        side: Solution, −1 or 1, the sign of the square root in the quadratic equation; only 1 if
            both joints slide.
        q: Posture, float64[n], [rad or m]. q[i] and q[j] are overwritten in place, even if there is
            no solution.

    Returns:
        True if there is a solution. False if there is none, or if both joints slide along parallel
        lines.
    """
    x, z, heading = tip
    q[i] = q[j] = 0.0
    ax, az, ahead = _compute_offset(m, q, i, j, heading)
    bx, bz, _ = _compute_offset(m, q, j, len(q), ahead)
    ex, ez, fx, fz = math.cos(heading), math.sin(heading), math.cos(ahead), math.sin(ahead)
    if m.slides[i] and m.slides[j]:
        across, wx, wz = ex * fz - ez * fx, x - ax - bx, z - az - bz
        if side < 0 or abs(across) < COSINE_TOLERANCE:
            return False
        q[i], q[j] = (wx * fz - wz * fx) / across, (ex * wz - ez * wx) / across
        return True
    if m.slides[i]:
        found, slid = intersect_line_with_circle(x - ax, z - az, -ex, -ez, bx * bx + bz * bz, side)
        wx, wz = x - ax - slid * ex, z - az - slid * ez
        turning, turn = j, math.atan2(wz, wx) - math.atan2(bz, bx)
        q[i] = slid
    else:
        found, slid = intersect_line_with_circle(ax + bx, az + bz, fx, fz, x * x + z * z, side)
        wx, wz = ax + bx + slid * fx, az + bz + slid * fz
        turning, turn = i, math.atan2(z, x) - math.atan2(wz, wx)
        q[j] = slid
    q[turning] = wrap_near(turn, 0.5 * (m.joint_min[turning] + m.joint_max[turning]))
    return found


@kernel(borrows=True)
def _compute_offset(
    m: MachineArrays, q: FloatArray, first: int, last: int, heading: float
) -> tuple[float, float, float]:
    """Compute the vector from one joint of the chain to a later one, in the base frame.

    Args:
        m: Planar machine (without a slewing joint).
        q: Posture, float64[n], [rad or m].
        first: Index of the first joint.
        last: Index of the later joint; n for the tip.
        heading: Direction of the link before the first joint [rad].

    Returns:
        Vector (x, z) [m], and the direction of the link before joint `last` [rad].
    """
    x, z = 0.0, 0.0
    for k in range(first, last):
        heading += get_turn_angle(m.turns, q, k)
        length = add_extension(m.slides, m.link_length, q, k)
        x += length * math.cos(heading)
        z += length * math.sin(heading)
    return x, z, heading


@kernel(borrows=True)
def intersect_line_with_circle(
    px: float, pz: float, ex: float, ez: float, squared_radius: float, side: int
) -> tuple[bool, float]:
    """Intersect a straight line with a circle around the origin.

    The line is p + s e with |e| = 1, R is the circle's radius, and × the cross product:

        s = −p·e ± √(R² − (p × e)²)

    Args:
        px: Point p of the line, first coordinate [m].
        pz: Point p of the line, second coordinate [m].
        ex: Direction e, first coordinate.
        ez: Direction e, second coordinate.
        squared_radius: R² [m²].
        side: Sign of the square root, −1 or 1.

    Returns:
        Whether the line meets the circle (up to rounding), and s of the selected intersection [m].
        If the line misses the circle, s belongs to the point of the line that is nearest to the
        origin.
    """
    across = px * ez - pz * ex
    under = squared_radius - across * across
    return under >= -COSINE_TOLERANCE, side * math.sqrt(max(0.0, under)) - (px * ex + pz * ez)


@kernel(borrows=True)
def has_prismatic_joint(m: MachineArrays) -> bool:
    """Return whether a joint of the machine slides."""
    return bool(m.slides.any())


@kernel(borrows=True)
def find_closing_joints(m: MachineArrays) -> tuple[int, int]:
    """Return the indices of the last two revolute joints, which bring the tip to a given place.

    Only prismatic joints come between these two and after them. So the links between the two form
    one straight line, and the links from the second joint on form another.

    Args:
        m: Planar machine (without a slewing joint).

    Returns:
        Indices i < j. With one revolute joint, i is −1; without revolute joints, i and j are −1.
    """
    i = j = -1
    for k in range(len(m.slides)):
        if not m.slides[k]:
            i, j = j, k
    return i, j


@kernel(borrows=True, forceinline=True)  # inlined, since passing `m` costs more than the call
def solve_posture_with_held_joints(
    m: MachineArrays,
    x: float,
    z: float,
    moved: tuple[int, int],
    held_positions: FloatArray,
    side: int,
    q: FloatArray,
) -> bool:
    """Compute the posture for a tip position in which two joints move and all others are held.

    Args:
        m: Planar machine (without a slewing joint), with n joints.
        x: Tip position forward [m].
        z: Tip position up [m].
        moved: Indices i < j of the two joints that move.
        held_positions: Positions of all other joints in joint order, float64[n - 2], [rad or m].
        side: Selects one of up to two solutions, −1 or 1. `find_closure_side` returns the side of a
            given posture. If both joints slide, only 1 is valid.
        q: Posture, float64[n], overwritten in place, even if there is no solution [rad or m].

    Returns:
        True if there is such a posture and it is within the joint limits.
    """
    at, (i, j) = 0, moved
    for k in range(len(q)):
        if k not in (i, j):
            q[k] = held_positions[at]
            at += 1
    return close_chain(m, x, z, i, j, side, q) and is_within_limits(m, q)


@kernel(borrows=True)
def find_closure_side(m: MachineArrays, q: FloatArray, i: int, j: int) -> int:
    """Return the value of `side` for which `close_chain` reproduces a given posture.

    `close_chain` moves joints i and j so that the tip is at a point, and `side` selects one of two
    solutions. The result is 1 in these cases, else −1:

    - Both joints turn: the tip is to the left of the line from joint i to joint j.
    - Only j slides: the tip is ahead of joint i, seen along the direction in which j slides.
    - Only i slides: the tip is behind joint j, seen along the direction in which i slides.
    - Both slide: always.

    Args:
        m: Planar machine (without a slewing joint).
        q: Posture, float64[n], [rad or m].
        i: Index of the first joint.
        j: Index of the second joint, j > i.

    Returns:
        −1 or 1, the argument `side` of `close_chain`.
    """
    heading, x, z, ahead, up = 0.0, 0.0, 0.0, 0.0, 0.0
    ex = ez = fx = fz = 0.0
    for k in range(len(q)):
        heading += get_turn_angle(m.turns, q, k)
        length = add_extension(m.slides, m.link_length, q, k)
        along, across = math.cos(heading), math.sin(heading)
        if k == i:
            ex, ez = along, across
        if k == j:
            fx, fz = along, across
        if k >= j:
            ahead += length * along
            up += length * across
        elif k >= i:
            x += length * along
            z += length * across
    if m.slides[i] and m.slides[j]:
        return 1
    if m.slides[i]:
        return 1 if ahead * ex + up * ez < 0.0 else -1
    if m.slides[j]:
        return 1 if (x + ahead) * fx + (z + up) * fz > 0.0 else -1
    return 1 if x * up - z * ahead > 0.0 else -1


@kernel
def find_nearest_posture(
    m: MachineArrays, x: float, z: float, given: FloatArray, q: FloatArray
) -> bool:
    """Find a posture with the tip at a point by moving two joints of a given posture.

    All pairs of joints are tried. The other joints keep their given positions; a position outside
    its limits becomes the nearest limit. For each solution the largest change of a joint is
    computed, where 1 m counts as 1 rad. The solution with the smallest such change is the result.

    Args:
        m: Planar machine (without a slewing joint).
        x: Tip position forward [m].
        z: Tip position up [m].
        given: Given posture, which may exceed the limits, float64[n], [rad or m].
        q: Result within the limits, float64[n], written in place if there is one [rad or m].

    Returns:
        True if a solution within the limits was found.
    """
    n, least = len(q), math.inf
    trial = np.empty(n)
    for i in range(n):
        for j in range(i + 1, n):
            for side in (-1, 1):
                for k in range(n):
                    trial[k] = min(max(given[k], m.joint_min[k]), m.joint_max[k])
                if close_chain(m, x, z, i, j, side, trial) and is_within_limits(m, trial):
                    change = 0.0
                    for k in range(n):
                        change = max(change, abs(trial[k] - given[k]))
                    if change < least:
                        least = change
                        copy_row(q, trial)
    return least < math.inf
