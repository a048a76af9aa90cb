"""Forward kinematics of a planar chain whose joints turn or slide.

Where joint 1 slews, the plane is what it turns, and the chain begins at joint 2 (`slewing`).

Plane x (forward), z (up); joint angles are counter-clockwise, each relative to the link before. A
joint that slides turns nothing: it puts the tip of its link qⱼ farther along the direction of the
link before, which is its own.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import BoolArray, FloatArray


@kernel(inline="always")
def turned(turns: BoolArray, q: FloatArray, j: int) -> float:
    """By how much link j is turned in the plane from the link before [rad]: qⱼ, or 0."""
    return q[j] if turns[j] else 0.0


@kernel(inline="always")
def extended(slides: BoolArray, rest: FloatArray, q: FloatArray, j: int) -> float:
    """restⱼ, a length or a centre at qⱼ = 0, with the extension qⱼ of a joint that slides [m]."""
    return rest[j] + q[j] if slides[j] else rest[j]


@kernel
def radians(m: MachineArrays) -> FloatArray:
    """What counts as much of each joint as a radian, float64[n]: 1 rad of one that turns or slews.

    Of one that slides its whole range counts as half a turn [m].
    """
    radian = np.ones(len(m.slides))
    for j in range(len(radian)):
        if m.slides[j]:
            radian[j] = (m.joint_max[j] - m.joint_min[j]) / math.pi
    return radian


@kernel(borrows=True)
def farthest_move(
    m: MachineArrays, start: FloatArray, end: FloatArray, turn: float, j: int
) -> float:
    """Farther than this no point of link j moves against the link before, from start[n] to end[n]
    [m].

    turn  of link j and all before it [rad], by which its points are turned
    """
    length = extended(m.slides, m.link_length, start, j)
    if not m.slides[j]:
        return length * abs(turn)
    slid = end[j] - start[j]
    return (length + max(0.0, slid)) * abs(turn) + abs(slid)


@kernel(borrows=True)
def tip_position(m: MachineArrays, q: FloatArray) -> tuple[float, float]:
    """x = Σ Lᵢ cos θᵢ, z = Σ Lᵢ sin θᵢ, θᵢ the sum of the turns up to link i [m]."""
    angle = 0.0
    x = 0.0
    z = 0.0
    for i in range(len(q)):
        angle += turned(m.turns, q, i)
        length = extended(m.slides, m.link_length, q, i)
        x += length * math.cos(angle)
        z += length * math.sin(angle)
    return x, z


@kernel
def tip_positions(m: MachineArrays, q: FloatArray) -> FloatArray:
    """Tip (x, z) [m] in each of the postures q[k, n], float64[k, 2]."""
    tip = np.empty((len(q), 2))
    for k in range(len(q)):
        tip[k, 0], tip[k, 1] = tip_position(m, q[k])
    return tip


@kernel(borrows=True)
def end_link_angle(m: MachineArrays, q: FloatArray) -> float:
    """ψ, the angle of the last link: the sum of all turns [rad]."""
    angle = 0.0
    for i in range(len(q)):
        angle += turned(m.turns, q, i)
    return angle


@kernel
def joint_positions(m: MachineArrays, q: FloatArray) -> FloatArray:
    """Positions of all joints and of the tip, float64[n + 1, 2] (x, z) [m].

    That of a joint that slides is the tip of the link before.
    """
    points = np.zeros((len(q) + 1, 2))
    angle = 0.0
    for i in range(len(q)):
        angle += turned(m.turns, q, i)
        length = extended(m.slides, m.link_length, q, i)
        points[i + 1, 0] = points[i, 0] + length * math.cos(angle)
        points[i + 1, 1] = points[i, 1] + length * math.sin(angle)
    return points


@kernel
def tip_jacobian(m: MachineArrays, q: FloatArray) -> FloatArray:
    """J = ∂(x, z)/∂q, float64[2, n].

    Column j is the tip's offset from joint j, turned 90° [m], or, of a joint that slides, the
    direction in which it does; 0 of one that slews.
    """
    n = len(q)
    points = joint_positions(m, q)
    jacobian = np.empty((2, n))
    angle = 0.0
    for j in range(n):
        angle += turned(m.turns, q, j)
        if m.slides[j]:
            jacobian[0, j], jacobian[1, j] = math.cos(angle), math.sin(angle)
        elif not m.turns[j]:
            jacobian[0, j] = jacobian[1, j] = 0.0
        else:
            jacobian[0, j] = -(points[n, 1] - points[j, 1])
            jacobian[1, j] = points[n, 0] - points[j, 0]
    return jacobian
