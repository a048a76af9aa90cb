"""Statics and mass matrix of the planar chain."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mhsb_model.arrays import MachineArrays
from mhsb_model.kinematics import joint_positions
from mhsb_model.linkages.linkage import moment_arm
from mhsb_model.types import FloatArray


@njit(cache=True, nogil=True)
def gravity_torque(m: MachineArrays, q: FloatArray, torque: FloatArray) -> None:
    """τⱼ = g Σ mᵢ (xᵢ − xⱼ) over all masses beyond joint j, written to torque[n] [N m].

    Positive where the joint must lift; ∂U/∂q of the potential energy U.
    """
    n = len(q)
    angle = 0.0
    for j in range(n):
        angle += q[j]
        torque[j] = math.cos(angle)
    moment = 0.0
    mass = m.payload
    for j in range(n - 1, -1, -1):
        cosine = torque[j]
        moment += cosine * (m.link_mass[j] * m.link_center[j] + mass * m.link_length[j])
        mass += m.link_mass[j]
        torque[j] = m.gravity * moment


@njit(cache=True, nogil=True)
def piston_forces(m: MachineArrays, q: FloatArray, force: FloatArray) -> None:
    """F = τ / r under gravity, written to force[n] [N]; F > 0 resists extension."""
    gravity_torque(m, q, force)
    for j in range(len(q)):
        force[j] /= moment_arm(m.linkage[j], q[j])


@njit(cache=True, nogil=True)
def mass_matrix(m: MachineArrays, q: FloatArray) -> FloatArray:
    """M(q) = Σ mᵢ JᵢᵀJᵢ + Iᵢ eᵢᵀeᵢ over links and payload, float64[n, n] [kg m²]."""
    n = len(q)
    points = joint_positions(m.link_length, q)
    result = np.zeros((n, n))
    angle = 0.0
    for i in range(n + 1):
        if i < n:
            angle += q[i]
            px = points[i, 0] + m.link_center[i] * math.cos(angle)
            pz = points[i, 1] + m.link_center[i] * math.sin(angle)
            mass, inertia, moved = m.link_mass[i], m.link_inertia[i], i + 1
        else:
            px, pz = points[n, 0], points[n, 1]
            mass, inertia, moved = m.payload, 0.0, n
        for j in range(moved):
            for k in range(moved):
                arm = (px - points[j, 0]) * (px - points[k, 0])
                arm += (pz - points[j, 1]) * (pz - points[k, 1])
                result[j, k] += mass * arm + inertia
    return result
