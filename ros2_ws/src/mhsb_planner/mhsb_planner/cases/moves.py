"""Moves by which planners are compared and timed: moves of the paper's cases and random moves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray, Position
from mhsb_planner.cases.paper_cases import load_paper_cases
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


def list_case_moves(machine: Machine) -> dict[str, Move]:
    """Return the moves of the paper's Cases 1 to 4, without repetition.

    Only cases with the planner `table` are used. Cases with equal start and goal give one move,
    with the name and start posture of the first case.

    Args:
        machine: The machine.

    Returns:
        Moves by case name, such as `1-1`. Empty if joint 1 slews, because the cases lie in a plane.

    Raises:
        InfeasibleGoalError: No posture within the joint limits reaches the start of a case.
    """
    if machine.slews:
        return {}
    moves: dict[tuple[Position, Position], str] = {}
    cases = load_paper_cases()
    for name, case in cases.items():
        if case.planner == "table":
            moves.setdefault((case.start, case.goal), name)
    return {
        name: Move(cases[name].start_posture(machine), cases[name].goal) for name in moves.values()
    }


def draw_random_position(machine: Machine, random: np.random.Generator) -> Position:
    """Draw a random point of the workspace of the machine file, even if the arm cannot reach it.

    In the arm's plane, the point is uniform over an area. The area lies between two radii around
    the origin, and x is not below a minimum. If the arm slews, the slew angle is uniform over its
    range.

    Args:
        machine: The machine.
        random: Source of random numbers; its state changes.

    Returns:
        Position in `base_link`, (x, z) or (x, y, z) [m].
    """
    a, area = machine.arrays, machine.config.workspace
    while True:
        x = random.uniform(area.min_x, area.max_radius)
        z = random.uniform(-area.max_radius, area.max_radius)
        if area.min_radius <= np.hypot(x, z) <= area.max_radius:
            break
    slew = random.uniform(a.joint_min[0], a.joint_max[0]) if machine.slews else 0.0
    return tuple(machine.convert_to_base(np.array([x, z]), slew).tolist())


def yield_random_moves(planner: Planner, count: int, seed: int = DEFAULT_SEED) -> Iterator[Move]:
    """Yield random moves between nodes of the posture table's grid that have a plan.

    The start posture is the table's posture for mode N (main pump alone) of all actuators at a
    random node. The goal is another random node. A slewing arm moves between random angles of joint
    1. Moves without a plan are skipped and not counted.

    Args:
        planner: Planner that decides, with its default options, whether a move has a plan.
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
