"""How far the arm is from everything that it keeps clear of.

A link is a capsule: all points within its radius of the line between its joints. The clearance of
an obstacle is the least signed distance, negative by the depth of the deepest point: for a box
max(x_min − x, x − x_max, z_min − z, z − z_max) inside, for a circle |p − c| − R, less the link's
radius. It changes by no more than the arm's points move, so that clearances at both ends of a move
bound those in between:

    clearance ≥ (c_start + c_end − D) / 2,   D = Σ_k L_k |Σ_{j ≤ k} Δq_j|

where all joints move in proportion, and with Σ_{j ≤ k} |Δq_j| where they do not but none turns
back. A joint that slides turns nothing and adds |Δq_k| to D; its L_k is the longer one. One that
slews adds (a + Σ_k L_k) |Δq_1|, with joint 2 at a ahead of its axis. Source: Lipschitz bound of the
distance function, as in conservative advancement (Mirtich, 1996).

Zones in space are seen from `base_link`, everything else from the plane that joint 1 turns.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import farthest_move, joint_positions, turned
from mhsb_model.linkages.linkage import cylinder_length, joint_angle
from mhsb_model.obstacles.distances_in_space import line_in_space, point_in_space
from mhsb_model.obstacles.zones import (
    BOX,
    BOX_IN_SPACE,
    CIRCLE,
    KIND,
    LINK,
    PART,
    RADIUS,
    SHAPE,
)
from mhsb_model.types import FloatArray, IntArray

FINEST = 1e-3
"""Parts of a move within which no point moves farther are not divided any more [m]: there the
clearance falls short of that at the ends by half as much at most."""

DEEPEST = 32
"""Times that a move is halved, at most."""

ROUNDING = 1e-9  # m


@kernel
def _point_to_box(
    x: float, z: float, x_min: float, z_min: float, x_max: float, z_max: float
) -> float:
    """Signed distance of a point to a box [m]."""
    dx, dz = max(x_min - x, x - x_max), max(z_min - z, z - z_max)
    if dx > 0.0 and dz > 0.0:
        return math.hypot(dx, dz)
    return max(dx, dz)


@kernel
def _point_to_segment(
    x: float, z: float, ax: float, az: float, bx: float, bz: float
) -> float:
    """Distance of a point to the segment from a to b [m]."""
    ux, uz = bx - ax, bz - az
    square = ux * ux + uz * uz
    share = 0.0
    if square > 0.0:
        share = min(1.0, max(0.0, ((x - ax) * ux + (z - az) * uz) / square))
    return math.hypot(x - ax - share * ux, z - az - share * uz)


@kernel
def _depth_in_box(
    ax: float, az: float, bx: float, bz: float,
    x_min: float, z_min: float, x_max: float, z_max: float,
) -> float:  # fmt: skip
    """Least value along a segment of the largest of x_min − x, x − x_max, z_min − z, z − z_max.

    These are linear along the segment, so the least is met at an end or where two of them are
    equal. Negative where the segment meets the inside of the box.
    """
    at_a = (x_min - ax, ax - x_max, z_min - az, az - z_max)
    at_b = (x_min - bx, bx - x_max, z_min - bz, bz - z_max)
    least = min(max(at_a), max(at_b))
    for i in range(4):
        for k in range(i):
            apart, closing = at_a[i] - at_a[k], at_a[i] - at_a[k] - at_b[i] + at_b[k]
            if closing == 0.0:
                continue
            share = apart / closing
            if 0.0 < share < 1.0:
                highest = -math.inf
                for m in range(4):
                    highest = max(highest, at_a[m] + share * (at_b[m] - at_a[m]))
                least = min(least, highest)
    return least


@kernel
def segment_to_box(
    ax: float, az: float, bx: float, bz: float,
    x_min: float, z_min: float, x_max: float, z_max: float,
) -> float:  # fmt: skip
    """Signed distance of the segment from a to b to a box [m]."""
    aside = (
        min(ax, bx) >= x_max or max(ax, bx) <= x_min or min(az, bz) >= z_max or max(az, bz) <= z_min
    )
    if not aside:
        depth = _depth_in_box(ax, az, bx, bz, x_min, z_min, x_max, z_max)
        if depth <= 0.0:
            return depth
    nearest = min(
        _point_to_box(ax, az, x_min, z_min, x_max, z_max),
        _point_to_box(bx, bz, x_min, z_min, x_max, z_max),
    )
    for x in (x_min, x_max):
        for z in (z_min, z_max):
            nearest = min(nearest, _point_to_segment(x, z, ax, az, bx, bz))
    return nearest


@kernel
def _side(px: float, pz: float, ax: float, az: float, bx: float, bz: float) -> float:
    """On which side of the line from a to b a point lies, by its sign."""
    return (bx - ax) * (pz - az) - (bz - az) * (px - ax)


@kernel
def segment_to_segment(
    ax: float, az: float, bx: float, bz: float, cx: float, cz: float, dx: float, dz: float
) -> float:
    """Distance between the segments a–b and c–d, 0 where they cross [m]."""
    c_and_d = _side(cx, cz, ax, az, bx, bz) * _side(dx, dz, ax, az, bx, bz)
    a_and_b = _side(ax, az, cx, cz, dx, dz) * _side(bx, bz, cx, cz, dx, dz)
    if c_and_d < 0.0 and a_and_b < 0.0:
        return 0.0
    return min(
        min(_point_to_segment(ax, az, cx, cz, dx, dz), _point_to_segment(bx, bz, cx, cz, dx, dz)),
        min(_point_to_segment(cx, cz, ax, az, bx, bz), _point_to_segment(dx, dz, ax, az, bx, bz)),
    )


@kernel
def row_clearance(
    m: MachineArrays, rows: FloatArray, k: int, q: FloatArray, joint: FloatArray
) -> float:
    """Clearance of row k in the posture q[n], with joints and tip at joint[n + 1, 2] [m]."""
    part = int(rows[k, PART])
    if rows[k, KIND] >= BOX_IN_SPACE:
        last, ahead = min(part + 1, len(joint) - 1), m.slew_offset
        return line_in_space(
            rows, k, q[0],
            ahead + joint[part, 0], joint[part, 1], ahead + joint[last, 0], joint[last, 1],
        ) - rows[k, RADIUS]  # fmt: skip
    if part == len(joint) - 1:
        return point_clearance(rows, k, joint[part, 0], joint[part, 1])
    ax, az, bx, bz = joint[part, 0], joint[part, 1], joint[part + 1, 0], joint[part + 1, 1]
    kind, radius = rows[k, KIND], rows[k, RADIUS]
    if kind == BOX:
        return segment_to_box(
            ax, az, bx, bz, rows[k, 2], rows[k, 3], rows[k, 4], rows[k, 5]
        ) - radius  # fmt: skip
    if kind == CIRCLE:
        distance = _point_to_segment(rows[k, 2], rows[k, 3], ax, az, bx, bz)
        return distance - rows[k, 4] - radius
    o = int(rows[k, SHAPE])
    return segment_to_segment(
        ax, az, bx, bz, joint[o, 0], joint[o, 1], joint[o + 1, 0], joint[o + 1, 1]
    ) - radius  # fmt: skip


@kernel
def point_clearance(rows: FloatArray, k: int, x: float, z: float) -> float:
    """Clearance of row k, of a box or a circle, if the arm were but a point [m]."""
    if rows[k, KIND] == CIRCLE:
        distance = math.hypot(x - rows[k, 2], z - rows[k, 3]) - rows[k, 4]
    else:
        distance = _point_to_box(x, z, rows[k, 2], rows[k, 3], rows[k, 4], rows[k, 5])
    return distance - rows[k, RADIUS]


@kernel
def tip_clearance(rows: FloatArray, links: int, x: float, z: float) -> tuple[float, int]:
    """Least clearance of the end of the last link at (x, z) m, and of which row; inf, −1.

    No posture with the tip there has more. Zones in space are not looked at.
    """
    least, nearest = math.inf, -1
    for k in range(len(rows)):
        if rows[k, KIND] == LINK or rows[k, KIND] >= BOX_IN_SPACE or rows[k, PART] < links - 1:
            continue
        distance = point_clearance(rows, k, x, z)
        if distance < least:
            least, nearest = distance, k
    return least, nearest


@kernel
def tip_clearance_in_space(
    rows: FloatArray, links: int, x: float, y: float, z: float
) -> tuple[float, int]:
    """The same of zones in space, with the tip at (x, y, z) m in `base_link`."""
    least, nearest = math.inf, -1
    for k in range(len(rows)):
        if rows[k, KIND] < BOX_IN_SPACE or rows[k, PART] < links - 1:
            continue
        distance = point_in_space(rows, k, x, y, z) - rows[k, RADIUS]
        if distance < least:
            least, nearest = distance, k
    return least, nearest


@kernel
def clearance(
    m: MachineArrays, rows: FloatArray, q: FloatArray, leeway: FloatArray
) -> tuple[float, int]:
    """Least clearance [m] in the posture q[n] [rad], and of which row; inf, −1 without any.

    leeway  float64[rows], added to each clearance [m]
    """
    joint = joint_positions(m, q)
    least, nearest = math.inf, -1
    for k in range(len(rows)):
        distance = row_clearance(m, rows, k, q, joint) + leeway[k]
        if distance < least:
            least, nearest = distance, k
    return least, nearest


@kernel
def clearances(
    m: MachineArrays, rows: FloatArray, posture: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Of many postures float64[count, n]: least clearance [m], and of which row."""
    least, nearest = np.empty(len(posture)), np.empty(len(posture), dtype=np.int64)
    none = np.zeros(len(rows))
    for i in range(len(posture)):
        least[i], nearest[i] = clearance(m, rows, posture[i], none)
    return least, nearest


@kernel
def leeway_from(m: MachineArrays, rows: FloatArray, q: FloatArray, kept: float) -> FloatArray:
    """What each row's clearance in the posture q[n] lacks to `kept` m, float64[rows]."""
    joint = joint_positions(m, q)
    leeway = np.empty(len(rows))
    for k in range(len(rows)):
        leeway[k] = max(0.0, kept - row_clearance(m, rows, k, q, joint))
    return leeway


@kernel(borrows=True)
def longest_reach(m: MachineArrays, start: FloatArray, end: FloatArray) -> float:
    """No point of an arm that slews is farther from the slew's axis between two postures [m]."""
    reach = abs(m.slew_offset)
    for k in range(len(start)):
        reach += m.link_length[k]
        if m.slides[k]:
            reach += max(start[k], end[k])
    return reach


@kernel(borrows=True)
def travel(m: MachineArrays, start: FloatArray, end: FloatArray, along_cylinders: bool) -> float:
    """Farther than this no point of the arm moves between two postures [m]; D above."""
    turn, farthest = 0.0, 0.0
    if m.slews:
        farthest = longest_reach(m, start, end) * abs(end[0] - start[0])
    for k in range(len(start)):
        more = turned(m.turns, end, k) - turned(m.turns, start, k)
        turn += abs(more) if along_cylinders else more
        farthest += farthest_move(m, start, end, turn, k)
    return farthest


@kernel(borrows=True)
def _half_way(
    m: MachineArrays, start: FloatArray, end: FloatArray, along_cylinders: bool, middle: FloatArray
) -> None:
    """The posture half-way between two, in joint angles or in cylinder lengths, to middle[n]."""
    for j in range(len(start)):
        middle[j] = 0.5 * (start[j] + end[j])
        if along_cylinders:
            linkage = m.linkage[j]
            length = cylinder_length(linkage, start[j]) + cylinder_length(linkage, end[j])
            low, high = min(start[j], end[j]), max(start[j], end[j])
            middle[j] = joint_angle(linkage, 0.5 * length, low, high, middle[j])


@kernel
def move_is_clear(
    m: MachineArrays, rows: FloatArray, start: FloatArray, end: FloatArray, along_cylinders: bool
) -> bool:
    """Whether a move between two postures [rad] keeps clear of all obstacles.

    rows             of the obstacles, `Obstacles.path_rows` for a discrete path
    along_cylinders  straight in cylinder lengths; otherwise in joint angles

    A start in an obstacle may be left, but no deeper into it. Never true of a move that gets into
    one by more than FINEST/2.
    """
    if len(rows) == 0:
        return True
    leeway = np.zeros(len(rows))
    left = clearance(m, rows, start, leeway)[0]
    if left < 0.0:
        leeway = leeway_from(m, rows, start, 0.0)
        left = 0.0
    if left >= travel(m, start, end, along_cylinders):
        return True
    n = len(start)
    here = np.empty(n)
    ends, clear = np.empty((DEEPEST, n)), np.empty(DEEPEST)
    here[:] = start
    ends[0], clear[0] = end, clearance(m, rows, end, leeway)[0]
    waiting = 1  # parts of the move that are left, the next one last
    while waiting > 0:
        right = clear[waiting - 1]
        if right < -ROUNDING:
            return False
        apart = travel(m, here, ends[waiting - 1], along_cylinders)
        if apart <= FINEST or left + right >= apart:
            here[:] = ends[waiting - 1]
            left = right
            waiting -= 1
            continue
        if waiting == DEEPEST:
            return False
        _half_way(m, here, ends[waiting - 1], along_cylinders, ends[waiting])
        clear[waiting] = clearance(m, rows, ends[waiting], leeway)[0]
        waiting += 1
    return True
