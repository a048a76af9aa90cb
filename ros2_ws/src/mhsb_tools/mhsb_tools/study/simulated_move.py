"""Conversion of a headless run to one move, with energy from the simulator's audit."""

from __future__ import annotations

from mhsb_model.goal import format_position
from mhsb_model.machine import Machine
from mhsb_planner.motion.motion_profile import motion_profile
from mhsb_tools.moves.move import MoveRecord
from mhsb_tools.study.energy_comparison import EnergyPart
from mhsb_tools.study.headless import Samples, TimedGoal

SUPPLY_NAMES = {"by the main pump": "main pump", "by the servo pumps": "servo pumps"}
"""Name in the energy flow diagram of each part that delivers energy."""
TOTAL_NAME = "delivered"
"""Part that is the sum of others and therefore left out."""


def simulated_move(
    machine: Machine, samples: Samples, goals: list[TimedGoal], elements: list[EnergyPart]
) -> MoveRecord:
    """Convert a simulated run to one move.

    Args:
        machine: The arm that the planner knows.
        samples: The simulated signals; the move goes from the first to the last sample.
        goals: The goals, for the title and for marks in the picture.
        elements: Planned and simulated energy of each part; only the simulated energies are used.

    Returns:
        The move, beginning at time 0. Its piston forces are p_A A − p_B a, with pressure p and area
        A or a of cap side and rod side.
    """
    m = machine.arrays
    energy = {
        SUPPLY_NAMES.get(each.name, each.name): -each.simulated
        if each.name in SUPPLY_NAMES
        else each.simulated
        for each in elements
        if each.name != TOTAL_NAME
    }
    places = ", ".join(format_position(goal.position, "g") for goal in goals)
    return MoveRecord(
        machine=machine,
        title=f"To {places}, as simulated",
        goals=tuple(goal.position for goal in goals),
        time=samples.time - samples.time[0],
        position=samples.position,
        reference=samples.reference,
        modes=samples.modes,
        speed=motion_profile(machine, samples.position, samples.velocity).speed,
        force=samples.cap_pressure * m.cap_area - samples.rod_pressure * m.rod_area,
        supply=samples.supply_pressure,
        chambers={"cap side": samples.cap_pressure, "rod side": samples.rod_pressure},
        energy=energy,
        energy_source="the simulator's audit",
    )
