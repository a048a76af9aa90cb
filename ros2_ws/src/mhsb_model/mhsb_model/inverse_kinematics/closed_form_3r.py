"""Closed-form inverse kinematics of the planar arm with three joints.

The tip position leaves one degree of freedom: the angle ψ = q₁+q₂+q₃ of the end link. For a
given ψ the first two links form a triangle to the wrist, with two elbow branches.

Of a chain with more joints it is its last three, seen from where they stand: tip and ψ relative to
the end of the links before (`tip_postures.outer_tip`).
"""

from __future__ import annotations

import math

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


@kernel(borrows=True)
def joint_angles(
    m: MachineArrays, x: float, z: float, psi: float, elbow: int, q: FloatArray
) -> bool:
    """Angles of the last three joints that put the tip at (x, z) m with end-link angle ψ rad.

    c = (wx² + wz² − L₁² − L₂²)/(2 L₁ L₂), q₂ = ±acos c, with the wrist w = tip − L₃(cos ψ, sin ψ).
    Written to the last three of q[n]. Returns False where the wrist is out of reach; joint limits
    are not looked at, angles are given by whole turns nearest to the middle of each joint's range.
    """
    k = len(q) - 3
    l1, l2, l3 = m.link_length[k], m.link_length[k + 1], m.link_length[k + 2]
    wx = x - l3 * math.cos(psi)
    wz = z - l3 * math.sin(psi)
    c = (wx * wx + wz * wz - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)
    if c > 1.0 + 1e-12 or c < -1.0 - 1e-12:
        return False
    q2 = elbow * math.acos(min(1.0, max(-1.0, c)))
    q1 = math.atan2(wz, wx) - math.atan2(l2 * math.sin(q2), l1 + l2 * math.cos(q2))
    q[k] = wrap_near(q1, 0.5 * (m.joint_min[k] + m.joint_max[k]))
    q[k + 1] = wrap_near(q2, 0.5 * (m.joint_min[k + 1] + m.joint_max[k + 1]))
    q[k + 2] = wrap_near(psi - q1 - q2, 0.5 * (m.joint_min[k + 2] + m.joint_max[k + 2]))
    return True


@kernel(borrows=True)
def within_limits(m: MachineArrays, q: FloatArray, tolerance: float = 0.0) -> bool:
    """Whether every joint lies within its limits, widened by `tolerance` rad."""
    for j in range(len(q)):
        if q[j] < m.joint_min[j] - tolerance or q[j] > m.joint_max[j] + tolerance:
            return False
    return True
