"""Integrated search from a start posture to a goal point: a first path early, then cheaper ones.

1. Straight lines lead to the goal postures, tried in the order of their lower bounds.
2. A* searches lattices of decreasing spacing, if a cheaper path is still possible.
3. Local changes improve paths: waypoints are removed and moved, and the goal posture is changed.

The first admissible straight line is yielded at once, later paths as they are found
(`anytime_search`). All work is limited, so that the result depends on the clock only if there is a
deadline.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from time import perf_counter

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.goal_region import Region, is_goal_met
from mhsb_planner.integrated import anytime_search, ik_near_start
from mhsb_planner.integrated.anytime_search import SearchWork
from mhsb_planner.integrated.cylinder_path import (
    PathPieces,
    compute_pieces,
    cost_model,
    count_switches_to_hold,
    to_discrete_path,
    without_leakage_cost,
)
from mhsb_planner.integrated.goal_postures import sample_goal_postures
from mhsb_planner.integrated.search_problem import (
    WITH_AREA,
    CylinderPath,
    SearchLimits,
    SearchProblem,
)
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.manipulability_loss import WITHOUT_AREA, AreaTerm
from mhsb_planner.search.s2_search import SAME_POINT, SEARCH_TASK, PathQuery, Weights
from mhsb_planner.search.s2_step import ENERGY_COLUMN

__all__ = ["CylinderPath", "IntegratedSearch", "SearchLimits", "SearchProblem", "search"]


class IntegratedSearch:
    """Search for path, postures and modes together, for one request and one thread."""

    def __init__(
        self,
        machine: Machine,
        query: PathQuery,
        *,
        goal_region: Region | None = None,
        area: AreaTerm = WITHOUT_AREA,
        counts_leakage: bool = True,
        progress: PlanProgress | None = None,
        limits: SearchLimits | None = None,
    ) -> None:
        """Prepare the search: sample goal postures, and compute a lower bound on the cost to each.

        Args:
            machine: The arm without a slewing joint.
            query: Start, goal, cost weights and energy reading.
            goal_region: Other admissible tip positions; None means the goal alone.
            area: Weight and reference area of the manipulability loss (lost area of the velocity
                polytope).
            counts_leakage: Whether leakage counts when paths are compared. The costs of the paths
                yielded include it in any case.
            progress: State of the planning loop, with the deadline. None means no deadline.
            limits: Limits on the effort for an arm of the paper's size; lengths are scaled to this
                arm. None means default limits, which are larger if `area` has a weight.

        Raises:
            OutOfWorkspaceError: No tip position has a posture, and the goal is outside the
                workspace.
            InfeasibleGoalError: No posture within joint limits reaches the goal or its region.
            ZoneError: The arm would be too near to an obstacle in every goal posture.
            DeadlineError: The deadline passed before the search could begin.
        """
        self._began, progress = perf_counter(), progress or PlanProgress()
        limits = limits or (WITH_AREA if area.weight > 0.0 else SearchLimits())
        limits = limits.scaled(machine.relative_size)
        progress.search_deadline.check(SEARCH_TASK)
        posture = np.array(query.start_posture, dtype=np.float64)
        self._modes = np.array(query.start_modes, dtype=np.uint8)
        goals = sample_goal_postures(
            machine, *query.goal_xz, query.goal_psi, limits.psi_spacing, goal_region
        )
        self._standing = is_goal_met(
            query.goal_xz,
            goal_region,
            query.goal_psi,
            machine.tip_position(posture),
            0.0 if query.goal_psi is None else machine.end_link_angle(posture),
            SAME_POINT,
            SAME_POINT,
        )
        progress.search_deadline.check(SEARCH_TASK)
        weights, column = query.weights, ENERGY_COLUMN[query.energy_reading]
        weight = np.array([weights.energy, weights.time, weights.switches], dtype=np.float64)
        self._terms = cost_model(machine, self._modes, weight, column, area)
        priced_by = self._terms if counts_leakage else without_leakage_cost(self._terms)
        goals = ik_near_start.add_postures_near_start(
            machine, goals, posture, priced_by.circuit, weight
        )
        self._task = SearchProblem.create(
            machine, posture, self._modes, priced_by, goals, progress, limits
        )
        progress.search_deadline.check(SEARCH_TASK)

    def paths(self) -> Iterator[DiscretePath | None]:
        """Yield ever cheaper discrete paths from the start to the goal.

        Straight paths come first, then paths from lattices and local changes. If the arm starts at
        the goal, one path without steps is yielded.

        Yields:
            A path, or the value None before work that may take long. At None, the caller can try
            something else.

        Raises:
            NoPathError: The search has ended without any path.
            DeadlineError: The time was up before there was a path.
        """
        task = self._task
        if self._standing:
            tip = task.machine.tip_position(task.start)
            yield DiscretePath.create_without_steps(tip, task.start, self._modes, self._elapsed)
            return
        work = SearchWork()
        for best in anytime_search.yield_paths(task, work):
            yield None if best is None else self._to_discrete_path(best, work)

    def best_path(self) -> DiscretePath:
        """Run the search to its end, or to its deadline, and return the cheapest path.

        Raises:
            NoPathError: There is no path.
            DeadlineError: The time was up before there was a path.
        """
        return [path for path in self.paths() if path is not None][-1]

    def improve_path(self, via: FloatArray, spacings: tuple[float, ...]) -> DiscretePath | None:
        """Improve a given cylinder path by local changes.

        The goal posture nearest to the last waypoint counts as the path's end. The distance of two
        postures is their largest difference of a cylinder length.

        Args:
            via: Waypoints (cylinder lengths) from the start to a goal posture, shape (points, n)
                [m].
            spacings: Lattice spacings, in the order of use [m]. Waypoints move by shares of these.

        Returns:
            The improved path, or the given one if nothing improves it; None if the given path is
            inadmissible.
        """
        task = self._task
        off = np.abs(task.goals.length - via[-1]).max(axis=1)
        route = task.path_to_goal(via, int(np.argmin(off)), task.price(via))
        if route.cost == math.inf:
            return None
        for spacing in spacings:
            route = anytime_search.refine(task, route, spacing, task.limits.max_sweeps)
        return self._to_discrete_path(route, SearchWork())

    @property
    def _elapsed(self) -> float:
        """Time since the search was created [s]."""
        return perf_counter() - self._began

    def _to_discrete_path(self, best: CylinderPath, work: SearchWork) -> DiscretePath:
        """Convert a cylinder path to a discrete path whose cost always includes leakage.

        Args:
            best: The cylinder path.
            work: Numbers of expanded states and priced steps, for the statistics.

        Returns:
            The discrete path with the statistics of the search.
        """
        task, leaks = self._task, self._task.cost_model is self._terms
        pieces = best.pieces if leaks else None
        if pieces is None:
            found = compute_pieces(self._terms, task.buffers, best.waypoints, task.start)
            pieces = PathPieces(*found)
        path = to_discrete_path(
            self._terms,
            pieces,
            best.cost if leaks else pieces.cost,
            self._modes,
            SearchStatistics(
                work.expanded, work.priced, self._elapsed, task.progress.search_deadline.has_passed
            ),
        )
        return _add_holding_switches(task.machine, path)


def _add_holding_switches(machine: Machine, path: DiscretePath) -> DiscretePath:
    """Add to a discrete path the number of switches to the modes that hold the arm at its end.

    Args:
        machine: The arm without a slewing joint.
        path: The path; its `holding_switches` is ignored.
    """
    force = machine.piston_forces(path.posture[-1])
    holding = count_switches_to_hold(machine.arrays, force, path.modes[-1])
    return replace(path, holding_switches=holding)


def search(
    machine: Machine,
    query: PathQuery,
    *,
    goal_region: Region | None = None,
    area: AreaTerm = WITHOUT_AREA,
    deadline: Deadline = NO_DEADLINE,
    effort: SearchLimits | None = None,
) -> DiscretePath:
    """Create an integrated search, run it to its end, and return the cheapest path.

    Args:
        machine: The arm without a slewing joint.
        query: Start, goal, cost weights and energy reading.
        goal_region: Other admissible tip positions; None means the goal alone.
        area: Weight and reference area of the manipulability loss (lost area of the velocity
            polytope).
        deadline: Instant at which the search ends with the cheapest path so far.
        effort: Limits on the effort for an arm of the paper's size; lengths are scaled to this arm.
            None means default limits.

    Returns:
        The path; without steps if the start is at the goal.

    Raises:
        OutOfWorkspaceError: The goal is outside the workspace.
        InfeasibleGoalError: No posture within limits reaches the goal.
        ZoneError: The arm would be too near to an obstacle in every goal posture.
        NoPathError: There is no path.
        DeadlineError: The time was up before there was a path.
    """
    under_way = IntegratedSearch(
        machine,
        query,
        goal_region=goal_region,
        area=area,
        progress=PlanProgress(deadline),
        limits=effort,
    )
    return under_way.best_path()


def warm_up(machine: Machine) -> None:
    """Compile all kernels of the integrated search, even those that only some requests need.

    Args:
        machine: Arm without a slewing joint, used for trial calls. Its obstacles are ignored.
    """
    task = _example_problem(machine)
    x, z = task.goals.tip
    modes, weights = np.zeros(machine.joint_count, dtype=np.uint8), Weights(1.0, 1.0, 1.0)
    psi = machine.end_link_angle(task.goals.posture[0])
    query = PathQuery(task.start, modes, (x, z), weights, goal_psi=psi)
    search(task.machine, query, effort=task.limits)
    for part in (warm_up_pricing, warm_up_paths, warm_up_lattice, warm_up_refinement):
        part(machine)


def warm_up_pricing(machine: Machine) -> None:
    """Compile the kernels that price a cylinder path or find goal postures.

    Args:
        machine: Arm without a slewing joint, used for trial calls. Its obstacles are ignored.
    """
    task = _example_problem(machine)
    task.price(_straight_line(task))
    sample_goal_postures(machine, *task.goals.tip, None, task.limits.psi_spacing)
    ik_near_start.warm_up(machine, task.start, task.cost_model.circuit)


def warm_up_paths(machine: Machine) -> None:
    """Compile the kernels of the lower bound and of the conversion to a discrete path.

    Args:
        machine: Arm without a slewing joint, used for trial calls. Its obstacles are ignored.
    """
    task = _example_problem(machine)
    _ = task.lower_bound
    modes, statistics = np.zeros(machine.joint_count, dtype=np.uint8), SearchStatistics(0, 0, 0.0)
    pieces = task.compute_pieces(_straight_line(task))
    path = to_discrete_path(task.cost_model, pieces, pieces.cost, modes, statistics)
    _add_holding_switches(machine, path)


def warm_up_lattice(machine: Machine) -> None:
    """Compile the kernels of the A* search over lattices of cylinder lengths.

    Args:
        machine: Arm without a slewing joint, used for trial calls. Its obstacles are ignored.
    """
    task = _example_problem(machine)
    lattice = anytime_search.create_lattice_search(
        task, task.cost_model, np.array([0]), task.limits.max_first_spacing
    )
    lattice.search(math.inf, task.limits.max_expansions)


def warm_up_refinement(machine: Machine) -> None:
    """Compile the kernels that improve a cylinder path by local changes.

    Args:
        machine: Arm without a slewing joint, used for trial calls. Its obstacles are ignored.
    """
    task = _example_problem(machine)
    anytime_search.refine(
        task, task.path_to_goal(_straight_line(task), 0, math.inf), task.limits.max_first_spacing
    )


def _straight_line(task: SearchProblem) -> FloatArray:
    """Return the waypoints of the straight line to the first goal posture, shape (2, n) [m]."""
    return np.array([task.start_lengths, task.goals.length[0]])


def _example_problem(machine: Machine) -> SearchProblem:
    """Create a short, easy search problem for compiling kernels.

    The problem starts in the middle of the joint ranges and allows very little effort. Without
    obstacles and gravity, it has a solution for every machine, even without boost.

    Args:
        machine: The arm without a slewing joint.

    Returns:
        The problem. The weight of each term of the cost, including the manipulability loss, is 1.
    """
    machine = machine.without_obstacles().with_values({"gravity": 0.0})
    low, high = machine.arrays.joint_min, machine.arrays.joint_max
    start, end = low + 0.5 * (high - low), low + 0.52 * (high - low)
    effort = SearchLimits(psi_spacing=0.02, max_expansions=2, max_sweeps=1)
    x, z = machine.tip_position(end)
    psi = machine.end_link_angle(end)
    goals = sample_goal_postures(machine, float(x), float(z), psi, effort.psi_spacing)
    modes = np.zeros(machine.joint_count, dtype=np.uint8)
    priced_by = cost_model(machine, modes, np.ones(3), ENERGY_COLUMN["paper"], AreaTerm(1.0, 1.0))
    return SearchProblem.create(machine, start, modes, priced_by, goals, PlanProgress(), effort)
