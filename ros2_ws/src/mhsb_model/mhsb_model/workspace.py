"""The region in which the tip may be asked to work: x ≥ x_min, r_min ≤ √(x² + z²) ≤ r_max.

Coordinates are in the arm's plane; the origin is joint 1, or joint 2 if joint 1 slews.
"""

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import add_extension, get_turn_angle, tip_position
from mhsb_model.types import FloatArray

WORKSPACE_TOLERANCE = 1e-5
"""Distance by which the tip may leave the region on a straight joint move [m], to allow for
rounding."""

MOVE_SAMPLES = 8
"""Number of instants between the ends at which a straight joint move is checked."""


def compute_joint_excess(m: MachineArrays, q: FloatArray) -> FloatArray:
    """Compute the largest distance of a joint beyond its limits.

    Args:
        m: Arrays of the machine.
        q: Joint positions, shape (…, n) [rad or m].

    Returns:
        Excess of the worst joint, shape (…) [rad or m]; negative if all joints are within their
        limits.
    """
    return np.maximum(m.joint_min - q, q - m.joint_max).max(axis=-1)


@kernel(borrows=True)
def compute_workspace_excess(m: MachineArrays, x: float, z: float) -> float:
    """Compute how far a point lies outside the workspace of a machine.

    The workspace has a least x, a least and a greatest distance from the plane's origin. The origin
    is joint 1, or joint 2 if joint 1 slews.

    Args:
        m: Arrays of the machine.
        x: Position of the point in the arm's plane, forward [m].
        z: Position of the point in the arm's plane, up [m].

    Returns:
        Largest violation of the three bounds [m]; negative inside.
    """
    return compute_region_excess(m.min_x, m.min_radius, m.max_radius, x, z)


@kernel
def compute_region_excess(
    min_x: float, min_radius: float, max_radius: float, x: float, z: float
) -> float:
    """Compute how far a point lies outside a region with a least x and two radii.

    Args:
        min_x: Smallest allowed x [m].
        min_radius: Smallest allowed distance from the origin [m].
        max_radius: Largest allowed distance from the origin [m].
        x: Position of the point, forward [m].
        z: Position of the point, up [m].

    Returns:
        Largest violation of the three bounds [m]; negative inside.
    """
    radius = math.hypot(x, z)
    return max(min_x - x, max(min_radius - radius, radius - max_radius))


@kernel(borrows=True)
def move_stays_in_workspace(m: MachineArrays, start: FloatArray, end: FloatArray) -> bool:
    """Return whether the tip stays in the workspace on a straight move in joint space.

    Args:
        m: Arrays of the machine.
        start: Joint positions at the start, shape (n,) [rad or m].
        end: Joint positions at the end, shape (n,) [rad or m].

    Returns:
        Result of `move_between_tips_stays_in_workspace`.
    """
    tips = tip_position(m, start), tip_position(m, end)
    return move_between_tips_stays_in_workspace(m, start, end, tips)


@kernel(borrows=True)
def move_between_tips_stays_in_workspace(
    m: MachineArrays,
    start: FloatArray,
    end: FloatArray,
    tips: tuple[tuple[float, float], tuple[float, float]],
) -> bool:
    """Return whether the tip stays in the workspace on a straight move whose end tips are known.

    The tip may be outside the workspace by `WORKSPACE_TOLERANCE`. If it is farther outside at an
    end of the move, it may be that far outside during the whole move, plus the tolerance.

    First an upper bound is tried. The straight line between both tips is outside by no more than
    its ends, or than its point nearest to the origin is within the least radius. The tip's distance
    from that line is at most an eighth of the largest second derivative of its position:

        Σ (l Δθ² + 2 |Δl Δθ|) / 8

    l is the length of a link and Δl its change, both 0 or more [m]. Δθ is the turn of the link in
    the plane [rad]. If the bound does not prove that the tip stays inside, only `MOVE_SAMPLES`
    postures between the ends are checked.

    Tested against the same samples in NumPy.

    Args:
        m: Arrays of the machine.
        start: Joint positions at the start, shape (n,) [rad or m].
        end: Joint positions at the end, shape (n,) [rad or m].
        tips: Tip positions (x, z) at the start and at the end [m].

    Returns:
        True if the bound or all samples show that the tip stays inside.
    """
    (x, z), (last_x, last_z) = tips
    outermost = max(compute_workspace_excess(m, x, z), compute_workspace_excess(m, last_x, last_z))
    allowed = max(0.0, outermost) + WORKSPACE_TOLERANCE
    turn = bulge = 0.0
    for j in range(len(start)):
        turn += get_turn_angle(m.turns, end, j) - get_turn_angle(m.turns, start, j)
        one, other = (
            add_extension(m.slides, m.link_length, start, j),
            add_extension(m.slides, m.link_length, end, j),
        )
        bulge += 0.125 * (max(one, other) * turn * turn + 2.0 * abs((other - one) * turn))
    along, across = last_x - x, last_z - z
    square = along * along + across * across
    share = min(1.0, max(0.0, -(x * along + z * across) / square)) if square > 0.0 else 0.0
    nearest = math.hypot(x + share * along, z + share * across)
    if max(outermost, m.min_radius - nearest) + bulge <= allowed:
        return True
    for look in range(1, MOVE_SAMPLES + 1):
        angle = x = z = 0.0
        for j in range(len(start)):
            q = start[j] + (end[j] - start[j]) * look / (MOVE_SAMPLES + 1)
            angle += q if m.turns[j] else 0.0
            length = m.link_length[j] + q if m.slides[j] else m.link_length[j]
            x += length * math.cos(angle)
            z += length * math.sin(angle)
        if compute_workspace_excess(m, x, z) > allowed:
            return False
    return True
