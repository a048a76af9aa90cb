"""Forward kinematics of a planar chain whose joints turn or slide.

Coordinates are x (forward) and z (up) in the arm's plane. The origin is joint 1, or joint 2 if
joint 1 slews: a slew turns the whole plane about the vertical (`slewing`).

Joint angles are counter-clockwise, each relative to the link before. A sliding (prismatic) joint
turns nothing. It extends its link by qⱼ, so the tip of the link moves along the direction of the
link before.
"""

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import BoolArray, FloatArray


@kernel(borrows=True, forceinline=True, reads=True)
def get_turn_angle(turns: BoolArray, q: FloatArray, j: int) -> float:
    """Return the angle by which joint j turns its link in the plane.

    Args:
        turns: Whether each joint is revolute in the arm's plane, shape (n,).
        q: Joint angles [rad], or extensions [m] of sliding joints, shape (n,). Velocities or
            accelerations work as well; the result is then an angular velocity or acceleration.
        j: Index of the joint.

    Returns:
        qⱼ [rad] for a revolute joint; 0 for a sliding or slewing joint.
    """
    return q[j] if turns[j] else 0.0


@kernel(borrows=True, forceinline=True, reads=True)
def add_extension(slides: BoolArray, retracted_length: FloatArray, q: FloatArray, j: int) -> float:
    """Return a length along link j, plus the extension of joint j if it slides.

    Args:
        slides: Whether each joint is prismatic, shape (n,).
        retracted_length: Length for each link with its joint at q = 0, shape (n,) [m]: the link's
            own length, or the distance of its centre of mass from the joint.
        q: Joint angles [rad], or extensions [m] of sliding joints, shape (n,).
        j: Index of the link.

    Returns:
        Element j of `retracted_length`, plus qⱼ if joint j slides [m].
    """
    return retracted_length[j] + q[j] if slides[j] else retracted_length[j]


@kernel
def compute_radian_equivalents(m: MachineArrays) -> FloatArray:
    """Return the motion of each joint that counts as 1 rad when joints are compared.

    It is 1 rad for a joint that turns or slews. The whole range of a sliding joint counts as π rad,
    that is half a turn.

    Args:
        m: Arrays of the machine.

    Returns:
        Shape (n,): 1 [rad], or range / π [m] for a sliding joint.
    """
    radian = np.ones(len(m.slides))
    for j in range(len(radian)):
        if m.slides[j]:
            radian[j] = (m.joint_max[j] - m.joint_min[j]) / math.pi
    return radian


@kernel(borrows=True, reads=True)
def bound_displacement(
    m: MachineArrays, start: FloatArray, end: FloatArray, turn: float, j: int
) -> float:
    """Return an upper bound on how far a move displaces any point of link j.

    The displacement is relative to the joint at the beginning of the link, in axes that do not
    turn. The bound is

        L |turn|                            for a joint that turns or slews
        (L + max(0, Δqⱼ)) |turn| + |Δqⱼ|    for a joint that slides by Δqⱼ

    L is the length of link j at the start.

    Args:
        m: Arrays of the machine.
        start: Joint positions at the start of the move, shape (n,) [rad or m].
        end: Joint positions at the end of the move, shape (n,) [rad or m].
        turn: Turn of link j in the plane [rad]: the sum of the turns of joints 0 to j. If the
            joints do not move in proportion, pass the sum of their magnitudes.
        j: Index of the link.

    Returns:
        Upper bound of the displacement [m].
    """
    length = add_extension(m.slides, m.link_length, start, j)
    if not m.slides[j]:
        return length * abs(turn)
    slid = end[j] - start[j]
    return (length + max(0.0, slid)) * abs(turn) + abs(slid)


@kernel(borrows=True, reads=True)
def tip_position(m: MachineArrays, q: FloatArray) -> tuple[float, float]:
    """Compute the position of the tip in the arm's plane.

        x = Σ Lᵢ cos θᵢ,  z = Σ Lᵢ sin θᵢ

    Lᵢ is the length of link i with its extension, and θᵢ the sum of all revolute joint angles up to
    i. The origin is joint 1, or joint 2 if joint 1 slews.

    Args:
        m: Arrays of the machine.
        q: Joint angles [rad], or extensions [m] of sliding joints, shape (n,).

    Returns:
        x (forward) and z (up) [m].
    """
    angle = 0.0
    x = 0.0
    z = 0.0
    for i in range(len(q)):
        angle += get_turn_angle(m.turns, q, i)
        length = add_extension(m.slides, m.link_length, q, i)
        x += length * math.cos(angle)
        z += length * math.sin(angle)
    return x, z


@kernel
def tip_positions(m: MachineArrays, q: FloatArray) -> FloatArray:
    """Compute the position of the tip in each of several postures.

    Args:
        m: Arrays of the machine.
        q: Postures, shape (k, n) [rad or m].

    Returns:
        Tip (x, z) in the arm's plane for each posture, shape (k, 2) [m].
    """
    tip = np.empty((len(q), 2))
    for k in range(len(q)):
        tip[k, 0], tip[k, 1] = tip_position(m, q[k])
    return tip


@kernel(borrows=True)
def end_link_angle(m: MachineArrays, q: FloatArray) -> float:
    """Compute the end-link angle ψ, the sum of the angles of all revolute joints.

    Args:
        m: Arrays of the machine.
        q: Joint positions, shape (n,) [rad or m].

    Returns:
        Angle of the last link from the x axis, not wrapped [rad].
    """
    angle = 0.0
    for i in range(len(q)):
        angle += get_turn_angle(m.turns, q, i)
    return angle


@kernel(reads=True)
def joint_positions(m: MachineArrays, q: FloatArray) -> FloatArray:
    """Compute the positions of all joints and of the tip in the arm's plane.

    The origin is joint 1, or joint 2 if joint 1 slews. The position of a sliding joint is the tip
    of the link before.

    Args:
        m: Arrays of the machine.
        q: Joint positions, shape (n,) [rad or m].

    Returns:
        (x, z), shape (n + 1, 2) [m]. The first row is joint 1, at the origin; the last row is the
        tip. If joint 1 slews, the first two rows are both the origin.
    """
    points = np.zeros((len(q) + 1, 2))
    angle = 0.0
    for i in range(len(q)):
        angle += get_turn_angle(m.turns, q, i)
        length = add_extension(m.slides, m.link_length, q, i)
        points[i + 1, 0] = points[i, 0] + length * math.cos(angle)
        points[i + 1, 1] = points[i, 1] + length * math.sin(angle)
    return points


@kernel
def tip_jacobian(m: MachineArrays, q: FloatArray) -> FloatArray:
    """Compute the Jacobian of the tip position in the arm's plane, J = ∂(x, z)/∂q.

    Column j is the tip's offset from joint j, turned by 90° counter-clockwise [m/rad]. For a
    sliding joint it is the unit vector along the link [-]. For a slewing joint it is 0.

    Args:
        m: Arrays of the machine.
        q: Joint positions, shape (n,) [rad or m].

    Returns:
        Jacobian with the rows x and z, shape (2, n).
    """
    n = len(q)
    points = joint_positions(m, q)
    jacobian = np.empty((2, n))
    angle = 0.0
    for j in range(n):
        angle += get_turn_angle(m.turns, q, j)
        if m.slides[j]:
            jacobian[0, j], jacobian[1, j] = math.cos(angle), math.sin(angle)
        elif not m.turns[j]:
            jacobian[0, j] = jacobian[1, j] = 0.0
        else:
            jacobian[0, j] = -(points[n, 1] - points[j, 1])
            jacobian[1, j] = points[n, 0] - points[j, 0]
    return jacobian
