"""Statics and dynamics of the planar chain: what gravity asks of the joints, and what inertia."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import extended, joint_positions, turned
from mhsb_model.linkages.linkage import moment_arm
from mhsb_model.types import BoolArray, FloatArray


class Chain(NamedTuple):
    """What is moved: n links and a payload, a point mass at the tip."""

    turns: BoolArray  # [n] whether its joint turns it in the plane
    slides: BoolArray  # [n] whether that is prismatic
    length: FloatArray  # [n] m, retracted, likewise the centre
    mass: FloatArray  # [n] kg
    center: FloatArray  # [n] m, centre of mass from the link's joint
    inertia: FloatArray  # [n] kg m², about the centre of mass
    payload: float  # kg
    gravity: float  # m/s²
    slews: bool  # whether joint 1 turns the plane about the vertical
    slew_offset: float  # m, of joint 2 ahead of the slew's axis
    slew_inertia: float  # kg m², of the platform about that axis


@kernel(inline="always")
def chain_of(m: MachineArrays) -> Chain:
    """The links and the payload of a machine."""
    return Chain(
        m.turns,
        m.slides,
        m.link_length,
        m.link_mass,
        m.link_center,
        m.link_inertia,
        m.payload,
        m.gravity,
        m.slews,
        m.slew_offset,
        m.slew_inertia,
    )


@kernel(inline="always")
def with_payload(c: Chain, payload: float) -> Chain:
    """The same links with another payload [kg]."""
    return Chain(
        c.turns,
        c.slides,
        c.length,
        c.mass,
        c.center,
        c.inertia,
        payload,
        c.gravity,
        c.slews,
        c.slew_offset,
        c.slew_inertia,
    )


@kernel
def link_directions(turns: BoolArray, q: FloatArray, cosine: FloatArray, sine: FloatArray) -> None:
    """Cosine and sine of each link's angle in the plane, written to cosine[n] and sine[n]."""
    angle = 0.0
    for j in range(len(q)):
        angle += turned(turns, q, j)
        cosine[j], sine[j] = math.cos(angle), math.sin(angle)


@kernel(inline="always")
def gravity_torques(
    c: Chain, q: FloatArray, cosine: FloatArray, sine: FloatArray, torque: FloatArray
) -> None:
    """τⱼ = g Σ mᵢ (xᵢ − xⱼ) over all masses beyond joint j, written to torque[n] [N m].

    Of a joint that slides g sin θⱼ Σ mᵢ [N], of one that slews 0. Positive where the joint must
    lift; ∂U/∂q of the potential energy U. cosine[n], sine[n] are those of `link_directions`.
    Oracles: U of point masses, MuJoCo.
    """
    moment = 0.0
    mass = c.payload
    for j in range(len(torque) - 1, -1, -1):
        moment, mass = _with_link(c, q, j, cosine[j], moment, mass)
        torque[j] = c.gravity * (mass * sine[j] if c.slides[j] else moment)
    if c.slews:
        torque[0] = 0.0


@kernel(inline="always")
def _with_link(
    c: Chain, q: FloatArray, j: int, cosine: float, moment: float, mass: float
) -> tuple[float, float]:
    """Moment [kg m] about joint j and mass [kg] of link j and all beyond, from what is beyond."""
    center = extended(c.slides, c.center, q, j)
    length = extended(c.slides, c.length, q, j)
    return moment + cosine * (c.mass[j] * center + mass * length), mass + c.mass[j]


INERTIA_WORK = 3
"""Rows of working memory that `inertia_torques` needs."""

MOTION_WORK = INERTIA_WORK + 2
"""Likewise `moving_torques`."""


@kernel(inline="always")
def inertia_torques(
    c: Chain,
    q: FloatArray,
    cosine: FloatArray,
    sine: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
    work: FloatArray,
    torque: FloatArray,
) -> None:
    """τ = M(q) q̈ + C(q, q̇) q̇, written to torque[n] [N m], of a joint that slides [N].

    cosine, sine as `link_directions` has them; q̇, q̈ float64[n]; work float64[INERTIA_WORK, n].
    Outwards, each link's accelerations and the force and moment that they take; inwards, what it
    passes on. With ω, ω̇ of the link and e along, n across it, the point of it at d beyond the link
    before, whose tip has the acceleration p̈, has

        p̈ + d (ω̇ n − ω² e), and where the link slides 2 ω q̇ n + q̈ e besides (Coriolis).

    Source: recursive Newton–Euler, R. Featherstone, Rigid Body Dynamics Algorithms, 5.3.
    Oracles: the mass matrix and its slopes, MuJoCo's qfrc_inverse.
    """
    n = len(torque)
    omega = alpha = ax = az = 0.0
    for j in range(n):
        omega += turned(c.turns, qd, j)
        alpha += turned(c.turns, qdd, j)
        inwards = omega * omega
        gx = -inwards * cosine[j] - alpha * sine[j]
        gz = -inwards * sine[j] + alpha * cosine[j]
        if c.slides[j]:
            across = 2.0 * omega * qd[j]
            ax += qdd[j] * cosine[j] - across * sine[j]
            az += qdd[j] * sine[j] + across * cosine[j]
        center = extended(c.slides, c.center, q, j)
        length = extended(c.slides, c.length, q, j)
        work[0, j] = c.inertia[j] * alpha
        work[1, j] = c.mass[j] * (ax + gx * center)
        work[2, j] = c.mass[j] * (az + gz * center)
        ax += gx * length
        az += gz * length
    moment, fx, fz = 0.0, c.payload * ax, c.payload * az
    for j in range(n - 1, -1, -1):
        center = extended(c.slides, c.center, q, j)
        length = extended(c.slides, c.length, q, j)
        moment += work[0, j] + length * (cosine[j] * fz - sine[j] * fx)
        moment += center * (cosine[j] * work[2, j] - sine[j] * work[1, j])
        fx += work[1, j]
        fz += work[2, j]
        torque[j] = cosine[j] * fx + sine[j] * fz if c.slides[j] else moment
    if c.slews:
        _add_slewing(c, q, cosine, sine, qd, qdd, work, torque)


@kernel
def _add_slewing(
    c: Chain,
    q: FloatArray,
    cosine: FloatArray,
    sine: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
    work: FloatArray,
    torque: FloatArray,
) -> None:
    """What slewing takes of joint 1, written to torque[0], and of all others, added to theirs.

    With ρ the distances of masses from the slew's axis, φ the links' angles and J their inertias,
    for links that are slender:

        I = I₀ + Σ m ρ² + Σ J cos²φ,  τ₁ = I q̈₁ + İ q̇₁,  τⱼ = … − ½ ∂I/∂qⱼ q̇₁²

    Arguments as in `inertia_torques`. Source: Lagrange's equations.
    """
    n, square = len(torque), qd[0] * qd[0]
    inertia, rate, omega = c.slew_inertia, 0.0, 0.0
    distance, moving = c.slew_offset, 0.0  # of the tip of the link before, and its rate
    for j in range(1, n):
        omega += turned(c.turns, qd, j)
        if c.slides[j]:
            moving += qd[j] * cosine[j]
        center, closing = extended(c.slides, c.center, q, j), -omega * sine[j]
        at, its_rate = distance + center * cosine[j], moving + center * closing
        inertia += c.mass[j] * at * at + c.inertia[j] * cosine[j] * cosine[j]
        rate += 2.0 * (c.mass[j] * at * its_rate + c.inertia[j] * cosine[j] * closing)
        work[0, j] = -c.mass[j] * at * square
        length = extended(c.slides, c.length, q, j)
        distance += length * cosine[j]
        moving += length * closing
    inertia += c.payload * distance * distance
    rate += 2.0 * c.payload * distance * moving
    torque[0] = inertia * qdd[0] + rate * qd[0]
    moment, inwards = 0.0, -c.payload * distance * square
    for j in range(n - 1, 0, -1):
        center = extended(c.slides, c.center, q, j)
        length = extended(c.slides, c.length, q, j)
        moment -= sine[j] * (length * inwards + center * work[0, j])
        moment += c.inertia[j] * cosine[j] * sine[j] * square
        inwards += work[0, j]
        torque[j] += cosine[j] * inwards if c.slides[j] else moment


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
    link_directions(c.turns, q, cosine, sine)
    gravity_torques(c, q, cosine, sine, weight)
    inertia_torques(c, q, cosine, sine, qd, qdd, work, torque)
    for j in range(len(torque)):
        torque[j] += weight[j]


@kernel(borrows=True)
def gravity_torque(m: MachineArrays, q: FloatArray, torque: FloatArray) -> None:
    """`gravity_torques` of a machine in the posture q[n], written to torque[n] [N m]."""
    chain, angle = chain_of(m), 0.0
    for j in range(len(q)):
        angle += turned(m.turns, q, j)
        torque[j] = angle
    moment, mass = 0.0, m.payload
    for j in range(len(q) - 1, -1, -1):
        angle = torque[j]
        moment, mass = _with_link(chain, q, j, math.cos(angle), moment, mass)
        torque[j] = m.gravity * (mass * math.sin(angle) if m.slides[j] else moment)
    if m.slews:
        torque[0] = 0.0


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
    """M(q) = Σ mᵢ JᵢᵀJᵢ + Iᵢ eᵢᵀeᵢ over links and payload, float64[n, n] [kg m²].

    Jᵢ moves the centre of link i, eᵢ turns it. Where one joint of two slides [kg m], where both do
    [kg]. Slewing moves all across the plane, and has I of `_add_slewing` alone.
    """
    n = len(q)
    points = joint_positions(m, q)
    result = np.zeros((n, n))
    cosine, sine, column = np.empty(n), np.empty(n), np.empty((3, n))
    link_directions(m.turns, q, cosine, sine)
    for i in range(n + 1):
        if i < n:
            center = extended(m.slides, m.link_center, q, i)
            px, pz = points[i, 0] + center * cosine[i], points[i, 1] + center * sine[i]
            mass, inertia, moved = m.link_mass[i], m.link_inertia[i], i + 1
        else:
            px, pz = points[n, 0], points[n, 1]
            mass, inertia, moved = m.payload, 0.0, n
        for j in range(moved):
            if m.slides[j]:
                column[0, j], column[1, j], column[2, j] = cosine[j], sine[j], 0.0
            elif not m.turns[j]:
                column[:, j] = 0.0
            else:
                column[0, j], column[1, j] = points[j, 1] - pz, px - points[j, 0]
                column[2, j] = 1.0
        for j in range(moved):
            for k in range(moved):
                arm = column[0, j] * column[0, k] + column[1, j] * column[1, k]
                result[j, k] += mass * arm + inertia * column[2, j] * column[2, k]
        if m.slews:
            distance, across = m.slew_offset + px, cosine[i] if i < n else 0.0
            result[0, 0] += mass * distance * distance + inertia * across * across
    if m.slews:
        result[0, 0] += m.slew_inertia
    return result
