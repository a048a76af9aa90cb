"""Statics and dynamics of the planar chain: what gravity asks of the joints, and what inertia."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import joint_positions
from mhsb_model.linkages.linkage import moment_arm
from mhsb_model.types import FloatArray


class Chain(NamedTuple):
    """What is moved: n links and a payload, a point mass at the tip."""

    length: FloatArray  # [n] m
    mass: FloatArray  # [n] kg
    center: FloatArray  # [n] m, centre of mass from the link's joint
    inertia: FloatArray  # [n] kg m², about the centre of mass
    payload: float  # kg
    gravity: float  # m/s²


@kernel(inline="always")
def chain_of(m: MachineArrays) -> Chain:
    """The links and the payload of a machine."""
    return Chain(m.link_length, m.link_mass, m.link_center, m.link_inertia, m.payload, m.gravity)


@kernel
def link_directions(q: FloatArray, cosine: FloatArray, sine: FloatArray) -> None:
    """Cosine and sine of each link's angle q₁ + … + qⱼ, written to cosine[n] and sine[n]."""
    angle = 0.0
    for j in range(len(q)):
        angle += q[j]
        cosine[j], sine[j] = math.cos(angle), math.sin(angle)


@kernel(inline="always")
def gravity_torques(c: Chain, cosine: FloatArray, torque: FloatArray) -> None:
    """τⱼ = g Σ mᵢ (xᵢ − xⱼ) over all masses beyond joint j, written to torque[n] [N m].

    Positive where the joint must lift; ∂U/∂q of the potential energy U. cosine[n] is that of
    `link_directions`, and may be the same array as torque. Oracles: U of point masses, MuJoCo.
    """
    moment = 0.0
    mass = c.payload
    for j in range(len(torque) - 1, -1, -1):
        moment += cosine[j] * (c.mass[j] * c.center[j] + mass * c.length[j])
        mass += c.mass[j]
        torque[j] = c.gravity * moment


INERTIA_WORK = 3
"""Rows of working memory that `inertia_torques` needs."""

MOTION_WORK = INERTIA_WORK + 2
"""Likewise `moving_torques`."""


@kernel(inline="always")
def inertia_torques(
    c: Chain,
    cosine: FloatArray,
    sine: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
    work: FloatArray,
    torque: FloatArray,
) -> None:
    """τ = M(q) q̈ + C(q, q̇) q̇, written to torque[n] [N m].

    cosine, sine as `link_directions` has them; q̇, q̈ float64[n]; work float64[INERTIA_WORK, n].
    Outwards, each link's accelerations and the force and moment that they take; inwards, what it
    passes on. Source: recursive Newton–Euler, R. Featherstone, Rigid Body Dynamics Algorithms, 5.3.
    Oracles: the mass matrix and its slopes, MuJoCo's qfrc_inverse.
    """
    n = len(torque)
    omega = alpha = ax = az = 0.0
    for j in range(n):
        omega += qd[j]
        alpha += qdd[j]
        inwards = omega * omega
        gx = -inwards * cosine[j] - alpha * sine[j]
        gz = -inwards * sine[j] + alpha * cosine[j]
        work[0, j] = c.inertia[j] * alpha
        work[1, j] = c.mass[j] * (ax + gx * c.center[j])
        work[2, j] = c.mass[j] * (az + gz * c.center[j])
        ax += gx * c.length[j]
        az += gz * c.length[j]
    moment, fx, fz = 0.0, c.payload * ax, c.payload * az
    for j in range(n - 1, -1, -1):
        moment += work[0, j] + c.length[j] * (cosine[j] * fz - sine[j] * fx)
        moment += c.center[j] * (cosine[j] * work[2, j] - sine[j] * work[1, j])
        fx += work[1, j]
        fz += work[2, j]
        torque[j] = moment


@kernel(inline="always")
def moving_torques(
    c: Chain,
    q: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
    work: FloatArray,
    weight: FloatArray,
    torque: FloatArray,
) -> None:
    """What gravity asks in the posture q, to weight[n], and in all τ = M q̈ + C q̇ + g, to torque[n].

    [N m]; q̇, q̈ float64[n]; work float64[MOTION_WORK, n].
    """
    cosine, sine = work[INERTIA_WORK], work[INERTIA_WORK + 1]
    link_directions(q, cosine, sine)
    gravity_torques(c, cosine, weight)
    inertia_torques(c, cosine, sine, qd, qdd, work, torque)
    for j in range(len(torque)):
        torque[j] += weight[j]


@kernel(borrows=True)
def gravity_torque(m: MachineArrays, q: FloatArray, torque: FloatArray) -> None:
    """`gravity_torques` of a machine in the posture q[n], written to torque[n] [N m]."""
    angle = 0.0
    for j in range(len(q)):
        angle += q[j]
        torque[j] = math.cos(angle)
    gravity_torques(chain_of(m), torque, torque)


@kernel(borrows=True)
def piston_forces(m: MachineArrays, q: FloatArray, force: FloatArray) -> None:
    """F = τ / r under gravity, written to force[n] [N]; F > 0 resists extension."""
    gravity_torque(m, q, force)
    for j in range(len(q)):
        force[j] /= moment_arm(m.linkage[j], q[j])


@kernel(borrows=True)
def piston_forces_in(m: MachineArrays, posture: FloatArray, force: FloatArray) -> None:
    """The same in each of the postures[k, n] [rad], written to force[k, n] [N]."""
    for k in range(len(posture)):
        piston_forces(m, posture[k], force[k])


@kernel
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
