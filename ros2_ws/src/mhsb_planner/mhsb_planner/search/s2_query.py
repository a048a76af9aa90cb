"""A question to the search, the graph extended by a start and a goal, and the answer's assembly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.lower_bound import energy_bound_between
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_joining import Goal, Start, Steps, steps_from_start, steps_to_goal
from mhsb_planner.search.s2_step import DURATION, ENERGY_PAPER, ENERGY_SERIES


class Search(Protocol):
    """A search under way, taken further portion by portion.

    first_portion, portion  states to expand before the first look at the clock, and between two of
                            them at most
    """

    first_portion: int
    portion: int

    @property
    def expanded(self) -> int:
        """States expanded so far."""

    @property
    def generated(self) -> int:
        """Steps looked at so far."""

    @property
    def cost(self) -> float:
        """Cost of the path found."""

    def expand(self, limit: int) -> int:
        """Expand up to `limit` states; PAUSED, FOUND or EXHAUSTED."""

    def way(self) -> tuple[IntArray, IntArray]:
        """The path found: the states between start and goal, and the numbers of its steps.

        A number is that of the step in `Query.from_start`, in the graph's edges or in
        `Query.to_goal`, whichever the states before and behind it imply.
        """


@dataclass(frozen=True, eq=False)
class Query:
    """What is asked for.

    start_modes     uint8[n], in force at the start
    weight          float64[3], of energy [1/J], time [1/s] and mode switches
    column          of the energy reading in a step's cost
    from_start      steps that leave the start
    start_switches  int64[patterns], actuators that change their mode from those in force
    to_goal         steps to the goal; of posture i those from goal_first[i] to goal_first[i + 1]
    """

    graph: StepGraph
    start: Start
    start_modes: ModeArray
    goal: Goal
    weight: FloatArray
    column: int
    from_start: Steps
    start_switches: IntArray
    to_goal: Steps
    goal_first: IntArray

    @classmethod
    def joined(
        cls,
        graph: StepGraph,
        start: Start,
        start_modes: ModeArray,
        goal: Goal,
        weight: FloatArray,
        column: int,
        rings: int,
        deadline: Deadline = NEVER,
    ) -> Query:
        """The question with start and goal joined to so many rings of nodes around them.

        Raises DeadlineError.
        """
        to_goal, goal_first = steps_to_goal(graph, goal, rings, deadline)
        return cls(
            graph=graph,
            start=start,
            start_modes=start_modes,
            goal=goal,
            weight=weight,
            column=column,
            from_start=steps_from_start(graph, start, goal, rings),
            start_switches=graph.switches_from(start_modes),
            to_goal=to_goal,
            goal_first=goal_first,
        )

    def path(self, found: Search, seconds: float) -> DiscretePath:
        """The path that a search has found, `seconds` after it was asked for."""
        graph, table = self.graph, self.graph.table
        state, step = found.way()
        node, pattern = np.divmod(state, len(table.patterns))
        first, last = self.from_start, self.to_goal if len(step) > 1 else self.from_start
        end, final = last.end[step[-1]], last.pattern[step[-1]]
        cost = np.concatenate([
            first.cost[step[:-1][:1]], graph.steps.edges.cost[step[1:-1]], last.cost[step[-1:]]
        ])
        return DiscretePath(
            tip=np.vstack([self.start.tip, table.nodes[node] * table.spacing, self.goal.tip]),
            posture=np.vstack([
                self.start.postures.posture,
                table.posture[node, pattern],
                self.goal.postures.posture[end],
            ]),
            modes=table.patterns[np.append(pattern, final)],
            duration=cost[:, DURATION],
            energy=cost[:, ENERGY_PAPER],
            energy_series=cost[:, ENERGY_SERIES],
            cost=found.cost,
            start_modes=self.start_modes,
            lower_bound=energy_bound_between(
                graph.circuit, self.start.postures, self.goal.postures
            ),
            statistics=SearchStatistics(found.expanded, found.generated, seconds),
        )
