"""Conversion between motions of the joints and motions of the pistons."""

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import evaluate_linkage, find_joint_angle
from mhsb_model.types import FloatArray

MAX_TAYLOR_STEP = 1e-5
"""Largest second correction of a joint position that `convert_to_joints` accepts [rad or m].

After a smaller correction, the remaining error is below rounding. After a larger correction,
`find_joint_angle` solves for the position."""


@kernel
def convert_to_pistons(
    m: MachineArrays, q: FloatArray, qd: FloatArray, qdd: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Convert position, velocity and acceleration of the joints to those of the pistons.

        v = r q̇,  v̇ = r q̈ + r′ q̇²

    v is the piston speed and v̇ its acceleration. r = dL/dq is the moment arm, with the cylinder
    length L, and r′ = dr/dq its slope.

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

    L⁻¹ maps a cylinder length to the joint position, and v is the piston speed. r = dL/dq is the
    moment arm, and r′ = dr/dq its slope. The numerical search for a position begins at the position
    of the previous instant. Beyond a joint limit, the cylinder length is a linear function of the
    joint position. So cylinder lengths beyond the limits give joint positions beyond the limits.

    Args:
        m: Arrays of the machine.
        length: Cylinder lengths at k instants in time order, shape (k, n) [m].
        speed: Piston speeds, shape (k, n) [m/s].
        acceleration: Piston accelerations, shape (k, n) [m/s²].
        start: Joint positions close to the first result, shape (n,) [rad or m]. The search begins
            there.

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
