"""Comparison of planners, and of boosters with one constant pressure, on a sequence of goals."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.holding import choose_holding_modes
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_model.types import Position
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planner import DEFAULT_PLANNER, PLANNER_KINDS, Planner, PlanOptions
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_tools.comparison.supply_comparison import (
    ONE_PRESSURE,
    PLANNED_SYSTEM,
    Supplied,
    compute_supply_energies,
    sum_supply_energies,
)
from mhsb_tools.moves.supply_systems import remove_leakage


def compare_on_tour(machine: Machine, goals: Iterable[Position]) -> dict[str, Any]:
    """Plan motions through a sequence of goals with every planner, and compare their energies.

    Each motion is planned from rest to rest and begins where the previous motion ended. The energy
    is the one that all pumps give to the oil, leakage of the valves included.

    Args:
        machine: The arm; the tour begins at the start posture of the machine file.
        goals: Goals in `base_link` in their order, (x, z) or (x, y, z) [m].

    Returns:
        A dictionary. Keys:

        - planned_j: sum of the energies of all motions [J], by planner
        - constant_pressure_pa: lowest constant pressure at which the default planner's motions need
            no boost [Pa]
        - constant_pressure_j: energy of these motions with a main pump at that pressure and without
            boosters [J]
        - failures: reason as a sentence, by planner, if the planner did not reach a goal; it is
            then not in `planned_j`

        Both values of the constant pressure are None if the default planner has failed.
    """
    planner, goals = Planner(machine, load_or_build_table(machine)), list(goals)
    found: dict[str, dict[str, Any]] = {}
    failures: dict[str, str] = {}
    for kind in PLANNER_KINDS:
        try:
            tour = _plan_tour(planner, goals, PlanOptions(planner=kind))
        except MhsbError as error:
            failures[kind] = str(error)
            continue
        found[kind] = sum_supply_energies(machine, [{kind: motion} for motion in tour])
    energies = {
        kind: {
            name: entry["leaking"]["hydraulic_j"]
            for name, entry in total.get("systems", {}).items()
            if "leaking" in entry
        }
        for kind, total in found.items()
    }
    own = energies.get(DEFAULT_PLANNER, {})
    return {
        "planned_j": {kind: each.get(PLANNED_SYSTEM, 0.0) for kind, each in energies.items()},
        "constant_pressure_j": own.get(ONE_PRESSURE),
        "constant_pressure_pa": found.get(DEFAULT_PLANNER, {}).get("one_pressure_pa"),
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
