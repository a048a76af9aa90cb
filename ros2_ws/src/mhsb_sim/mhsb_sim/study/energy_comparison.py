"""Planned against simulated energy, element by element.

Planned is the planner's model (`mhsb_planner.motion.energy`, pumps in series) of the motion that
the servo followed and the modes that were in force. It is quasi-static and knows ideal lines and
pumps: friction, compression, the servo's own margin and bias, check and switching valves are in
the simulation alone.

Two boundaries are added up, as the plan's series reading does: the main pump's energy is that of
its oil, the servo pumps' that of their shafts.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from mhsb_planner.motion.energy import Energy

OTHERS = ("check_valves", "join_valves", "relief_valves", "anti_cavitation", "bleed", "cavities")


@dataclass(frozen=True)
class Element:
    """A part of the energy as planned and as simulated [J]."""

    name: str
    planned: float
    simulated: float


def energy_elements(planned: Energy, simulated: dict[str, float]) -> list[Element]:
    """What the pumps delivered, then where it went; `simulated` as `Simulator.energies`."""
    delivered = simulated["main_pump"] + simulated["servo_pumps"]
    against_loads = simulated["piston_work"] - simulated["friction"]
    others = sum(simulated[name] for name in OTHERS)
    return [
        Element("delivered", planned.series, delivered),
        Element("by the main pump", planned.main_pump, simulated["main_pump"]),
        Element("by the servo pumps", planned.servo_pumps, simulated["servo_pumps"]),
        Element("servo pump losses", planned.servo_pump_losses, simulated["servo_pump_losses"]),
        Element("leakage", planned.leakage, simulated["leakage"]),
        Element("throttling", planned.servo_valves, simulated["servo_valves"]),
        Element("work on the loads", planned.piston_work, against_loads),
        Element("friction", 0.0, simulated["friction"]),
        Element("compression", 0.0, simulated["compression"]),
        Element("other valves", 0.0, others),
        Element("oil to the tank", planned.return_oil, simulated["return_oil"]),
    ]


def total(runs: Iterable[list[Element]]) -> list[Element]:
    """Sums over several runs."""
    return [
        Element(
            parts[0].name,
            sum(part.planned for part in parts),
            sum(part.simulated for part in parts),
        )
        for parts in zip(*runs, strict=True)
    ]


def as_text(elements: list[Element]) -> list[str]:
    """A table for a person; shares are of all that was planned to be delivered."""
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
