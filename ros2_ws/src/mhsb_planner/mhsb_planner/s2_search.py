"""Exact search for the cheapest discrete path and its modes (paper, step S2).

States are (node, pattern of arrival), so that a step's cost depends on nothing but the state it
leaves and the state it reaches, and A* with the consistent estimate of `lower_bound` is exact.
Among equally cheap paths that with the fewest steps is taken, then the lowest state index.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.errors import (
    DeadlineError,
    NoPathError,
    PlanningCancelledError,
    RequestError,
)
from mhsb_planner.lower_bound import energy_lower_bound
from mhsb_planner.s1_global_search import postures_at
from mhsb_planner.s2_astar import FOUND, PAUSED, empty_frontier, expand
from mhsb_planner.s2_graph import StepGraph
from mhsb_planner.s2_joining import (
    NOWHERE,
    Goal,
    Start,
    goal_at,
    start_at,
    steps_from_start,
    steps_to_goal,
)
from mhsb_planner.s2_step import (
    DURATION,
    ENERGY_COLUMN,
    ENERGY_PAPER,
    ENERGY_SERIES,
    EnergyReading,
)

EXPANSIONS_PER_LOOK = 2000
"""Budget and cancellation are looked at after so many expansions, every millisecond or two."""

RINGS = (0, 1)
"""Start and goal are joined to the corners of their cells; where this leads nowhere, because
these are out of reach, also to the ring of nodes around."""

SAME_POINT = 1e-6
"""A start this close to the goal, in m and, where ψ is asked for, in rad, is at the goal."""


@dataclass(frozen=True)
class Weights:
    """Weights of the cost w₁ E + w₂ T + w₃ switches; each finite and not negative."""

    energy: float  # 1/J
    time: float  # 1/s
    switches: float

    def __post_init__(self) -> None:
        for name in ("energy", "time", "switches"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise RequestError(f"weight of {name}", value, "must be finite and not negative")


def search(
    graph: StepGraph,
    start_posture: FloatArray,
    start_modes: ModeArray,
    goal_xz: tuple[float, float],
    weights: Weights | Sequence[float],
    energy_reading: EnergyReading = "paper",
    *,
    goal_psi: float | None = None,
    budget: float | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> DiscretePath:
    """Cheapest discrete path from a posture [rad] and the modes in force to a tip position [m].

    goal_psi asks for that end-link angle at the goal [rad]; budget is in s; cancelled() is
    asked now and then. A start at the goal gives a path without steps. Raises
    OutOfWorkspaceError, InfeasibleGoalError, NoPathError, DeadlineError,
    PlanningCancelledError and, for useless values, RequestError.
    """
    began = time.perf_counter()
    weights = weights if isinstance(weights, Weights) else Weights(*weights)
    if energy_reading not in ENERGY_COLUMN:
        raise RequestError("energy_reading", energy_reading, "must be paper or series")
    posture = _checked_posture(graph, start_posture)
    modes = np.array(start_modes, dtype=np.uint8)
    x, z = float(goal_xz[0]), float(goal_xz[1])
    start, goal = start_at(graph, posture), goal_at(graph, x, z, goal_psi)
    if _is_at(start, posture, goal, goal_psi):
        return _no_steps(start, modes, time.perf_counter() - began)
    for rings in RINGS:
        query = _Query(graph, start, modes, goal, weights, energy_reading, rings)
        status = PAUSED
        while status == PAUSED:
            status = query.expand()
            seconds = time.perf_counter() - began
            if status == FOUND:
                return query.path(seconds)
            if cancelled is not None and cancelled():
                raise PlanningCancelledError("planning")
            if budget is not None and seconds > budget:
                raise DeadlineError(budget, query.expanded)
    raise NoPathError(start.tip, goal.tip)


def _checked_posture(graph: StepGraph, posture: FloatArray) -> FloatArray:
    posture = np.array(posture, dtype=np.float64)
    n = graph.machine.joint_count
    if posture.shape != (n,) or not np.all(np.isfinite(posture)):
        raise RequestError("start posture", posture.tolist(), f"must be {n} finite angles")
    return posture


def _is_at(start: Start, posture: FloatArray, goal: Goal, psi: float | None) -> bool:
    if math.dist(start.tip, goal.tip) > SAME_POINT:
        return False
    ends = goal.postures.posture
    return psi is None or bool(np.any(np.max(np.abs(ends - posture), axis=1) <= SAME_POINT))


def _no_steps(start: Start, modes: ModeArray, seconds: float) -> DiscretePath:
    nothing = np.empty(0)
    return DiscretePath(
        tip=np.array([start.tip]),
        posture=start.postures.posture,
        modes=np.empty((0, len(modes)), dtype=np.uint8),
        duration=nothing,
        energy=nothing,
        energy_series=nothing,
        cost=0.0,
        start_modes=modes,
        lower_bound=0.0,
        statistics=SearchStatistics(0, 0, seconds),
    )


class _Query:
    """One search: the graph extended by its start and its goal."""

    def __init__(
        self,
        graph: StepGraph,
        start: Start,
        start_modes: ModeArray,
        goal: Goal,
        weights: Weights,
        energy_reading: EnergyReading,
        rings: int,
    ) -> None:
        self.graph = graph
        self.start = start
        self.start_modes = start_modes
        self.goal = goal
        self.weight = np.array([weights.energy, weights.time, weights.switches], dtype=np.float64)
        self.column = ENERGY_COLUMN[energy_reading]
        self.from_start = steps_from_start(graph, start, goal, rings)
        self.to_goal, self.goal_first = steps_to_goal(graph, goal, rings)
        self.frontier = empty_frontier(graph)

    @property
    def expanded(self) -> int:
        """States expanded so far."""
        return int(self.frontier.counts[1])

    def expand(self) -> int:
        """Take the search one portion further."""
        graph = self.graph
        return int(
            expand(
                self.frontier,
                graph.circuit,
                graph.edges,
                graph.switches,
                graph.layout.owner.ravel(),
                graph.postures.length,
                self.goal.postures.length,
                self.from_start,
                graph.switches_from(self.start_modes),
                self.to_goal,
                self.goal_first,
                self.weight,
                self.column,
                EXPANSIONS_PER_LOOK,
            )
        )

    def path(self, seconds: float) -> DiscretePath:
        """The path found."""
        graph, start, goal = self.graph, self.start, self.goal
        ends = goal.postures.posture
        tips, postures, patterns, costs = [goal.tip], [], [], []
        for parent, state, e in self._trace():
            if state is None:
                steps = self.to_goal if parent is not None else self.from_start
                postures.append(ends[steps.end[e]])
                pattern, cost = steps.pattern[e], steps.cost[e]
            else:
                node, pattern = divmod(state, len(graph.table.patterns))
                tips.append(tuple(graph.table.nodes[node] * graph.table.spacing))
                postures.append(graph.table.posture[node, pattern])
                cost = graph.edges.cost[e] if parent is not None else self.from_start.cost[e]
            patterns.append(pattern)
            costs.append(cost)
        own = start.postures.posture[0]
        cost = np.array(costs[::-1])
        return DiscretePath(
            tip=np.array([start.tip, *tips[::-1]]),
            posture=np.array([own, *postures[::-1]]),
            modes=graph.table.patterns[patterns[::-1]],
            duration=cost[:, DURATION],
            energy=cost[:, ENERGY_PAPER],
            energy_series=cost[:, ENERGY_SERIES],
            cost=float(self.frontier.cost[-1]),
            start_modes=self.start_modes,
            lower_bound=energy_lower_bound(graph.machine, own, ends),
            statistics=SearchStatistics(self.expanded, int(self.frontier.counts[2]), seconds),
        )

    def _trace(self) -> Iterator[tuple[int | None, int | None, int]]:
        """Steps from the goal back: state left (None: start), state reached (None: goal), edge."""
        frontier = self.frontier
        sink = len(frontier.cost) - 1
        state = sink
        while state != NOWHERE:
            parent = int(frontier.parent[state])
            yield (
                None if parent == NOWHERE else parent,
                None if state == sink else state,
                int(frontier.edge[state]),
            )
            state = parent


def warm_up(graph: StepGraph) -> None:
    """Compile everything that a search can run through."""
    machine, table = graph.machine, graph.table
    here, *_, there = np.flatnonzero(table.feasible)
    start = table.posture[here, 0]
    x, z = table.nodes[there] * table.spacing
    with suppress(NoPathError):
        search(graph, start, table.patterns[0], (x, z), (1.0, 1.0, 1.0))
    postures_at(machine, x, z)
    machine.postures(x, z, np.zeros(1))
    energy_lower_bound(machine, start, start[None, :])
