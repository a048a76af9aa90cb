"""Motions of the cylinders and of the joints, from one to the other."""

from __future__ import annotations

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length, joint_angle, motion
from mhsb_model.types import FloatArray


@kernel
def lengths_of(m: MachineArrays, posture: FloatArray) -> FloatArray:
    """Cylinder lengths [m] in the postures [k, n]."""
    length = np.empty(posture.shape)
    for k in range(len(posture)):
        for j in range(posture.shape[1]):
            length[k, j] = cylinder_length(m.linkage[j], posture[k, j])
    return length


@kernel
def piston_state(
    m: MachineArrays, q: FloatArray, qd: FloatArray, qdd: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Cylinder lengths L(q) [m], v = r q̇ and v̇ = r q̈ + r′ q̇² of a state, float64[n] each."""
    length, speed, acceleration = np.empty(len(q)), np.empty(len(q)), np.empty(len(q))
    for j in range(len(q)):
        length[j], arm, slope = motion(m.linkage[j], q[j])
        speed[j] = arm * qd[j]
        acceleration[j] = arm * qdd[j] + slope * qd[j] ** 2
    return length, speed, acceleration


@kernel
def joint_motion(
    m: MachineArrays,
    length: FloatArray,
    speed: FloatArray,
    acceleration: FloatArray,
    start: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Joint motion of a piston motion: q = L⁻¹, q̇ = v/r, q̈ = (v̇ − r′ q̇²)/r.

    The search for q begins where the two instants before lead. Beyond the joint limits the linkage
    goes on as straight as it is there, so that a motion that passes them shows it.
    """
    rows, n = length.shape
    q, qd, qdd = np.empty((rows, n)), np.empty((rows, n)), np.empty((rows, n))
    for j in range(n):
        linkage, lower, upper = m.linkage[j], m.joint_min[j], m.joint_max[j]
        guess = start[j]
        for k in range(rows):
            within = joint_angle(linkage, length[k, j], lower, upper, guess)
            reached, arm, slope = motion(linkage, within)
            q[k, j] = within + (length[k, j] - reached) / arm
            qd[k, j] = speed[k, j] / arm
            qdd[k, j] = (acceleration[k, j] - slope * qd[k, j] ** 2) / arm
            guess = within if k == 0 else 2.0 * within - q[k - 1, j]
    return q, qd, qdd
