"""Search for the discrete path and its modes (paper, step S2), `exact` or as `published`.

The exact search (`s2_astar`) finds the cheapest path. The published search (`s2_published`) keeps
one path per node and may miss the cheapest path.
"""

import math
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, ModeArray, frozen
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.errors import (
    DeadlineError,
    InfeasibleGoalError,
    NoPathError,
    RequestError,
)
from mhsb_planner.goal_region import Angle, Region, is_goal_met
from mhsb_planner.posture.s1_global_search import find_postures_at
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.lower_bound import ENERGY_ONLY_WEIGHTS, bound_costs_between
from mhsb_planner.search.open_list import GOAL_FOUND, SEARCH_PAUSED
from mhsb_planner.search.s2_astar import ExactSearch
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_published import DEFAULT_HEURISTIC_SCALE, PublishedSearch
from mhsb_planner.search.s2_query import Query, Search
from mhsb_planner.search.s2_start_goal_edges import create_goal, create_start
from mhsb_planner.search.s2_step import ENERGY_COLUMN, EnergyReading

SEARCH_TASK = "the search for a path"

SearchMethod = Literal["exact", "published"]
SEARCH_METHODS: tuple[SearchMethod, ...] = ("exact", "published")

NODE_RINGS = (0, 1)
"""Numbers of rings of nodes to which start and goal are joined, in the order of trial.

With 0 rings, start and goal are joined to the corners of their grid cells. If the search then finds
no path, the nodes in one ring around the corners are added.
"""

SAME_POINT = 1e-6
"""A start is at the goal if its tip is within this distance [m], and its end-link angle within this
angle [rad].
"""


@dataclass(frozen=True)
class Weights:
    """Weights of the cost w₁ E + w₂ T + w₃ switches.

    Raises RequestError if a weight is negative or not finite.

    Attributes:
        energy: Weight w₁ [1/J].
        time: Weight w₂ [1/s].
        switches: Weight w₃ [-].
    """

    energy: float
    time: float
    switches: float

    def __post_init__(self) -> None:
        """Raise RequestError if a weight is negative or not finite."""
        for name in ("energy", "time", "switches"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise RequestError(f"weight of {name}", value, "must be finite and not negative")


@dataclass(frozen=True, eq=False)
class PathQuery:
    """Start, goal and cost weights of the path that a search is to find.

    Attributes:
        start_posture: Joint positions of the start, shape (n,) [rad or m].
        start_modes: Modes in force at the start, shape (n,).
        goal_xz: Tip position of the goal, (x, z) [m].
        weights: Weights of energy [1/J], time [1/s] and switches [-].
        energy_reading: Formula for the energy of boosted oil in the cost, `paper` or `series`.
        goal_psi: End-link angle at the goal [rad]. A pair is a range; None leaves the angle free.
        goal_region: Other admissible tip positions; None means the goal alone. The search in a step
            graph only tests with it whether the start is at the goal.
    """

    start_posture: FloatArray
    start_modes: ModeArray
    goal_xz: tuple[float, float]
    weights: Weights
    energy_reading: EnergyReading = "paper"
    goal_psi: Angle = None
    goal_region: Region | None = None

    def begins_at_goal(self, machine: Machine) -> bool:
        """Return whether the start posture is at the goal already.

        Args:
            machine: The arm without a slewing joint.

        Returns:
            True by `is_goal_met`, with the tolerance SAME_POINT for tip [m] and angle ψ [rad].
        """
        posture = np.array(self.start_posture, dtype=np.float64)
        region, psi, tip = self.goal_region, self.goal_psi, machine.tip_position(posture)
        angle = 0.0 if psi is None else machine.end_link_angle(posture)
        return is_goal_met(self.goal_xz, region, psi, tip, angle, SAME_POINT, SAME_POINT)


def search(
    graph: StepGraph,
    query: PathQuery,
    *,
    method: SearchMethod = "exact",
    heuristic_scale: float = DEFAULT_HEURISTIC_SCALE,
    deadline: Deadline = NO_DEADLINE,
) -> DiscretePath:
    """Search for a discrete path from a start posture to a tip position.

    Start and goal are first joined to the corners of their grid cells. If no path is found, they
    are also joined to the next ring of nodes. Missing step costs are computed and stored in the
    graph. If the start is at the goal, the path has no steps.

    Args:
        graph: Graph of the steps between workspace nodes.
        query: Start posture, modes in force, goal, cost weights and energy reading. If the goal has
            a range of end-link angles, samples of the range are tried.
        method: `exact` finds the cheapest path. `published` keeps only one path per node and may
            miss the cheapest path.
        heuristic_scale: Heuristic cost per distance to the goal, for `published` only [1/m].
        deadline: Instant at which an unfinished search is given up.

    Returns:
        The path; if `method` is `exact`, the cheapest path.

    Raises:
        OutOfWorkspaceError: The goal is outside the workspace.
        InfeasibleGoalError: No posture within joint limits reaches the goal.
        ZoneError: The goal is too near to an obstacle.
        NoPathError: No path leads to the goal.
        DeadlineError: The deadline passed.
        RequestError: A weight, the posture or an option is invalid.
    """
    began, weights = time.perf_counter(), query.weights
    if query.energy_reading not in ENERGY_COLUMN:
        raise RequestError("energy_reading", query.energy_reading, "must be paper or series")
    posture = _check_posture(graph, query.start_posture)
    modes = np.array(query.start_modes, dtype=np.uint8)
    x, z = float(query.goal_xz[0]), float(query.goal_xz[1])
    deadline.check(SEARCH_TASK)
    start, goal = create_start(graph, posture), create_goal(graph, x, z, query.goal_psi, deadline)
    if query.begins_at_goal(graph.machine):
        seconds = time.perf_counter() - began
        return DiscretePath.create_without_steps(np.array(start.tip), posture, modes, seconds)
    weight = np.array([weights.energy, weights.time, weights.switches], dtype=np.float64)
    column = ENERGY_COLUMN[query.energy_reading]
    for rings in NODE_RINGS:
        joined = Query.join(graph, start, modes, goal, weight, column, rings, deadline)
        under_way = _create_search(joined, method, heuristic_scale, deadline)
        if _run_to_goal(under_way, deadline):
            return joined.assemble_path(under_way, time.perf_counter() - began)
    raise NoPathError(start.tip, goal.tip, graph.machine.obstacles.names)


def _create_search(query: Query, method: str, heuristic_scale: float, deadline: Deadline) -> Search:
    """Create the exact or the published search for a problem.

    For `published` all steps of the graph are priced first.

    Args:
        query: Problem to solve: graph, start, goal and weights.
        method: `exact` (finds the cheapest path) or `published` (keeps only one path per node).
        heuristic_scale: Heuristic cost per distance to the goal, for `published` only [1/m].
        deadline: Instant at which the pricing of steps is given up.

    Returns:
        A search that has not yet expanded any state.

    Raises:
        RequestError: The method or the scale is invalid.
        DeadlineError: The deadline passed.
    """
    if method == "exact":
        return ExactSearch(query)
    if method == "published":
        query.graph.steps.price_all(deadline)
        return PublishedSearch(query, heuristic_scale)
    raise RequestError("search method", method, f"must be one of {', '.join(SEARCH_METHODS)}")


def _run_to_goal(running_search: Search, deadline: Deadline) -> bool:
    """Run a search in portions until the goal is found or no state is left to expand.

    Args:
        running_search: Search to run or to continue.
        deadline: Instant at which the search is given up, checked between portions.

    Returns:
        True if the goal was found, False if no state was left to expand.

    Raises:
        DeadlineError: The deadline passed.
    """
    for portion in deadline.portions(running_search.first_portion, running_search.portion):
        status = running_search.expand(portion)
        if status != SEARCH_PAUSED:
            return status == GOAL_FOUND
    raise DeadlineError(SEARCH_TASK)


def _check_posture(graph: StepGraph, posture: FloatArray) -> FloatArray:
    """Convert a start posture to an array and check its shape and values.

    Args:
        graph: Graph whose machine gives the number of joints n.
        posture: Joint positions [rad or m].

    Returns:
        A copy, shape (n,) [rad or m].

    Raises:
        RequestError: The posture does not consist of n finite numbers.
    """
    posture = np.array(posture, dtype=np.float64)
    n = graph.machine.joint_count
    if posture.shape != (n,) or not np.all(np.isfinite(posture)):
        raise RequestError("start posture", posture.tolist(), f"must be {n} finite numbers")
    return posture


def warm_up(graph: StepGraph) -> None:
    """Compile the kernels of the exact search.

    Two short searches are run: one with a node as goal, and one with a given end-link angle. The
    kernels for goal postures and lower bounds are also called once.

    Args:
        graph: Graph on which the searches run.
    """
    machine, table = graph.machine, graph.table
    here, *_, there = np.flatnonzero(table.feasible)
    start = table.posture[here, 0]
    (x, z), weights = table.nodes[there] * table.spacing, Weights(1.0, 1.0, 1.0)
    # Without ψ the goal is a node of the graph; with ψ it must be joined to the graph.
    for psi in (None, machine.end_link_angle(table.posture[there, 0])):
        with suppress(NoPathError, InfeasibleGoalError):  # longer chains meet ψ by samples
            search(graph, PathQuery(start, table.patterns[0], (x, z), weights, goal_psi=psi))
    find_postures_at(machine, x, z)
    machine.postures(x, z, np.zeros(1))
    lengths = machine.cylinder_lengths(start)
    bound_costs_between(graph.circuit, lengths, frozen(lengths[None, :]), ENERGY_ONLY_WEIGHTS)
