"""Moves by which planners are compared and timed: those of the paper's cases, and random ones."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray
from mhsb_planner.evaluation.paper_cases import paper_cases
from mhsb_planner.planner import Planner

SEED = 0


class Move(NamedTuple):
    """From a start posture float64[n] rad at rest to the tip position `goal` (x, z) m."""

    start: FloatArray
    goal: tuple[float, float]


def case_moves(machine: Machine) -> dict[str, Move]:
    """The moves of Cases 1 to 4, each once, from the posture of the table planner's case."""
    moves: dict[tuple[tuple[float, float], tuple[float, float]], str] = {}
    cases = paper_cases()
    for name, case in cases.items():
        if case.planner == "table":
            moves.setdefault((case.start, case.goal), name)
    return {
        name: Move(cases[name].start_posture(machine), cases[name].goal)
        for name in moves.values()
    }


def random_moves(planner: Planner, count: int) -> Iterator[Move]:
    """Random moves between nodes of the grid, from the table's posture in N, that have a plan.

    Goals are nodes, since those off the grid would have their postures sought first (S1).
    """
    random = np.random.default_rng(SEED)
    table = planner.graph.table
    nodes = np.flatnonzero(table.feasible)
    while count:
        here, there = random.choice(nodes, 2, replace=False)
        x, z = table.nodes[there] * table.spacing
        move = Move(table.posture[here, 0], (float(x), float(z)))
        try:
            planner.plan(move.goal, MotionState.at_rest(move.start))
        except MhsbError:
            continue
        count -= 1
        yield move
