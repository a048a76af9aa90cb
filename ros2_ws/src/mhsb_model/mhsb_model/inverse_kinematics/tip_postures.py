"""Postures with the tip at a point, of planar chains with three or more joints.

The tip leaves n − 2 joints free. Where all joints turn, the free angles are

    free = (q₁ … q₍ₙ₋₃₎, ψ),  ψ = Σ q

the angles of the inner joints and that of the end link: the inner links held, the last three joints
are an arm of their own, in closed form (`closed_form_3r`), with two elbow branches.

Seen otherwise, two joints close the chain while all others are held (`close_chain`); which two is
free to choose, so that every posture at a joint's limit is among those with this joint held. Where
telescopes are in the chain, what is free are all joints but the last two that turn, which close it.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.closed_form_3r import joint_angles, within_limits, wrap_near
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import extended, turned
from mhsb_model.types import FloatArray

LEAST_JOINTS = 3
"""Fewer leave no angle free at a tip position, which is what all planners choose."""

INNER_SAMPLES = 24
"""Angles of each inner joint, and extensions of a telescope, for which postures are looked for."""

TANGENT = 1e-12
"""A cosine beyond ±1 by no more than this is a touching triangle, computed with rounding."""


@kernel
def outer_tip(
    link_length: FloatArray, x: float, z: float, q: FloatArray
) -> tuple[float, float, float]:
    """The tip (x, z) m as the last three joints see it, and how far their frame is turned [rad].

    p = Σ Lᵢ(cos θᵢ, sin θᵢ) over the inner links, θ = Σ qᵢ: the tip less p, turned by −θ.
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
def posture_at(
    m: MachineArrays, x: float, z: float, free: FloatArray, elbow: int, q: FloatArray
) -> bool:
    """Whether there is a posture within limits at (x, z) m with these free joints; to q[n].

    free   float64[n - 2], as above [rad or m]
    elbow  ∓1, the sign of q₍ₙ₋₁₎; of chains with telescopes the side of `close_chain`
    """
    if slides_anywhere(m):
        i, j = closing_joints(m)
        return posture_with(m, x, z, i, j, free, elbow, q)
    inner = len(q) - 3
    for i in range(inner):
        q[i] = free[i]
    ahead, up, heading = outer_tip(m.link_length, x, z, q)
    return joint_angles(m, ahead, up, free[inner] - heading, elbow, q) and within_limits(m, q)


@kernel(borrows=True)
def inner_angles(m: MachineArrays, number: int, samples: int, q: FloatArray) -> None:
    """Put angles of the inner joints into q: `number` counts their even samples, ends included."""
    for i in range(len(q) - 3):
        share = (number % samples) / (samples - 1)
        number //= samples
        q[i] = (1.0 - share) * m.joint_min[i] + share * m.joint_max[i]


@kernel
def postures(m: MachineArrays, x: float, z: float, psi: FloatArray) -> FloatArray:
    """Postures within limits at (x, z) m for the end-link angles ψ, float64[found, n].

    All of them with three joints; with more, `INNER_SAMPLES` of each inner joint.
    """
    n = len(m.link_length)
    inner = INNER_SAMPLES ** (n - 3)
    found = np.empty((2 * len(psi) * inner, n))
    count = 0
    q = np.empty(n)
    for angle in psi:
        for number in range(inner):
            inner_angles(m, number, INNER_SAMPLES, q)
            ahead, up, heading = outer_tip(m.link_length, x, z, q)
            for elbow in (-1, 1):
                if joint_angles(m, ahead, up, angle - heading, elbow, q) and within_limits(m, q):
                    found[count] = q
                    count += 1
    return found[:count]


@kernel(borrows=True)
def _rigid(m: MachineArrays, q: FloatArray, first: int, last: int) -> tuple[float, float, float]:
    """Links first … last − 1 as one: its length [m], its direction, and by how much the last link
    is turned [rad], both from the first link."""
    heading, ahead, across = 0.0, 0.0, 0.0
    for k in range(first, last):
        if k > first:
            heading += turned(m.turns, q, k)
        length = extended(m.slides, m.link_length, q, k)
        ahead += length * math.cos(heading)
        across += length * math.sin(heading)
    return math.hypot(ahead, across), math.atan2(across, ahead), heading


@kernel(borrows=True)
def close_chain(
    m: MachineArrays, x: float, z: float, i: int, j: int, side: int, q: FloatArray
) -> bool:
    """Positions of joints i < j that put the tip at (x, z) m while all others are held; into q[n].

    Whether there is such a posture; limits are not looked at, angles are those nearest to the
    middle of a joint's range. There may be two, which `side` tells apart; of two joints that slide
    there is one, on side +1. Oracle: SciPy's root finder on the forward kinematics.
    """
    heading = 0.0
    for k in range(i):
        heading += turned(m.turns, q, k)
        length = extended(m.slides, m.link_length, q, k)
        x -= length * math.cos(heading)
        z -= length * math.sin(heading)
    if not m.slides[i] and not m.slides[j]:
        return _close_by_turns(m, x, z, heading, i, j, side, q)
    return _close_by_slides(m, x, z, heading, i, j, side, q)


@kernel(borrows=True)
def _close_by_turns(
    m: MachineArrays, x: float, z: float, heading: float, i: int, j: int, side: int, q: FloatArray
) -> bool:
    """`close_chain` of two joints that turn, with the tip (x, z) m seen from joint i.

    The links from i to j, and from j to the tip, are rigid, D₁ and D₂ long. With t from joint i to
    the tip: cos γ = (t² − D₁² − D₂²)/(2 D₁ D₂), γ = ±acos the angle between them (`side`).
    """
    d1, beta1, turn = _rigid(m, q, i, j)
    d2, beta2, _ = _rigid(m, q, j, len(q))
    if d1 == 0.0 or d2 == 0.0:
        return False
    cosine = (x * x + z * z - d1 * d1 - d2 * d2) / (2.0 * d1 * d2)
    if abs(cosine) > 1.0 + TANGENT:
        return False
    gamma = side * math.acos(min(1.0, max(-1.0, cosine)))
    qi = math.atan2(z, x) - math.atan2(d2 * math.sin(gamma), d1 + d2 * math.cos(gamma))
    q[i] = wrap_near(qi - beta1 - heading, 0.5 * (m.joint_min[i] + m.joint_max[i]))
    q[j] = wrap_near(gamma - beta2 + beta1 - turn, 0.5 * (m.joint_min[j] + m.joint_max[j]))
    return True


@kernel(borrows=True)
def _close_by_slides(
    m: MachineArrays, x: float, z: float, heading: float, i: int, j: int, side: int, q: FloatArray
) -> bool:
    """`close_chain` where joint i, or j, or both slide, with the tip (x, z) m seen from joint i.

    With both joints at 0: a from joint i to joint j, b from there to the tip, e and f the
    directions in which they slide, t the tip.

        j slides, i turns   |a + b + qⱼ f| = |t|, then qᵢ turns the one to the other
        i slides, j turns   |t − a − qᵢ e| = |b|, then qⱼ turns b
        both slide          qᵢ e + qⱼ f = t − a − b
    """
    q[i] = q[j] = 0.0
    ax, az, ahead = _offset(m, q, i, j, heading)
    bx, bz, _ = _offset(m, q, j, len(q), ahead)
    ex, ez, fx, fz = math.cos(heading), math.sin(heading), math.cos(ahead), math.sin(ahead)
    if m.slides[i] and m.slides[j]:
        across, wx, wz = ex * fz - ez * fx, x - ax - bx, z - az - bz
        if side < 0 or abs(across) < TANGENT:
            return False
        q[i], q[j] = (wx * fz - wz * fx) / across, (ex * wz - ez * wx) / across
        return True
    if m.slides[i]:
        found, slid = on_circle(x - ax, z - az, -ex, -ez, bx * bx + bz * bz, side)
        wx, wz = x - ax - slid * ex, z - az - slid * ez
        turning, turn = j, math.atan2(wz, wx) - math.atan2(bz, bx)
        q[i] = slid
    else:
        found, slid = on_circle(ax + bx, az + bz, fx, fz, x * x + z * z, side)
        wx, wz = ax + bx + slid * fx, az + bz + slid * fz
        turning, turn = i, math.atan2(z, x) - math.atan2(wz, wx)
        q[j] = slid
    q[turning] = wrap_near(turn, 0.5 * (m.joint_min[turning] + m.joint_max[turning]))
    return found


@kernel(borrows=True)
def _offset(
    m: MachineArrays, q: FloatArray, first: int, last: int, heading: float
) -> tuple[float, float, float]:
    """From joint `first` to joint `last` (x, z) [m], and the direction of the link before that.

    heading  direction of the link before the first [rad]
    """
    x, z = 0.0, 0.0
    for k in range(first, last):
        heading += turned(m.turns, q, k)
        length = extended(m.slides, m.link_length, q, k)
        x += length * math.cos(heading)
        z += length * math.sin(heading)
    return x, z, heading


@kernel(borrows=True)
def on_circle(
    px: float, pz: float, ex: float, ez: float, square: float, side: int
) -> tuple[bool, float]:
    """Whether p + s e, |e| = 1, meets the circle of radius √square about 0, and s [m].

    s = −p·e ± √(square − (p × e)²): the sign is `side`, and that of (p + s e)·e.
    """
    across = px * ez - pz * ex
    under = square - across * across
    return under >= -TANGENT, side * math.sqrt(max(0.0, under)) - (px * ex + pz * ez)


@kernel(borrows=True)
def slides_anywhere(m: MachineArrays) -> bool:
    """Whether a joint slides."""
    return bool(m.slides.any())


@kernel(borrows=True)
def closing_joints(m: MachineArrays) -> tuple[int, int]:
    """The last two joints that turn: all links between them, and beyond, lie in two lines."""
    i = j = -1
    for k in range(len(m.slides)):
        if not m.slides[k]:
            i, j = j, k
    return i, j


@kernel(inline="always", borrows=True)  # called in a loop, it costs less than handing over `m`
def posture_with(
    m: MachineArrays,
    x: float,
    z: float,
    i: int,
    j: int,
    held: FloatArray,
    side: int,
    q: FloatArray,
) -> bool:
    """Whether there is a posture within limits at (x, z) m with all joints but i < j held; to q[n].

    held  float64[n - 2], in order [rad or m]
    side  of `close_chain`
    """
    at = 0
    for k in range(len(q)):
        if k not in (i, j):
            q[k] = held[at]
            at += 1
    return close_chain(m, x, z, i, j, side, q) and within_limits(m, q)


@kernel(borrows=True)
def side_of(m: MachineArrays, q: FloatArray, i: int, j: int) -> int:
    """The `side` of `close_chain` on which joints i < j close the chain in posture q[n].

    Of two that turn +1 where γ > 0: where the tip is to the left of the line from joint i to j.
    Where j slides +1 where the tip is ahead of joint i, where i slides where it is behind joint j,
    seen along what slides.
    """
    heading, x, z, ahead, up = 0.0, 0.0, 0.0, 0.0, 0.0
    ex = ez = fx = fz = 0.0
    for k in range(len(q)):
        heading += turned(m.turns, q, k)
        length = extended(m.slides, m.link_length, q, k)
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
def nearest_posture(m: MachineArrays, x: float, z: float, near: FloatArray, q: FloatArray) -> bool:
    """The posture within limits at (x, z) m of those next to `near`, with two joints moved, to q.

    All pairs of joints are tried with the others held, each put within its limits; of what is
    possible the least change of any joint counts. False where nothing is.
    """
    n, least = len(q), math.inf
    trial = np.empty(n)
    for i in range(n):
        for j in range(i + 1, n):
            for side in (-1, 1):
                for k in range(n):
                    trial[k] = min(max(near[k], m.joint_min[k]), m.joint_max[k])
                if close_chain(m, x, z, i, j, side, trial) and within_limits(m, trial):
                    change = 0.0
                    for k in range(n):
                        change = max(change, abs(trial[k] - near[k]))
                    if change < least:
                        least = change
                        q[:] = trial
    return least < math.inf
