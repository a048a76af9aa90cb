"""A headless run as one move, its energy by the simulator's audit."""

from __future__ import annotations

from mhsb_model.goal import place
from mhsb_model.machine import Machine
from mhsb_planner.evaluation.move import Move
from mhsb_planner.motion.motion_profile import motion_profile
from mhsb_sim.study.energy_comparison import Element
from mhsb_sim.study.headless import Samples, TimedGoal

GIVEN = {"by the main pump": "main pump", "by the servo pumps": "servo pumps"}
SUM = "delivered"


def simulated_move(
    machine: Machine, samples: Samples, goals: list[TimedGoal], elements: list[Element]
) -> Move:
    """All that was simulated, from its first to its last sample."""
    m = machine.arrays
    energy = {
        GIVEN.get(each.name, each.name): -each.simulated if each.name in GIVEN else each.simulated
        for each in elements
        if each.name != SUM
    }
    places = ", ".join(place(goal.position, "g") for goal in goals)
    return Move(
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
        counted="the simulator's audit",
    )
