"""Benchmark of the integrated planner against the table planner and the ground truth.

Energies are of motions made in one way on both sides: S3 follows the path.
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
from mhsb_planner.cases.moves import Move, list_case_moves
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.planner import ENERGY_OPTIMAL, Plan, Planner, PlanOptions
from mhsb_planner.slewing.slew_distribution import compute_slew_demand
from mhsb_tools.comparison.ground_truth import search_ground_truth

MILLI = 1e3

TABLE = PlanOptions(ENERGY_OPTIMAL, planner="table", trajectory="followed")
INTEGRATED = PlanOptions(ENERGY_OPTIMAL, planner="integrated")


class PlanComparison(NamedTuple):
    """Comparison of the integrated planner's plans with the table planner's motion for one move.

    Attributes:
        energy: Ratio of energies, without a deadline.
        cost: Ratio of costs, without a deadline.
        plan_ms: Planning time without a deadline [ms].
        quick_energy: Ratio of energies with a deadline; NaN if no plan was found.
        quick_cost: Ratio of costs with a deadline; NaN if no plan was found.
        quick_plan_ms: Planning time with a deadline [ms].
    """

    energy: float
    cost: float
    plan_ms: float
    quick_energy: float
    quick_cost: float
    quick_plan_ms: float


def integrated_figures(
    planner: Planner, moves: Sequence[Move], truths: int, deadline: float
) -> dict[str, Any]:
    """Measure times, energies and costs of integrated plans, without and with a deadline.

    Args:
        planner: The planner.
        moves: Random moves.
        truths: Number of these, the first ones, that are compared with the ground truth.
        deadline: Deadline of the plans under `soon` [s]; answers come a little later.

    Returns:
        Planning times of the moves [ms]. `energy_ratio_geomean` is over the paper's cases, or over
        the moves for an arm without them. `worst_energy_ratio` and `worst_cost_ratio` are over
        cases and moves. All these are relative to the table planner's motions, the cost being w₁ E
        + w₂ T + w₃ switches. `ground_truth_ratio_…` compares path energies of the cases and of the
        first moves, and is left out if there are none. `soon` has these figures with the deadline.
    """
    three = planner.machine.is_3r
    cases = list(list_case_moves(planner.machine).values()) if three else []
    of_cases = [_compare_plans(planner, move, deadline) for move in cases]
    bar = tqdm(moves, desc="against the table")
    of_moves = [_compare_plans(planner, move, deadline) for move in bar]
    ratios = [row.energy for row in of_cases or of_moves]
    measured = [*cases, *moves[:truths]]
    bar = tqdm(measured, desc="ground truth")
    of_truths = np.array([_ratios_to_truth(planner, move, deadline) for move in bar]).reshape(-1, 2)
    everything = [*of_cases, *of_moves]
    soon = np.array([(row.quick_energy, row.quick_cost) for row in everything])
    return {
        **_times([row.plan_ms for row in of_moves]),
        "energy_ratio_geomean": float(np.exp(np.mean(np.log(ratios)))),
        "worst_energy_ratio": max(row.energy for row in everything),
        "worst_cost_ratio": max(row.cost for row in everything),
        **_truth_ratios(of_truths[:, 0]),
        "soon": {
            "deadline_ms": MILLI * deadline,
            **_times([row.quick_plan_ms for row in of_moves]),
            "not_found": int(np.count_nonzero(np.isnan(soon[:, 0]))),
            "worst_energy_ratio": float(np.nanmax(soon[:, 0])),
            "worst_cost_ratio": float(np.nanmax(soon[:, 1])),
            **_truth_ratios(of_truths[:, 1]),
        },
    }


def _truth_ratios(ratios: FloatArray) -> dict[str, float]:
    """Return mean and largest finite ratio to the ground truth.

    Args:
        ratios: Ratios, shape (moves,); some may be NaN.

    Returns:
        `ground_truth_ratio_mean` and `ground_truth_ratio_max`; empty if no ratio is finite.
    """
    known = ratios[np.isfinite(ratios)]
    if not len(known):
        return {}
    mean, worst = float(known.mean()), float(known.max())
    return {"ground_truth_ratio_mean": mean, "ground_truth_ratio_max": worst}


def _ground_truth_energy(machine: Machine, move: Move) -> float:
    """Return the energy of the ground truth for a move.

    For an arm that does not slew, this is the energy of the best known path. For one that slews it
    is a lower bound: the path in the plane plus the slew's oil. If the slew takes longer than that
    path, the bound is at least the plane's energy without leakage plus leakage during the slew.

    Args:
        machine: The arm.
        move: Start posture and goal.

    Returns:
        Energy [J].
    """
    plane, a = machine.planar_arm, machine.arrays
    modes = np.full(plane.joint_count, Mode.N, dtype=np.uint8)
    goal, slew = machine.convert_to_plane(move.goal, move.start[0])
    start = move.start[-plane.joint_count :]
    truth = search_ground_truth(plane, start, modes, goal, ENERGY_OPTIMAL)
    energy = float(truth.energy.sum())
    if slew is None:
        return energy
    oil, time = compute_slew_demand(machine, float(move.start[0]), slew)
    leakage = machine.joint_count * a.leakage_flow
    if time > truth.duration.sum():
        flow = a.main_pump_flow - leakage
        tight = plane.arrays._replace(leakage_flow=0.0, external_leakage=0.0, main_pump_flow=flow)
        patient = search_ground_truth(
            replace(plane, arrays=tight), start, modes, goal, ENERGY_OPTIMAL
        )
        energy = max(energy, float(patient.energy.sum()) + a.supply_pressure * leakage * time)
    return energy + a.supply_pressure * oil


def _times(times: Sequence[float]) -> dict[str, float]:
    """Return median and 99th percentile of times in ms."""
    p50, p99 = np.percentile(times, [50, 99]).tolist()
    return {"p50_ms": p50, "p99_ms": p99}


def _plan(
    planner: Planner, move: Move, options: PlanOptions, deadline: Deadline = NO_DEADLINE
) -> Plan:
    """Plan a move from rest.

    Args:
        planner: The planner.
        move: Start posture and goal.
        options: Options of the plan.
        deadline: When planning must end.

    Returns:
        The plan.
    """
    start = MotionState.at_rest(move.start)
    return planner.plan(move.goal, start, options=options, deadline=deadline)


def _plan_with_deadline(planner: Planner, move: Move, within: float) -> Plan | None:
    """Plan a move by the integrated planner with a deadline.

    Args:
        planner: The planner.
        move: Start posture and goal.
        within: Deadline after the call [s].

    Returns:
        The plan; None if there is none in time.
    """
    try:
        return _plan(planner, move, INTEGRATED, Deadline.after(within))
    except DeadlineError:
        return None


def _compare_plans(planner: Planner, move: Move, within: float) -> PlanComparison:
    """Plan a move by the table planner and by the integrated one, the latter twice.

    Args:
        planner: The planner.
        move: Start posture and goal.
        within: Deadline of the second integrated plan [s].

    Returns:
        Ratios and times.
    """
    table = _plan(planner, move, TABLE)
    began = time.perf_counter()
    integrated = _plan(planner, move, INTEGRATED)
    ended = time.perf_counter()
    soon = _plan_with_deadline(planner, move, within)
    soon_took = time.perf_counter() - ended
    return PlanComparison(
        *_ratios_to_table(integrated, table),
        MILLI * (ended - began),
        *_ratios_to_table(soon, table),
        MILLI * soon_took,
    )


def _ratios_to_table(plan: Plan | None, table: Plan) -> tuple[float, float]:
    """Divide energy and cost of a plan by the table plan's.

    Args:
        plan: The plan, or None.
        table: The table planner's plan.

    Returns:
        Ratio of energies and of costs; NaN twice if there is no plan.
    """
    if plan is None:
        return math.nan, math.nan
    cost = plan.cost(INTEGRATED) / table.cost(INTEGRATED)
    return plan.energy.paper / table.energy.paper, cost


def _ratios_to_truth(planner: Planner, move: Move, within: float) -> tuple[float, float]:
    """Divide the path energy of integrated plans by the ground truth's.

    Args:
        planner: The planner.
        move: Start posture and goal.
        within: Deadline of the second plan [s].

    Returns:
        Ratio without a deadline and with one; the latter is NaN if there was no plan in time.
    """
    truth = _ground_truth_energy(planner.machine, move)
    soon = _plan_with_deadline(planner, move, within)
    path = _plan(planner, move, INTEGRATED).path
    return (
        float(path.energy.sum() / truth),
        math.nan if soon is None else float(soon.path.energy.sum() / truth),
    )
