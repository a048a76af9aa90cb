"""The region in which the tip may be asked to work: x ≥ x_min, r_min ≤ √(x² + z²) ≤ r_max.

Coordinates are in the arm's plane; the origin is joint 1, or joint 2 if joint 1 slews.
"""

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import bound_displacement, get_turn_angle, tip_position
from mhsb_model.types import FloatArray

WORKSPACE_TOLERANCE = 1e-5
"""Distance by which the tip may leave the region on a straight joint move [m], to allow for
rounding."""

MOVE_SAMPLES = 8
"""Number of instants between the ends at which a straight joint move is checked."""


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


@kernel
def move_stays_in_workspace(m: MachineArrays, start: FloatArray, end: FloatArray) -> bool:
    """Return whether the tip stays in the workspace on a straight move in joint space.

    The tip may be outside the workspace by `WORKSPACE_TOLERANCE`. If it is farther outside at an
    end of the move, it may be that far outside during the whole move, plus the tolerance.

    First an upper bound on the distance that the tip moves is tried. If this bound does not prove
    that the tip stays inside, only `MOVE_SAMPLES` postures between the ends are checked.

    Args:
        m: Arrays of the machine.
        start: Joint positions at the start, shape (n,) [rad or m].
        end: Joint positions at the end, shape (n,) [rad or m].

    Returns:
        True if the bound or all samples show that the tip stays inside.
    """
    outermost = -math.inf
    for ends in (start, end):
        x, z = tip_position(m, ends)
        outermost = max(outermost, compute_workspace_excess(m, x, z))
    allowed = max(0.0, outermost) + WORKSPACE_TOLERANCE
    # The tip is never farther from the nearer end than half of each link's motion can take it.
    turn, farthest = 0.0, 0.0
    for j in range(len(start)):
        turn += get_turn_angle(m.turns, end, j) - get_turn_angle(m.turns, start, j)
        farthest += 0.5 * bound_displacement(m, start, end, turn, j)
    if outermost + farthest <= allowed:
        return True
    q = np.empty(len(start))
    for look in range(1, MOVE_SAMPLES + 1):
        for j in range(len(q)):
            q[j] = start[j] + (end[j] - start[j]) * look / (MOVE_SAMPLES + 1)
        x, z = tip_position(m, q)
        if compute_workspace_excess(m, x, z) > allowed:
            return False
    return True
