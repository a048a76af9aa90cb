"""One search problem: the graph extended by a start and a goal, and the assembly of the path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_start_goal_edges import (
    JoiningSteps,
    SearchGoal,
    SearchStart,
    compute_steps_from_start,
    compute_steps_to_goal,
)
from mhsb_planner.search.s2_step import DURATION_COLUMN, ENERGY_PAPER_COLUMN, ENERGY_SERIES_COLUMN


class Search(Protocol):
    """Interface of a search that is continued in portions.

    Attributes:
        first_portion: Number of states to expand before the first check of the clock.
        portion: Largest number of states to expand between two checks of the clock.
    """

    first_portion: int
    portion: int

    @property
    def expanded(self) -> int:
        """Number of states expanded so far."""

    @property
    def generated(self) -> int:
        """Number of steps examined so far."""

    @property
    def cost(self) -> float:
        """Cost of the path found; inf as long as no path is found."""

    def expand(self, limit: int) -> int:
        """Expand up to `limit` states; call again to continue.

        Args:
            limit: Largest number of states to expand.

        Returns:
            SEARCH_PAUSED if the limit is reached, GOAL_FOUND, or SEARCH_EXHAUSTED if there is no
            path.
        """

    def trace_path(self) -> tuple[IntArray, IntArray]:
        """Return the states and steps of the path found.

        The numbers of steps are rows of three lists. The first step is a row of `Query.from_start`,
        even if it is the only step. The last of several steps is a row of `Query.to_goal`. All
        others are rows of the graph's edges.

        Returns:
            Numbers of the states between start and goal, shape (k - 1,), and numbers of the k
            steps.
        """


@dataclass(frozen=True, eq=False)
class Query:
    """Problem of one search: the graph joined to a start and a goal.

    Attributes:
        graph: Graph of the steps between workspace nodes.
        start: Tip position and posture of the start.
        start_modes: Modes in force at the start, shape (n,).
        goal: Admissible postures of the goal.
        weight: Weights of energy [1/J], time [1/s] and mode switches [-], shape (3,).
        energy_column: Column of the energy in step costs, ENERGY_PAPER_COLUMN or
            ENERGY_SERIES_COLUMN.
        from_start: Steps that leave the start.
        start_switches: Number of actuators that change their mode from `start_modes` to each
            combination, shape (patterns,).
        to_goal: Steps to the goal, sorted by the posture that they leave.
        goal_first: Steps of posture i to the goal are goal_first[i] to goal_first[i + 1] - 1, shape
            (postures + 1,).
    """

    graph: StepGraph
    start: SearchStart
    start_modes: ModeArray
    goal: SearchGoal
    weight: FloatArray
    energy_column: int
    from_start: JoiningSteps
    start_switches: IntArray
    to_goal: JoiningSteps
    goal_first: IntArray

    @classmethod
    def join(
        cls,
        graph: StepGraph,
        start: SearchStart,
        start_modes: ModeArray,
        goal: SearchGoal,
        weight: FloatArray,
        column: int,
        rings: int,
        deadline: Deadline = NO_DEADLINE,
    ) -> Query:
        """Create a search problem: compute the steps that join start and goal to the graph.

        Args:
            graph: Graph of the steps between workspace nodes.
            start: Tip position and posture of the start.
            start_modes: Modes in force at the start, shape (n,).
            goal: Admissible postures of the goal.
            weight: Weights of energy [1/J], time [1/s] and mode switches [-], shape (3,).
            column: Energy that the cost contains: ENERGY_PAPER_COLUMN or ENERGY_SERIES_COLUMN
                (energy readings `paper` and `series`).
            rings: Start and goal are joined to the corner nodes of their grid cells, and to this
                number of rings of nodes around the corners.
            deadline: Instant at which the work is given up.

        Returns:
            The problem.

        Raises:
            DeadlineError: The deadline passed.
        """
        to_goal, goal_first = compute_steps_to_goal(graph, goal, rings, deadline)
        return cls(
            graph=graph,
            start=start,
            start_modes=start_modes,
            goal=goal,
            weight=weight,
            energy_column=column,
            from_start=compute_steps_from_start(graph, start, goal, rings),
            start_switches=graph.count_switches_from(start_modes),
            to_goal=to_goal,
            goal_first=goal_first,
        )

    def assemble_path(self, found: Search, seconds: float) -> DiscretePath:
        """Assemble the discrete path that a search has found.

        Args:
            found: Search of this problem that has reached the goal.
            seconds: Duration of the search, for the statistics [s].

        Returns:
            The path from the start over nodes to the goal: tip positions, postures, modes,
            durations, energies, cost, and the statistics of the search.
        """
        graph, table = self.graph, self.graph.table
        state, step = found.trace_path()
        node, pattern = np.divmod(state, len(table.patterns))
        first, last = self.from_start, self.to_goal if len(step) > 1 else self.from_start
        end, final = last.end[step[-1]], last.pattern[step[-1]]
        cost = np.concatenate(
            [first.cost[step[:-1][:1]], graph.steps.edges.cost[step[1:-1]], last.cost[step[-1:]]]
        )
        return DiscretePath(
            tip=np.vstack([self.start.tip, table.nodes[node] * table.spacing, self.goal.tip]),
            posture=np.vstack(
                [
                    self.start.postures.posture,
                    table.posture[node, pattern],
                    self.goal.postures.posture[end],
                ]
            ),
            modes=table.patterns[np.append(pattern, final)],
            duration=cost[:, DURATION_COLUMN],
            energy=cost[:, ENERGY_PAPER_COLUMN],
            energy_series=cost[:, ENERGY_SERIES_COLUMN],
            cost=found.cost,
            start_modes=self.start_modes,
            statistics=SearchStatistics(found.expanded, found.generated, seconds),
        )
