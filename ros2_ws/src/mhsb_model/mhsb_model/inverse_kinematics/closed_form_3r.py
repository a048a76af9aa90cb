"""Closed-form inverse kinematics of a planar arm with three revolute joints.

The tip position leaves one degree of freedom, the end-link angle ψ = q₁ + q₂ + q₃. For a given ψ
the first two links form a triangle with the wrist, which has two elbow branches.

In a chain with more joints, the functions apply to the last three joints. Tip and ψ are then given
in the frame of the link before these joints (`tip_postures.transform_tip_to_outer_frame`).
"""

import math

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray

ELBOW_BRANCHES = (-1, 1)
"""Elbow branches by the sign of q₂: −1 elbow up (above the shoulder-wrist line), +1 elbow down."""


@kernel
def wrap_near(angle: float, center: float) -> float:
    """Add whole turns to an angle so that it lies within half a turn of `center`.

    Args:
        angle: Angle [rad].
        center: Middle of the range of the result [rad].

    Returns:
        Angle in [center − π, center + π) [rad].
    """
    turns = math.floor((angle - center + math.pi) / (2.0 * math.pi))
    return angle - 2.0 * math.pi * turns


@kernel(borrows=True)
def solve_last_three_joints(
    m: MachineArrays, x: float, z: float, psi: float, elbow: int, q: FloatArray
) -> bool:
    """Solve the last three joints for a tip position and an end-link angle, without joint limits.

        w = (x, z) − L₃ (cos ψ, sin ψ)
        c = (|w|² − L₁² − L₂²)/(2 L₁ L₂),   q₂ = ±acos c

    w is the wrist, the beginning of the last link. L₁, L₂, L₃ are the lengths of the last three
    links, and q₂ is the angle of the second-last joint. Whole turns are added to each angle, so
    that it is within half a turn of the middle of its joint's range.

    Args:
        m: Planar machine with n ≥ 3 joints. The last three joints are revolute.
        x: Tip position relative to the third-last joint, along the link before that joint [m].
        z: Tip position across that link [m].
        psi: End-link angle ψ, relative to the direction of that link [rad].
        elbow: Elbow branch, the sign of q₂: −1 or 1.
        q: Joint angles, float64[n], [rad]. The last three are written in place if there is a
            solution.

    Returns:
        True if there is a solution, False if the wrist is out of reach.
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
def is_within_limits(m: MachineArrays, q: FloatArray, tolerance: float = 0.0) -> bool:
    """Return whether every joint lies within its limits, widened by a tolerance.

    Args:
        m: Machine with the limits.
        q: Posture, float64[n], [rad or m].
        tolerance: Distance by which each limit may be exceeded [rad or m].

    Returns:
        True if no joint exceeds its limits by more than the tolerance.
    """
    for j in range(len(q)):
        if q[j] < m.joint_min[j] - tolerance or q[j] > m.joint_max[j] + tolerance:
            return False
    return True
