"""Remarks on a payload that is too heavy for the highest supply pressure."""

from __future__ import annotations

import numpy as np

from mhsb_model.hydraulics import (
    compute_required_pressures,
    get_max_supply_pressure,
    get_shared_hydraulics,
)
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.posture.s1_posture_table import PostureTable

NAMED_OVERLOAD_SHARE = 0.1
"""A remark names the share of the table's nodes at which no posture holds the payload, from this
share on [-].
"""


def describe_overload(machine: Machine, table: PostureTable, start: FloatArray) -> str:
    """Describe where the arm cannot hold its payload, as a possible reason for a missing path.

    The start is checked first, then the posture table.

    Args:
        machine: The whole arm.
        table: Posture table of its plane. Only `posture` is read.
        start: Posture at the start, shape (n,) [rad or m].

    Returns:
        A clause. If the payload cannot be held at the start, the clause names payload, actuator,
        needed pressure and highest supply pressure. Otherwise it gives the share of the table's
        nodes at which no posture holds the payload. Empty if that share is below
        NAMED_OVERLOAD_SHARE.
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
    """Compute the supply pressure that each actuator needs to hold the arm at rest, per posture.

    Args:
        machine: The arm.
        postures: Postures, shape (k, n) [rad or m].

    Returns:
        Pressures, shape (k, n) [Pa], aligned with `postures`.
    """
    force = machine.piston_forces_in(postures)
    return compute_required_pressures(machine.arrays, force, np.zeros_like(force))
