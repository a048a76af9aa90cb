"""Postures with the tip at a point, of planar chains with three or more joints.

The tip leaves n − 2 joints free. Where telescopes are in the chain, their extensions are among
these, and with them held the rest is a chain of revolute joints (`telescope_postures`). Of that the
free angles are

    free = (q₁ … q₍ₙ₋₃₎, ψ),  ψ = Σ q

the angles of the inner joints and that of the end link: the inner links held, the last three joints
are an arm of their own, in closed form (`closed_form_3r`), with two elbow branches.

Seen otherwise, two joints close the chain while all others are held (`close_chain`); which two is
free to choose, so that every posture at a joint's limit is among those with this joint held.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.closed_form_3r import joint_angles, within_limits, wrap_near
from mhsb_model.kernels.kernel import kernel
from mhsb_model.telescopes import telescope_kinematics as telescopes
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
    """Whether there is a posture within limits at (x, z) m with these free angles; to q[n] [rad].

    free   float64[n - 2] rad
    elbow  ∓1, the sign of q₍ₙ₋₁₎
    """
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


@kernel
def _two_joint_postures(m: MachineArrays, x: float, z: float) -> FloatArray:
    """Postures within limits at (x, z) m of a chain with two joints, float64[found, 2]."""
    found, count = np.empty((2, 2)), 0
    q = np.empty(2)
    for side in (-1, 1):
        if close_chain(m, x, z, 0, 1, side, q) and within_limits(m, q):
            found[count] = q
            count += 1
    return found[:count]


def telescope_postures(
    m: MachineArrays, slides: telescopes.Slides, x: float, z: float, psi: FloatArray
) -> FloatArray:
    """Postures within limits at (x, z) m of a chain in which joints slide, float64[found, n].

    `INNER_SAMPLES` extensions of each telescope, limits included. Where two joints turn, these
    close the chain in closed form, and ψ follows; where more do, ψ is one of `psi` [rad].
    """
    found = [np.empty((0, len(slides)))]
    for extension in telescopes.extension_samples(m, slides, INNER_SAMPLES):
        held = telescopes.with_extensions_held(m, slides, extension)
        if len(held.link_length) == 2:
            angles = _two_joint_postures(held, x, z)
        else:
            angles = postures(held, x, z, psi)
        found.append(telescopes.with_extensions(slides, angles, extension))
    return np.concatenate(found)


@kernel
def _rigid(link_length: FloatArray, q: FloatArray, first: int, last: int) -> tuple[float, ...]:
    """Links first … last − 1 as one: its length [m], its direction, and by how much the last link
    is turned [rad], both from the first link."""
    heading, ahead, across = 0.0, 0.0, 0.0
    for k in range(first, last):
        if k > first:
            heading += q[k]
        ahead += link_length[k] * math.cos(heading)
        across += link_length[k] * math.sin(heading)
    return math.hypot(ahead, across), math.atan2(across, ahead), heading


@kernel(borrows=True)
def close_chain(
    m: MachineArrays, x: float, z: float, i: int, j: int, side: int, q: FloatArray
) -> bool:
    """Angles of joints i < j that put the tip at (x, z) m while all others are held; into q[n].

    The links from i to j, and from j to the tip, are rigid, D₁ and D₂ long. With t from joint i to
    the tip: cos γ = (t² − D₁² − D₂²)/(2 D₁ D₂), γ = ±acos the angle between them (`side`). Whether
    there is such a posture; limits are not looked at, angles are those nearest to the middle of a
    joint's range. Oracle: SciPy's root finder on the forward kinematics.
    """
    heading = 0.0
    for k in range(i):
        heading += q[k]
        x -= m.link_length[k] * math.cos(heading)
        z -= m.link_length[k] * math.sin(heading)
    d1, beta1, turned = _rigid(m.link_length, q, i, j)
    d2, beta2, _ = _rigid(m.link_length, q, j, len(q))
    if d1 == 0.0 or d2 == 0.0:
        return False
    cosine = (x * x + z * z - d1 * d1 - d2 * d2) / (2.0 * d1 * d2)
    if abs(cosine) > 1.0 + TANGENT:
        return False
    gamma = side * math.acos(min(1.0, max(-1.0, cosine)))
    qi = math.atan2(z, x) - math.atan2(d2 * math.sin(gamma), d1 + d2 * math.cos(gamma))
    q[i] = wrap_near(qi - beta1 - heading, 0.5 * (m.joint_min[i] + m.joint_max[i]))
    q[j] = wrap_near(
        gamma - beta2 + beta1 - turned, 0.5 * (m.joint_min[j] + m.joint_max[j])
    )
    return True


@kernel(borrows=True)
def side_of(m: MachineArrays, q: FloatArray, i: int, j: int) -> int:
    """The `side` of `close_chain` on which joints i < j close the chain in posture q[n] [rad].

    +1 where γ > 0: where the tip is to the left of the line from joint i to joint j.
    """
    heading, x, z, ahead, up = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(q)):
        heading += q[k]
        along, across = math.cos(heading), math.sin(heading)
        if k >= j:
            ahead += m.link_length[k] * along
            up += m.link_length[k] * across
        elif k >= i:
            x += m.link_length[k] * along
            z += m.link_length[k] * across
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
