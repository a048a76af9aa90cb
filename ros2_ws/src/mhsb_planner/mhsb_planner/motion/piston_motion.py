"""Motions of the cylinders and of the joints, from one to the other."""

from __future__ import annotations

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length, joint_angle, motion
from mhsb_model.types import FloatArray

CLOSE = 1e-5
"""A step of two terms that is shorter leaves an error below rounding [rad]."""


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

    From the instant before, q + Δq (1 − r′Δq/2r) with Δq = ΔL/r leads so close that one more such
    step ends there; where it is not, Newton's method takes over. Beyond the joint limits the
    linkage goes on as straight as it is there, so that a motion that passes them shows it.
    """
    rows, n = length.shape
    q, qd, qdd = np.empty((rows, n)), np.empty((rows, n)), np.empty((rows, n))
    state = np.empty((n, 4))  # of each joint: angle, length, moment arm and its slope
    for j in range(n):
        state[j, 0] = start[j]
        state[j, 1], state[j, 2], state[j, 3] = motion(m.linkage[j], start[j])
    for k in range(rows):
        for j in range(n):  # none waits for another: a processor works on all at a time
            angle, reached, arm, slope = state[j, 0], state[j, 1], state[j, 2], state[j, 3]
            if length[k, j] != reached:
                linkage, lower, upper = m.linkage[j], m.joint_min[j], m.joint_max[j]
                step = (length[k, j] - reached) / arm
                angle += step * (1.0 - 0.5 * step * slope / arm)
                reached, arm, slope = motion(linkage, angle)
                step = (length[k, j] - reached) / arm
                angle += step * (1.0 - 0.5 * step * slope / arm)
                arm += slope * step
                if abs(step) > CLOSE or not lower <= angle <= upper:
                    angle = joint_angle(linkage, length[k, j], lower, upper, angle)
                    reached, arm, slope = motion(linkage, angle)
                    angle += (length[k, j] - reached) / arm
                state[j, 0], state[j, 1] = angle, length[k, j]
                state[j, 2], state[j, 3] = arm, slope
            q[k, j] = angle
            qd[k, j] = speed[k, j] / arm
            qdd[k, j] = (acceleration[k, j] - slope * qd[k, j] ** 2) / arm
    return q, qd, qdd
