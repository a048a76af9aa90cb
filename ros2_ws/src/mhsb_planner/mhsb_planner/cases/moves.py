"""Moves by which planners are compared and timed: moves of the paper's cases and random moves."""

from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from mhsb_model.errors import MhsbError, OutOfWorkspaceError
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray, Position
from mhsb_planner.cases.paper_cases import PaperCase, load_paper_cases
from mhsb_planner.errors import InfeasibleGoalError
from mhsb_planner.planner import Planner
from mhsb_planner.posture.s1_global_search import find_postures_at

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


def list_distinct_cases() -> dict[str, PaperCase]:
    """Return the paper's Cases 1 to 4 by name, such as `1-1`, without repetition.

    Only cases with the planner `table` are used. Of cases with equal start and goal, only the first
    one is returned.
    """
    first: dict[tuple[Position, Position], tuple[str, PaperCase]] = {}
    for name, case in load_paper_cases().items():
        if case.planner == "table":
            first.setdefault((case.start, case.goal), (name, case))
    return dict(first.values())


def list_case_moves(machine: Machine) -> dict[str, Move]:
    """Return the moves of the paper's Cases 1 to 4 that an arm can do, without repetition.

    A case is left out if the arm cannot reach its start or its goal.

    Args:
        machine: The machine.

    Returns:
        Moves by case name, such as `1-1`. Empty if joint 1 slews, because the cases lie in a plane.
    """
    if machine.slews:
        return {}
    moves = {}
    for name, case in list_distinct_cases().items():
        with suppress(OutOfWorkspaceError, InfeasibleGoalError):
            machine.check_in_workspace(case.start)
            machine.check_in_workspace(case.goal)
            find_postures_at(machine, case.goal[0], case.goal[1])
            moves[name] = Move(case.start_posture(machine), case.goal)
    return moves


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
    """Yield random moves that can be planned, between nodes of the posture table's grid.

    The start posture is the table's posture for mode N (main pump alone) of all actuators at a
    random node. The goal is another random node. If the arm slews, its slew angles at start and
    goal are random. Moves without a plan are skipped and not counted. If no move has a plan, the
    generator never ends.

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
