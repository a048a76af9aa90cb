"""Operating regions: where in the workspace which joints need boost (paper, Figure 5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.hydraulics import required_pressures
from mhsb_model.machine import Machine
from mhsb_model.modes import any_boosted
from mhsb_model.types import IntArray
from mhsb_planner.posture.s1_posture_table import PostureTable


@dataclass(frozen=True, eq=False)
class OperatingRegions:
    """Need for boost at every node of the grid that the arm can reach, in its N posture.

    spacing  of the grid [m]
    nodes    int64[nodes, 2], (x, z) in units of the spacing
    boosted  bool[nodes, n], whether P_S is not enough for joint j; never for one that slews, which
             holds nothing against gravity
    heavy    bool[nodes], whether even the highest boost pressure is not enough for a joint
    """

    spacing: float
    nodes: IntArray
    boosted: np.ndarray
    heavy: np.ndarray


def operating_regions(machine: Machine, table: PostureTable) -> OperatingRegions:
    """Regions of a machine by its posture table.

    A joint needs boost where p_L + m(V_max) + margin > P_S for a motion against its load at
    V_max (`mhsb_model.hydraulics.required_pressure`).
    """
    normal = int(np.flatnonzero(~any_boosted(table.patterns))[0])
    reached = table.feasible
    plane = machine.plane
    m, postures = plane.arrays, np.ascontiguousarray(table.posture[reached, normal])
    force = np.array([plane.piston_forces(q) for q in postures]).reshape(-1, plane.joint_count)
    pressure = required_pressures(m, force, np.copysign(m.max_piston_speed, force))
    slews = machine.joint_count - plane.joint_count
    return OperatingRegions(
        table.spacing,
        table.nodes[reached],
        np.pad(pressure > m.supply_pressure, ((0, 0), (slews, 0))),
        np.any(pressure > m.max_boost_pressure, axis=1),
    )
