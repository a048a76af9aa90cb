"""Comparison of MHSB with other supplies over the same moves, in numbers.

MHSB is the arm's own supply: main pump and booster modules. Each move has several motions. The
planners make theirs for MHSB. One further motion is made for a main pump at the highest boost
pressure; it never needs boost, and so it needs no detours. Each supply counts with the motion for
which it takes least energy, separately for each of the four energies. MHSB counts only with motions
that have a mode schedule.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.holding import choose_holding_modes
from mhsb_model.hydraulics import compute_valve_leakage, get_shared_hydraulics
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import MotionState, Trajectory
from mhsb_model.types import Position
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planner import DEFAULT_PLANNER, PLANNER_KINDS, Planner, PlanOptions
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_tools.moves.supply_systems import (
    SupplyEnergy,
    add_main_pump_shaft,
    baselines,
    compute_loads,
    compute_mhsb_energy,
    compute_needed_supply,
    remove_leakage,
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
    """Compute the energy that a motion takes with every supply, with and without valve leakage.

    The supplies are MHSB (main pump and booster modules, by the planner's energy model) and those
    of `baselines`: constant pressure, load sensing and pump control.

    Args:
        machine: The arm with leaking valves.
        leakproof: The same arm with valves that do not leak.
        trajectory: The motion.
        schedule: Mode schedule of the motion; None leaves MHSB out.

    Returns:
        Energies by supply, and the motion's needed pressure, oil volume and duration.
    """
    loads = compute_loads(machine, trajectory)
    found = Supplied(
        compute_needed_supply(machine, loads), loads.integral(loads.inflow(machine)), loads.duration
    )
    for arm, taken in ((machine, found.leaking), (leakproof, found.tight)):
        if schedule is not None:
            taken[PLANNED_SYSTEM] = compute_mhsb_energy(arm, trajectory, schedule)
        for name, system in baselines(machine).items():
            taken[name] = system(arm, loads)
    return found


Motions = Mapping[str, Supplied]
"""Motions of one move with their energies, by the name of the planner that made them."""


def sum_supply_energies(machine: Machine, moves: Iterable[Motions]) -> dict[str, Any]:
    """Sum the energies of all moves for each supply.

    Each move has several motions, and each supply has four energies for each motion: to the oil and
    at the shafts, with and without leakage. For each supply and energy, the motion that takes least
    is used. Moves without a motion for MHSB (main pump and booster modules) do not count. A supply
    that lacks a value for a counted move has no sum.

    One further supply is one constant pressure for all moves. It is the lowest pressure with which
    every move can be done in one of its motions.

    Args:
        machine: The arm.
        moves: Motions of each move, by name.

    Returns:
        A dictionary; empty if no move counts. Keys:

        - moves: number of moves that count
        - one_pressure_pa: the constant pressure for all moves [Pa]
        - systems: by name of the supply and then by `leaking` or `tight`, a dictionary with the
            sums `hydraulic_j` and `shaft_j` [J]. `cheaper_than_mhsb_hydraulic` and
            `cheaper_than_mhsb_shaft` count the moves in which the supply takes less than planned
            MHSB.
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
    """Return the least energy of each supply over all alternative motions of one move.

    Args:
        machine: The arm.
        motions: Motions of the move.
        kind: `leaking` or `tight`: valves with or without leakage.
        boundary: `hydraulic_j` for the energy to the oil, `shaft_j` for that at the pumps' shafts.
        pressure: The one constant pressure for all moves [Pa], for the supply `ONE_PRESSURE`.
            Motions that need a higher pressure are not used for this supply.

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
    """Compute the energy of a motion with a main pump at constant pressure.

        E = p (V + n q(p) T)

    E is the energy to the oil [J], V the oil volume that the cylinders take [m³], n the number of
    joints, q(p) the leakage of a valve at pressure p [m³/s] and T the duration of the motion [s].

    Args:
        machine: The arm; has n, q(p) and the main pump's efficiency map.
        motion: The motion; has V and T.
        pressure: Pressure p [Pa].
        kind: `leaking`, or `tight` for q = 0.

    Returns:
        Energy to the oil, and at the pump's shaft.
    """
    leaks = machine.joint_count * compute_valve_leakage(
        get_shared_hydraulics(machine.arrays), pressure
    )
    oil = motion.piston_oil_m3 + (leaks * motion.duration_s if kind == "leaking" else 0.0)
    return add_main_pump_shaft(machine, pressure * oil, motion.duration_s)


def as_markdown(sets: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Format the energies of several sets of moves as Markdown tables.

    Args:
        sets: Results of `sum_supply_energies`, by title of the set of moves.

    Returns:
        Lines without line breaks. Each set that is not empty has a table with a row for each
        supply. Each row has four energies [kJ]: to the oil and at the shafts, with leakage and
        without. A missing value is a dash. A number in brackets counts the moves in which the
        supply takes less than MHSB. The title has the lowest constant pressure with which every
        move can be done [MPa].
    """
    lines = []
    for title, found in sets.items():
        if not found:
            continue
        lines += [
            f"| {title}, {found['moves']} moves [kJ], one pressure for all: "
            f"{found['one_pressure_pa'] / 1e6:.2f} MPa | to the oil | at the shafts "
            "| to the oil, no leakage | at the shafts, no leakage |",
            "|---|---|---|---|---|",
        ]
        for name, numbers in found["systems"].items():
            cells = _cells(name, numbers)
            lines.append(f"| {name} | " + " | ".join(cell or "–" for cell in cells) + " |")
        lines.append("")
    return lines


def _cells(name: str, systems: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Format the energies of one supply as four table cells.

    Args:
        name: Name of the supply.
        systems: Entry of this supply in the `systems` of `sum_supply_energies`. By `leaking` and
            `tight`, it has a dictionary with `hydraulic_j`, `shaft_j` [J],
            `cheaper_than_mhsb_hydraulic` and `cheaper_than_mhsb_shaft` (numbers of moves). May be
            empty.

    Returns:
        Four texts [kJ]: to the oil and at the shafts with leakage, then both without leakage. A
        text is empty if its value is missing. For supplies other than MHSB, the number in brackets
        counts the moves in which the supply takes less than MHSB.
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


def format_energy_by_move(
    names: Sequence[str], moves: Sequence[Motions], machine: Machine
) -> list[str]:
    """Format the energy to the oil of each move in a table of supplies and moves.

    Args:
        names: Name of each move.
        moves: Motions of each move, aligned with `names`.
        machine: The arm.

    Returns:
        Lines without line breaks: a title, a line with the names of the moves, and one line for
        each supply. A cell has the energy [J] with leakage / without leakage. Moves for which MHSB
        (main pump and booster modules) has no motion have no column.
    """
    found = [sum_supply_energies(machine, [motions]) for motions in moves]
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


def compare_on_tour(machine: Machine, goals: Iterable[Position]) -> dict[str, Any]:
    """Plan motions through a sequence of goals with every planner, and compare their energies.

    Each motion is planned from rest to rest and begins where the previous motion ended. The energy
    is the one that all pumps give to the oil, leakage of the valves included.

    Args:
        machine: The arm; the tour begins at the start posture of the machine file.
        goals: Goals in `base_link` in their order, (x, z) or (x, y, z) [m].

    Returns:
        A dictionary. Keys:

        - planned_j: sum of the energies of all motions [J], by planner; 0 if no motion was needed
        - constant_pressure_pa: lowest constant pressure at which the default planner's motions need
            no boost [Pa]
        - constant_pressure_j: energy of these motions with a main pump at that pressure and without
            boosters [J]
        - failures: reason as a sentence, by planner, if the planner did not reach a goal; it is
            then not in `planned_j`

        Both values of the constant pressure are None if the default planner has failed, or if the
        arm is at all goals already.
    """
    planner, goals = Planner(machine, load_or_build_table(machine)), list(goals)
    tours: dict[str, list[Supplied]] = {}
    failures: dict[str, str] = {}
    for kind in PLANNER_KINDS:
        try:
            tours[kind] = _plan_tour(planner, goals, PlanOptions(planner=kind))
        except MhsbError as error:
            failures[kind] = str(error)
    own = tours.get(DEFAULT_PLANNER, [])
    pressure = max((each.needed_pa for each in own), default=0.0)
    taken = (_energy_at_pressure(machine, each, pressure, "leaking").hydraulic_j for each in own)
    return {
        "planned_j": {
            kind: sum((each.leaking[PLANNED_SYSTEM].hydraulic_j for each in tour), 0.0)
            for kind, tour in tours.items()
        },
        "constant_pressure_j": sum(taken) if own else None,
        "constant_pressure_pa": pressure if own else None,
        "failures": failures,
    }


def _plan_tour(planner: Planner, goals: list[Position], options: PlanOptions) -> list[Supplied]:
    """Plan motions from goal to goal, and compute the energy of each motion with every supply.

    The first motion begins at the start posture of the machine file. Each motion begins at rest, in
    the modes that hold the arm there.

    Args:
        planner: Planner of the arm.
        goals: Goals in their order [m].
        options: Options of every plan.

    Returns:
        Energies of each motion, in the order of the goals. A goal at which the tip is already has
        no entry.

    Raises:
        MhsbError: There is no plan to one of the goals.
    """
    machine, tour = planner.machine, []
    posture = np.array(machine.config.simulation.start_posture)
    for goal in goals:
        modes = StartModes.create_settled(
            choose_holding_modes(machine, machine.piston_forces(posture))
        )
        plan = planner.plan(goal, MotionState.at_rest(posture), modes=modes, options=options)
        if plan.duration > 0.0:
            motion = plan.motion.trajectory, plan.motion.schedule
            tour.append(compute_supply_energies(machine, remove_leakage(machine), *motion))
        posture = plan.motion.trajectory.position[-1]
    return tour
