"""The exact search: A* over (node, pattern), which can be stopped and taken up again.

States are (node, pattern of arrival), so that a step's cost depends on nothing but the state it
leaves and the state it reaches. The estimate of the cost that remains, `lower_bound`, is
consistent, so a state is final once it has been expanded; where rounding says otherwise, it is
expanded again. States that share a posture are left by the same steps: one to which it is cheaper
to switch from another than to arrive there is passed over, since whatever it leads to is reached
from the other one for less, as switches obey the triangle inequality.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.search.frontier import (
    EXHAUSTED,
    EXPANDED,
    FOUND,
    FULL,
    GENERATED,
    NOWHERE,
    PAUSED,
    WAITING,
    Frontier,
    empty_frontier,
    reach,
    take_first,
    way_to_goal,
)
from mhsb_planner.search.lower_bound import least_cost
from mhsb_planner.search.s2_joining import Steps
from mhsb_planner.search.s2_pricing import NOT_PRICED, Edges, Terms, largest_number, price
from mhsb_planner.search.s2_query import Query
from mhsb_planner.search.s2_step import DURATION, new_scratch


class Known(NamedTuple):
    """What this search notes beside its frontier."""

    remaining: FloatArray  # [postures] least cost to the goal, NaN where not yet computed
    cheapest: IntArray  # [postures] pattern of its state with the least cost so far, or NOWHERE


class Asked(NamedTuple):
    """What is asked of the graph."""

    from_start: Steps  # that leave the start; the state NOWHERE is the goal
    start_switches: IntArray  # [patterns] joints that change their mode from those in force
    to_goal: Steps
    goal_first: IntArray  # [postures + 1] steps to the goal from posture i: first[i] … first[i + 1]
    goal_length: FloatArray  # [goal's postures that steps lead to, n] m, of the cylinders
    switches: IntArray  # [patterns, patterns] joints that change their mode between patterns
    weight: FloatArray  # [3] of energy, time, switches
    column: int  # of the energy reading in costs


@kernel(inline="always")
def _is_passed_over(
    cost: float, steps: int, other_cost: float, other_steps: int, switching: float
) -> bool:
    """Whether a state reached at this cost, in so many steps, is no better than another one of its
    posture, from which `switching` to its pattern costs so much."""
    through = other_cost + switching
    return other_cost < cost and (
        through < cost or (through == cost and other_steps <= steps)
    )


@kernel
def expand(
    f: Frontier, known: Known, terms: Terms, edges: Edges, asked: Asked, limit: int
) -> int:
    """Expand up to `limit` states; PAUSED, FOUND, EXHAUSTED or FULL.

    Steps that are not in `edges` yet are priced by `terms`. Oracle:
    scipy.sparse.csgraph.dijkstra on the same graph.
    """
    states, heap, counts = f.states, f.heap, f.counts
    remaining, cheapest = known
    edge_first, edge_last, edge_used, edge_state, edge_pattern, edge_cost = edges
    start_state, start_pattern = asked.from_start.state, asked.from_start.pattern
    start_cost, start_switches = asked.from_start.cost, asked.start_switches
    goal_pattern, goal_cost = asked.to_goal.pattern, asked.to_goal.cost
    goal_first, goal_length = asked.goal_first, asked.goal_length
    switches, column = asked.switches, asked.column
    owner, length = terms.layout.owner.ravel(), terms.postures.length
    c = terms.circuit
    area, pace = c.area, c.pace
    scratch = new_scratch(terms.patterns)
    room = largest_number(terms.layout, terms.patterns)
    leakage = len(area) * c.leakage_flow + c.idle_leakage
    w_energy, w_time, w_switch = asked.weight
    sink = len(states) - 1
    fresh = counts[EXPANDED] == 0
    for _ in range(limit):
        if fresh:
            state, posture, own, so, steps = NOWHERE, NOWHERE, 0, 0.0, 1
            begin, grid_end = 0, len(start_pattern)
            end = grid_end
        else:
            if counts[WAITING] == 0:
                return EXHAUSTED
            state = heap[0]
            own = state % len(switches)  # a posture's states are those of its node in some patterns
            if state != sink:
                pattern = cheapest[owner[state]]
                here, other = states[state], states[state - own + pattern]
                switching = w_switch * switches[pattern, own]
                if _is_passed_over(here.cost, here.depth, other.cost, other.depth, switching):
                    take_first(f)
                    continue
            if state != sink and edge_first[owner[state]] == NOT_PRICED:
                posture, found = owner[state], edge_used[0]
                if found + room > len(edge_state):
                    return FULL
                edge_used[0] = price(
                    terms, posture, scratch, edge_state, edge_pattern, edge_cost, found
                )
                edge_first[posture], edge_last[posture] = found, edge_used[0]
            state = take_first(f)
            if state == sink:
                return FOUND
            posture = owner[state]
            so, steps = states[state].cost, states[state].depth + 1
            begin, grid_end = edge_first[posture], edge_last[posture]
            end = grid_end + goal_first[posture + 1] - goal_first[posture]
        counts[EXPANDED] += 1
        counts[GENERATED] += end - begin
        for i in range(begin, end):
            if fresh:
                e, target = i, start_state[i]
                cost = w_energy * start_cost[e, column] + w_time * start_cost[e, DURATION]
                cost += w_switch * start_switches[start_pattern[e]]
                if target == NOWHERE:
                    target = sink
            elif i < grid_end:
                e, target = i, edge_state[i]
                cost = w_energy * edge_cost[e, column] + w_time * edge_cost[e, DURATION]
                cost += w_switch * switches[own, edge_pattern[e]]
            else:
                e, target = goal_first[posture] + i - grid_end, sink
                cost = w_energy * goal_cost[e, column] + w_time * goal_cost[e, DURATION]
                cost += w_switch * switches[own, goal_pattern[e]]
            cost += so
            there = states[target]
            if cost > there.cost or (cost == there.cost and steps >= there.depth):
                continue
            least = 0.0
            if target != sink:
                at, arrival = owner[target], start_pattern[e] if fresh else edge_pattern[e]
                pattern = cheapest[at]
                other = states[target - arrival + pattern]
                if pattern == NOWHERE or cost < other.cost:
                    cheapest[at] = arrival
                else:
                    switching = w_switch * switches[pattern, arrival]
                    if _is_passed_over(cost, steps, other.cost, other.depth, switching):
                        continue
                if math.isnan(remaining[at]):
                    remaining[at] = math.inf
                    for k in range(len(goal_length)):
                        bound = least_cost(
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
            reach(f, target, state, steps, cost, least)
        fresh = False
    return PAUSED


class ExactSearch:
    """The search for the cheapest path; of equally cheap ones that with the fewest steps."""

    first_portion, portion = 50, 2000

    def __init__(self, query: Query) -> None:
        self._query = query
        layout = query.graph.layout
        self._frontier = empty_frontier(layout.owner.size)
        postures, reached = len(layout.posture), np.zeros(len(query.goal.postures.length), bool)
        reached[query.to_goal.end] = True
        self._known = Known(np.full(postures, np.nan), np.full(postures, NOWHERE))
        self._asked = Asked(
            from_start=query.from_start,
            start_switches=query.start_switches,
            to_goal=query.to_goal,
            goal_first=query.goal_first,
            goal_length=query.goal.postures.length[reached],
            switches=query.graph.switches,
            weight=query.weight,
            column=query.column,
        )

    @property
    def expanded(self) -> int:
        """States expanded so far."""
        return int(self._frontier.counts[EXPANDED])

    @property
    def generated(self) -> int:
        """Steps looked at so far."""
        return int(self._frontier.counts[GENERATED])

    @property
    def cost(self) -> float:
        """Cost of the path found."""
        return self._frontier.goal_cost

    def expand(self, limit: int) -> int:
        """Expand up to `limit` states; PAUSED, FOUND or EXHAUSTED."""
        steps, end = self._query.graph.steps, self.expanded + limit
        with steps.guard():
            status = self._expand(limit)
            while status == FULL:
                steps.grow(largest_number(steps.terms.layout, steps.terms.patterns))
                status = self._expand(end - self.expanded)
        return status

    def _expand(self, limit: int) -> int:
        steps = self._query.graph.steps
        return int(
            expand(self._frontier, self._known, steps.terms, steps.edges, self._asked, limit)
        )

    def way(self) -> tuple[IntArray, IntArray]:
        """The path found: the states between start and goal, and the numbers of its steps."""
        way = way_to_goal(self._frontier)
        return way[:-1], self._frontier.states["step"][way].astype(np.int64)
