"""The region in which the tip may be asked to work: x ≥ x_min, r_min ≤ √(x² + z²) ≤ r_max."""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import farthest_move, tip_position, turned
from mhsb_model.types import FloatArray

INSIDE_TOLERANCE = 1e-5
"""By how much the tip may leave the region on a straight joint move [m]; rounding."""

LOOKS = 8
"""Instants at which a straight joint move is looked at, between its ends."""


@kernel(borrows=True)
def node_set_excess(m: MachineArrays, x: float, z: float) -> float:
    """How far the tip at (x, z) m lies outside the region [m]; negative within it."""
    return excess_of(m.min_x, m.min_radius, m.max_radius, x, z)


@kernel
def excess_of(min_x: float, min_radius: float, max_radius: float, x: float, z: float) -> float:
    """The same for a region of these bounds [m], where many points are looked at."""
    radius = math.hypot(x, z)
    return max(min_x - x, max(min_radius - radius, radius - max_radius))


@kernel
def stays_inside(m: MachineArrays, start: FloatArray, end: FloatArray) -> bool:
    """Whether the tip stays in the region while all joints move in proportion, start[n] to end[n].

    Where an end lies outside itself, the way between may be as far outside, and no farther.
    """
    outermost = -math.inf
    for ends in (start, end):
        x, z = tip_position(m, ends)
        outermost = max(outermost, node_set_excess(m, x, z))
    allowed = max(0.0, outermost) + INSIDE_TOLERANCE
    # On its way the tip is never farther from the nearer end than the links' half turns take it.
    turn, farthest = 0.0, 0.0
    for j in range(len(start)):
        turn += turned(m.turns, end, j) - turned(m.turns, start, j)
        farthest += 0.5 * farthest_move(m, start, end, turn, j)
    if outermost + farthest <= allowed:
        return True
    q = np.empty(len(start))
    for look in range(1, LOOKS + 1):
        for j in range(len(q)):
            q[j] = start[j] + (end[j] - start[j]) * look / (LOOKS + 1)
        x, z = tip_position(m, q)
        if node_set_excess(m, x, z) > allowed:
            return False
    return True
