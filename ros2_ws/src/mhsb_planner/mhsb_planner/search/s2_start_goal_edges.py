"""Start and goal of a search, and the steps that join them to the grid.

Start and goal may lie between the nodes of the grid. The start is one posture. The goal is a set of
postures: one for each mode combination by the graph's posture rule, or all postures with a given
end-link angle. Both are joined to the corners of the cells in which they lie. If they share a cell,
they are also joined to each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.errors import InfeasibleGoalError
from mhsb_planner.goal_region import Angle, angle_range
from mhsb_planner.search.goal_clearance import check_tip_clearance, find_clear_postures
from mhsb_planner.search.open_list import NO_STATE
from mhsb_planner.search.s2_edge_costs import Edges, StepCostModel
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_step import (
    STEP_INADMISSIBLE,
    NodeMoves,
    Postures,
    compute_middle_forces,
    create_step_buffers,
    describe_postures,
    mark_collisions,
    price_steps_to_node,
)

ORIGINS_AT_ONCE = 50
"""Number of postures whose steps to the goal are priced between two checks of the deadline."""

GOAL_PSI_SPACING = math.radians(5.0)
"""Largest spacing of the samples in a range of end-link angles [rad]."""

JOIN_TASK = "joining start and goal to the table"


@dataclass(frozen=True, eq=False)
class SearchStart:
    """Start of a search.

    Attributes:
        tip: Tip position (x, z) [m].
        postures: Description of the start posture, with one row.
    """

    tip: tuple[float, float]
    postures: Postures


@dataclass(frozen=True, eq=False)
class SearchGoal:
    """Admissible end postures of a search, in groups.

    A group holds one posture for each combination, and combinations may share a posture. A goal
    without end-link angle has one group. With an end-link angle each posture is a separate group.

    Attributes:
        tip: Tip position (x, z) [m].
        node: Node of the graph whose postures these are; None if the goal is between nodes, or has
            an end-link angle.
        postures: Descriptions of the admissible postures.
        first: Postures of group g are first[g] to first[g + 1] - 1, shape (groups + 1,).
        owner: Index of the posture in which a step of each combination ends, shape (groups,
            patterns). Read-only like the graph's arrays, so that kernels are compiled once for
            both.
    """

    tip: tuple[float, float]
    node: int | None
    postures: Postures
    first: IntArray
    owner: IntArray


class JoiningSteps(NamedTuple):
    """Admissible steps from the start or to the goal, with their costs.

    Attributes:
        origin: Posture of the graph that a step leaves, shape (steps,); NO_STATE for the start.
        state: State of the graph that a step reaches, shape (steps,); NO_STATE for the goal.
        end: Posture of the goal that a step reaches, shape (steps,); NO_STATE for a step to a node.
        pattern: Index of the mode combination of a step, shape (steps,).
        cost: Cost of each step, shape (steps, 3): duration [s], energy by the published model
            (`paper`) [J], energy with the pumps in series (`series`) [J].
    """

    origin: IntArray
    state: IntArray
    end: IntArray
    pattern: IntArray
    cost: FloatArray


def create_start(graph: StepGraph, posture: FloatArray) -> SearchStart:
    """Create the start of a search from a posture.

    Args:
        graph: Graph of the machine.
        posture: Joint positions, shape (n,) [rad or m].

    Returns:
        Start with the tip position [m], and the posture's cylinder lengths [m] and piston forces
        [N].
    """
    x, z = graph.machine.tip_position(posture)
    return SearchStart(
        (float(x), float(z)), describe_postures(graph.machine.arrays, posture[None, :])
    )


def create_goal(
    graph: StepGraph, x: float, z: float, psi: Angle = None, deadline: Deadline = NO_DEADLINE
) -> SearchGoal:
    """Create the goal of a search: the admissible postures at a tip position.

    Without an end-link angle every mode combination has its own posture. At a node it comes from
    the posture table, elsewhere from the graph's posture rule. With an end-link angle all postures
    with that angle are admissible in any combination.

    Args:
        graph: Graph that gives machine, grid and posture rule.
        x: Tip position forward [m].
        z: Tip position upward [m].
        psi: End-link angle [rad]. A pair is a range, whose samples are at most `GOAL_PSI_SPACING`
            apart. None leaves the angle free.
        deadline: Instant at which the work is given up.

    Returns:
        Goal with its postures. Some of them may be too near to an obstacle; steps to these are
        inadmissible.

    Raises:
        OutOfWorkspaceError: The point is outside the workspace.
        InfeasibleGoalError: No posture within joint limits reaches the point.
        ZoneError: The tip, or the arm in every posture, is too near to an obstacle.
        DeadlineError: The deadline passed.
    """
    machine = graph.machine
    machine.check_in_workspace((x, z))
    check_tip_clearance(machine, (x, z))
    node, between = None if psi is not None else graph.grid.node_at(x, z), angle_range(psi)
    if between is not None:
        count = math.ceil((between[1] - between[0]) / GOAL_PSI_SPACING) + 1
        postures = machine.postures(x, z, np.linspace(*between, count))
        if len(postures) == 0:
            raise InfeasibleGoalError(x, z, between)
        first = np.arange(len(postures) + 1)
        owner = np.repeat(first[:-1, None], len(machine.patterns), axis=1)
    elif node is not None:
        return _create_goal_at_node(graph, x, z, node)
    else:
        postures, owner = np.unique(
            find_postures_by_rule(graph, x, z, deadline), axis=0, return_inverse=True
        )
        first, owner = np.array([0, len(postures)]), owner.reshape(1, -1)
    find_clear_postures(machine, x, z, postures)  # only to raise; steps to unclear ones are barred
    described = describe_postures(machine.arrays, postures)
    return SearchGoal((x, z), node, described, first, frozen(owner))


def _create_goal_at_node(graph: StepGraph, x: float, z: float, node: int) -> SearchGoal:
    """Create a goal from the postures that the posture table has for a node.

    Args:
        graph: Graph that the node belongs to.
        x: Tip position of the node, forward [m].
        z: Tip position of the node, upward [m].
        node: Index of the node.

    Returns:
        Goal with one group of postures: the node's distinct postures. Some may be too near to an
        obstacle; steps to these are inadmissible.

    Raises:
        InfeasibleGoalError: The node has no posture within joint limits.
        ZoneError: The arm is too near to an obstacle in every posture of the node.
    """
    if not graph.table.feasible[node]:
        raise InfeasibleGoalError(x, z)
    layout = graph.layout
    first, last = layout.first_posture[node], layout.first_posture[node + 1]
    postures = Postures(*(values[first:last] for values in graph.postures))
    find_clear_postures(graph.machine, x, z, postures.posture)
    owner = layout.posture_of_state[node : node + 1] - first
    return SearchGoal((x, z), node, postures, np.array([0, last - first]), frozen(owner))


def find_postures_by_rule(
    graph: StepGraph, x: float, z: float, deadline: Deadline = NO_DEADLINE
) -> FloatArray:
    """Return the posture of each mode combination at a tip position, from table or posture rule.

    At a node these are the table's postures. Elsewhere the graph's `posture_rule` computes them.

    Args:
        graph: Graph that gives table and posture rule.
        x: Tip position forward [m].
        z: Tip position upward [m].
        deadline: Instant at which the work is given up.

    Returns:
        Joint positions, shape (patterns, n) [rad or m]; one mode combination per row.

    Raises:
        InfeasibleGoalError: No posture within joint limits reaches the point.
        DeadlineError: The deadline passed.
    """
    node = graph.grid.node_at(x, z)
    if node is None:
        return graph.posture_rule(graph.machine, x, z, deadline)
    if not graph.table.feasible[node]:
        raise InfeasibleGoalError(x, z)
    return graph.table.posture[node]


def compute_steps_from_start(
    graph: StepGraph, start: SearchStart, goal: SearchGoal, rings: int = 0
) -> JoiningSteps:
    """Compute the admissible steps from the start to the nodes around it, and to a near goal.

    The nodes are the corners of the start's grid cell, and `rings` further rings around them. If
    the goal lies in the same cell, the steps from the start to the goal come last. A step is
    inadmissible if the tip leaves the workspace or the arm comes too near to an obstacle. It is
    also inadmissible if a joint that needs boost is not boosted. A mode combination that also
    boosts a joint without need is admissible only if a node has no other admissible combination.

    Args:
        graph: Graph whose nodes are reached.
        start: Start of the search.
        goal: Goal of the search.
        rings: Number of further rings of nodes; 0 means the corners alone.

    Returns:
        One step for each reached node and admissible combination, with duration [s] and energies in
        both readings (`paper`, `series`) [J]. The steps to the goal have the state NO_STATE.
    """
    to_grid = _price_steps_to_nodes(
        graph.steps.cost_model, start.postures, graph.grid.cell_corners(*start.tip, rings)
    )
    if not graph.grid.share_cell(start.tip, goal.tip):
        return to_grid
    direct = _compute_steps_to_goal(graph, start.postures, np.array([0]), goal)
    direct.origin[:] = NO_STATE
    return JoiningSteps(*(np.concatenate(pair) for pair in zip(to_grid, direct, strict=True)))


def compute_steps_to_goal(
    graph: StepGraph, goal: SearchGoal, rings: int = 0, deadline: Deadline = NO_DEADLINE
) -> tuple[JoiningSteps, IntArray]:
    """Compute the admissible steps to the goal from the nodes around it.

    The nodes are the corners of the goal's grid cell, and `rings` further rings around them. If the
    goal is a node and `rings` is 0, the graph's own steps to that node are taken. Missing costs of
    these steps are computed and stored in the graph.

    Args:
        graph: Graph whose postures the steps leave.
        goal: Goal of the search.
        rings: Number of further rings of nodes; 0 means the corners alone.
        deadline: Instant at which the work is given up.

    Returns:
        Steps, sorted by the posture that they leave, and an index `first` of shape (postures + 1,).
        Steps that leave posture i are first[i] to first[i + 1] - 1.

    Raises:
        DeadlineError: The deadline passed.
    """
    origins = _list_postures(
        graph.layout.first_posture, np.sort(graph.grid.cell_corners(*goal.tip, rings))
    )
    if goal.node is not None and rings == 0:
        graph.steps.price(origins, deadline)
        steps = _collect_steps_to_goal_node(
            graph.steps.edges, len(graph.table.patterns), goal.node, origins, goal.owner[0]
        )
    else:
        parts = []
        for at in range(0, max(1, len(origins)), ORIGINS_AT_ONCE):
            deadline.check(JOIN_TASK)
            part = origins[at : at + ORIGINS_AT_ONCE]
            parts.append(_compute_steps_to_goal(graph, graph.postures, part, goal))
        steps = JoiningSteps(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    deadline.check(JOIN_TASK)
    return steps, _index_first_steps(steps.origin, len(graph.layout.posture))


@kernel
def _list_postures(first: IntArray, nodes: IntArray) -> IntArray:
    """List all postures of some nodes.

    Args:
        first: Number of the first posture of each node, shape (nodes + 1,). Postures of node i are
            first[i] to first[i + 1] - 1.
        nodes: Indices of the nodes.

    Returns:
        Numbers of the postures, node by node in the order of `nodes`.
    """
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
def _index_first_steps(origin: IntArray, postures: int) -> IntArray:
    """Compute the index of the first step of each posture in a sorted list of steps.

    Args:
        origin: Posture that each step leaves, in ascending order, shape (steps,).
        postures: Number of postures of the graph.

    Returns:
        Array `first` of shape (postures + 1,). Steps of posture i are first[i] to first[i + 1] - 1.
    """
    first = np.zeros(postures + 1, dtype=np.int64)
    for posture in origin:
        first[posture + 1] += 1
    for posture in range(postures):
        first[posture + 1] += first[posture]
    return first


@kernel
def _collect_steps_to_goal_node(
    edges: Edges, patterns: int, node: int, origins: IntArray, owner: IntArray
) -> JoiningSteps:
    """Collect the graph's steps to one node, which is the goal of a search.

    Args:
        edges: Steps of the graph; those that leave `origins` must be priced.
        patterns: Number of mode combinations.
        node: Index of the node that is the goal.
        origins: Numbers of the graph's postures whose steps are examined. A node has one or more
            postures.
        owner: For each mode combination the index of the goal posture in which a step of that
            combination ends, shape (patterns,).

    Returns:
        Steps in the order of `origins`. The field `origin` is the number of the posture that is
        left, `end` the index of the goal posture, and `state` NO_STATE.
    """
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
                end[found] = owner[pattern[found]]
                copy_row(cost[found], edges.cost[e])
                found += 1
    nowhere = np.full(found, NO_STATE)
    return JoiningSteps(origin[:found], nowhere, end[:found], pattern[:found], cost[:found])


def _compute_steps_to_goal(
    graph: StepGraph, start: Postures, origins: IntArray, goal: SearchGoal
) -> JoiningSteps:
    """Compute the admissible steps to a goal, with the cost model of a graph.

    Args:
        graph: Graph; only its cost model `steps.cost_model` is read.
        start: Descriptions of the postures that steps may leave.
        origins: Rows of `start` for which steps are computed.
        goal: Goal of the search.

    Returns:
        Steps in the order of `origins`. The field `origin` is the row of `start` that is left,
        `end` the index of the goal posture, and `state` NO_STATE.
    """
    return _price_steps_to_goal(
        graph.steps.cost_model, start, origins, goal.postures, goal.first, goal.owner
    )


@kernel
def _price_steps_to_nodes(
    cost_model: StepCostModel, start: Postures, nodes: IntArray
) -> JoiningSteps:
    """Compute the admissible steps from one posture to given nodes of the graph.

    A step is inadmissible if the tip leaves the workspace or the arm comes too near to an obstacle.
    It is also inadmissible in a mode combination that does not boost a joint that needs boost.
    Combinations that boost a joint without need are admissible only if the node has no other
    admissible combination.

    Args:
        cost_model: Machine, obstacles, postures and states of the graph.
        start: Description of the start; only its first posture counts.
        nodes: Indices of the nodes to reach.

    Returns:
        One step for each node and admissible combination, in the order of `nodes`. The field
        `state` is the state that is reached (node · patterns + pattern). The fields `origin` and
        `end` are NO_STATE.
    """
    m, obstacles, patterns = cost_model.machine, cost_model.obstacles, cost_model.patterns
    layout, postures = cost_model.layout, cost_model.postures
    scratch = create_step_buffers(patterns)
    count = len(patterns)
    state = np.empty(len(nodes) * count, dtype=np.int64)
    cost = np.empty((len(nodes) * count, 3))
    found = 0
    for node in nodes:
        first = layout.first_posture[node]
        here = layout.first_posture[node + 1] - first
        if here == 0:
            continue
        middle = np.empty((here, patterns.shape[1]))
        compute_middle_forces(m, start.posture[0], postures.posture, first, middle)
        mark_collisions(m, obstacles, start.posture[0], postures.posture, first, middle)
        owner = layout.posture_of_state[node]
        moves = NodeMoves(start, 0, postures, first, here, owner, middle)
        status = price_steps_to_node(cost_model.circuit, patterns, moves, scratch)
        if status == STEP_INADMISSIBLE:
            continue
        for p in range(count):
            if scratch.status[p] == status:
                state[found] = node * count + p
                copy_row(cost[found], scratch.cost[p])
                found += 1
    nowhere = np.full(found, NO_STATE)
    return JoiningSteps(nowhere, state[:found], nowhere.copy(), state[:found] % count, cost[:found])


@kernel
def _price_steps_to_goal(
    cost_model: StepCostModel,
    start: Postures,
    origins: IntArray,
    goal: Postures,
    goal_first: IntArray,
    goal_owner: IntArray,
) -> JoiningSteps:
    """Compute the admissible steps from given postures to each group of goal postures.

    A step is inadmissible if the tip leaves the workspace or the arm comes too near to an obstacle.
    It is also inadmissible in a mode combination that does not boost a joint that needs boost. A
    group assigns a goal posture to each mode combination, and combinations may share a posture.
    Combinations that boost a joint without need are admissible only if the group has no other
    admissible combination.

    Args:
        cost_model: Machine, obstacles and mode combinations of the graph.
        start: Descriptions of the postures that steps may leave.
        origins: Rows of `start` for which steps are computed.
        goal: Descriptions of the goal postures.
        goal_first: Postures of group g are goal_first[g] to goal_first[g + 1] - 1, shape (groups +
            1,).
        goal_owner: Index of the goal posture of each group and combination, shape (groups,
            patterns).

    Returns:
        Steps in the order of `origins`, and group by group for each origin. The field `origin` is
        the row of `start` that is left, `end` the index of the goal posture, and `state` NO_STATE.
    """
    m, obstacles, patterns = cost_model.machine, cost_model.obstacles, cost_model.patterns
    scratch = create_step_buffers(patterns)
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
            compute_middle_forces(m, start.posture[i], goal.posture, first, middle)
            mark_collisions(m, obstacles, start.posture[i], goal.posture, first, middle)
            moves = NodeMoves(start, i, goal, first, here, goal_owner[g], middle)
            status = price_steps_to_node(cost_model.circuit, patterns, moves, scratch)
            if status == STEP_INADMISSIBLE:
                continue
            for p in range(count):
                if scratch.status[p] == status:
                    origin[found] = i
                    end[found] = goal_owner[g, p]
                    pattern[found] = p
                    copy_row(cost[found], scratch.cost[p])
                    found += 1
    nowhere = np.full(found, NO_STATE)
    return JoiningSteps(origin[:found], nowhere, end[:found], pattern[:found], cost[:found])
