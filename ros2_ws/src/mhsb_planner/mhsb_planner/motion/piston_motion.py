"""Conversion between motions of the joints and motions of the pistons."""

from __future__ import annotations

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import evaluate_linkage, find_joint_angle
from mhsb_model.types import FloatArray

MAX_TAYLOR_STEP = 1e-5
"""Largest second step of a joint angle for which the two-term Taylor series is accepted [rad].

With a smaller step the error is below rounding."""


@kernel
def convert_to_pistons(
    m: MachineArrays, q: FloatArray, qd: FloatArray, qdd: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Convert one state of motion of the joints to the pistons.

    With the cylinder length L, the moment arm r = dL/dq and its slope r′ = dr/dq, piston speed v
    and piston acceleration v̇ are

        v = r q̇,  v̇ = r q̈ + r′ q̇²

    Args:
        m: Arrays of the machine.
        q: Joint positions, shape (n,) [rad or m].
        qd: Joint velocities, shape (n,) [rad/s or m/s].
        qdd: Joint accelerations, shape (n,) [rad/s² or m/s²].

    Returns:
        Cylinder lengths [m], piston speeds v [m/s] and piston accelerations v̇ [m/s²], of shape
        (n,).
    """
    length, speed, acceleration = np.empty(len(q)), np.empty(len(q)), np.empty(len(q))
    for j in range(len(q)):
        length[j], arm, slope = evaluate_linkage(m.linkage[j], q[j])
        speed[j] = arm * qd[j]
        acceleration[j] = arm * qdd[j] + slope * qd[j] ** 2
    return length, speed, acceleration


@kernel
def convert_to_joints(
    m: MachineArrays,
    length: FloatArray,
    speed: FloatArray,
    acceleration: FloatArray,
    start: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Convert a motion of the pistons to a motion of the joints.

        q = L⁻¹(length),  q̇ = v/r,  q̈ = (v̇ − r′ q̇²)/r

    L⁻¹ is the joint position that belongs to a cylinder length, v the piston speed, r = dL/dq the
    moment arm and r′ its slope. The search for each position begins at the previous position.
    Beyond the joint limits the linkage is continued as a straight line. A motion that passes the
    limits therefore gives positions beyond them.

    Args:
        m: Arrays of the machine.
        length: Cylinder lengths at k instants in time order, shape (k, n) [m].
        speed: Piston speeds, shape (k, n) [m/s].
        acceleration: Piston accelerations, shape (k, n) [m/s²].
        start: Joint positions near the first instant, where the iteration starts, shape (n,)
            [rad or m].

    Returns:
        Joint positions [rad or m], velocities [rad/s or m/s] and accelerations [rad/s² or m/s²], of
        shape (k, n).
    """
    rows, n = length.shape
    q, qd, qdd = np.empty((rows, n)), np.empty((rows, n)), np.empty((rows, n))
    state = np.empty((n, 4))  # columns: angle, length, moment arm r and its slope r′
    for j in range(n):
        state[j, 0] = start[j]
        state[j, 1], state[j, 2], state[j, 3] = evaluate_linkage(m.linkage[j], start[j])
    for k in range(rows):
        for j in range(n):  # innermost: joints are independent, which the processor uses
            angle, reached, arm, slope = state[j, 0], state[j, 1], state[j, 2], state[j, 3]
            if length[k, j] != reached:
                linkage, lower, upper = m.linkage[j], m.joint_min[j], m.joint_max[j]
                step = (length[k, j] - reached) / arm
                angle += step * (1.0 - 0.5 * step * slope / arm)
                reached, arm, slope = evaluate_linkage(linkage, angle)
                step = (length[k, j] - reached) / arm
                angle += step * (1.0 - 0.5 * step * slope / arm)
                arm += slope * step
                if abs(step) > MAX_TAYLOR_STEP or not lower <= angle <= upper:
                    angle = find_joint_angle(linkage, length[k, j], lower, upper, angle)
                    reached, arm, slope = evaluate_linkage(linkage, angle)
                    angle += (length[k, j] - reached) / arm
                state[j, 0], state[j, 1] = angle, length[k, j]
                state[j, 2], state[j, 3] = arm, slope
            q[k, j] = angle
            qd[k, j] = speed[k, j] / arm
            qdd[k, j] = (acceleration[k, j] - slope * qd[k, j] ** 2) / arm
    return q, qd, qdd
