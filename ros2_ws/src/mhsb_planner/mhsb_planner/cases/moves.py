"""Moves by which planners are compared and timed: those of the paper's cases, and random ones."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray, Position
from mhsb_planner.cases.paper_cases import paper_cases
from mhsb_planner.planner import Planner

DEFAULT_SEED = 0
"""Default seed of random moves."""


class Move(NamedTuple):
    """Move from rest in a start posture to a goal.

    Attributes:
        start: Start posture, shape (n,) [rad or m].
        goal: Goal of the tip in `base_link` [m].
    """

    start: FloatArray
    goal: Position


def case_moves(machine: Machine) -> dict[str, Move]:
    """Return the moves of Cases 1 to 4, each once.

    Only cases of the table planner count. If several have equal start and goal, they give one move,
    with the name and the start posture of the first.

    Args:
        machine: The machine.

    Returns:
        Moves by case name; empty if joint 1 slews, because the cases lie in a plane.
    """
    if machine.slews:
        return {}
    moves: dict[tuple[Position, Position], str] = {}
    cases = paper_cases()
    for name, case in cases.items():
        if case.planner == "table":
            moves.setdefault((case.start, case.goal), name)
    return {
        name: Move(cases[name].start_posture(machine), cases[name].goal) for name in moves.values()
    }


def random_position(machine: Machine, random: np.random.Generator) -> Position:
    """Draw a random point of the workspace.

    Points are uniform over the workspace's area in the plane: between two radii and from its least
    x on. If the arm slews, the slew angle is uniform over its range.

    Args:
        machine: The machine.
        random: Source of random numbers.

    Returns:
        Position in `base_link` [m].
    """
    a, area = machine.arrays, machine.config.workspace
    while True:
        x = random.uniform(area.min_x, area.max_radius)
        z = random.uniform(-area.max_radius, area.max_radius)
        if area.min_radius <= np.hypot(x, z) <= area.max_radius:
            break
    slew = random.uniform(a.joint_min[0], a.joint_max[0]) if machine.slews else 0.0
    return tuple(machine.convert_to_base(np.array([x, z]), slew).tolist())


def random_moves(planner: Planner, count: int, seed: int = DEFAULT_SEED) -> Iterator[Move]:
    """Yield random moves between nodes of the posture table's grid that have a plan.

    The start posture is the table's posture at a random node, with all actuators in mode N. The
    goal is another random node; at other points a posture would have to be optimised first (S1). A
    slewing arm moves between random angles of joint 1. Moves for which planning fails are skipped
    and do not count.

    Args:
        planner: Planner that must find a plan with its default options.
        count: Number of moves.
        seed: Seed of the random choice.

    Yields:
        `count` moves, each a start posture and a goal.
    """
    random, machine = np.random.default_rng(seed), planner.machine
    table, a = planner.graph.table, machine.arrays
    nodes = np.flatnonzero(table.feasible)
    while count:
        here, there = random.choice(nodes, 2, replace=False)
        goal, start = table.nodes[there] * table.spacing, table.posture[here, 0]
        if machine.slews:
            began, ended = random.uniform(a.joint_min[0], a.joint_max[0], 2)
            goal, start = machine.convert_to_base(goal, ended), np.append(began, start)
        move = Move(start, tuple(goal.tolist()))
        try:
            planner.plan(move.goal, MotionState.at_rest(move.start))
        except MhsbError:
            continue
        count -= 1
        yield move
