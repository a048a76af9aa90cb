"""The search as published (paper, Section 2.2): A* over the nodes with one label for each node.

A label stands for the cheapest path found to a node: its cost, and the mode combination of arrival,
for which the table has one posture. Steps in all admissible combinations leave this posture; the
cheapest step to each node counts. Labels are taken in the order of

    w₁ Σ E + w₂ Σ T + w₃ switches + H,    H = scale · |goal − node|

and are final once taken. The method has two known defects. First, the cost of the next step depends
on posture and modes at the node. The cheapest path to the node is therefore not always part of the
cheapest path beyond it. Second, H is a scaled distance, which is no lower bound on the cost at any
scale. `s2_astar` has neither defect.
"""

import heapq
import math
from typing import NamedTuple

import numpy as np

from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.errors import RequestError
from mhsb_planner.search.open_list import GOAL_FOUND, NO_STATE, SEARCH_EXHAUSTED, SEARCH_PAUSED
from mhsb_planner.search.s2_query import Query
from mhsb_planner.search.s2_step import DURATION_COLUMN

DEFAULT_HEURISTIC_SCALE = 1.0
"""Heuristic cost per distance to the goal [1/m].

The paper gives no scale: it adds the distance in metres to the other terms.
"""


class SearchEdge(NamedTuple):
    """Last step of the path that a label stands for.

    Attributes:
        parent: State that the step leaves; None means the start.
        state: State that the step reaches; None means the goal.
        step: Row of the step in its list: steps from the start, steps to the goal, or steps of the
            graph.
    """

    parent: int | None
    state: int | None
    step: int


class PublishedSearch:
    """The published search: A* that keeps one label (cheapest path found) for each node.

    The goal has the index after the last node.

    Tested against the same search written with dictionaries, with step costs from the equations.
    """

    first_portion, portion = 5, 100

    def __init__(self, query: Query, scale: float = DEFAULT_HEURISTIC_SCALE) -> None:
        """Prepare a search without expanding anything, but price all steps of the graph.

        Args:
            query: Problem to solve: graph, start, goal and weights.
            scale: Heuristic cost per straight distance to the goal [1/m].

        Raises:
            RequestError: The scale is negative or not finite.
        """
        if not (math.isfinite(scale) and scale >= 0.0):
            raise RequestError("heuristic scale", scale, "must be finite and not negative")
        table = query.graph.table
        self._query = query
        self._edges = query.graph.edges
        self._patterns = len(table.patterns)
        self._goal = nodes = len(table.nodes)
        away = np.hypot(*(table.nodes * table.spacing - query.goal.tip).T)
        self._heuristic = [*(scale * away).tolist(), 0.0]
        self._cost = [math.inf] * (nodes + 1)
        self._is_closed = [False] * (nodes + 1)
        self._best_edge = [SearchEdge(None, None, 0)] * (nodes + 1)
        self._open: list[tuple[float, int]] = []  # (estimate, node); outdated entries stay
        self.expanded = 0
        self.generated = 0

    @property
    def cost(self) -> float:
        """Cost of the path found; inf as long as no path is found."""
        return self._cost[self._goal]

    def expand(self, limit: int) -> int:
        """Expand up to `limit` labels of the A* search; call again to continue.

        A label is the cheapest path found to a node: its cost and its last step. A label is final
        once it is taken from the open list. The first call expands the start.

        Args:
            limit: Largest number of labels to expand.

        Returns:
            SEARCH_PAUSED if the limit is reached, GOAL_FOUND, or SEARCH_EXHAUSTED if the open list
            is empty.
        """
        for _ in range(limit):
            if self.expanded == 0:
                self._expand_start()
            else:
                node = self._pop_next_label()
                if node is None:
                    return SEARCH_EXHAUSTED
                if node == self._goal:
                    return GOAL_FOUND
                self._expand_label(node)
            self.expanded += 1
        return SEARCH_PAUSED

    def trace_path(self) -> tuple[IntArray, IntArray]:
        """Return the states and steps of the path that the search has found.

        Returns:
            Numbers of the states between start and goal, shape (k - 1,). The state of combination p
            (of P combinations) at a node has the number node · P + p. Numbers of the k steps, shape
            (k,), as rows of three lists. The first step is a row of `Query.from_start`, even if it
            is the only step. The last of several steps is a row of `Query.to_goal`. All others are
            rows of the graph's edges.
        """
        link = self._best_edge[self._goal]
        states, steps = [], [link.step]
        while link.parent is not None:
            states.append(link.parent)
            link = self._best_edge[link.parent // self._patterns]
            steps.append(link.step)
        return np.array(states[::-1], dtype=np.int64), np.array(steps[::-1])

    def _pop_next_label(self) -> int | None:
        """Take the node with the least estimated cost from the open list and make its label final.

        A label is the cheapest path found to a node. Entries of nodes whose label is final already
        are dropped on the way.

        Returns:
            Index of the node, which may be the goal; None if the open list is empty.
        """
        while self._open:
            _, node = heapq.heappop(self._open)
            if not self._is_closed[node]:
                self._is_closed[node] = True
                return node
        return None

    def _expand_start(self) -> None:
        """Relax all steps that leave the start: record every cheaper path that they give.

        The node that a step reaches, or the goal, gets a new label if the path with this step is
        cheaper, and enters the open list. Each step counts as generated. A label is the cost of the
        cheapest path found to a node, and its last step. The cost of the path includes the mode
        switches from the modes in force at the start. A step's number is its row in
        `Query.from_start`.
        """
        query, steps = self._query, self._query.from_start
        total = (
            self._weigh_costs(steps.cost) + query.weight[2] * query.start_switches[steps.pattern]
        )
        offers = zip(steps.state.tolist(), total.tolist(), strict=True)
        for step, (state, cost) in enumerate(offers):
            self._relax(SearchEdge(None, None if state == NO_STATE else state, step), cost)

    def _expand_label(self, node: int) -> None:
        """Relax all steps that leave a node with a final label: record every cheaper path.

        A label is the cost of the cheapest path found to a node, and its last step. This step
        arrives in one mode combination, and the table has one posture for this combination. The
        steps leave this posture, and mode switches count from this combination.

        The node that a step reaches, or the goal, gets a new label if the path with this step is
        cheaper. That path costs as much as this node's label plus the step and its mode switches.

        Args:
            node: Index of the node.
        """
        query, graph = self._query, self._query.graph
        own = self._best_edge[node].state
        assert own is not None
        posture, pattern = graph.layout.posture_of_state.flat[own], own % self._patterns
        so_far, switches = self._cost[node], query.weight[2] * graph.switches[pattern]

        edges = self._edges
        part = slice(edges.first[posture], edges.last[posture])
        total = so_far + self._weigh_costs(edges.cost[part])
        total += switches[edges.pattern[part]]
        states = edges.state[part].tolist()
        for step, (state, cost) in enumerate(zip(states, total.tolist(), strict=True), part.start):
            self._relax(SearchEdge(own, state, step), cost)

        part = slice(query.goal_first[posture], query.goal_first[posture + 1])
        total = so_far + self._weigh_costs(query.to_goal.cost[part])
        total += switches[query.to_goal.pattern[part]]
        for step, cost in enumerate(total.tolist(), part.start):
            self._relax(SearchEdge(own, None, step), cost)

    def _weigh_costs(self, cost: FloatArray) -> FloatArray:
        """Compute the weighted costs of steps, w₁ · energy + w₂ · duration.

        Args:
            cost: Step costs, shape (steps, 3): duration [s], energy by the published model
                (`paper`) [J], energy with the pumps in series (`series`) [J].

        Returns:
            Weighted costs without mode switches, in the energy reading of the problem, shape
            (steps,) [-].
        """
        weight = self._query.weight
        return weight[0] * cost[:, self._query.energy_column] + weight[1] * cost[:, DURATION_COLUMN]

    def _relax(self, link: SearchEdge, cost: float) -> None:
        """Replace a node's label if the path over a given step to this node is cheaper.

        A label has the cost of the cheapest path to a node, and the last step of this path. A final
        label stays, and a label of equal cost stays. The step counts as generated. A new label is
        put on the open list.

        Args:
            link: Step that reaches the node or the goal.
            cost: Cost of the path from the start including this step.
        """
        self.generated += 1
        node = self._goal if link.state is None else link.state // self._patterns
        if self._is_closed[node] or cost >= self._cost[node]:
            return
        self._cost[node] = cost
        self._best_edge[node] = link
        heapq.heappush(self._open, (cost + self._heuristic[node], node))
