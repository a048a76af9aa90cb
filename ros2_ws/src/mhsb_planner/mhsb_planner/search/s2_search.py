"""Search for the discrete path and its modes (paper, step S2): `exact` or as `published`.

The exact search (`s2_astar`) finds the cheapest path; the published one (`s2_published`) keeps
one label per node, which may miss it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.errors import (
    DeadlineError,
    ExpansionLimitError,
    InfeasibleGoalError,
    NoPathError,
    PlanningCancelledError,
    RequestError,
)
from mhsb_planner.goal_region import Angle, is_met
from mhsb_planner.posture.s1_global_search import postures_at
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.frontier import FOUND, PAUSED
from mhsb_planner.search.lower_bound import energy_lower_bound
from mhsb_planner.search.s2_astar import ExactSearch
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_joining import goal_at, start_at
from mhsb_planner.search.s2_published import DEFAULT_HEURISTIC_SCALE, PublishedSearch
from mhsb_planner.search.s2_query import Query, Search
from mhsb_planner.search.s2_step import ENERGY_COLUMN, EnergyReading

SEARCHING = "the search for a path"

SearchMethod = Literal["exact", "published"]
SEARCH_METHODS: tuple[SearchMethod, ...] = ("exact", "published")

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
    method: SearchMethod = "exact",
    heuristic_scale: float = DEFAULT_HEURISTIC_SCALE,
    goal_psi: Angle = None,
    deadline: Deadline = NEVER,
    max_expansions: int | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> DiscretePath:
    """Discrete path from a posture [rad] and the modes in force to a tip position [m].

    method           `exact`, the cheapest path, or `published`, one label per node
    heuristic_scale  of the published search, cost per distance from the goal [1/m]
    goal_psi         end-link angle asked for at the goal [rad]; of a range some are looked at
    deadline         after which a search that has not ended is given up
    max_expansions   states after whose expansion likewise
    cancelled        asked now and then whether anybody still wants the path

    A start at the goal gives a path without steps. Raises OutOfWorkspaceError,
    InfeasibleGoalError, ZoneError, NoPathError, DeadlineError, ExpansionLimitError,
    PlanningCancelledError and, for useless values, RequestError.
    """
    began = time.perf_counter()
    weights = weights if isinstance(weights, Weights) else Weights(*weights)
    if energy_reading not in ENERGY_COLUMN:
        raise RequestError("energy_reading", energy_reading, "must be paper or series")
    posture = _checked_posture(graph, start_posture)
    modes = np.array(start_modes, dtype=np.uint8)
    x, z = float(goal_xz[0]), float(goal_xz[1])
    deadline.check(SEARCHING)
    start, goal = start_at(graph, posture), goal_at(graph, x, z, goal_psi, deadline)
    angle = graph.machine.end_link_angle(posture)
    if is_met((x, z), None, goal_psi, np.array(start.tip), angle, SAME_POINT, SAME_POINT):
        seconds = time.perf_counter() - began
        return DiscretePath.standing(np.array(start.tip), posture, modes, seconds)
    weight = np.array([weights.energy, weights.time, weights.switches], dtype=np.float64)
    expanded = 0
    for rings in RINGS:
        query = Query.joined(
            graph, start, modes, goal, weight, ENERGY_COLUMN[energy_reading], rings, deadline
        )
        under_way = _begun(query, method, heuristic_scale, deadline)
        if _ends_at_goal(under_way, deadline, max_expansions, expanded, cancelled):
            return query.path(under_way, time.perf_counter() - began)
        expanded += under_way.expanded
    raise NoPathError(start.tip, goal.tip, graph.machine.obstacles.names)


def _begun(query: Query, method: str, heuristic_scale: float, deadline: Deadline) -> Search:
    if method == "exact":
        return ExactSearch(query)
    if method == "published":
        query.graph.steps.price_all(deadline)
        return PublishedSearch(query, heuristic_scale)
    raise RequestError("search method", method, f"must be one of {', '.join(SEARCH_METHODS)}")


def _ends_at_goal(
    under_way: Search,
    deadline: Deadline,
    max_expansions: int | None,
    before: int,
    cancelled: Callable[[], bool] | None,
) -> bool:
    """Take a search to its end; `before` states were expanded by others that count."""
    for portion in deadline.portions(under_way.first_portion, under_way.portion):
        status = under_way.expand(_within(portion, under_way, max_expansions, before))
        if status == FOUND:
            return True
        if cancelled is not None and cancelled():
            raise PlanningCancelledError("planning")
        if status != PAUSED:
            return False
    raise DeadlineError(SEARCHING)


def _within(portion: int, under_way: Search, max_expansions: int | None, before: int) -> int:
    """What of a portion may be expanded."""
    if max_expansions is None:
        return portion
    rest = max_expansions - before - under_way.expanded
    if rest <= 0:
        raise ExpansionLimitError(max_expansions)
    return min(portion, rest)


def _checked_posture(graph: StepGraph, posture: FloatArray) -> FloatArray:
    posture = np.array(posture, dtype=np.float64)
    n = graph.machine.joint_count
    if posture.shape != (n,) or not np.all(np.isfinite(posture)):
        raise RequestError("start posture", posture.tolist(), f"must be {n} finite angles")
    return posture


def warm_up(graph: StepGraph) -> None:
    """Compile everything that a search can run through."""
    machine, table = graph.machine, graph.table
    here, *_, there = np.flatnonzero(table.feasible)
    start = table.posture[here, 0]
    x, z = table.nodes[there] * table.spacing
    # A goal that is a node of the graph, and one that has to be joined to it.
    for psi in (None, machine.end_link_angle(table.posture[there, 0])):
        with suppress(NoPathError, InfeasibleGoalError):  # of longer chains ψ is met by samples
            search(graph, start, table.patterns[0], (x, z), (1.0, 1.0, 1.0), goal_psi=psi)
    postures_at(machine, x, z)
    machine.postures(x, z, np.zeros(1))
    energy_lower_bound(machine, start, start[None, :])
