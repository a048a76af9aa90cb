"""How good and how fast the integrated planner is, against the table planner and the ground truth.

Energies are those of motions made in the same way on both sides: S3 follows the path.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.evaluation.ground_truth import ground_truth
from mhsb_planner.evaluation.moves import Move, case_moves
from mhsb_planner.planner import ENERGY_OPTIMAL, Plan, Planner, PlanOptions
from mhsb_planner.slewing.sharing_out import slewing_meanwhile

MILLI = 1e3

TABLE = PlanOptions(ENERGY_OPTIMAL, planner="table", trajectory="followed")
INTEGRATED = PlanOptions(ENERGY_OPTIMAL, planner="integrated")


class Compared(NamedTuple):
    """Plans of a move: energies and costs over the table planner's motion, and times [ms]; with the
    deadline not a number where none was found."""

    energy: float
    cost: float
    took: float
    soon_energy: float
    soon_cost: float
    soon_took: float


def integrated_figures(
    planner: Planner, moves: Sequence[Move], truths: int, within: float
) -> dict[str, Any]:
    """Times over the moves; energies over cases and moves; ratios to `truths` ground truths.

    within: deadline of plans that are wanted soon [s]; answers come a little later

    energy_ratio_geomean of the cases alone, which are the three-joint arm's, of the moves where
    there are none; worst_energy_ratio of cases and moves, both to the table planner's motions, and
    worst_cost_ratio, that of w₁ E + w₂ T + w₃ switches, by which plans are chosen: a switch less
    may be worth a little energy; ground_truth_ratio_… of the paths of the cases and of the first
    moves, left out where there are none; soon: the same with a deadline.
    """
    three = planner.machine.is_3r
    cases = list(case_moves(planner.machine).values()) if three else []
    of_cases = [_compared(planner, move, within) for move in cases]
    bar = tqdm(moves, desc="against the table")
    of_moves = [_compared(planner, move, within) for move in bar]
    ratios = [row.energy for row in of_cases or of_moves]
    measured = [*cases, *moves[:truths]]
    bar = tqdm(measured, desc="ground truth")
    of_truths = np.array([_over_truth(planner, move, within) for move in bar]).reshape(-1, 2)
    everything = [*of_cases, *of_moves]
    soon = np.array([(row.soon_energy, row.soon_cost) for row in everything])
    return {
        **_times([row.took for row in of_moves]),
        "energy_ratio_geomean": float(np.exp(np.mean(np.log(ratios)))),
        "worst_energy_ratio": max(row.energy for row in everything),
        "worst_cost_ratio": max(row.cost for row in everything),
        **_truth_ratios(of_truths[:, 0]),
        "soon": {
            "deadline_ms": MILLI * within,
            **_times([row.soon_took for row in of_moves]),
            "not_found": int(np.count_nonzero(np.isnan(soon[:, 0]))),
            "worst_energy_ratio": float(np.nanmax(soon[:, 0])),
            "worst_cost_ratio": float(np.nanmax(soon[:, 1])),
            **_truth_ratios(of_truths[:, 1]),
        },
    }


def _truth_ratios(ratios: FloatArray) -> dict[str, float]:
    """Mean and largest of those that are numbers; nothing where none is."""
    known = ratios[np.isfinite(ratios)]
    if not len(known):
        return {}
    mean, worst = float(known.mean()), float(known.max())
    return {"ground_truth_ratio_mean": mean, "ground_truth_ratio_max": worst}


def _truth(machine: Machine, move: Move) -> float:
    """No path for a move takes less energy [J], and where the arm does not slew one takes that."""
    plane, a = machine.plane, machine.arrays
    modes = np.full(plane.joint_count, Mode.N, dtype=np.uint8)
    goal, slew = machine.in_plane(move.goal, move.start[0])
    start = move.start[-plane.joint_count:]
    truth = ground_truth(plane, start, modes, goal, ENERGY_OPTIMAL)
    energy = float(truth.energy.sum())
    if slew is None:
        return energy
    oil, time = slewing_meanwhile(machine, float(move.start[0]), slew)
    leakage = machine.joint_count * a.leakage_flow
    if time > truth.duration.sum():
        flow = a.main_pump_flow - leakage
        tight = plane.arrays._replace(leakage_flow=0.0, idle_leakage=0.0, main_pump_flow=flow)
        patient = ground_truth(replace(plane, arrays=tight), start, modes, goal, ENERGY_OPTIMAL)
        energy = max(energy, float(patient.energy.sum()) + a.supply_pressure * leakage * time)
    return energy + a.supply_pressure * oil


def _times(times: Sequence[float]) -> dict[str, float]:
    p50, p99 = np.percentile(times, [50, 99]).tolist()
    return {"p50_ms": p50, "p99_ms": p99}


def _plan(
    planner: Planner, move: Move, options: PlanOptions, deadline: Deadline = NEVER
) -> Plan:
    start = MotionState.at_rest(move.start)
    return planner.plan(move.goal, start, options=options, deadline=deadline)


def _soon(planner: Planner, move: Move, within: float) -> Plan | None:
    """The integrated planner's plan with a deadline."""
    try:
        return _plan(planner, move, INTEGRATED, Deadline.after(within))
    except DeadlineError:
        return None


def _compared(planner: Planner, move: Move, within: float) -> Compared:
    table = _plan(planner, move, TABLE)
    began = time.perf_counter()
    integrated = _plan(planner, move, INTEGRATED)
    ended = time.perf_counter()
    soon = _soon(planner, move, within)
    soon_took = time.perf_counter() - ended
    return Compared(
        *_over(integrated, table),
        MILLI * (ended - began),
        *_over(soon, table),
        MILLI * soon_took,
    )


def _over(plan: Plan | None, table: Plan) -> tuple[float, float]:
    """Energy and cost of a plan over the table planner's."""
    if plan is None:
        return math.nan, math.nan
    cost = plan.cost(INTEGRATED) / table.cost(INTEGRATED)
    return plan.energy.paper / table.energy.paper, cost


def _over_truth(planner: Planner, move: Move, within: float) -> tuple[float, float]:
    """Energy of the integrated planner's path over that of the ground truth's, and of the path
    that it has by the deadline.

    Where the arm slews the truth is at least that of its plane and the slew's oil, and at least
    what its plane takes if nothing leaks, that oil, and what leaks while it slews.
    """
    truth = _truth(planner.machine, move)
    soon = _soon(planner, move, within)
    path = _plan(planner, move, INTEGRATED).path
    return (
        float(path.energy.sum() / truth),
        math.nan if soon is None else float(soon.path.energy.sum() / truth),
    )
