"""Distance of the arm from its obstacles.

A link is a capsule: all points within its radius of the line between its joints. The clearance of
an obstacle is the least signed distance of the link's line from it, minus the link's radius. Inside
an obstacle the signed distance is negative: max(x_min − x, x − x_max, z_min − z, z − z_max) for a
box, |p − c| − R for a circle.

A move changes the clearance by no more than the distance that the arm's points move. So the
clearances at both ends of a move bound the clearance in between:

    clearance ≥ (c_start + c_end − D) / 2,   D = Σ_k L_k |Σ_{j ≤ k} Δq_j|

This holds if all joints move in proportion. If they do not, but no joint reverses, Σ_{j ≤ k} |Δq_j|
takes the place of |Σ_{j ≤ k} Δq_j|. A joint k that slides turns nothing and adds |Δq_k| to D; L_k
is then the longer length of its link. A slew adds (a + Σ_k L_k) |Δq_1|, with joint 2 at a distance
a ahead of its axis.

Zones in space are given in `base_link`, all other obstacles in the arm's plane, which joint 1 turns
if it slews. Obstacles are rows of numbers; `zones` describes the columns.

Source: Lipschitz bound of the distance function, as in conservative advancement (Mirtich, 1996).
"""

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import bound_displacement, get_turn_angle, joint_positions
from mhsb_model.linkages.linkage import cylinder_length, find_joint_angle
from mhsb_model.obstacles.distances_in_space import compute_line_distance, compute_point_distance
from mhsb_model.obstacles.zones import (
    BOX_KIND,
    CIRCLE_KIND,
    KIND_COLUMN,
    LINK_COLUMN,
    LINK_KIND,
    RADIUS_COLUMN,
    SHAPE_COLUMN,
    SPACE_BOX_KIND,
)
from mhsb_model.types import FloatArray, IntArray

MIN_PART_TRAVEL = 1e-3
"""Travel below which a part of a move is not divided further [m].

In such a part the clearance is at most half of this value lower than at the ends of the part."""

MAX_HALVINGS = 32
"""Largest number of times that a part of a move is halved."""

CLEARANCE_ROUNDING = 1e-9
"""Negative clearance that counts as rounding [m]."""


class LineSegment(NamedTuple):
    """Straight line between two points a and b of the arm's plane, x forward and z up [m]."""

    ax: float
    az: float
    bx: float
    bz: float


class BoxInPlane(NamedTuple):
    """Box in the arm's plane, x forward and z up [m]."""

    x_min: float
    z_min: float
    x_max: float
    z_max: float


@kernel
def _point_to_box(x: float, z: float, box: BoxInPlane) -> float:
    """Compute the signed distance of a point from a box.

    Args:
        x: Point, forward [m].
        z: Point, up [m].
        box: The box.

    Returns:
        Distance [m]; inside the box, the negative distance from the nearest face.
    """
    dx, dz = max(box.x_min - x, x - box.x_max), max(box.z_min - z, z - box.z_max)
    if dx > 0.0 and dz > 0.0:
        return math.hypot(dx, dz)
    return max(dx, dz)


@kernel
def _point_to_segment(x: float, z: float, segment: LineSegment) -> float:
    """Compute the distance of a point from a segment.

    Args:
        x: Point, forward [m].
        z: Point, up [m].
        segment: The segment.

    Returns:
        Distance ≥ 0 [m].
    """
    ax, az, bx, bz = segment
    ux, uz = bx - ax, bz - az
    square = ux * ux + uz * uz
    share = 0.0
    if square > 0.0:
        share = min(1.0, max(0.0, ((x - ax) * ux + (z - az) * uz) / square))
    return math.hypot(x - ax - share * ux, z - az - share * uz)


@kernel
def _depth_in_box(segment: LineSegment, box: BoxInPlane) -> float:
    """Compute how deep the deepest point of a segment lies in a box.

    For each point let d be the largest of x_min − x, x − x_max, z_min − z and z − z_max. Inside the
    box, −d is the point's distance from the nearest face. The result is the least d along the
    segment. All four terms are linear along the segment. So the least d is at an end, or at a point
    at which two of the terms are equal.

    Args:
        segment: The segment.
        box: The box.

    Returns:
        Least d [m]. If it is negative, the segment enters the box to the depth −d. Otherwise it is
        only a lower bound on the distance between segment and box.
    """
    (ax, az, bx, bz), (x_min, z_min, x_max, z_max) = segment, box
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
def segment_to_box(segment: LineSegment, box: BoxInPlane) -> float:
    """Compute the signed distance of a segment from a box.

    Args:
        segment: The segment.
        box: The box.

    Returns:
        Distance [m]. If the segment enters the box, it is negative: minus the distance of the
        segment's deepest point from the nearest face.
    """
    (ax, az, bx, bz), (x_min, z_min, x_max, z_max) = segment, box
    aside = (
        min(ax, bx) >= x_max or max(ax, bx) <= x_min or min(az, bz) >= z_max or max(az, bz) <= z_min
    )
    if not aside:
        depth = _depth_in_box(segment, box)
        if depth <= 0.0:
            return depth
    nearest = min(_point_to_box(ax, az, box), _point_to_box(bx, bz, box))
    for x in (x_min, x_max):
        for z in (z_min, z_max):
            nearest = min(nearest, _point_to_segment(x, z, segment))
    return nearest


@kernel
def _compute_side_of_line(px: float, pz: float, line: LineSegment) -> float:
    """Return a number whose sign says on which side of a line a point lies.

    The line goes from a to b. The number is the cross product (b − a) × (p − a) for the point p.

    Args:
        px: Point, forward [m].
        pz: Point, up [m].
        line: Two points a and b of the line.

    Returns:
        Cross product [m²]; positive on the left, negative on the right, 0 on the line.
    """
    ax, az, bx, bz = line
    return (bx - ax) * (pz - az) - (bz - az) * (px - ax)


@kernel
def segment_to_segment(one: LineSegment, other: LineSegment) -> float:
    """Compute the distance between two segments.

    Args:
        one: First segment.
        other: Second segment.

    Returns:
        Distance [m]; 0 if the segments cross.
    """
    (ax, az, bx, bz), (cx, cz, dx, dz) = one, other
    c_and_d = _compute_side_of_line(cx, cz, one) * _compute_side_of_line(dx, dz, one)
    a_and_b = _compute_side_of_line(ax, az, other) * _compute_side_of_line(bx, bz, other)
    if c_and_d < 0.0 and a_and_b < 0.0:
        return 0.0
    return min(
        min(_point_to_segment(ax, az, other), _point_to_segment(bx, bz, other)),
        min(_point_to_segment(cx, cz, one), _point_to_segment(dx, dz, one)),
    )


@kernel(borrows=True, forceinline=True)
def _get_link_line(joint: FloatArray, k: int) -> LineSegment:
    """Return the line of a link in the arm's plane, from its joint to the next joint or the tip.

    Args:
        joint: Positions (x, z) of all joints and the tip, float64[n + 1, 2], [m].
        k: Index of the link, 0 … n − 1.
    """
    return LineSegment(joint[k, 0], joint[k, 1], joint[k + 1, 0], joint[k + 1, 1])


@kernel(borrows=True, forceinline=True)
def _get_box(rows: FloatArray, k: int) -> BoxInPlane:
    """Return the box that a row of the obstacle table describes.

    Args:
        rows: Obstacle table, float64[rows, ROW_WIDTH].
        k: Index of the row; its kind must be BOX_KIND.
    """
    return BoxInPlane(rows[k, 2], rows[k, 3], rows[k, 4], rows[k, 5])


@kernel(borrows=True, reads=True)
def row_clearance(
    m: MachineArrays, rows: FloatArray, k: int, q: FloatArray, joint: FloatArray
) -> float:
    """Compute the clearance that one row of the obstacle table describes.

    A row names an obstacle, and the link (or the tip alone) that must keep clear of it. The
    clearance is the signed distance between the obstacle and the link's line, minus the value in
    column RADIUS_COLUMN. This column has the link's radius, or 0 for the tip alone. In the rows of
    `Obstacles.path_rows` it also includes a margin.

    Args:
        m: Machine with n joints.
        rows: Obstacle table, float64[rows, ROW_WIDTH]. Column LINK_COLUMN has the index of the
            link, or n for the tip alone.
        k: Index of the row.
        q: Posture, float64[n], [rad or m]. Only the slew's angle q[0] is read, for zones in space.
        joint: Positions (x, z) of all joints and the tip in this posture, float64[n + 1, 2], [m],
            from `kinematics.joint_positions`.

    Returns:
        Clearance [m]; negative if the link or the tip is in the obstacle.
    """
    part = int(rows[k, LINK_COLUMN])
    if rows[k, KIND_COLUMN] >= SPACE_BOX_KIND:
        last, ahead = min(part + 1, len(joint) - 1), m.slew_offset
        return compute_line_distance(
            rows, k, q[0],
            ahead + joint[part, 0], joint[part, 1], ahead + joint[last, 0], joint[last, 1],
        ) - rows[k, RADIUS_COLUMN]  # fmt: skip
    if part == len(joint) - 1:
        return point_clearance(rows, k, joint[part, 0], joint[part, 1])
    link, radius = _get_link_line(joint, part), rows[k, RADIUS_COLUMN]
    if rows[k, KIND_COLUMN] == BOX_KIND:
        return segment_to_box(link, _get_box(rows, k)) - radius
    if rows[k, KIND_COLUMN] == CIRCLE_KIND:
        distance = _point_to_segment(rows[k, 2], rows[k, 3], link)
        return distance - rows[k, 4] - radius
    return segment_to_segment(link, _get_link_line(joint, int(rows[k, SHAPE_COLUMN]))) - radius


@kernel(borrows=True)
def point_clearance(rows: FloatArray, k: int, x: float, z: float) -> float:
    """Compute the clearance of a point in the arm's plane from one obstacle.

    The point counts as a disc. Its radius is in column RADIUS_COLUMN of the obstacle's row.

    Args:
        rows: Obstacle table, float64[rows, ROW_WIDTH].
        k: Index of the row; the obstacle must be a box or a circle in the plane.
        x: Point, forward [m].
        z: Point, up [m].

    Returns:
        Signed distance of the point from the obstacle, minus the radius [m]; negative if they
        overlap.
    """
    if rows[k, KIND_COLUMN] == CIRCLE_KIND:
        distance = math.hypot(x - rows[k, 2], z - rows[k, 3]) - rows[k, 4]
    else:
        distance = _point_to_box(x, z, _get_box(rows, k))
    return distance - rows[k, RADIUS_COLUMN]


@kernel(borrows=True)
def tip_clearance(rows: FloatArray, links: int, x: float, z: float) -> tuple[float, int]:
    """Compute the least clearance of the tip from the boxes and circles in the arm's plane.

    No posture with the tip at this point has a larger clearance. Only obstacles of the last link or
    of the tip alone count. Other links, and zones in space, are skipped.

    Args:
        rows: Obstacle table, one row for each obstacle and link, float64[rows, ROW_WIDTH].
        links: Number of links of the arm, equal to the number of its joints.
        x: Tip, forward in the arm's plane [m].
        z: Tip, up [m].

    Returns:
        Least clearance [m] and the index of its row; inf and −1 if no row counts. The clearance is
        the signed distance of the point from the obstacle, minus the value in column RADIUS_COLUMN.
        This column has the radius of the last link, or 0 in a row for the tip alone. In the rows of
        `Obstacles.path_rows` it also includes the margin of discrete paths.
    """
    least, nearest = math.inf, -1
    for k in range(len(rows)):
        if (
            rows[k, KIND_COLUMN] == LINK_KIND
            or rows[k, KIND_COLUMN] >= SPACE_BOX_KIND
            or rows[k, LINK_COLUMN] < links - 1
        ):
            continue
        distance = point_clearance(rows, k, x, z)
        if distance < least:
            least, nearest = distance, k
    return least, nearest


@kernel(borrows=True)
def tip_clearance_in_space(
    rows: FloatArray, links: int, x: float, y: float, z: float
) -> tuple[float, int]:
    """Compute the least clearance of the tip from the keep-out zones in space.

    No posture with the tip at this point has a larger clearance. Only zones of the last link or of
    the tip alone count. Other links, and obstacles in the arm's plane, are skipped.

    Args:
        rows: Obstacle table, one row for each obstacle and link, float64[rows, ROW_WIDTH].
        links: Number of links of the arm, equal to the number of its joints.
        x: Tip in `base_link`, forward [m].
        y: Tip in `base_link`, to the left [m].
        z: Tip in `base_link`, up [m].

    Returns:
        Least clearance [m] and the index of its row; inf and −1 if no row counts. The clearance is
        the signed distance of the point from the zone, minus the radius in column RADIUS_COLUMN.
        This column has the radius of the last link, or 0 in a row for the tip alone. In the rows of
        `Obstacles.path_rows` it also includes a margin.
    """
    least, nearest = math.inf, -1
    for k in range(len(rows)):
        if rows[k, KIND_COLUMN] < SPACE_BOX_KIND or rows[k, LINK_COLUMN] < links - 1:
            continue
        distance = compute_point_distance(rows, k, x, y, z) - rows[k, RADIUS_COLUMN]
        if distance < least:
            least, nearest = distance, k
    return least, nearest


@kernel(reads=True)
def clearance(
    m: MachineArrays, rows: FloatArray, q: FloatArray, leeway: FloatArray
) -> tuple[float, int]:
    """Compute the least clearance of the arm in a posture over all obstacles.

    The clearance of a row is the distance between its obstacle and its link, minus the link's
    radius. In the rows of `Obstacles.path_rows` the radius includes a margin.

    Args:
        m: Machine with n joints.
        rows: Obstacle table, one row for each obstacle and link, float64[rows, ROW_WIDTH].
        q: Posture, float64[n], [rad or m].
        leeway: Distance that is added to the clearance of each row, float64[rows], [m]; usually 0.

    Returns:
        Least clearance, leeway included [m], and the index of its row. The clearance is negative if
        the arm is in an obstacle. Without obstacles the result is inf and −1.
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
    """Compute the least clearance of the arm in each of several postures.

    The clearance is the distance between a link and an obstacle, minus the link's radius. In the
    rows of `Obstacles.path_rows` the radius includes a margin.

    Args:
        m: Machine with n joints.
        rows: Obstacle table, one row for each obstacle and link, float64[rows, ROW_WIDTH].
        posture: Postures, float64[count, n], [rad or m].

    Returns:
        Least clearance of each posture, float64[count], [m], and the index of its row,
        int64[count]. Clearances are negative in an obstacle. Without obstacles they are inf, and
        the indices −1.
    """
    least, nearest = np.empty(len(posture)), np.empty(len(posture), dtype=np.int64)
    none = np.zeros(len(rows))
    for i in range(len(posture)):
        least[i], nearest[i] = clearance(m, rows, posture[i], none)
    return least, nearest


@kernel(reads=True)
def compute_leeway(
    m: MachineArrays, rows: FloatArray, q: FloatArray, required: float
) -> FloatArray:
    """Compute by how much each row's clearance in a posture falls short of a required clearance.

    This shortfall is the leeway of the row. If an arm starts in an obstacle, the leeway is added to
    all later clearances. So no collision is reported while the arm leaves the obstacle.

    Args:
        m: Machine with n joints.
        rows: Obstacle table, one row for each obstacle and link, float64[rows, ROW_WIDTH].
        q: Posture, float64[n], [rad or m].
        required: Required clearance [m].

    Returns:
        max(0, required − clearance) of each row, float64[rows], [m].
    """
    joint = joint_positions(m, q)
    leeway = np.empty(len(rows))
    for k in range(len(rows)):
        leeway[k] = max(0.0, required - row_clearance(m, rows, k, q, joint))
    return leeway


@kernel(inline="always")
def bound_reach(m: MachineArrays, start: FloatArray, end: FloatArray) -> float:
    """Return an upper bound on the distance of any link from the slew's axis during a move.

        |a| + Σ L + Σ max(q₀, q₁)

    a is the distance of joint 2 from the axis. The first sum has the length L of each link at q = 0
    [m]. The second sum has, for each sliding joint, the larger of its positions q₀ and q₁ at both
    ends [m]. The bound holds if each joint stays between its positions at both ends. The radii of
    the links are not included.

    Args:
        m: Machine that slews.
        start: Posture at the start of the move, float64[n], [rad or m].
        end: Posture at its end, float64[n], [rad or m].

    Returns:
        Upper bound [m].
    """
    reach = abs(m.slew_offset)
    for k in range(len(start)):
        reach += m.link_length[k]
        if m.slides[k]:
            reach += max(start[k], end[k])
    return reach


@kernel(borrows=True, reads=True)
def bound_travel(
    m: MachineArrays, start: FloatArray, end: FloatArray, along_cylinders: bool
) -> float:
    """Return an upper bound on the distance that any point of the arm moves between two postures.

        D = R |Δq_slew| + Σ_k (L_k |Σ_{j ≤ k} Δq_j| + |Δs_k|)

    Only points on the lines of the links count. The symbols are

    - R: upper bound on the distance of the links from the slew's axis (`bound_reach`).
    - L_k: length of link k, the larger of its lengths at start and end if joint k slides.
    - Δq_j: turn of joint j in the arm's plane, 0 if joint j slews or slides.
    - Δs_k: stroke of joint k if it slides, else 0.

    If the move is straight in cylinder lengths, joints do not move in proportion, and Σ |Δq_j|
    takes the place of |Σ Δq_j|.

    Args:
        m: Machine with n joints.
        start: Posture at the start of the move, float64[n], [rad or m].
        end: Posture at its end, float64[n], [rad or m].
        along_cylinders: True if the move is straight in cylinder lengths, False if it is straight
            in joint positions.

    Returns:
        Upper bound D [m].
    """
    turn, farthest = 0.0, 0.0
    if m.slews:
        farthest = bound_reach(m, start, end) * abs(end[0] - start[0])
    for k in range(len(start)):
        more = get_turn_angle(m.turns, end, k) - get_turn_angle(m.turns, start, k)
        turn += abs(more) if along_cylinders else more
        farthest += bound_displacement(m, start, end, turn, k)
    return farthest


@kernel(inline="always")
def _write_midpoint(
    m: MachineArrays, start: FloatArray, end: FloatArray, along_cylinders: bool, middle: FloatArray
) -> None:
    """Write the posture half-way between two postures.

    Args:
        m: Machine with n joints.
        start: First posture, float64[n], [rad or m].
        end: Second posture, float64[n], [rad or m].
        along_cylinders: True: each cylinder gets the mean of its two lengths. False: each joint
            gets the mean of its two positions.
        middle: Result, float64[n], written in place [rad or m].
    """
    for j in range(len(start)):
        middle[j] = 0.5 * (start[j] + end[j])
        if along_cylinders:
            linkage = m.linkage[j]
            length = cylinder_length(linkage, start[j]) + cylinder_length(linkage, end[j])
            low, high = min(start[j], end[j]), max(start[j], end[j])
            middle[j] = find_joint_angle(linkage, 0.5 * length, low, high, middle[j])


@kernel
def move_is_clear(
    m: MachineArrays, rows: FloatArray, start: FloatArray, end: FloatArray, along_cylinders: bool
) -> bool:
    """Return whether the arm keeps clear of all obstacles during a move.

    The move is halved again and again until all of its parts are proven clear. A part is proven
    clear if the clearances at both of its ends add up to at least D. D is an upper bound on how far
    any point of the arm moves in this part. A part with D up to MIN_PART_TRAVEL is not halved
    further, and counts as clear if both ends are clear. So an accepted move enters no obstacle by
    more than MIN_PART_TRAVEL/2.

    If the arm starts in an obstacle, it may leave the obstacle but not move deeper into it.

    Args:
        m: Machine with n joints.
        rows: Obstacle table, one row for each obstacle and link, float64[rows, ROW_WIDTH]. For
            discrete paths pass `Obstacles.path_rows`, whose radii include a margin.
        start: Posture at the start of the move, float64[n], [rad or m].
        end: Posture at its end, float64[n], [rad or m].
        along_cylinders: True if the move is straight in cylinder lengths, False if it is straight
            in joint positions.

    Returns:
        True if the move is clear. False if it is not clear, or if MAX_HALVINGS halvings do not
        prove that it is clear.
    """
    if len(rows) == 0:
        return True
    leeway = np.zeros(len(rows))
    left = clearance(m, rows, start, leeway)[0]
    if left < 0.0:
        leeway = compute_leeway(m, rows, start, 0.0)
        left = 0.0
    if left >= bound_travel(m, start, end, along_cylinders):
        return True
    n = len(start)
    here = np.empty(n)
    ends, clear = np.empty((MAX_HALVINGS, n)), np.empty(MAX_HALVINGS)
    copy_row(here, start)
    copy_row(ends[0], end)
    clear[0] = clearance(m, rows, end, leeway)[0]
    waiting = 1  # number of parts on the stack, the next one last
    while waiting > 0:
        right = clear[waiting - 1]
        if right < -CLEARANCE_ROUNDING:
            return False
        apart = bound_travel(m, here, ends[waiting - 1], along_cylinders)
        if apart <= MIN_PART_TRAVEL or left + right >= apart:
            copy_row(here, ends[waiting - 1])
            left = right
            waiting -= 1
            continue
        if waiting == MAX_HALVINGS:
            return False
        _write_midpoint(m, here, ends[waiting - 1], along_cylinders, ends[waiting])
        clear[waiting] = clearance(m, rows, ends[waiting], leeway)[0]
        waiting += 1
    return True
