"""Comparison of planned and simulated energy, element by element.

Planned is the planner's model (`mhsb_planner.motion.energy`, pumps in series) of the motion that
the servo followed and the modes that were in force. The model is quasi-static with ideal lines and
pumps. Friction, compression, the servo's own margin and bias, check valves and switching valves
exist in the simulation only.

The delivered energy is the sum of the energy that the main pump gives to its oil and of the energy
at the shafts of the servo pumps. The plan's reading `series` adds up the same two.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from mhsb_planner.motion.energy import Energy
from mhsb_sim.circuit.valves.registry import VALVE_KINDS

OTHER_LOSSES = (
    "check_valves",
    "join_valves",
    "relief_valves",
    "anti_cavitation",
    *(kind.name for kind in VALVE_KINDS),
    "cavities",
)
"""Circuit elements of `Simulator.energies` that are summed as `other valves`."""


@dataclass(frozen=True)
class EnergyPart:
    """A part of the energy.

    Attributes:
        name: Name of the part.
        planned: Energy by the planner's model [J].
        simulated: Energy in the simulator [J].
    """

    name: str
    planned: float
    simulated: float


def list_energy_parts(planned: Energy, simulated: dict[str, float]) -> list[EnergyPart]:
    """List the parts of a motion's energy, each as planned and as simulated.

    Args:
        planned: Energy that the planner's model gives for the motion that the servo followed.
        simulated: Energy by circuit element, as `Simulator.energies` [J].

    Returns:
        The parts in this order: `delivered` (by all pumps), `by the main pump`, `by the servo
        pumps`, and then where the energy went: `servo pump losses`, `leakage`, `throttling`, `work
        on the loads`, `friction`, `compression`, `other valves`, `oil to the tank`. The planner's
        model has no friction, compression and other valves; their planned value is 0. The simulated
        work on the loads does not include friction.
    """
    delivered = simulated["main_pump"] + simulated["servo_pumps"]
    against_loads = simulated["piston_work"] - simulated["friction"]
    others = sum(simulated[name] for name in OTHER_LOSSES)
    return [
        EnergyPart("delivered", planned.series, delivered),
        EnergyPart("by the main pump", planned.main_pump, simulated["main_pump"]),
        EnergyPart("by the servo pumps", planned.servo_pumps, simulated["servo_pumps"]),
        EnergyPart("servo pump losses", planned.servo_pump_losses, simulated["servo_pump_losses"]),
        EnergyPart("leakage", planned.leakage, simulated["leakage"]),
        EnergyPart("throttling", planned.servo_valves, simulated["servo_valves"]),
        EnergyPart("work on the loads", planned.piston_work, against_loads),
        EnergyPart("friction", 0.0, simulated["friction"]),
        EnergyPart("compression", 0.0, simulated["compression"]),
        EnergyPart("other valves", 0.0, others),
        EnergyPart("oil to the tank", planned.return_oil, simulated["return_oil"]),
    ]


def sum_parts(runs: Iterable[list[EnergyPart]]) -> list[EnergyPart]:
    """Add the energies of several runs, part by part.

    Args:
        runs: Parts of each run; all runs must have the same parts in the same order.

    Returns:
        The parts with summed energies; empty if there are no runs.
    """
    return [
        EnergyPart(
            parts[0].name,
            sum(part.planned for part in parts),
            sum(part.simulated for part in parts),
        )
        for parts in zip(*runs, strict=True)
    ]


def as_text(elements: list[EnergyPart]) -> list[str]:
    """Format planned and simulated energies as a table.

    Args:
        elements: Planned and simulated energy of each part; the first must be `delivered`.

    Returns:
        Two title lines, then a line for each part. It has name, planned energy [J], simulated
        energy [J] and simulated minus planned [J]. Last comes this difference as a share of the
        planned `delivered` energy [%], or nothing if that energy is 0.
    """
    delivered = elements[0].planned
    lines = [
        "delivered: by the main pump to its oil, by the servo pumps' motors to their shafts",
        "energy [J]               planned  simulated   difference",
    ]
    for element in elements:
        excess = element.simulated - element.planned
        share = f"{100 * excess / delivered:+6.1f} %" if delivered > 0.0 else ""
        lines.append(
            f"  {element.name:20s}{element.planned:10.1f}{element.simulated:11.1f}"
            f"{excess:+11.1f}  {share}"
        )
    return lines
