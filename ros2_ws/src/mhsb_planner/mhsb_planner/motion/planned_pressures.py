"""Planned supply pressures of a motion, in each actuator's line."""

import numpy as np

from mhsb_model.hydraulics import (
    compute_boosted_supply,
    get_shared_hydraulics,
    rail_pressure,
    select_supply_pressure,
)
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED_MODES
from mhsb_model.types import FloatArray, ModeArray


def compute_planned_supply(
    machine: Machine, force: FloatArray, speed: FloatArray, modes: ModeArray
) -> FloatArray:
    """Compute the planned supply pressure in each actuator's line at k instants.

    In mode N this is the main pump's pressure, in DB that of the actuator's own servo pump, and in
    SB that of the shared rail. The rail has the highest pressure that an actuator in SB needs.

    Args:
        machine: Machine with its hydraulics.
        force: Piston forces, positive if they resist extension, shape (k, n) [N].
        speed: Piston speeds, positive in extension, shape (k, n) [m/s].
        modes: Mode codes in force at each instant, shape (k, n).

    Returns:
        Pressures, shape (k, n) [Pa].
    """
    m, oil = machine.arrays, get_shared_hydraulics(machine.arrays)
    own_of = list(zip(m.valve_coefficient, m.cap_area, m.rod_area, strict=True))
    supply = np.empty_like(force)
    for k, pattern in enumerate(modes):
        own = np.array([
            compute_boosted_supply(oil, *own_of[j], force[k, j], speed[k, j])
            if BOOSTED_MODES[pattern[j]]
            else oil.supply_pressure
            for j in range(machine.joint_count)
        ])  # fmt: skip
        rail = rail_pressure(oil, own, pattern)
        supply[k] = [
            select_supply_pressure(oil, mode, each, rail)
            for mode, each in zip(pattern, own, strict=True)
        ]
    return supply
