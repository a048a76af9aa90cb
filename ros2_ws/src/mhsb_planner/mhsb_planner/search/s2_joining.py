"""Start and goal of a search, and the steps that join them to the grid.

Neither need lie on the grid. The start is the actual posture; the goal is the posture that the
graph's rule gives at that very point, for every pattern its own, or all postures with a given
end-link angle. Both are joined to the corners of the cells they lie in, and to each other within
one cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.errors import InfeasibleGoalError
from mhsb_planner.goal_region import Angle, angle_range
from mhsb_planner.search.frontier import NOWHERE
from mhsb_planner.search.goal_clearance import check_tip, clear_postures
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_layout import Layout
from mhsb_planner.search.s2_pricing import Edges
from mhsb_planner.search.s2_step import (
    INADMISSIBLE,
    Circuit,
    Postures,
    bar_collisions,
    describe,
    middle_forces,
    new_scratch,
    steps_to_node,
)

ORIGINS_AT_ONCE = 50
"""Postures from which steps to the goal are priced between two looks at a deadline."""

PSI_SPACING = math.radians(5.0)
"""Of a range of end-link angles these are looked at [rad]."""

JOINING = "joining start and goal to the table"


@dataclass(frozen=True, eq=False)
class Start:
    """Where a search begins: tip (x, z) m and posture, one row with what steps need of it."""

    tip: tuple[float, float]
    postures: Postures


@dataclass(frozen=True, eq=False)
class Goal:
    """Where a search may end.

    tip       (x, z) m
    node      of the graph whose postures these are, None where there is none
    postures  the admissible ones
    first     int64[groups + 1]: postures first[g] … first[g + 1] are alternatives by pattern
    owner     int64[groups, patterns], posture in which a step in that pattern ends
    """

    tip: tuple[float, float]
    node: int | None
    postures: Postures
    first: IntArray
    owner: IntArray


class Steps(NamedTuple):
    """Steps from the start or to the goal."""

    origin: IntArray  # [steps] posture of the graph that is left; NOWHERE for the start
    state: IntArray  # [steps] state of the graph that is reached; NOWHERE for the goal
    end: IntArray  # [steps] posture of the goal that is reached; NOWHERE for a state
    pattern: IntArray  # [steps]
    cost: FloatArray  # [steps, 3] as in `Edges`


def start_at(graph: StepGraph, posture: FloatArray) -> Start:
    """A search's start in a posture [rad]."""
    x, z = graph.machine.tip_position(posture)
    return Start((float(x), float(z)), describe(graph.machine.arrays, posture[None, :]))


def goal_at(
    graph: StepGraph, x: float, z: float, psi: Angle = None, deadline: Deadline = NEVER
) -> Goal:
    """A search's goal at (x, z) m.

    Without psi, for every pattern the posture by the graph's rule, for the posture table that of
    largest velocity polytope; with psi [rad], all postures with that end-link angle, of a range
    some every `PSI_SPACING`, in any pattern. Raises OutOfWorkspaceError, InfeasibleGoalError,
    ZoneError, DeadlineError.
    """
    machine = graph.machine
    machine.check_in_workspace((x, z))
    check_tip(machine, (x, z))
    node, between = None if psi is not None else graph.grid.node_at(x, z), angle_range(psi)
    if between is not None:
        count = math.ceil((between[1] - between[0]) / PSI_SPACING) + 1
        postures = machine.postures(x, z, np.linspace(*between, count))
        if len(postures) == 0:
            raise InfeasibleGoalError(x, z, between)
        first = np.arange(len(postures) + 1)
        owner = np.repeat(first[:-1, None], len(machine.patterns), axis=1)
    elif node is not None:
        return _goal_on_node(graph, x, z, node)
    else:
        postures, owner = np.unique(
            postures_by_rule(graph, x, z, deadline), axis=0, return_inverse=True
        )
        first, owner = np.array([0, len(postures)]), owner.reshape(1, -1)
    clear_postures(machine, x, z, postures)  # steps to those that are not will be barred
    return Goal((x, z), node, describe(machine.arrays, postures), first, owner)


def _goal_on_node(graph: StepGraph, x: float, z: float, node: int) -> Goal:
    """The goal at a node: its own postures."""
    if not graph.table.feasible[node]:
        raise InfeasibleGoalError(x, z)
    layout = graph.layout
    first, last = layout.first[node], layout.first[node + 1]
    postures = Postures(*(values[first:last] for values in graph.postures))
    clear_postures(graph.machine, x, z, postures.posture)
    owner = layout.owner[node : node + 1] - first
    return Goal((x, z), node, postures, np.array([0, last - first]), owner)


def postures_by_rule(
    graph: StepGraph, x: float, z: float, deadline: Deadline = NEVER
) -> FloatArray:
    """Posture for each pattern at (x, z) m, float64[patterns, n] [rad]; the table's on a node.

    Raises InfeasibleGoalError, DeadlineError.
    """
    node = graph.grid.node_at(x, z)
    if node is None:
        return graph.resolve(graph.machine, x, z, deadline)
    if not graph.table.feasible[node]:
        raise InfeasibleGoalError(x, z)
    return graph.table.posture[node]


def steps_from_start(graph: StepGraph, start: Start, goal: Goal, rings: int = 0) -> Steps:
    """Steps to the nodes around the start, and to the goal where both share a cell.

    rings: how many further rings of nodes count as around.
    """
    to_grid = _steps_to_nodes(
        graph.machine.arrays,
        graph.machine.obstacles.path_rows,
        graph.circuit,
        graph.table.patterns,
        start.postures,
        graph.layout,
        graph.postures,
        graph.grid.around(*start.tip, rings),
    )
    if not graph.grid.share_cell(start.tip, goal.tip):
        return to_grid
    direct = _to_goal(graph, start.postures, np.array([0]), goal)
    direct.origin[:] = NOWHERE
    return Steps(*(np.concatenate(pair) for pair in zip(to_grid, direct, strict=True)))


def steps_to_goal(
    graph: StepGraph, goal: Goal, rings: int = 0, deadline: Deadline = NEVER
) -> tuple[Steps, IntArray]:
    """Steps from the nodes around the goal, and where those of each posture begin.

    The second is int64[postures + 1]: steps from posture i are first[i] … first[i + 1]. Raises
    DeadlineError.
    """
    origins = _postures_of(graph.layout.first, np.sort(graph.grid.around(*goal.tip, rings)))
    if goal.node is not None and rings == 0:
        graph.steps.price(origins, deadline)
        steps = _steps_to_goal_on_node(
            graph.steps.edges, len(graph.table.patterns), goal.node, origins, goal.owner[0]
        )
    else:
        parts = []
        for at in range(0, max(1, len(origins)), ORIGINS_AT_ONCE):
            deadline.check(JOINING)
            part = origins[at : at + ORIGINS_AT_ONCE]
            parts.append(_to_goal(graph, graph.postures, part, goal))
        steps = Steps(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    deadline.check(JOINING)
    return steps, _beginnings(steps.origin, len(graph.layout.posture))


@kernel
def _postures_of(first: IntArray, nodes: IntArray) -> IntArray:
    """All postures of some nodes, by `Layout.first`, node by node."""
    count = 0
    for node in nodes:
        count += first[node + 1] - first[node]
    postures = np.empty(count, dtype=np.int64)
    count = 0
    for node in nodes:
        for posture in range(first[node], first[node + 1]):
            postures[count] = posture
            count += 1
    return postures


@kernel
def _beginnings(origin: IntArray, postures: int) -> IntArray:
    """Where the steps that leave each posture begin in a list in the order of their origins."""
    first = np.zeros(postures + 1, dtype=np.int64)
    for posture in origin:
        first[posture + 1] += 1
    for posture in range(postures):
        first[posture + 1] += first[posture]
    return first


@kernel
def _steps_to_goal_on_node(
    edges: Edges, patterns: int, node: int, origins: IntArray, owner: IntArray
) -> Steps:
    """Steps to a goal that is a node: the graph's own, priced, to that node's states."""
    room = 0
    for i in origins:
        room += edges.last[i] - edges.first[i]
    origin, end = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64)
    pattern, cost = np.empty(room, dtype=np.int64), np.empty((room, 3))
    found = 0
    for i in origins:
        for e in range(edges.first[i], edges.last[i]):
            if edges.state[e] // patterns == node:
                origin[found], pattern[found] = i, edges.pattern[e]
                end[found], cost[found] = owner[pattern[found]], edges.cost[e]
                found += 1
    nowhere = np.full(found, NOWHERE)
    return Steps(origin[:found], nowhere, end[:found], pattern[:found], cost[:found])


def _to_goal(graph: StepGraph, start: Postures, origins: IntArray, goal: Goal) -> Steps:
    return _steps_to_goal(
        graph.machine.arrays,
        graph.machine.obstacles.path_rows,
        graph.circuit,
        graph.table.patterns,
        start,
        origins,
        goal.postures,
        goal.first,
        goal.owner,
    )


@kernel
def _steps_to_nodes(
    m: MachineArrays,
    obstacles: FloatArray,
    c: Circuit,
    patterns: ModeArray,
    start: Postures,
    layout: Layout,
    postures: Postures,
    nodes: IntArray,
) -> Steps:
    """Steps from the only posture of `start` to nodes of the graph."""
    scratch = new_scratch(patterns)
    count = len(patterns)
    state = np.empty(len(nodes) * count, dtype=np.int64)
    cost = np.empty((len(nodes) * count, 3))
    found = 0
    for node in nodes:
        first = layout.first[node]
        here = layout.first[node + 1] - first
        if here == 0:
            continue
        middle = np.empty((here, patterns.shape[1]))
        middle_forces(m, start.posture[0], postures.posture, first, middle)
        bar_collisions(m, obstacles, start.posture[0], postures.posture, first, middle)
        status = steps_to_node(
            c, patterns, start, 0, postures, first, here, layout.owner[node], middle, scratch
        )
        if status == INADMISSIBLE:
            continue
        for p in range(count):
            if scratch.status[p] == status:
                state[found] = node * count + p
                cost[found] = scratch.cost[p]
                found += 1
    nowhere = np.full(found, NOWHERE)
    return Steps(nowhere, state[:found], nowhere.copy(), state[:found] % count, cost[:found])


@kernel
def _steps_to_goal(
    m: MachineArrays,
    obstacles: FloatArray,
    c: Circuit,
    patterns: ModeArray,
    start: Postures,
    origins: IntArray,
    goal: Postures,
    goal_first: IntArray,
    goal_owner: IntArray,
) -> Steps:
    """Steps from postures of `start`, named by `origins`, to the goal."""
    scratch = new_scratch(patterns)
    count = len(patterns)
    capacity = len(origins) * len(goal_owner) * count
    origin = np.empty(capacity, dtype=np.int64)
    end = np.empty(capacity, dtype=np.int64)
    pattern = np.empty(capacity, dtype=np.int64)
    cost = np.empty((capacity, 3))
    found = 0
    for i in origins:
        for g in range(len(goal_owner)):
            first = goal_first[g]
            here = goal_first[g + 1] - first
            middle = np.empty((here, patterns.shape[1]))
            middle_forces(m, start.posture[i], goal.posture, first, middle)
            bar_collisions(m, obstacles, start.posture[i], goal.posture, first, middle)
            status = steps_to_node(
                c, patterns, start, i, goal, first, here, goal_owner[g], middle, scratch
            )
            if status == INADMISSIBLE:
                continue
            for p in range(count):
                if scratch.status[p] == status:
                    origin[found] = i
                    end[found] = goal_owner[g, p]
                    pattern[found] = p
                    cost[found] = scratch.cost[p]
                    found += 1
    nowhere = np.full(found, NOWHERE)
    return Steps(origin[:found], nowhere, end[:found], pattern[:found], cost[:found])
