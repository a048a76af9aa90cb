"""Moves by which planners are compared and timed: those of the paper's cases, and random ones."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray, Position
from mhsb_planner.evaluation.paper_cases import paper_cases
from mhsb_planner.planner import Planner

SEED = 0


class Move(NamedTuple):
    """From a start posture float64[n] rad at rest to the tip position `goal` in `base_link` [m]."""

    start: FloatArray
    goal: Position


def case_moves(machine: Machine) -> dict[str, Move]:
    """The moves of Cases 1 to 4, each once, from the posture of the table planner's case.

    None where the arm slews: the cases are in a plane.
    """
    if machine.slews:
        return {}
    moves: dict[tuple[Position, Position], str] = {}
    cases = paper_cases()
    for name, case in cases.items():
        if case.planner == "table":
            moves.setdefault((case.start, case.goal), name)
    return {
        name: Move(cases[name].start_posture(machine), cases[name].goal)
        for name in moves.values()
    }


def anywhere(machine: Machine, random: np.random.Generator) -> Position:
    """A point of the workspace [m], all areas of the plane and all angles of the slew alike."""
    a, area = machine.arrays, machine.config.workspace
    while True:
        x = random.uniform(area.min_x, area.max_radius)
        z = random.uniform(-area.max_radius, area.max_radius)
        if area.min_radius <= np.hypot(x, z) <= area.max_radius:
            break
    slew = random.uniform(a.joint_min[0], a.joint_max[0]) if machine.slews else 0.0
    return tuple(machine.in_base(np.array([x, z]), slew).tolist())


def random_moves(planner: Planner, count: int, seed: int = SEED) -> Iterator[Move]:
    """Random moves between nodes of the grid, from the table's posture in N, that have a plan.

    Goals are nodes, since those off the grid would have their postures sought first (S1). Arms that
    slew do so between any angles within their limits.
    """
    random, machine = np.random.default_rng(seed), planner.machine
    table, a = planner.graph.table, machine.arrays
    nodes = np.flatnonzero(table.feasible)
    while count:
        here, there = random.choice(nodes, 2, replace=False)
        goal, start = table.nodes[there] * table.spacing, table.posture[here, 0]
        if machine.slews:
            began, ended = random.uniform(a.joint_min[0], a.joint_max[0], 2)
            goal, start = machine.in_base(goal, ended), np.append(began, start)
        move = Move(start, tuple(goal.tolist()))
        try:
            planner.plan(move.goal, MotionState.at_rest(move.start))
        except MhsbError:
            continue
        count -= 1
        yield move
