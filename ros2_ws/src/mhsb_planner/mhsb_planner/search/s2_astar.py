"""The exact search: A* over (node, pattern), which can be stopped and taken up again.

States are (node, pattern of arrival), so that a step's cost depends on nothing but the state it
leaves and the state it reaches. The estimate of the cost that remains, `lower_bound`, is
consistent, so a state is final once it has been expanded; where rounding says otherwise, it is
expanded again.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.search.indexed_heap import NOT_IN_HEAP, pop, sift_up
from mhsb_planner.search.lower_bound import least_cost
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_joining import NOWHERE, Steps
from mhsb_planner.search.s2_pricing import NOT_PRICED, Edges, Terms, largest_number, price
from mhsb_planner.search.s2_query import EXHAUSTED, FOUND, PAUSED, Link, Query
from mhsb_planner.search.s2_step import DURATION, new_scratch

FULL = -1
"""What a portion of a search also can end with: there is no room for the steps of a posture."""


class Frontier(NamedTuple):
    """State of a search that can be taken up again; the goal is one more state, the last."""

    cost: FloatArray  # [states + 1] so far
    estimate: FloatArray  # [states + 1] cost so far plus least cost to the goal
    depth: IntArray  # [states + 1] steps so far
    parent: IntArray  # [states + 1] state before; NOWHERE for the start
    edge: IntArray  # [states + 1] step by which it was reached, in the list its parent implies
    place: IntArray  # [states + 1] in the heap, NOT_IN_HEAP where not there
    heap: IntArray  # [states + 1]
    remaining: FloatArray  # [postures] least cost to the goal, NaN where not yet computed
    counts: IntArray  # [3] size of the heap, states expanded, steps looked at


def empty_frontier(graph: StepGraph) -> Frontier:
    """A search that has not begun."""
    states = graph.layout.owner.size + 1
    return Frontier(
        cost=np.full(states, np.inf),
        estimate=np.empty(states),
        depth=np.zeros(states, dtype=np.int64),
        parent=np.empty(states, dtype=np.int64),
        edge=np.empty(states, dtype=np.int64),
        place=np.full(states, NOT_IN_HEAP),
        heap=np.empty(states, dtype=np.int64),
        remaining=np.full(len(graph.layout.posture), np.nan),
        counts=np.zeros(3, dtype=np.int64),
    )


@kernel
def expand(
    f: Frontier,
    terms: Terms,
    edges: Edges,
    switches: IntArray,
    owner: IntArray,
    length: FloatArray,
    goal_length: FloatArray,
    start_steps: Steps,
    start_switches: IntArray,
    goal_steps: Steps,
    goal_first: IntArray,
    weight: FloatArray,
    column: int,
    limit: int,
) -> int:
    """Expand up to `limit` states; PAUSED, FOUND, EXHAUSTED or FULL.

    terms, edges    steps that are not priced yet are priced
    switches        int64[patterns, patterns], joints that change their mode between patterns
    owner           int64[states], posture of a state
    length          float64[postures, n]; goal_length likewise of the goal's postures [m]
    start_steps     steps that leave the start, with their switches from the modes in force in
                    start_switches[patterns]; the state NOWHERE is the goal
    goal_first      int64[postures + 1], steps to the goal that leave posture i are
                    first[i] … first[i + 1]
    weight          float64[3] of energy, time, switches
    column          of the energy reading in costs

    Oracle: scipy.sparse.csgraph.dijkstra on the same graph.
    """
    so_far, estimate, depth, parent, edge = f.cost, f.estimate, f.depth, f.parent, f.edge
    place, heap, remaining, counts = f.place, f.heap, f.remaining, f.counts
    edge_first, edge_last, edge_used, edge_state, edge_pattern, edge_cost = edges
    start_state, start_pattern = start_steps.state, start_steps.pattern
    start_cost = start_steps.cost
    goal_pattern, goal_cost = goal_steps.pattern, goal_steps.cost
    c = terms.circuit
    area, pace = c.area, c.pace
    scratch = new_scratch(terms.patterns)
    room = largest_number(terms.layout, terms.patterns)
    leakage = len(area) * c.leakage_flow
    w_energy, w_time, w_switch = weight
    sink = len(so_far) - 1
    fresh = counts[1] == 0
    for _ in range(limit):
        if fresh:
            state, posture, own, so, steps = NOWHERE, NOWHERE, 0, 0.0, 1
            begin, grid_end = 0, len(start_pattern)
            end = grid_end
        else:
            if counts[0] == 0:
                return EXHAUSTED
            if heap[0] != sink and edge_first[owner[heap[0]]] == NOT_PRICED:
                posture, found = owner[heap[0]], edge_used[0]
                if found + room > len(edge_state):
                    return FULL
                edge_used[0] = price(
                    terms, posture, scratch, edge_state, edge_pattern, edge_cost, found
                )
                edge_first[posture], edge_last[posture] = found, edge_used[0]
            state = pop(estimate, depth, heap, place, counts[0])
            counts[0] -= 1
            if state == sink:
                return FOUND
            posture, own = owner[state], state % len(switches)
            so, steps = so_far[state], depth[state] + 1
            begin, grid_end = edge_first[posture], edge_last[posture]
            end = grid_end + goal_first[posture + 1] - goal_first[posture]
        counts[1] += 1
        counts[2] += end - begin
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
            if cost > so_far[target] or (cost == so_far[target] and steps >= depth[target]):
                continue
            least = 0.0
            if target != sink:
                at = owner[target]
                if math.isnan(remaining[at]):
                    remaining[at] = math.inf
                    for k in range(len(goal_length)):
                        bound = least_cost(
                            area,
                            pace,
                            c.shared_flow,
                            leakage,
                            length[at],
                            goal_length[k],
                            w_energy * c.supply_pressure,
                            w_time,
                        )
                        remaining[at] = min(remaining[at], bound)
                least = remaining[at]
            so_far[target] = cost
            estimate[target] = cost + least
            depth[target] = steps
            parent[target] = state
            edge[target] = e
            slot = place[target]
            if slot == NOT_IN_HEAP:
                slot = counts[0]
                counts[0] += 1
            sift_up(estimate, depth, heap, place, slot, target)
        fresh = False
    return PAUSED


class ExactSearch:
    """The search for the cheapest path; of equally cheap ones that with the fewest steps."""

    first_portion, portion = 50, 2000

    def __init__(self, query: Query) -> None:
        self._query = query
        self._frontier = empty_frontier(query.graph)

    @property
    def expanded(self) -> int:
        """States expanded so far."""
        return int(self._frontier.counts[1])

    @property
    def generated(self) -> int:
        """Steps looked at so far."""
        return int(self._frontier.counts[2])

    @property
    def cost(self) -> float:
        """Cost of the path found."""
        return float(self._frontier.cost[-1])

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
        query, graph = self._query, self._query.graph
        return int(
            expand(
                self._frontier,
                graph.steps.terms,
                graph.steps.edges,
                graph.switches,
                graph.layout.owner.ravel(),
                graph.postures.length,
                query.goal.postures.length,
                query.from_start,
                query.start_switches,
                query.to_goal,
                query.goal_first,
                query.weight,
                query.column,
                limit,
            )
        )

    def links(self) -> list[Link]:
        """The path found, from the start on."""
        frontier = self._frontier
        state = sink = len(frontier.cost) - 1
        links = []
        while state != NOWHERE:
            parent = int(frontier.parent[state])
            links.append(
                Link(
                    None if parent == NOWHERE else parent,
                    None if state == sink else state,
                    int(frontier.edge[state]),
                )
            )
            state = parent
        return links[::-1]
