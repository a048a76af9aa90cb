"""Remarks on a payload that the highest supply pressure does not carry."""

from __future__ import annotations

import numpy as np

from mhsb_model.hydraulics import (
    get_max_supply_pressure,
    get_shared_hydraulics,
    required_pressures,
)
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.posture.s1_posture_table import PostureTable

NAMED_OVERLOAD_SHARE = 0.1
"""Least share of the posture table's nodes without a posture that carries the payload, from which a
remark names it.
"""


def describe_overload(machine: Machine, table: PostureTable, start: FloatArray) -> str:
    """Describe where the arm cannot carry its payload, as a possible reason why there is no path.

    Args:
        machine: The whole arm.
        table: Posture table of its plane.
        start: Posture at the start, shape (n,) [rad or m].

    Returns:
        Clause with the payload, the pressure that it needs at the start and the highest one, or the
        share of the workspace in which no posture of the table carries it. Empty if the payload is
        carried at the start and in most of the workspace.
    """
    m = machine.arrays
    highest = get_max_supply_pressure(get_shared_hydraulics(m), m.module_count)
    needed = _find_needed_pressures(machine, start[None, :])[0]
    j = int(np.argmax(needed))
    if needed[j] > highest:
        return (
            f"to hold the payload of {m.payload:.4g} kg at the start, {machine.actuator_names[j]} "
            f"needs {needed[j] / 1e6:.3g} MPa, and the highest pressure is {highest / 1e6:.3g} MPa"
        )
    needed_at_nodes = np.full(table.posture.shape[:2], np.inf)
    reached = np.isfinite(table.posture[..., 0])
    postures = np.ascontiguousarray(table.posture[reached])
    needed_at_nodes[reached] = _find_needed_pressures(machine.planar_arm, postures).max(axis=1)
    least = needed_at_nodes.min(axis=1)[reached.any(axis=1)]
    share = float(np.mean(least > highest))
    if share < NAMED_OVERLOAD_SHARE:
        return ""
    return (
        f"at {100 * share:.0f} % of the table's nodes, no posture holds the payload "
        f"of {m.payload:.4g} kg with the highest pressure of {highest / 1e6:.3g} MPa"
    )


def _find_needed_pressures(machine: Machine, postures: FloatArray) -> FloatArray:
    """Return the supply pressures that hold an arm in postures, shape (k, n) [Pa]."""
    force = machine.piston_forces_in(postures)
    return required_pressures(machine.arrays, force, np.zeros_like(force))
