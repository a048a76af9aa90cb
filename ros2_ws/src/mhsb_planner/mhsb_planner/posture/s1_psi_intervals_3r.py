"""Feasible intervals of the end-link angle ψ at a tip position, for the arm with three joints.

With the tip held, an elbow branch reaches a limit only where the wrist meets the edge of its
reach or a joint meets one of its limits. Each of these fixes one side of a triangle, and the law
of cosines gives ψ; between two such angles a branch is feasible throughout or not at all.

Of a chain with more joints these are its last three, tip and ψ as they see them
(`tip_postures.outer_tip`).
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.closed_form_3r import joint_angles, within_limits
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray

MAX_CRITICAL = 16
"""Two each of: outer and inner reach, lower and upper limits of q₁, q₂ and q₃."""

MAX_INTERVALS = 2 * (MAX_CRITICAL + 1)
TANGENT = 1e-12
"""A cosine beyond ±1 by no more than this is a touching triangle, computed with rounding."""


@kernel(borrows=True)
def feasible(m: MachineArrays, x: float, z: float, psi: float, elbow: int, q: FloatArray) -> bool:
    """Whether the posture (ψ, elbow) at (x, z) m exists within limits; the last three of q[n]."""
    return joint_angles(m, x, z, psi, elbow, q) and within_limits(m, q)


@kernel
def _add_pair(found: FloatArray, count: int, center: float, cosine: float) -> int:
    """Append center ± acos(cosine), where that exists."""
    if abs(cosine) > 1.0 + TANGENT:
        return count
    half = math.acos(min(1.0, max(-1.0, cosine)))
    found[count] = center - half
    found[count + 1] = center + half
    return count + 2


@kernel
def _critical_angles(m: MachineArrays, x: float, z: float, found: FloatArray) -> int:
    """All ψ at which either branch can become infeasible, sorted in [−π, π); their number.

    Triangles, with R the distance of the tip and φ its direction:
    reach, q₂: shoulder, wrist (at distance D), tip: cos(ψ − φ) = (R² + L₃² − D²)/(2 L₃ R);
    q₁: elbow (at distance d in direction δ from the tip), wrist, tip:
        cos(ψ − δ) = (d² + L₃² − L₂²)/(2 L₃ d);
    q₃: shoulder, elbow, tip, the outer links rigid at D from elbow to tip, in direction β from
        the middle link: cos(θ − φ) = (R² + D² − L₁²)/(2 D R), ψ = θ − β + q₃.
    """
    k = len(m.link_length) - 3
    l1, l2, l3 = m.link_length[k], m.link_length[k + 1], m.link_length[k + 2]
    radius, phi = math.hypot(x, z), math.atan2(z, x)
    count = 0
    if radius > 0.0:
        double = 2.0 * l3 * radius
        count = _add_pair(found, count, phi, (radius**2 + l3**2 - (l1 + l2) ** 2) / double)
        count = _add_pair(found, count, phi, (radius**2 + l3**2 - (l1 - l2) ** 2) / double)
    for side in range(2):
        q1 = m.joint_min[k] if side == 0 else m.joint_max[k]
        q2 = m.joint_min[k + 1] if side == 0 else m.joint_max[k + 1]
        q3 = m.joint_min[k + 2] if side == 0 else m.joint_max[k + 2]
        dx, dz = x - l1 * math.cos(q1), z - l1 * math.sin(q1)
        d = math.hypot(dx, dz)
        if d > 0.0:
            cosine = (d**2 + l3**2 - l2**2) / (2.0 * l3 * d)
            count = _add_pair(found, count, math.atan2(dz, dx), cosine)
        if radius > 0.0:
            square = l1**2 + l2**2 + 2.0 * l1 * l2 * math.cos(q2)
            count = _add_pair(found, count, phi, (radius**2 + l3**2 - square) / (2.0 * l3 * radius))
            ahead, across = l2 + l3 * math.cos(q3), l3 * math.sin(q3)
            rigid = math.hypot(ahead, across)
            if rigid > 0.0:
                cosine = (radius**2 + rigid**2 - l1**2) / (2.0 * rigid * radius)
                count = _add_pair(found, count, phi - math.atan2(across, ahead) + q3, cosine)
    for i in range(count):
        turns = math.floor((found[i] + math.pi) / (2.0 * math.pi))
        found[i] -= 2.0 * math.pi * turns
    found[:count].sort()
    return count


@kernel(borrows=True)
def _step_inside(
    m: MachineArrays, x: float, z: float, end: float, middle: float, elbow: int, q: FloatArray
) -> float:
    """The feasible angle next to a computed interval end, which rounding may have put outside."""
    psi = end
    step = 1e-16
    while not feasible(m, x, z, psi, elbow, q):
        if step >= abs(middle - end):
            return middle
        psi = end + math.copysign(step, middle - end)
        step *= 2.0
    return psi


@kernel
def feasible_intervals(m: MachineArrays, x: float, z: float, found: FloatArray) -> int:
    """Intervals in which all joints are within limits, tip at (x, z) m; returns their number.

    Written to found[MAX_INTERVALS, 3]: elbow (∓1), lower and upper end of ψ [rad], elbow −1
    first, then ascending; the ends themselves are feasible. An interval can be a single point,
    or end where the next one begins. Oracle: a fine scan of ψ.
    """
    critical = np.empty(MAX_CRITICAL)
    edges = _critical_angles(m, x, z, critical)
    if edges == 0:
        critical[0] = -math.pi
        edges = 1
    q = m.joint_min.copy()  # inner joints, where there are any, are within their limits
    count = 0
    for elbow in (-1, 1):
        open_interval = False
        for i in range(edges):
            lower = critical[i]
            upper = critical[i + 1] if i + 1 < edges else critical[0] + 2.0 * math.pi
            if not feasible(m, x, z, 0.5 * (lower + upper), elbow, q):
                open_interval = False
                continue
            if not open_interval:
                found[count, 0], found[count, 1] = elbow, lower
                count += 1
                open_interval = True
            found[count - 1, 2] = upper
    for i in range(count):
        elbow = int(found[i, 0])
        middle = 0.5 * (found[i, 1] + found[i, 2])
        found[i, 1] = _step_inside(m, x, z, found[i, 1], middle, elbow, q)
        found[i, 2] = _step_inside(m, x, z, found[i, 2], middle, elbow, q)
    return count
