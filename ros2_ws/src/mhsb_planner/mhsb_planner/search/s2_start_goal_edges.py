"""Start and goal of a search, and the steps that join them to the grid.

Start and goal may lie between the nodes of the grid. The start is one posture. The goal is a set of
postures: one for each mode combination by the graph's posture rule, or all postures with a given
end-link angle. Both are joined to the corners of the cells in which they lie. If they share a cell,
they are also joined to each other.
"""

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
from mhsb_planner.search.s2_edge_costs import StepCostModel
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
        postures: Start posture with its cylinder lengths and forces, in one row.
    """

    tip: tuple[float, float]
    postures: Postures


@dataclass(frozen=True, eq=False)
class SearchGoal:
    """Admissible end postures of a search, in groups.

    A group holds one posture for each combination, and combinations may share a posture. A goal
    without a given end-link angle has one group. With a given end-link angle each posture is a
    group of its own, for all combinations.

    Attributes:
        tip: Tip position (x, z) [m].
        node: Node of the graph that the goal lies on; None if the goal is between nodes, or has a
            given end-link angle.
        postures: Admissible postures with their cylinder lengths and forces.
        first: Postures of group g are first[g] to first[g + 1] - 1, shape (groups + 1,).
        owner: Index of the posture in which a step of each combination ends, shape (groups,
            patterns). `owner` and `first` are read-only like the graph's arrays. Kernels are
            therefore compiled only once for arrays of both.
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

    Without a given end-link angle each mode combination has one admissible posture. At a node the
    posture table gives it, elsewhere the graph's posture rule. With a given angle all postures with
    this angle are admissible in any combination.

    Args:
        graph: Graph that gives machine, grid and posture rule.
        x: Tip position forward [m].
        z: Tip position upward [m].
        psi: End-link angle [rad]. A pair is a range, sampled in steps of at most
            `GOAL_PSI_SPACING`. None leaves the angle free.
        deadline: Instant at which the work is given up.

    Returns:
        Goal with its postures. Steps to postures too near to an obstacle are inadmissible.

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
    return SearchGoal((x, z), node, described, frozen(first), frozen(owner))


def _create_goal_at_node(graph: StepGraph, x: float, z: float, node: int) -> SearchGoal:
    """Create a goal from the postures that the posture table has for a node.

    Args:
        graph: Graph that the node belongs to.
        x: Tip position of the node, forward [m].
        z: Tip position of the node, upward [m].
        node: Index of the node.

    Returns:
        Goal with one group of postures: the node's distinct postures. Steps to postures too near to
        an obstacle are inadmissible.

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
    return SearchGoal((x, z), node, postures, frozen(np.array([0, last - first])), frozen(owner))


def find_postures_by_rule(
    graph: StepGraph, x: float, z: float, deadline: Deadline = NO_DEADLINE
) -> FloatArray:
    """Return the posture of each mode combination at a tip position.

    At a node the posture table gives the postures; elsewhere the graph's `posture_rule` computes
    them.

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
    """Compute the admissible steps from the start to the nodes around it, and to a goal nearby.

    The nodes are the corners of the start's grid cell, and `rings` further rings around them. If
    the goal lies in the same cell, steps from the start to the goal are added at the end. A step is
    inadmissible if the tip leaves the workspace or the arm comes too near to an obstacle. It is
    also inadmissible if a joint that needs boost is not boosted. A mode combination that also
    boosts a joint without need is admissible only if no other combination is admissible for the
    node.

    Args:
        graph: Graph whose nodes are reached.
        start: Start of the search.
        goal: Goal of the search.
        rings: Number of rings of nodes around the corners; 0 means the corners alone.

    Returns:
        One step for each reached node and each admissible mode combination, with duration [s] and
        energies in both readings (`paper`, `series`) [J]. The steps to the goal have the state
        NO_STATE.
    """
    cost_model, nodes = graph.steps.cost_model, graph.grid.cell_corners(*start.tip, rings)
    to_grid = _compute_steps_to_nodes(cost_model, start.postures, nodes)
    if not graph.grid.share_cell(start.tip, goal.tip):
        return to_grid
    direct = _compute_steps_to_goal(cost_model, start.postures, np.array([0]), goal)
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
        rings: Number of rings of nodes around the corners; 0 means the corners alone.
        deadline: Instant at which the work is given up.

    Returns:
        Steps, sorted by the posture that they leave, and an array `first` of shape (postures + 1,).
        Posture i is left by steps first[i] to first[i + 1] - 1.

    Raises:
        DeadlineError: The deadline passed.
    """
    nodes, first = np.sort(graph.grid.cell_corners(*goal.tip, rings)), graph.layout.first_posture
    origins = _list_ranges(first[nodes], first[nodes + 1])
    if goal.node is not None and rings == 0:
        graph.steps.price(origins, deadline)
        steps = _collect_steps_to_goal_node(graph, goal, origins)
    else:
        parts = []
        for at in range(0, max(1, len(origins)), ORIGINS_AT_ONCE):
            deadline.check(JOIN_TASK)
            part = origins[at : at + ORIGINS_AT_ONCE]
            parts.append(_compute_steps_to_goal(graph.steps.cost_model, graph.postures, part, goal))
        steps = JoiningSteps(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    deadline.check(JOIN_TASK)
    count = np.bincount(steps.origin, minlength=len(graph.layout.posture))
    return steps, np.append(0, np.cumsum(count))


def _list_ranges(first: IntArray, last: IntArray) -> IntArray:
    """List the numbers of several ranges, one range after the other.

    Args:
        first: First number of each range, shape (ranges,).
        last: Last number of each range plus 1, shape (ranges,).

    Returns:
        The numbers first[0] to last[0] - 1, then first[1] to last[1] - 1, and so on.
    """
    count = last - first
    return np.arange(count.sum()) + np.repeat(last - np.cumsum(count), count)


def _collect_steps_to_goal_node(
    graph: StepGraph, goal: SearchGoal, origins: IntArray
) -> JoiningSteps:
    """Collect the graph's steps to one node, which is the goal of a search.

    Args:
        graph: Graph; its steps that leave `origins` must be priced.
        goal: Goal of the search, which is a node.
        origins: Numbers of the graph's postures whose steps are examined.

    Returns:
        Steps in the order of `origins`. The field `origin` is the number of the posture that the
        step leaves, `end` the index of the goal posture, and `state` NO_STATE.
    """
    edges = graph.steps.edges
    first, last = edges.first[origins], edges.last[origins]
    step, origin = _list_ranges(first, last), np.repeat(origins, last - first)
    ends_at_goal = edges.state[step] // len(graph.table.patterns) == goal.node
    step, origin = step[ends_at_goal], origin[ends_at_goal]
    pattern, nowhere = edges.pattern[step], np.full(len(step), NO_STATE)
    return JoiningSteps(origin, nowhere, goal.owner[0, pattern], pattern, edges.cost[step])


def _compute_steps_to_nodes(
    cost_model: StepCostModel, start: Postures, nodes: IntArray
) -> JoiningSteps:
    """Compute the admissible steps from one posture to given nodes of the graph.

    Args:
        cost_model: Machine, obstacles, postures and states of the graph.
        start: Start posture with its cylinder lengths and forces, in row 0; further rows are
            ignored.
        nodes: Indices of the nodes to reach.

    Returns:
        One step for each node and each combination of modes with which the step is admissible, in
        the order of `nodes`. The field `state` is the state that the step reaches (node · patterns
        + pattern). The fields `origin` and `end` are NO_STATE.
    """
    layout = cost_model.layout
    _, node, pattern, cost = _price_steps(
        cost_model,
        start,
        np.array([0]),
        nodes,
        cost_model.postures,
        layout.first_posture,
        layout.posture_of_state,
    )
    nowhere = np.full(len(node), NO_STATE)
    state = node * len(cost_model.patterns) + pattern
    return JoiningSteps(nowhere, state, nowhere, pattern, cost)


def _compute_steps_to_goal(
    cost_model: StepCostModel, start: Postures, origins: IntArray, goal: SearchGoal
) -> JoiningSteps:
    """Compute the admissible steps from given postures to a goal.

    Args:
        cost_model: Machine, obstacles and mode combinations of the graph.
        start: Postures that steps may leave, with their cylinder lengths and forces.
        origins: Rows of `start` for which steps are computed.
        goal: Goal of the search.

    Returns:
        Steps in the order of `origins`. The field `origin` is the row of `start` that the step
        leaves, `end` the index of the goal posture, and `state` NO_STATE.
    """
    groups = np.arange(len(goal.owner))
    origin, group, pattern, cost = _price_steps(
        cost_model, start, origins, groups, goal.postures, goal.first, goal.owner
    )
    end, nowhere = goal.owner[group, pattern], np.full(len(group), NO_STATE)
    return JoiningSteps(origin, nowhere, end, pattern, cost)


@kernel
def _price_steps(
    cost_model: StepCostModel,
    start: Postures,
    origins: IntArray,
    groups: IntArray,
    end: Postures,
    first: IntArray,
    owner: IntArray,
) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """Compute the admissible steps from given postures to groups of postures.

    A group assigns a posture to each mode combination, and combinations may share a posture. The
    postures of a node are a group; a goal has one or more groups. A step is inadmissible if the tip
    leaves the workspace or the arm comes too near to an obstacle. It is also inadmissible in a mode
    combination without boost for a joint that needs it. Combinations that boost a joint without
    need are admissible only if no other combination is admissible for the group.

    Args:
        cost_model: Machine, obstacles and mode combinations of the graph.
        start: Postures that steps may leave, with their cylinder lengths and forces.
        origins: Rows of `start` for which steps are computed.
        groups: Numbers of the groups to reach.
        end: Postures of all groups, with their cylinder lengths and forces.
        first: Postures of group g are first[g] to first[g + 1] - 1, shape (all groups + 1,).
        owner: Row of `end` for each group and combination, shape (all groups, patterns).

    Returns:
        Four arrays with a row for each step, in the order of `origins`, then of `groups`:

        - Row of `start` that the step leaves.
        - Number of the group that the step reaches.
        - Index of the step's mode combination.
        - Cost of the step, shape (steps, 3), with the columns of `JoiningSteps.cost`.
    """
    m, obstacles, patterns = cost_model.machine, cost_model.obstacles, cost_model.patterns
    scratch, count = create_step_buffers(patterns), len(patterns)
    capacity = len(origins) * len(groups) * count
    origin = np.empty(capacity, dtype=np.int64)
    group = np.empty(capacity, dtype=np.int64)
    pattern = np.empty(capacity, dtype=np.int64)
    cost = np.empty((capacity, 3))
    found = 0
    for i in origins:
        for g in groups:
            here = first[g + 1] - first[g]
            if here == 0:
                continue
            middle = np.empty((here, patterns.shape[1]))
            compute_middle_forces(m, start.posture[i], end.posture, first[g], middle)
            mark_collisions(m, obstacles, start.posture[i], end.posture, first[g], middle)
            moves = NodeMoves(start, i, end, first[g], here, owner[g], middle)
            status = price_steps_to_node(cost_model.circuit, patterns, moves, scratch)
            if status == STEP_INADMISSIBLE:
                continue
            for p in range(count):
                if scratch.status[p] == status:
                    origin[found], group[found], pattern[found] = i, g, p
                    copy_row(cost[found], scratch.cost[p])
                    found += 1
    return origin[:found], group[:found], pattern[:found], cost[:found]
