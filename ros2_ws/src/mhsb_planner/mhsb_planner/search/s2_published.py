"""The search as published (paper, Section 2.2): A* over the nodes, one label for each.

A label is the cheapest way found to a node: its cost, the pattern it arrives in and with it the
table's posture. A step is priced from the label's posture and modes in every admissible pattern,
and the cheapest of these is the step's cost. Labels are taken in the order of

    w₁ Σ E + w₂ Σ T + w₃ switches + H,    H = scale · |goal − node|

and are final once taken. Two known defects: since the next step's cost depends on posture and
modes as well, the best way to a node need not be part of the best way on; and H, a distance, is
no bound of a cost, whatever its scale. `s2_astar` has neither.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np

from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.errors import RequestError
from mhsb_planner.search.frontier import EXHAUSTED, FOUND, NOWHERE, PAUSED
from mhsb_planner.search.s2_query import Query
from mhsb_planner.search.s2_step import DURATION

DEFAULT_HEURISTIC_SCALE = 1.0
"""Cost per distance from the goal [1/m]; the paper gives none and adds metres to the rest."""


class Link(NamedTuple):
    """One step: the state it leaves (None: start), the one it reaches (None: goal), its number.

    The number is as of `Search.way`.
    """

    parent: int | None
    state: int | None
    step: int


class PublishedSearch:
    """The search under way; the goal is one more node, the last.

    Oracle: the same search written with dictionaries, on steps priced by the book.
    """

    first_portion, portion = 5, 100

    def __init__(self, query: Query, scale: float = DEFAULT_HEURISTIC_SCALE) -> None:
        """Raises RequestError where the scale [1/m] is not finite or negative."""
        if not (math.isfinite(scale) and scale >= 0.0):
            raise RequestError("heuristic scale", scale, "must be finite and not negative")
        table = query.graph.table
        self._query = query
        self._edges = query.graph.edges
        self._patterns = len(table.patterns)
        self._goal = nodes = len(table.nodes)
        away = np.hypot(*(table.nodes * table.spacing - query.goal.tip).T)
        self._to_go = [*(scale * away).tolist(), 0.0]
        self._cost = [math.inf] * (nodes + 1)
        self._taken = [False] * (nodes + 1)
        self._link = [Link(None, None, 0)] * (nodes + 1)
        self._open: list[tuple[float, int]] = []  # estimate and node; outdated entries stay
        self.expanded = 0
        self.generated = 0

    @property
    def cost(self) -> float:
        """Cost of the path found."""
        return self._cost[self._goal]

    def expand(self, limit: int) -> int:
        """Expand up to `limit` labels; PAUSED, FOUND or EXHAUSTED."""
        for _ in range(limit):
            if self.expanded == 0:
                self._leave_start()
            else:
                node = self._next_label()
                if node is None:
                    return EXHAUSTED
                if node == self._goal:
                    return FOUND
                self._leave(node)
            self.expanded += 1
        return PAUSED

    def way(self) -> tuple[IntArray, IntArray]:
        """The path found: the states between start and goal, and the numbers of its steps."""
        link = self._link[self._goal]
        states, steps = [], [link.step]
        while link.parent is not None:
            states.append(link.parent)
            link = self._link[link.parent // self._patterns]
            steps.append(link.step)
        return np.array(states[::-1], dtype=np.int64), np.array(steps[::-1])

    def _next_label(self) -> int | None:
        """The node whose label comes first, final from now on; None where there is none."""
        while self._open:
            _, node = heapq.heappop(self._open)
            if not self._taken[node]:
                self._taken[node] = True
                return node
        return None

    def _leave_start(self) -> None:
        query, steps = self._query, self._query.from_start
        total = self._priced(steps.cost) + query.weight[2] * query.start_switches[steps.pattern]
        offers = zip(steps.state.tolist(), total.tolist(), strict=True)
        for step, (state, cost) in enumerate(offers):
            self._offer(Link(None, None if state == NOWHERE else state, step), cost)

    def _leave(self, node: int) -> None:
        """Offer labels to all nodes that steps from this one's label lead to."""
        query, graph = self._query, self._query.graph
        own = self._link[node].state
        assert own is not None
        posture, pattern = graph.layout.owner.flat[own], own % self._patterns
        so_far, switches = self._cost[node], query.weight[2] * graph.switches[pattern]

        edges = self._edges
        part = slice(edges.first[posture], edges.last[posture])
        total = so_far + self._priced(edges.cost[part])
        total += switches[edges.pattern[part]]
        states = edges.state[part].tolist()
        for step, (state, cost) in enumerate(zip(states, total.tolist(), strict=True), part.start):
            self._offer(Link(own, state, step), cost)

        part = slice(query.goal_first[posture], query.goal_first[posture + 1])
        total = so_far + self._priced(query.to_goal.cost[part])
        total += switches[query.to_goal.pattern[part]]
        for step, cost in enumerate(total.tolist(), part.start):
            self._offer(Link(own, None, step), cost)

    def _priced(self, cost: FloatArray) -> FloatArray:
        """w₁ E + w₂ T of steps."""
        weight = self._query.weight
        return weight[0] * cost[:, self._query.column] + weight[1] * cost[:, DURATION]

    def _offer(self, link: Link, cost: float) -> None:
        """Make a label of it if it is cheaper than the one there; the first of equals stays."""
        self.generated += 1
        node = self._goal if link.state is None else link.state // self._patterns
        if self._taken[node] or cost >= self._cost[node]:
            return
        self._cost[node] = cost
        self._link[node] = link
        heapq.heappush(self._open, (cost + self._to_go[node], node))
