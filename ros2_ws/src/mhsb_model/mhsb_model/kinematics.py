"""Forward kinematics of a planar chain of any number of revolute joints.

Plane x (forward), z (up); joint angles are counter-clockwise, each relative to the link before.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray


@kernel
def tip_position(link_length: FloatArray, q: FloatArray) -> tuple[float, float]:
    """x = Σ Lᵢ cos(q₁+…+qᵢ), z = Σ Lᵢ sin(q₁+…+qᵢ) [m]."""
    angle = 0.0
    x = 0.0
    z = 0.0
    for i in range(len(q)):
        angle += q[i]
        x += link_length[i] * math.cos(angle)
        z += link_length[i] * math.sin(angle)
    return x, z


@kernel
def tip_positions(link_length: FloatArray, q: FloatArray) -> FloatArray:
    """Tip (x, z) [m] in each of the postures q[k, n], float64[k, 2]."""
    tip = np.empty((len(q), 2))
    for k in range(len(q)):
        tip[k, 0], tip[k, 1] = tip_position(link_length, q[k])
    return tip


@kernel
def joint_positions(link_length: FloatArray, q: FloatArray) -> FloatArray:
    """Positions of all joints and of the tip, float64[n + 1, 2] (x, z) [m]."""
    points = np.zeros((len(q) + 1, 2))
    angle = 0.0
    for i in range(len(q)):
        angle += q[i]
        points[i + 1, 0] = points[i, 0] + link_length[i] * math.cos(angle)
        points[i + 1, 1] = points[i, 1] + link_length[i] * math.sin(angle)
    return points


@kernel
def tip_jacobian(link_length: FloatArray, q: FloatArray) -> FloatArray:
    """J = ∂(x, z)/∂q, float64[2, n] [m]: column j is the tip's offset from joint j, turned 90°."""
    n = len(q)
    points = joint_positions(link_length, q)
    jacobian = np.empty((2, n))
    for j in range(n):
        jacobian[0, j] = -(points[n, 1] - points[j, 1])
        jacobian[1, j] = points[n, 0] - points[j, 0]
    return jacobian
