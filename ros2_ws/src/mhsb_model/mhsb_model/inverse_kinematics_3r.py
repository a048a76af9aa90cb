"""Closed-form inverse kinematics of the planar arm with three joints.

The tip position leaves one degree of freedom: the angle ψ = q₁+q₂+q₃ of the end link. For a
given ψ the first two links form a triangle to the wrist, with two elbow branches.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray

ELBOW_BRANCHES = (-1, 1)
"""Sign of q₂: −1 elbow up (above the line from shoulder to wrist), +1 elbow down."""


@kernel
def wrap_near(angle: float, center: float) -> float:
    """The angle, by whole turns, that lies within half a turn of `center` [rad]."""
    turns = math.floor((angle - center + math.pi) / (2.0 * math.pi))
    return angle - 2.0 * math.pi * turns


@kernel
def joint_angles(
    m: MachineArrays, x: float, z: float, psi: float, elbow: int, q: FloatArray
) -> bool:
    """Joint angles that put the tip at (x, z) m with end-link angle ψ rad, written to q[3].

    c = (wx² + wz² − L₁² − L₂²)/(2 L₁ L₂), q₂ = ±acos c, with the wrist w = tip − L₃(cos ψ, sin ψ).
    Returns False where the wrist is out of reach; joint limits are not looked at, angles are
    given by whole turns nearest to the middle of each joint's range.
    """
    l1, l2, l3 = m.link_length[0], m.link_length[1], m.link_length[2]
    wx = x - l3 * math.cos(psi)
    wz = z - l3 * math.sin(psi)
    c = (wx * wx + wz * wz - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)
    if c > 1.0 + 1e-12 or c < -1.0 - 1e-12:
        return False
    q2 = elbow * math.acos(min(1.0, max(-1.0, c)))
    q1 = math.atan2(wz, wx) - math.atan2(l2 * math.sin(q2), l1 + l2 * math.cos(q2))
    q[0] = wrap_near(q1, 0.5 * (m.joint_min[0] + m.joint_max[0]))
    q[1] = wrap_near(q2, 0.5 * (m.joint_min[1] + m.joint_max[1]))
    q[2] = wrap_near(psi - q1 - q2, 0.5 * (m.joint_min[2] + m.joint_max[2]))
    return True


@kernel
def within_limits(m: MachineArrays, q: FloatArray, tolerance: float = 0.0) -> bool:
    """Whether every joint lies within its limits, widened by `tolerance` rad."""
    for j in range(len(q)):
        if q[j] < m.joint_min[j] - tolerance or q[j] > m.joint_max[j] + tolerance:
            return False
    return True


@kernel
def postures(m: MachineArrays, x: float, z: float, psi: FloatArray) -> FloatArray:
    """All postures within limits at (x, z) m for the end-link angles ψ, float64[found, 3]."""
    found = np.empty((2 * len(psi), 3))
    count = 0
    q = np.empty(3)
    for angle in psi:
        for elbow in (-1, 1):
            if joint_angles(m, x, z, angle, elbow, q) and within_limits(m, q):
                found[count] = q
                count += 1
    return found[:count]
