"""Where boost is needed: points of the posture table by the strongest mode that the arm needs."""

from __future__ import annotations

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.modes import MODE_COUNT
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.posture.s1_polytope import flow_limits
from mhsb_planner.posture.s1_posture_table import PostureTable

BEYOND = MODE_COUNT
"""Of points at which no mode moves all joints either way, or that no posture reaches."""


def needed_mode(machine: Machine, posture: FloatArray) -> int:
    """Weakest mode by which every cylinder can be moved both ways under its static load.

    posture float64[n], rad. With that mode or weaker ones for all joints; BEYOND where there is
    none. By the limits of flow that plans are made with (paper, S1).
    """
    limit = np.empty((machine.joint_count, MODE_COUNT, 2))
    flow_limits(machine.arrays, posture, limit)
    moves = limit.min(axis=2) > 0.0  # joint, mode
    weakest = np.where(np.any(moves, axis=1), np.argmax(moves, axis=1), BEYOND)
    return int(weakest.max())


def boost_regions(machine: Machine, table: PostureTable) -> IntArray:
    """Mode code of every node of a table, BEYOND where none will do, int64[nodes].

    In the one of the node's postures that needs least.
    """
    return np.array(
        [
            min((needed_mode(machine, q) for q in node if np.isfinite(q[0])), default=BEYOND)
            for node in (np.unique(each, axis=0) for each in table.posture)
        ]
    )
