"""The exact search: A* over states (node, pattern), which can be paused and continued.

A state is a node and the pattern of arrival. A step's cost therefore depends only on the state it
leaves and the state it reaches. The heuristic of `lower_bound` is consistent, so an expanded state
is final; if rounding makes a later path cheaper, the state is expanded again.

The same steps leave all states that share a posture. A state is skipped if another state of its
posture is so cheap that a mode switch from there costs less than arriving here. Switch counts obey
the triangle inequality, so all successors are reached from the other state at no greater cost.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.search.lower_bound import compute_lower_bound
from mhsb_planner.search.open_list import (
    ARRAYS_FULL,
    EXPANDED_COUNT,
    GENERATED_COUNT,
    GOAL_FOUND,
    NO_STATE,
    SEARCH_EXHAUSTED,
    SEARCH_PAUSED,
    WAITING_COUNT,
    OpenList,
    SearchState,
    create_open_list,
    pop_first_state,
    record_path_to,
    trace_path_to_goal,
)
from mhsb_planner.search.s2_edge_costs import (
    NOT_PRICED,
    Edges,
    StepCostModel,
    compute_max_step_count,
    price_steps,
)
from mhsb_planner.search.s2_query import Query
from mhsb_planner.search.s2_start_goal_edges import JoiningSteps
from mhsb_planner.search.s2_step import DURATION_COLUMN, create_step_buffers


class PostureLabels(NamedTuple):
    """Values of the exact search per posture, beside its open list.

    Attributes:
        remaining: Lower bound on the cost to the goal, shape (postures,). NaN means not computed
            yet.
        cheapest: Pattern of the posture's state with the least cost so far, shape (postures,).
            NO_STATE if no state of the posture has been reached.
    """

    remaining: FloatArray
    cheapest: IntArray


class ExactSearchInput(NamedTuple):
    """Problem of one search, in the form that the kernel takes.

    Attributes:
        from_start: Steps that leave the start. A reached state of NO_STATE means the goal.
        start_switches: Number of actuators that change from the modes in force, shape (patterns,).
        to_goal: Steps to the goal, sorted by the posture that they leave.
        goal_first: Steps of posture i to the goal are goal_first[i] to goal_first[i + 1] - 1,
            shape (postures + 1,).
        goal_length: Cylinder lengths of the goal postures that steps lead to, shape (goals, n) [m].
        switches: Number of actuators that change between two patterns, shape (patterns, patterns).
        weight: Weights of energy [1/J], time [1/s] and switches [-], shape (3,).
        column: Column of the energy in step costs, ENERGY_PAPER_COLUMN or ENERGY_SERIES_COLUMN.
    """

    from_start: JoiningSteps
    start_switches: IntArray
    to_goal: JoiningSteps
    goal_first: IntArray
    goal_length: FloatArray
    switches: IntArray
    weight: FloatArray
    column: int


@kernel(inline="always")
def _is_dominated(
    cost: float, steps: int, other_cost: float, other_steps: int, switching: float
) -> bool:
    """Return whether another state of the same posture makes a state useless.

    This is so if the other state is cheaper, and switching from its pattern costs no more than
    arriving directly. At equal cost the other path must have no more steps.

    Args:
        cost: Cost of the path to the state.
        steps: Number of steps of that path.
        other_cost: Cost of the path to the other state.
        other_steps: Number of steps of the path to the other state.
        switching: Cost of the mode switches from the other state's pattern to this state's pattern.

    Returns:
        True if the state need not be expanded.
    """
    through = other_cost + switching
    return other_cost < cost and (through < cost or (through == cost and other_steps <= steps))


@kernel
def expand(
    open_list: OpenList,
    labels: PostureLabels,
    cost_model: StepCostModel,
    edges: Edges,
    search_input: ExactSearchInput,
    limit: int,
) -> int:
    """Expand up to `limit` states of the A* search.

    The first call expands the start. Steps of a posture that have no price yet are priced with
    `cost_model` and appended to `edges`. A state that `_is_dominated` rules out is not put on the
    open list. If it is ruled out only later, it is skipped when it comes first; it then counts
    towards `limit` but not as expanded. The caller holds the lock `PricedSteps.guard()`.

    Test oracle: scipy.sparse.csgraph.dijkstra on the same graph.

    Args:
        open_list: Open list and records of all states. Written in place.
        labels: Lower bounds and cheapest patterns per posture. Written in place.
        cost_model: Data for pricing steps, and postures with their cylinder lengths.
        edges: Steps priced so far. New steps are written in place if there is room.
        search_input: Start, goal, weights and mode switches.
        limit: Largest number of states to take from the open list, including the start.

    Returns:
        SEARCH_PAUSED if the limit is reached, GOAL_FOUND if the cheapest path is found,
        SEARCH_EXHAUSTED if no state is left. ARRAYS_FULL means that `edges` has less room than the
        steps of one posture may take. No state is lost then; the caller enlarges `edges` and calls
        again.
    """
    states, heap, counts = open_list.states, open_list.heap, open_list.counts
    remaining, cheapest = labels
    edge_first, edge_last, edge_used, edge_state, edge_pattern, edge_cost = edges
    start_state, start_pattern = search_input.from_start.state, search_input.from_start.pattern
    start_cost, start_switches = search_input.from_start.cost, search_input.start_switches
    goal_pattern, goal_cost = search_input.to_goal.pattern, search_input.to_goal.cost
    goal_first, goal_length = search_input.goal_first, search_input.goal_length
    switches, column = search_input.switches, search_input.column
    owner, length = cost_model.layout.posture_of_state.ravel(), cost_model.postures.length
    c = cost_model.circuit
    area, pace = c.area, c.inverse_speed_limit
    scratch = create_step_buffers(cost_model.patterns)
    room = compute_max_step_count(cost_model.layout, cost_model.patterns)
    leakage = len(area) * c.leakage_flow + c.idle_leakage
    w_energy, w_time, w_switch = search_input.weight
    sink = len(states) - 1
    fresh = counts[EXPANDED_COUNT] == 0
    state: int
    other: SearchState
    for _ in range(limit):
        if fresh:
            state, posture, own, so, steps = NO_STATE, NO_STATE, 0, 0.0, 1
            begin, grid_end = 0, len(start_pattern)
            end = grid_end
        else:
            if counts[WAITING_COUNT] == 0:
                return SEARCH_EXHAUSTED
            state = heap[0]
            own = state % len(switches)  # state = node · patterns + pattern
            if state != sink:
                pattern = cheapest[owner[state]]
                here, other = states[state], states[state - own + pattern]
                switching = w_switch * switches[pattern, own]
                if _is_dominated(here.cost, here.depth, other.cost, other.depth, switching):
                    pop_first_state(open_list)
                    continue
            if state != sink and edge_first[owner[state]] == NOT_PRICED:
                posture, found = owner[state], edge_used[0]
                if found + room > len(edge_state):
                    return ARRAYS_FULL
                edge_used[0] = price_steps(
                    cost_model, posture, scratch, edge_state, edge_pattern, edge_cost, found
                )
                edge_first[posture], edge_last[posture] = found, edge_used[0]
            state = pop_first_state(open_list)
            if state == sink:
                return GOAL_FOUND
            posture = owner[state]
            so, steps = states[state].cost, states[state].depth + 1
            begin, grid_end = edge_first[posture], edge_last[posture]
            end = grid_end + goal_first[posture + 1] - goal_first[posture]
        counts[EXPANDED_COUNT] += 1
        counts[GENERATED_COUNT] += end - begin
        for i in range(begin, end):
            if fresh:
                e, target = i, start_state[i]
                cost = w_energy * start_cost[e, column] + w_time * start_cost[e, DURATION_COLUMN]
                cost += w_switch * start_switches[start_pattern[e]]
                if target == NO_STATE:
                    target = sink
            elif i < grid_end:
                e, target = i, edge_state[i]
                cost = w_energy * edge_cost[e, column] + w_time * edge_cost[e, DURATION_COLUMN]
                cost += w_switch * switches[own, edge_pattern[e]]
            else:
                e, target = goal_first[posture] + i - grid_end, sink
                cost = w_energy * goal_cost[e, column] + w_time * goal_cost[e, DURATION_COLUMN]
                cost += w_switch * switches[own, goal_pattern[e]]
            cost += so
            there: SearchState = states[target]
            if cost > there.cost or (cost == there.cost and steps >= there.depth):
                continue
            least = 0.0
            if target != sink:
                at, arrival = owner[target], start_pattern[e] if fresh else edge_pattern[e]
                pattern = cheapest[at]
                other = states[target - arrival + pattern]
                if pattern == NO_STATE or cost < other.cost:
                    cheapest[at] = arrival
                else:
                    switching = w_switch * switches[pattern, arrival]
                    if _is_dominated(cost, steps, other.cost, other.depth, switching):
                        continue
                if math.isnan(remaining[at]):
                    remaining[at] = math.inf
                    for k in range(len(goal_length)):
                        bound = compute_lower_bound(
                            area,
                            pace,
                            c.shared_flow,
                            leakage,
                            0.0,
                            0.0,
                            length[at],
                            goal_length[k],
                            w_energy * c.supply_pressure,
                            w_time,
                        )
                        remaining[at] = min(remaining[at], bound)
                least = remaining[at]
            there.step = e
            record_path_to(open_list, target, state, steps, cost, least)
        fresh = False
    return SEARCH_PAUSED


class ExactSearch:
    """Search for the cheapest path; among equal ones it takes a path with the fewest steps."""

    first_portion, portion = 50, 2000

    def __init__(self, query: Query) -> None:
        """Prepare a search without expanding anything.

        Args:
            query: Problem to solve.
        """
        self._query = query
        layout = query.graph.layout
        self._open_list = create_open_list(layout.posture_of_state.size)
        postures, reached = len(layout.posture), np.zeros(len(query.goal.postures.length), bool)
        reached[query.to_goal.end] = True
        self._labels = PostureLabels(np.full(postures, np.nan), np.full(postures, NO_STATE))
        self._search_input = ExactSearchInput(
            from_start=query.from_start,
            start_switches=query.start_switches,
            to_goal=query.to_goal,
            goal_first=query.goal_first,
            goal_length=query.goal.postures.length[reached],
            switches=query.graph.switches,
            weight=query.weight,
            column=query.energy_column,
        )

    @property
    def expanded(self) -> int:
        """Number of states expanded so far."""
        return int(self._open_list.counts[EXPANDED_COUNT])

    @property
    def generated(self) -> int:
        """Number of steps examined so far."""
        return int(self._open_list.counts[GENERATED_COUNT])

    @property
    def cost(self) -> float:
        """Cost of the path found."""
        return self._open_list.goal_cost

    def expand(self, limit: int) -> int:
        """Expand up to `limit` states.

        The call prices missing steps of the graph and enlarges the graph's arrays if necessary. It
        holds the lock of the graph's steps until it returns.

        Args:
            limit: Largest number of states to take from the open list.

        Returns:
            SEARCH_PAUSED if the limit is reached, GOAL_FOUND or SEARCH_EXHAUSTED.
        """
        steps, end = self._query.graph.steps, self.expanded + limit
        with steps.guard():
            status = self._expand(limit)
            while status == ARRAYS_FULL:
                steps.grow(
                    compute_max_step_count(steps.cost_model.layout, steps.cost_model.patterns)
                )
                status = self._expand(end - self.expanded)
        return status

    def _expand(self, limit: int) -> int:
        """Expand up to `limit` states; the result may also be ARRAYS_FULL."""
        steps = self._query.graph.steps
        return int(
            expand(
                self._open_list,
                self._labels,
                steps.cost_model,
                steps.edges,
                self._search_input,
                limit,
            )
        )

    def trace_path(self) -> tuple[IntArray, IntArray]:
        """Return the states and steps of the path found.

        Returns:
            Numbers node · patterns + pattern of the states between start and goal, shape (k - 1,),
            and numbers of the k steps. The first step's number is a row of `Query.from_start`, the
            last one's a row of `Query.to_goal`. All others are rows of the graph's edges.
        """
        way = trace_path_to_goal(self._open_list)
        return way[:-1], self._open_list.states["step"][way].astype(np.int64)
