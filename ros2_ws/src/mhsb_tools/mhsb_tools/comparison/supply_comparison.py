"""Comparison of MHSB with other supplies over the same moves, in numbers.

MHSB is the arm's own supply: main pump and booster modules. Each move has several motions. The
planners make theirs for MHSB. One further motion is made for a main pump at the highest boost
pressure; it never needs boost, and so it needs no detours. Each supply counts with the motion for
which it takes least energy, separately for each of the four energies. MHSB counts only with motions
that have a mode schedule.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from mhsb_model.hydraulics import compute_valve_leakage, get_shared_hydraulics
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_tools.comparison.supply_systems import (
    SupplyEnergy,
    add_main_pump_shaft,
    baselines,
    compute_mhsb_energy,
    loads_of,
    needed_supply,
)

PLANNED_SYSTEM = "MHSB"
"""Name of MHSB by the planner's energy model."""
SIMULATED_SYSTEM = "MHSB, simulated"
"""Name of MHSB in the simulator."""
ONE_PRESSURE = "constant pressure, one for all moves"
"""Name of the supply with one constant pressure for all moves."""
UNBOOSTED_MOTION = "highest pressure"
"""Name of the motion that needs no boost, beside the planners' motions."""

LEAKAGE_CASES = ("leaking", "tight")
"""Fields of `Supplied`: valves that leak as the machine file says, and valves that do not leak."""
ENERGY_KEYS = ("hydraulic_j", "shaft_j")
"""Fields of `SupplyEnergy`, the boundaries at which energy is counted."""


@dataclass(frozen=True)
class Supplied:
    """Energy of one motion with each supply.

    Attributes:
        needed_pa: Lowest constant supply pressure that does the motion [Pa].
        piston_oil_m3: Oil that valve-controlled cylinders take [m³].
        duration_s: Duration of the motion [s].
        leaking: Energy by name of the supply, with valves that leak as the machine file says.
        tight: Energy by name of the supply, with valves that do not leak.
    """

    needed_pa: float
    piston_oil_m3: float
    duration_s: float
    leaking: dict[str, SupplyEnergy] = field(default_factory=dict)
    tight: dict[str, SupplyEnergy] = field(default_factory=dict)


def compute_supply_energies(
    machine: Machine, leakproof: Machine, trajectory: Trajectory, schedule: ModeSchedule | None
) -> Supplied:
    """Compute the energy of a motion with every supply.

    Args:
        machine: The arm with leaking valves.
        leakproof: The arm with valves that do not leak, as `without_leakage` makes it.
        trajectory: The motion.
        schedule: Its mode schedule; None leaves MHSB out.

    Returns:
        Energies by supply, with and without leakage, and needed pressure, oil and duration of the
        motion.
    """
    loads = loads_of(machine, trajectory)
    found = Supplied(
        needed_supply(machine, loads), loads.integral(loads.inflow(machine)), loads.duration
    )
    for arm, taken in ((machine, found.leaking), (leakproof, found.tight)):
        if schedule is not None:
            taken[PLANNED_SYSTEM] = compute_mhsb_energy(arm, trajectory, schedule)
        for name, system in baselines(machine).items():
            taken[name] = system(arm, loads)
    return found


Motions = Mapping[str, Supplied]
"""Motions of one move with their energies, by the name of the planner that made them."""


def totals(machine: Machine, moves: Iterable[Motions]) -> dict[str, Any]:
    """Sum the energies of all moves for each supply.

    Only moves count for which MHSB has a motion. For each supply and each of its four energies, the
    motion of a move that takes least is used. A supply without a value for some move is left out.
    The one constant pressure for all moves is the lowest with which every move can be done in one
    of its motions.

    Args:
        machine: The arm.
        moves: Motions of each move.

    Returns:
        `moves` (count), `one_pressure_pa` [Pa] and `systems`. The latter has by supply and by
        `leaking` or `tight` the sums `hydraulic_j` and `shaft_j` [J]. `cheaper_than_mhsb_hydraulic`
        and `…_shaft` count the moves in which a supply takes less than planned MHSB. Empty if MHSB
        can do no move.
    """
    done = [
        motions
        for motions in moves
        if any(PLANNED_SYSTEM in each.leaking for each in motions.values())
    ]
    if not done:
        return {}
    pressure = max(min(each.needed_pa for each in motions.values()) for motions in done)
    names = [PLANNED_SYSTEM, SIMULATED_SYSTEM, *baselines(machine), ONE_PRESSURE]
    systems: dict[str, Any] = {name: {} for name in names}
    for kind in LEAKAGE_CASES:
        for boundary in ENERGY_KEYS:
            least = [
                _least_energies(machine, motions, kind, boundary, pressure) for motions in done
            ]
            for name in names:
                values = [each[name] for each in least if name in each]
                if len(values) < len(done):
                    continue
                cheaper = sum(
                    v < each[PLANNED_SYSTEM] for v, each in zip(values, least, strict=True)
                )
                systems[name].setdefault(kind, {})[boundary] = sum(values)
                systems[name][kind][f"cheaper_than_mhsb_{boundary[:-2]}"] = cheaper
    return {"moves": len(done), "one_pressure_pa": pressure, "systems": systems}


def _least_energies(
    machine: Machine, motions: Motions, kind: str, boundary: str, pressure: float
) -> dict[str, float]:
    """Return the least energy of each supply over all motions of one move.

    Args:
        machine: The arm.
        motions: Motions of the move.
        kind: `leaking` or `tight`.
        boundary: `hydraulic_j` or `shaft_j`.
        pressure: One constant pressure for all moves [Pa]. Motions that need a higher one are not
            used for the supply `ONE_PRESSURE`.

    Returns:
        Energy by supply [J]; a supply without any motion is missing.
    """
    least: dict[str, float] = {}
    for motion in motions.values():
        taken = dict(getattr(motion, kind))
        if motion.needed_pa <= pressure:
            taken[ONE_PRESSURE] = _energy_at_pressure(machine, motion, pressure, kind)
        for name, each in taken.items():
            least[name] = min(least.get(name, float("inf")), getattr(each, boundary))
    return least


def _energy_at_pressure(
    machine: Machine, motion: Supplied, pressure: float, kind: str
) -> SupplyEnergy:
    """Compute the energy at a constant pressure in closed form, E = p (V + n q(p) T).

    Args:
        machine: The arm with n joints; q(p) is the leakage of a valve.
        motion: Oil volume V and duration T of the motion.
        pressure: Pressure p [Pa].
        kind: `leaking`, or `tight`, for which q = 0.

    Returns:
        Energy at both boundaries.
    """
    leaks = machine.joint_count * compute_valve_leakage(
        get_shared_hydraulics(machine.arrays), pressure
    )
    oil = motion.piston_oil_m3 + (leaks * motion.duration_s if kind == "leaking" else 0.0)
    return add_main_pump_shaft(machine, pressure * oil, motion.duration_s)


def as_text(title: str, found: Mapping[str, Any]) -> list[str]:
    """Format the totals for a person.

    Args:
        title: Name of the set of moves.
        found: Result of `totals`.

    Returns:
        Two title lines, then one line for each supply with four energies [kJ]: to the oil and at
        the shafts, with leakage and without. A number in brackets counts the moves in which the
        supply takes less than MHSB. The first title line also gives the number of moves and the one
        constant pressure [MPa]. Supplies without numbers are left out. An empty list if `found` is
        empty.
    """
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
    """Format the totals as Markdown tables, one for each set of moves.

    Args:
        sets: Result of `totals` by title of the set.

    Returns:
        Lines of the tables, a row for each supply with the four texts of `_cells` [kJ]; a missing
        value is a dash. Empty sets have no table.
    """
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
    """Format the energies of one supply as table cells.

    Args:
        name: Name of the supply.
        systems: Entry of this supply in `totals`: by `leaking` and `tight`, then by `hydraulic_j`
            and `shaft_j` [J]. `cheaper_than_mhsb_hydraulic` and `…_shaft` are the numbers of moves
            for the brackets.

    Returns:
        Four texts [kJ]: energy to the oil and at the shafts with leakage, then both without. A text
        is empty if its value is missing. For supplies other than MHSB, each text has in brackets
        the number of moves in which the supply takes less than MHSB.
    """
    cells = []
    for kind in LEAKAGE_CASES:
        for boundary in ENERGY_KEYS:
            numbers = systems.get(kind, {})
            cell = f"{numbers[boundary] / 1e3:.2f}" if boundary in numbers else ""
            if cell and name not in (PLANNED_SYSTEM, SIMULATED_SYSTEM):
                cell += f" ({numbers[f'cheaper_than_mhsb_{boundary[:-2]}']})"
            cells.append(cell)
    return cells


def by_case(names: Sequence[str], moves: Sequence[Motions], machine: Machine) -> list[str]:
    """Format the energy to the oil of each move separately.

    Args:
        names: Name of each move.
        moves: Motions of each move.
        machine: The arm.

    Returns:
        Two lines of titles, then a line for each supply with a column for each move: energy with
        leakage / without leakage [J]. Moves for which MHSB has no motion have no column.
    """
    found = [totals(machine, [motions]) for motions in moves]
    shown = [(name, each) for name, each in zip(names, found, strict=True) if each]
    lines = ["energy to the oil [J], with / without leakage"]
    lines.append(f"{'':38s}" + "".join(f"{name:>16s}" for name, _ in shown))
    for system in [PLANNED_SYSTEM, *baselines(machine)]:
        cells = []
        for _, each in shown:
            pair = [each["systems"][system][kind]["hydraulic_j"] for kind in LEAKAGE_CASES]
            cells.append(f"{pair[0]:.0f} / {pair[1]:.0f}")
        lines.append(f"{system:38s}" + "".join(f"{cell:>16s}" for cell in cells))
    return lines
