"""MHSB against other supplies, over the same moves, in numbers.

Of each move there are several motions: those of the planners, made for MHSB, and one that is made
for a main pump at the highest boost pressure, which never boosts and so takes the straight way.
Every supply is credited with the motion that is best for it, number by number; MHSB with those
that it can do itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from mhsb_model.hydraulics import leakage, oil_of
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_sim.study.supply_systems import (
    Taken,
    boosted,
    loads_of,
    needed_supply,
    rivals,
    shaft_of_main_pump,
)

MHSB = "MHSB"
SIMULATED = "MHSB, simulated"
ONE_PRESSURE = "constant pressure, one for all moves"
DIRECT = "highest pressure"
"""Name of the motion that needs no boost, beside the planners'."""

LEAKAGE = ("leaking", "tight")
BOUNDARIES = ("hydraulic_j", "shaft_j")


@dataclass(frozen=True)
class Supplied:
    """What one motion takes with each supply, by its name.

    needed_pa     the constant pressure that it needs
    piston_oil_m3 what valve-controlled cylinders take
    leaking, tight  with valves that leak as the machine file says, and not at all
    """

    needed_pa: float
    piston_oil_m3: float
    duration_s: float
    leaking: dict[str, Taken] = field(default_factory=dict)
    tight: dict[str, Taken] = field(default_factory=dict)


def supplied(
    machine: Machine, sealed: Machine, trajectory: Trajectory, schedule: ModeSchedule | None
) -> Supplied:
    """With every supply, MHSB among them where there is a schedule; sealed: `tight` machine."""
    loads = loads_of(machine, trajectory)
    found = Supplied(
        needed_supply(machine, loads), loads.integral(loads.inflow(machine)), loads.duration
    )
    for arm, taken in ((machine, found.leaking), (sealed, found.tight)):
        if schedule is not None:
            taken[MHSB] = boosted(arm, trajectory, schedule)
        for name, system in rivals(machine).items():
            taken[name] = system(arm, loads)
    return found


Motions = Mapping[str, Supplied]
"""The motions of one move by what they were made by."""


def totals(machine: Machine, moves: Iterable[Motions]) -> dict[str, Any]:
    """All moves that MHSB can do together: J by supply, with and without leakage, by boundary.

    cheaper_than_mhsb  moves in which a supply takes less than MHSB does
    """
    done = [motions for motions in moves if any(MHSB in each.leaking for each in motions.values())]
    if not done:
        return {}
    pressure = max(min(each.needed_pa for each in motions.values()) for motions in done)
    names = [MHSB, SIMULATED, *rivals(machine), ONE_PRESSURE]
    systems: dict[str, Any] = {name: {} for name in names}
    for kind in LEAKAGE:
        for boundary in BOUNDARIES:
            least = [_least(machine, motions, kind, boundary, pressure) for motions in done]
            for name in names:
                values = [each[name] for each in least if name in each]
                if len(values) < len(done):
                    continue
                cheaper = sum(v < each[MHSB] for v, each in zip(values, least, strict=True))
                systems[name].setdefault(kind, {})[boundary] = sum(values)
                systems[name][kind][f"cheaper_than_mhsb_{boundary[:-2]}"] = cheaper
    return {"moves": len(done), "one_pressure_pa": pressure, "systems": systems}


def _least(
    machine: Machine, motions: Motions, kind: str, boundary: str, pressure: float
) -> dict[str, float]:
    """The least that each supply takes for a move, over its motions."""
    least: dict[str, float] = {}
    for motion in motions.values():
        taken = dict(getattr(motion, kind))
        if motion.needed_pa <= pressure:
            taken[ONE_PRESSURE] = _at(machine, motion, pressure, kind)
        for name, each in taken.items():
            least[name] = min(least.get(name, float("inf")), getattr(each, boundary))
    return least


def _at(machine: Machine, motion: Supplied, pressure: float, kind: str) -> Taken:
    """`constant_pressure` in closed form, p (V + n q(p) T)."""
    leaks = machine.joint_count * leakage(oil_of(machine.arrays), pressure)
    oil = motion.piston_oil_m3 + (leaks * motion.duration_s if kind == "leaking" else 0.0)
    return shaft_of_main_pump(machine, pressure * oil, motion.duration_s)


def as_text(title: str, found: Mapping[str, Any]) -> list[str]:
    """The totals for a person."""
    if not found:
        return []
    lines = [
        f"{title}: {found['moves']} moves, energy [kJ]; one pressure for all: "
        f"{found['one_pressure_pa'] / 1e6:.2f} MPa; ( ) moves in which it takes less than MHSB",
        f"{'':38s}{'to the oil':>13s}{'at shafts':>13s}{'no leakage: oil':>19s}{'shafts':>13s}",
    ]
    for name, numbers in found["systems"].items():
        cells = _cells(name, numbers)
        if any(cell.strip() for cell in cells):
            lines.append(f"{name:38s}" + "".join(f"{cell:>14s}" for cell in cells))
    return lines


def as_markdown(sets: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The same as a table for docs: a column for each set and boundary, leakage / none."""
    lines = []
    for title, found in sets.items():
        if not found:
            continue
        lines += [
            f"| {title}, {found['moves']} moves [kJ] | to the oil | at the shafts "
            "| to the oil, no leakage | at the shafts, no leakage |",
            "|---|---|---|---|---|",
        ]
        for name, numbers in found["systems"].items():
            cells = _cells(name, numbers)
            lines.append(f"| {name} | " + " | ".join(cell or "–" for cell in cells) + " |")
        lines.append("")
    return lines


def _cells(name: str, systems: Mapping[str, Mapping[str, float]]) -> list[str]:
    """kJ by leakage and boundary; of rivals in how many moves they take less than MHSB."""
    cells = []
    for kind in LEAKAGE:
        for boundary in BOUNDARIES:
            numbers = systems.get(kind, {})
            cell = f"{numbers[boundary] / 1e3:.2f}" if boundary in numbers else ""
            if cell and name not in (MHSB, SIMULATED):
                cell += f" ({numbers[f'cheaper_than_mhsb_{boundary[:-2]}']})"
            cells.append(cell)
    return cells


def by_case(names: Sequence[str], moves: Sequence[Motions], machine: Machine) -> list[str]:
    """Each move by itself [J]: to the oil, with / without leakage, of every supply."""
    found = [totals(machine, [motions]) for motions in moves]
    shown = [(name, each) for name, each in zip(names, found, strict=True) if each]
    lines = ["energy to the oil [J], with / without leakage"]
    lines.append(f"{'':38s}" + "".join(f"{name:>16s}" for name, _ in shown))
    for system in [MHSB, *rivals(machine)]:
        cells = []
        for _, each in shown:
            pair = [each["systems"][system][kind]["hydraulic_j"] for kind in LEAKAGE]
            cells.append(f"{pair[0]:.0f} / {pair[1]:.0f}")
        lines.append(f"{system:38s}" + "".join(f"{cell:>16s}" for cell in cells))
    return lines
