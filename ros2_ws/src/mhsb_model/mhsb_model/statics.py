"""Statics and dynamics of the planar chain: joint torques for gravity and for inertia.

The "torque" of a sliding joint is the force along its link [N].
"""

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import add_extension, get_turn_angle, joint_positions
from mhsb_model.linkages.linkage import moment_arm
from mhsb_model.trajectory import JointMotion
from mhsb_model.types import BoolArray, FloatArray


class Chain(NamedTuple):
    """Masses and geometry of n links and a payload, which is a point mass at the tip."""

    turns: BoolArray
    """Whether each joint turns its link in the plane, shape (n,)."""
    slides: BoolArray
    """Whether each joint is prismatic, shape (n,)."""
    length: FloatArray
    """Length of each link with its joint at q = 0, shape (n,) [m]."""
    mass: FloatArray
    """Mass of each link, shape (n,) [kg]."""
    center: FloatArray
    """Distance of each link's centre of mass from its joint at q = 0, shape (n,) [m]."""
    inertia: FloatArray
    """Moment of inertia of each link about its centre of mass, shape (n,) [kg m²]."""
    payload: float
    """Mass at the tip [kg]."""
    gravity: float
    """Gravitational acceleration [m/s²]."""
    slews: bool
    """Whether joint 1 turns the plane of all others about the vertical."""
    slew_offset: float
    """Distance of joint 2 ahead of the slew's axis [m]."""
    slew_inertia: float
    """Moment of inertia of the slewing platform about the slew's axis [kg m²]."""


@kernel(inline="always")
def get_chain(m: MachineArrays) -> Chain:
    """Return the links and the payload of a machine."""
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
def replace_payload(c: Chain, payload: float) -> Chain:
    """Return a copy of a chain with another payload.

    Args:
        c: Links and payload; not changed.
        payload: New mass at the tip [kg].
    """
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


@kernel(borrows=True)
def compute_link_directions(
    turns: BoolArray, q: FloatArray, cosine: FloatArray, sine: FloatArray
) -> None:
    """Compute the cosine and the sine of each link's angle in the arm's plane.

    The angle θⱼ of link j is the sum of all revolute joint angles up to j.

    Args:
        turns: Whether each joint is revolute, shape (n,).
        q: Joint positions, shape (n,) [rad or m].
        cosine: Output, written in place, shape (n,): cos θⱼ.
        sine: Output, written in place, shape (n,): sin θⱼ.
    """
    angle = 0.0
    for j in range(len(q)):
        angle += get_turn_angle(turns, q, j)
        cosine[j], sine[j] = math.cos(angle), math.sin(angle)


@kernel(borrows=True, forceinline=True)
def compute_chain_gravity_torques(
    c: Chain, q: FloatArray, cosine: FloatArray, sine: FloatArray, torque: FloatArray
) -> None:
    """Compute the joint torques that hold a chain of links against gravity.

        τⱼ = g Σ mᵢ (xᵢ − xⱼ)    joint that turns [N m]
        τⱼ = g sin θⱼ Σ mᵢ       joint that slides [N]
        τⱼ = 0                   joint that slews

    The sums run over all masses beyond joint j: links and payload, each with its mass mᵢ and the x
    coordinate xᵢ of its centre of mass. xⱼ is the x coordinate of joint j, θⱼ the angle of link j,
    and g the acceleration of gravity. The torque τⱼ is positive if the joint must lift.

    Tested against the gradient of the potential energy of point masses, and MuJoCo.

    Args:
        c: Links and payload.
        q: Joint positions, shape (n,) [rad or m].
        cosine: Cosine of each link's angle in the plane, from `compute_link_directions`, shape
            (n,).
        sine: Sine of each link's angle in the plane, from `compute_link_directions`, shape (n,).
        torque: Output, written in place, shape (n,) [N m], or [N] for a sliding joint.
    """
    moment = 0.0
    mass = c.payload
    for j in range(len(torque) - 1, -1, -1):
        moment, mass = _add_link_moment(c, q, j, cosine[j], moment, mass)
        torque[j] = c.gravity * (mass * sine[j] if c.slides[j] else moment)
    if c.slews:
        torque[0] = 0.0


@kernel(borrows=True, forceinline=True)
def _add_link_moment(
    c: Chain, q: FloatArray, j: int, cosine: float, moment: float, mass: float
) -> tuple[float, float]:
    """Add link j to the mass beyond the link, and to the first moment of that mass.

    The first moment of masses about a point is Σ m (x − x_point), with x forward in the arm's
    plane.

    Args:
        c: Links and payload.
        q: Joint positions, shape (n,) [rad or m].
        j: Index of the link.
        cosine: Cosine of the link's angle in the plane.
        moment: First moment of all masses beyond link j, about the link's tip [kg m].
        mass: Mass of everything beyond link j, the payload included [kg].

    Returns:
        First moment about joint j [kg m], and mass [kg], both with link j included.
    """
    center = add_extension(c.slides, c.center, q, j)
    length = add_extension(c.slides, c.length, q, j)
    return moment + cosine * (c.mass[j] * center + mass * length), mass + c.mass[j]


INERTIA_WORK = 3
"""Number of rows of the scratch array `work` that `compute_inertia_torques` needs."""

MOTION_WORK = INERTIA_WORK + 2
"""Number of rows of the scratch array `work` that `compute_motion_torques` needs."""


@kernel(borrows=True, forceinline=True)
def compute_inertia_torques(
    c: Chain,
    motion: JointMotion,
    cosine: FloatArray,
    sine: FloatArray,
    work: FloatArray,
    torque: FloatArray,
) -> None:
    """Compute the joint torques of inertia, τ = M(q) q̈ + C(q, q̇) q̇, without gravity.

    The method is recursive Newton-Euler. An outward pass computes the acceleration of each link,
    and the force and moment that the link needs for it. An inward pass adds up the forces and
    moments of all links beyond each joint. A point at the distance d along a link has the
    acceleration

        a = p̈ + d (ω̇ n − ω² e)                      joint that turns
        a = p̈ + d (ω̇ n − ω² e) + 2 ω q̇ n + q̈ e     joint that slides (Coriolis)

    e is the unit vector along the link, and n the one across it. p̈ is the acceleration of the tip
    of the link before. ω and ω̇ are the link's angular velocity and acceleration. If joint 1 slews,
    its torque and its centrifugal effect on all others are included.

    Tested against the mass matrix and its derivatives, and MuJoCo's qfrc_inverse.

    Args:
        c: Links and payload.
        motion: Positions q, velocities q̇ and accelerations q̈ of the joints at one instant.
        cosine: Cosine of each link's angle in the plane, from `compute_link_directions`, shape
            (n,).
        sine: Sine of each link's angle in the plane, from `compute_link_directions`, shape (n,).
        work: Working memory with at least INERTIA_WORK rows, shape (…, n). The first INERTIA_WORK
            rows are overwritten.
        torque: Output, written in place, shape (n,) [N m], or [N] for a sliding joint.

    Source:
        R. Featherstone, Rigid Body Dynamics Algorithms, section 5.3.
    """
    q, qd, qdd = motion
    n = len(torque)
    omega = alpha = ax = az = 0.0
    for j in range(n):
        omega += get_turn_angle(c.turns, qd, j)
        alpha += get_turn_angle(c.turns, qdd, j)
        inwards = omega * omega
        gx = -inwards * cosine[j] - alpha * sine[j]
        gz = -inwards * sine[j] + alpha * cosine[j]
        if c.slides[j]:
            across = 2.0 * omega * qd[j]
            ax += qdd[j] * cosine[j] - across * sine[j]
            az += qdd[j] * sine[j] + across * cosine[j]
        center = add_extension(c.slides, c.center, q, j)
        length = add_extension(c.slides, c.length, q, j)
        work[0, j] = c.inertia[j] * alpha
        work[1, j] = c.mass[j] * (ax + gx * center)
        work[2, j] = c.mass[j] * (az + gz * center)
        ax += gx * length
        az += gz * length
    moment, fx, fz = 0.0, c.payload * ax, c.payload * az
    for j in range(n - 1, -1, -1):
        center = add_extension(c.slides, c.center, q, j)
        length = add_extension(c.slides, c.length, q, j)
        moment += work[0, j] + length * (cosine[j] * fz - sine[j] * fx)
        moment += center * (cosine[j] * work[2, j] - sine[j] * work[1, j])
        fx += work[1, j]
        fz += work[2, j]
        torque[j] = cosine[j] * fx + sine[j] * fz if c.slides[j] else moment
    if c.slews:
        _add_slew_torques(c, motion, cosine, sine, work, torque)


@kernel(borrows=True)
def _add_slew_torques(
    c: Chain,
    motion: JointMotion,
    cosine: FloatArray,
    sine: FloatArray,
    work: FloatArray,
    torque: FloatArray,
) -> None:
    """Compute the slew's inertia torque, and add the slew's centrifugal effect to the other joints.

    Lagrange's equations for slender links give

        I = I₀ + Σ m ρ² + Σ J cos²φ
        τ₁ = I q̈₁ + İ q̇₁
        τⱼ = τⱼ,before − ½ (∂I/∂qⱼ) q̇₁²,   j > 1

    q₁ is the slew's angle and qⱼ the position of joint j. I is the inertia of the whole arm about
    the slew's axis, and I₀ the inertia of the platform alone. ρ is the distance of each mass m from
    the axis. φ is the angle of each link from the horizontal, and J its inertia about its centre of
    mass.

    Args:
        c: Links and payload.
        motion: Positions q, velocities q̇ and accelerations q̈ of the joints at one instant.
        cosine: Cosine of each link's angle in the plane, shape (n,).
        sine: Sine of each link's angle in the plane, shape (n,).
        work: Working memory with n columns; the first row is overwritten.
        torque: Torques of the arm without slewing, changed in place, shape (n,) [N m or N]. Element
            0 is replaced by τ₁; the centrifugal term is added to all others.
    """
    q, qd, qdd = motion
    n, square = len(torque), qd[0] * qd[0]
    inertia, rate, omega = c.slew_inertia, 0.0, 0.0
    distance, moving = c.slew_offset, 0.0  # ρ of the last link's tip, and dρ/dt
    for j in range(1, n):
        omega += get_turn_angle(c.turns, qd, j)
        if c.slides[j]:
            moving += qd[j] * cosine[j]
        center, closing = add_extension(c.slides, c.center, q, j), -omega * sine[j]
        at, its_rate = distance + center * cosine[j], moving + center * closing
        inertia += c.mass[j] * at * at + c.inertia[j] * cosine[j] * cosine[j]
        rate += 2.0 * (c.mass[j] * at * its_rate + c.inertia[j] * cosine[j] * closing)
        work[0, j] = -c.mass[j] * at * square
        length = add_extension(c.slides, c.length, q, j)
        distance += length * cosine[j]
        moving += length * closing
    inertia += c.payload * distance * distance
    rate += 2.0 * c.payload * distance * moving
    torque[0] = inertia * qdd[0] + rate * qd[0]
    moment, inwards = 0.0, -c.payload * distance * square
    for j in range(n - 1, 0, -1):
        center = add_extension(c.slides, c.center, q, j)
        length = add_extension(c.slides, c.length, q, j)
        moment -= sine[j] * (length * inwards + center * work[0, j])
        moment += c.inertia[j] * cosine[j] * sine[j] * square
        inwards += work[0, j]
        torque[j] += cosine[j] * inwards if c.slides[j] else moment


@kernel(borrows=True, forceinline=True)
def compute_motion_torques(
    c: Chain,
    q: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
    work: FloatArray,
    static_torque: FloatArray,
    torque: FloatArray,
) -> None:
    """Compute the joint torques for gravity alone, and for the whole motion.

        τ = M(q) q̈ + C(q, q̇) q̇ + g(q)

    M is the mass matrix, and C q̇ are the torques by velocities (Coriolis and centrifugal). g are
    the gravity torques, positive if a joint must lift.

    Args:
        c: Links and payload.
        q: Joint positions, shape (n,) [rad or m].
        qd: Joint velocities, shape (n,) [rad/s or m/s].
        qdd: Joint accelerations, shape (n,) [rad/s² or m/s²].
        work: Working memory with at least MOTION_WORK rows, shape (…, n), overwritten.
        static_torque: Output, written in place: g, shape (n,) [N m], or [N] for a sliding joint.
        torque: Output, written in place: τ, gravity included, shape (n,) [N m or N].
    """
    cosine, sine = work[INERTIA_WORK], work[INERTIA_WORK + 1]
    compute_link_directions(c.turns, q, cosine, sine)
    compute_chain_gravity_torques(c, q, cosine, sine, static_torque)
    compute_inertia_torques(c, JointMotion(q, qd, qdd), cosine, sine, work, torque)
    for j in range(len(torque)):
        torque[j] += static_torque[j]


@kernel(borrows=True)
def gravity_torque(m: MachineArrays, q: FloatArray, torque: FloatArray) -> None:
    """Compute the joint torques that hold a machine with its payload against gravity.

    Args:
        m: Arrays of the machine.
        q: Joint positions, shape (n,) [rad or m].
        torque: Output, written in place, shape (n,) [N m], or [N] for a sliding joint. The sign is
            that of the joint's coordinate: positive if the actuator must push the joint towards
            larger values. It is 0 for a slew.
    """
    chain, angle = get_chain(m), 0.0
    for j in range(len(q)):
        angle += get_turn_angle(m.turns, q, j)
        torque[j] = angle
    moment, mass = 0.0, m.payload
    for j in range(len(q) - 1, -1, -1):
        angle = torque[j]
        moment, mass = _add_link_moment(chain, q, j, math.cos(angle), moment, mass)
        torque[j] = m.gravity * (mass * math.sin(angle) if m.slides[j] else moment)
    if m.slews:
        torque[0] = 0.0


@kernel(borrows=True)
def piston_forces(m: MachineArrays, q: FloatArray, force: FloatArray) -> None:
    """Compute the piston forces that hold a machine with its payload against gravity, F = τ / r.

    τ is the gravity torque of a joint, and r the moment arm of its cylinder.

    Args:
        m: Arrays of the machine.
        q: Joint positions, shape (n,) [rad or m].
        force: Output, written in place, shape (n,) [N]; positive if the load resists extension.
    """
    gravity_torque(m, q, force)
    for j in range(len(q)):
        force[j] /= moment_arm(m.linkage[j], q[j])


@kernel(borrows=True)
def piston_forces_in(m: MachineArrays, posture: FloatArray, force: FloatArray) -> None:
    """Compute the piston forces that hold a machine with its payload in each of several postures.

    Args:
        m: Arrays of the machine.
        posture: Postures, shape (k, n) [rad or m].
        force: Output, written in place, shape (k, n) [N]; positive if the load resists extension.
    """
    for k in range(len(posture)):
        piston_forces(m, posture[k], force[k])


@kernel
def mass_matrix(m: MachineArrays, q: FloatArray) -> FloatArray:
    """Compute the joint-space mass matrix of links and payload.

        M(q) = Σ mᵢ JᵢᵀJᵢ + Iᵢ eᵢᵀeᵢ

    mᵢ and Iᵢ are mass and inertia of link i (the payload is a point mass). Jᵢ is the Jacobian of
    its centre of mass. eᵢ has a 1 for each joint that turns link i in the plane. A slew moves all
    masses perpendicular to the plane. So the slew's row and column are 0 except for the diagonal
    element, the inertia of the whole arm about the slew's axis.

    Args:
        m: Arrays of the machine.
        q: Joint positions, shape (n,) [rad or m].

    Returns:
        M, shape (n, n) [kg m²]. An element is in [kg m] if one of its two joints slides, in [kg] if
        both do.
    """
    n = len(q)
    points = joint_positions(m, q)
    result = np.zeros((n, n))
    cosine, sine, column = np.empty(n), np.empty(n), np.empty((3, n))
    compute_link_directions(m.turns, q, cosine, sine)
    for i in range(n + 1):
        if i < n:
            center = add_extension(m.slides, m.link_center, q, i)
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
