"""Regions that need boost: nodes of the posture table by the strongest mode that the arm needs."""

from __future__ import annotations

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.modes import MODE_COUNT
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.posture.s1_polytope import compute_flow_limits
from mhsb_planner.posture.s1_posture_table import PostureTable

UNMOVABLE_REGION = MODE_COUNT
"""Code of points at which no mode moves all joints both ways, or that no posture reaches."""


def find_needed_mode(machine: Machine, posture: FloatArray) -> int:
    """Return the weakest mode in which every cylinder can move both ways under its static load.

    For each joint, this is the mode with the lowest code (N 0, DB 1, SB 2) whose highest speed is
    above 0 in both directions. The planner's flow limits give these speeds. The highest code over
    all joints is the result.

    Args:
        machine: The planar arm (without the slewing joint).
        posture: Joint positions, shape (n,) [rad, telescopes m].

    Returns:
        Mode code; UNMOVABLE_REGION if for some joint no mode is enough.
    """
    limit = np.empty((machine.joint_count, MODE_COUNT, 2))
    compute_flow_limits(machine.arrays, posture, limit)
    moves = limit.min(axis=2) > 0.0  # shape (joints, modes)
    weakest = np.where(np.any(moves, axis=1), np.argmax(moves, axis=1), UNMOVABLE_REGION)
    return int(weakest.max())


def compute_boost_regions(machine: Machine, table: PostureTable) -> IntArray:
    """Compute the mode that each node of a posture table needs.

    A node has one posture for each mode combination. Of these, the posture counts whose needed mode
    has the lowest code (N 0, DB 1, SB 2).

    Args:
        machine: The planar arm (without the slewing joint).
        table: Posture table.

    Returns:
        Mode code of each node, int64 (nodes,). UNMOVABLE_REGION means that no mode is enough, or
        that the arm does not reach the node.
    """
    return np.array(
        [
            min(
                (find_needed_mode(machine, q) for q in node if np.isfinite(q[0])),
                default=UNMOVABLE_REGION,
            )
            for node in (np.unique(each, axis=0) for each in table.posture)
        ]
    )
