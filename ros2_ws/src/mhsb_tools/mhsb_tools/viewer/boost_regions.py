"""Regions that need boost: nodes of the posture table by the strongest mode that the arm needs."""

from __future__ import annotations

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.modes import MODE_COUNT
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.posture.s1_polytope import flow_limits
from mhsb_planner.posture.s1_posture_table import PostureTable

UNMOVABLE_REGION = MODE_COUNT
"""Code of points at which no mode moves all joints both ways, or that no posture reaches."""


def find_needed_mode(machine: Machine, posture: FloatArray) -> int:
    """Return the weakest mode that lets every cylinder move both ways under its static load.

    For each joint, the mode of lowest code is found with which it can move in both directions
    (codes: N 0, DB 1, SB 2). The planner's flow limits decide this (posture search S1 of the
    paper). The highest of these codes is the result.

    Args:
        machine: The arm in its plane.
        posture: Joint positions, shape (n,) [rad; m for telescopes].

    Returns:
        Mode code; UNMOVABLE_REGION if no mode is enough for some joint.
    """
    limit = np.empty((machine.joint_count, MODE_COUNT, 2))
    flow_limits(machine.arrays, posture, limit)
    moves = limit.min(axis=2) > 0.0  # shape (joints, modes)
    weakest = np.where(np.any(moves, axis=1), np.argmax(moves, axis=1), UNMOVABLE_REGION)
    return int(weakest.max())


def compute_boost_regions(machine: Machine, table: PostureTable) -> IntArray:
    """Compute the mode that each node of a posture table needs.

    The table has a posture for each mode combination. The posture that needs the mode of lowest
    code counts for the node.

    Args:
        machine: The arm in its plane.
        table: Posture table.

    Returns:
        Mode code of each node, int64 (nodes,); UNMOVABLE_REGION if no mode is enough or no posture
        reaches the node.
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
