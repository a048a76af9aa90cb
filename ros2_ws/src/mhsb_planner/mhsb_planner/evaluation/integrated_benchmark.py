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


def integrated_figures(
    planner: Planner, moves: Sequence[Move], truths: int, runs: int
) -> dict[str, Any]:
    """Times over the moves; energies over cases and moves; ratios to `truths` ground truths.

    energy_ratio_geomean of the cases alone, worst_energy_ratio of cases and moves, both to the
    table planner's motions; ground_truth_ratio_… of the paths of the cases and of the first moves.
    """
    cases = list(case_moves(planner.machine).values())
    of_cases = [_energy_ratio(planner, move) for move in cases]
    of_moves = [_energy_ratio(planner, move) for move in tqdm(moves, desc="against the table")]
    measured = [*cases, *moves[:truths]]
    of_truths = [_truth_ratio(planner, move) for move in tqdm(measured, desc="ground truth")]
    p50, p99 = _percentiles(planner, moves, runs)
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


def _energy_ratio(planner: Planner, move: Move) -> float:
    """Energy of the integrated planner's motion over that of the table planner's."""
    table, integrated = (_plan(planner, move, options) for options in (TABLE, INTEGRATED))
    return integrated.energy.paper / table.energy.paper


def _truth_ratio(planner: Planner, move: Move) -> float:
    """Energy of the integrated planner's path over that of the ground truth's."""
    machine = planner.machine
    modes = np.full(machine.joint_count, Mode.N, dtype=np.uint8)
    truth = ground_truth(machine, move.start, modes, move.goal, ENERGY_OPTIMAL)
    path = _plan(planner, move, INTEGRATED).path
    return float(path.energy.sum() / truth.energy.sum())


def _percentiles(planner: Planner, moves: Sequence[Move], runs: int) -> tuple[float, float]:
    """Median of the runs' 50th and 99th percentiles of the time of a whole plan [ms]."""
    times = np.empty((runs, len(moves)))
    for row in tqdm(times, desc="integrated plans", unit="run"):
        for i, move in enumerate(moves):
            began = time.perf_counter()
            _plan(planner, move, INTEGRATED)
            row[i] = MILLI * (time.perf_counter() - began)
    p50, p99 = np.median(np.percentile(times, [50, 99], axis=1), axis=1)
    return float(p50), float(p99)
