"""Operating regions: nodes of the workspace at which joints need boost (paper, Figure 5)."""

from dataclasses import dataclass

import numpy as np

from mhsb_model.hydraulics import compute_required_pressures
from mhsb_model.machine import Machine
from mhsb_model.modes import any_boosted
from mhsb_model.types import IntArray
from mhsb_planner.posture.s1_posture_table import PostureTable


@dataclass(frozen=True, eq=False)
class OperatingRegions:
    """Need for boost at every grid node that the arm can reach, in the node's posture for mode N.

    Attributes:
        spacing: Spacing of the grid [m].
        nodes: Position (x, z) of each node in units of the spacing, shape (nodes, 2), int64.
        boosted: Whether P_S is too low for joint j, shape (nodes, n), bool. Never true for a joint
            that slews, which holds nothing against gravity.
        beyond_highest_boost: Whether even the highest boost pressure is too low for some joint,
            shape (nodes,), bool.
    """

    spacing: float
    nodes: IntArray
    boosted: np.ndarray
    beyond_highest_boost: np.ndarray

    @property
    def needs_boost(self) -> np.ndarray:
        """Whether some joint needs boost and the highest boost suffices, shape (nodes,), bool."""
        return np.asarray(np.any(self.boosted, axis=1) & ~self.beyond_highest_boost)


def determine_operating_regions(machine: Machine, table: PostureTable) -> OperatingRegions:
    """Determine which joints need boost at each node of the workspace grid.

    At each node, the posture is taken that the posture table has for mode N in all actuators. A
    joint needs boost there if p_L + m(V_max) + margin > P_S when it moves against its load at
    V_max. p_L is its load pressure, m the pressure drop of the fully open valve, margin the
    machine's boost margin and P_S the main pump's pressure [Pa]; V_max is the piston speed for
    planning [m/s].

    Args:
        machine: The arm.
        table: Its posture table.

    Returns:
        The regions. Nodes that the arm cannot reach are left out, so rows are not aligned with the
        table's nodes.
    """
    normal = int(np.flatnonzero(~any_boosted(table.patterns))[0])
    reached = table.feasible
    plane = machine.planar_arm
    m, postures = plane.arrays, np.ascontiguousarray(table.posture[reached, normal])
    force = np.array([plane.piston_forces(q) for q in postures]).reshape(-1, plane.joint_count)
    pressure = compute_required_pressures(m, force, np.copysign(m.max_piston_speed, force))
    slews = machine.joint_count - plane.joint_count
    return OperatingRegions(
        table.spacing,
        table.nodes[reached],
        np.pad(pressure > m.supply_pressure, ((0, 0), (slews, 0))),
        np.any(pressure > m.max_boost_pressure, axis=1),
    )
