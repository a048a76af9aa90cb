"""Doubts about a machine file: values that are allowed, but with which the machine cannot work."""

from __future__ import annotations

import numpy as np

from mhsb_model.errors import suggest_unit_of_number
from mhsb_model.machine import Machine

LARGEST_FLOW_RATIO = 50.0
"""Main pump flow over the flow of all cylinders at V_max that is plausible [-].

The suite's machines have at most a few times that flow; a wrong unit is off by a thousand."""

STEP_TOLERANCE = 1e-6
"""Deviation of a delay from whole steps that counts as rounding, as a share of a step [-]."""


def list_doubts(machine: Machine, held_points: int) -> list[str]:
    """List what is allowed in a machine file, but cannot work or is not simulated as given.

    Args:
        machine: The machine.
        held_points: Number of workspace points at which the arm can be held, boosted or not.

    Returns:
        One sentence for each doubt: the value, the limit, and what to do. Empty if all is well.
    """
    config, arrays = machine.config, machine.arrays
    supply, circuit = float(arrays.supply_pressure), config.circuit
    reliefs = {
        "circuit.line_relief_pressure": circuit.line_relief_pressure,
        "circuit.chamber_relief_pressure": circuit.chamber_relief_pressure,
    }
    doubts = [
        f"{key} {relief / 1e6:g} MPa is below the main pump's {supply / 1e6:g} MPa, whose oil its "
        "valves let go; raise it above that pressure"
        for key, relief in reliefs.items()
        if relief < supply
    ]
    if held_points == 0:
        doubts.append(
            f"the arm holds its payload of {arrays.payload:g} kg nowhere in the workspace; lower "
            "payload.mass, or raise pressures or bores"
        )
    flow = float(arrays.main_pump_flow)
    needed = float(np.sum(arrays.cap_area * arrays.max_piston_speed))
    if flow > LARGEST_FLOW_RATIO * needed:
        hint = suggest_unit_of_number(flow, "m³/s", 0.0, LARGEST_FLOW_RATIO * needed)
        doubts.append(
            f"hydraulics.main_pump.max_flow {flow:g} m³/s is {flow / needed:.0f} times what all "
            f"cylinders take at V_max ({needed:.3g} m³/s){hint}"
        )
    step, delay = config.simulation.step, config.imperfections.computing_delay
    steps = delay / step
    if abs(steps - round(steps)) > STEP_TOLERANCE:
        doubts.append(
            f"imperfections.computing_delay {1e3 * delay:g} ms is no whole number of steps of "
            f"{1e3 * step:g} ms; {1e3 * round(steps) * step:g} ms are simulated, so give that"
        )
    return doubts
