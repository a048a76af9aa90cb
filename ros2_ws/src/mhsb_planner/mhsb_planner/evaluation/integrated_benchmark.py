"""How good and how fast the integrated planner is, against the table planner and the ground truth.

Energies are those of motions made in the same way on both sides: S3 follows the path.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from tqdm import tqdm

from mhsb_model.modes import Mode
from mhsb_model.trajectory import MotionState
from mhsb_planner.evaluation.ground_truth import ground_truth
from mhsb_planner.evaluation.moves import Move, case_moves
from mhsb_planner.planner import ENERGY_OPTIMAL, Plan, Planner, PlanOptions

MILLI = 1e3

TABLE = PlanOptions(ENERGY_OPTIMAL, planner="table", trajectory="followed")
INTEGRATED = PlanOptions(ENERGY_OPTIMAL, planner="integrated")


def integrated_figures(planner: Planner, moves: Sequence[Move], truths: int) -> dict[str, Any]:
    """Times over the moves; energies over cases and moves; ratios to `truths` ground truths.

    energy_ratio_geomean of the cases alone, worst_energy_ratio of cases and moves, both to the
    table planner's motions; ground_truth_ratio_… of the paths of the cases and of the first moves.
    """
    cases = list(case_moves(planner.machine).values())
    of_cases = [_compared(planner, move)[0] for move in cases]
    compared = [_compared(planner, move) for move in tqdm(moves, desc="against the table")]
    of_moves, times = zip(*compared, strict=True)
    measured = [*cases, *moves[:truths]]
    of_truths = [_truth_ratio(planner, move) for move in tqdm(measured, desc="ground truth")]
    p50, p99 = np.percentile(times, [50, 99]).tolist()
    return {
        "p50_ms": p50,
        "p99_ms": p99,
        "energy_ratio_geomean": float(np.exp(np.mean(np.log(of_cases)))),
        "worst_energy_ratio": max(*of_cases, *of_moves),
        "ground_truth_ratio_mean": float(np.mean(of_truths)),
        "ground_truth_ratio_max": max(of_truths),
    }


def _plan(planner: Planner, move: Move, options: PlanOptions) -> Plan:
    return planner.plan(move.goal, MotionState.at_rest(move.start), options=options)


def _compared(planner: Planner, move: Move) -> tuple[float, float]:
    """Energy of the integrated planner's motion over the table planner's; time of its plan [ms]."""
    table = _plan(planner, move, TABLE)
    began = time.perf_counter()
    integrated = _plan(planner, move, INTEGRATED)
    took = MILLI * (time.perf_counter() - began)
    return integrated.energy.paper / table.energy.paper, took


def _truth_ratio(planner: Planner, move: Move) -> float:
    """Energy of the integrated planner's path over that of the ground truth's."""
    machine = planner.machine
    modes = np.full(machine.joint_count, Mode.N, dtype=np.uint8)
    truth = ground_truth(machine, move.start, modes, move.goal, ENERGY_OPTIMAL)
    path = _plan(planner, move, INTEGRATED).path
    return float(path.energy.sum() / truth.energy.sum())

