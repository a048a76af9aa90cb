"""Problem, effort limits and cylinder paths of the integrated search."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter

import numpy as np

from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.statics import piston_forces
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.integrated.cylinder_path import (
    PathCostBuffers,
    PathCostModel,
    PathPieces,
    compute_pieces,
    cost_model,
    count_switches_to_hold,
    least_move_cost,
    new_path_cost_buffers,
    price_path,
    to_discrete_path,
    without_leakage_cost,
)
from mhsb_planner.integrated.goal_postures import PSI_SPACING, GoalPostures, sample_goal_postures
from mhsb_planner.integrated.ik_near_start import add_postures_near_start
from mhsb_planner.integrated.lower_bound import (
    bound_cost_to_goals,
    max_bound_cells,
)
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.manipulability_loss import WITHOUT_AREA, AreaTerm
from mhsb_planner.search.s2_search import SEARCH_TASK, PathQuery
from mhsb_planner.search.s2_step import ENERGY_COLUMN


@dataclass(frozen=True)
class SearchLimits:
    """Limits on the effort of the integrated search.

    Attributes:
        psi_spacing: Spacing of the goal postures along the end-link angle ψ [rad].
        max_first_spacing: Upper bound on the spacing of the first lattice [m].
        min_spacing: Lower bound on the spacing of the last lattice, if there is a path already [m].
        finest_step_count: Number of steps of the last lattice over the largest stroke that a
            cheaper path may have. The spacing that follows is limited to `min_spacing` …
            `max_last_spacing`.
        spacing_ratio: Largest ratio of the spacings of two successive lattices [-].
        max_expansions: Number of states in all lattice searches together. If there is an incumbent,
            no lattice is searched after this number.
        max_last_spacing: Spacing of the last lattice if there is no path yet; otherwise an upper
            bound on this spacing [m].
        stride_shares: Strides of the compass search in the order of use, as shares of the lattice
            spacing.
        goal_turn: Change of a free coordinate of the goal posture that corresponds to a stride of
            one lattice spacing [rad]. For a telescope, range/π stands for 1 rad.
        max_sweeps: Largest number of sweeps with each stride.
    """

    psi_spacing: float = PSI_SPACING
    max_first_spacing: float = 25e-3
    min_spacing: float = 1e-3
    finest_step_count: int = 20
    spacing_ratio: float = 1.6
    max_expansions: int = 12_000
    max_last_spacing: float = 4e-3
    stride_shares: tuple[float, ...] = (0.5, 0.25, 0.125, 0.0625)
    goal_turn: float = 0.1
    max_sweeps: int = 3

    def scaled(self, scale: float) -> SearchLimits:
        """Return a copy of the limits for an arm of another size, with all lengths scaled.

        Args:
            scale: Size of the arm relative to the paper's arm.
        """
        if scale == 1.0:
            return self
        return replace(
            self,
            max_first_spacing=scale * self.max_first_spacing,
            min_spacing=scale * self.min_spacing,
            max_last_spacing=scale * self.max_last_spacing,
        )


WITH_AREA = SearchLimits(max_expansions=40_000, stride_shares=(0.5, 0.25, 0.1))
"""Search limits if the manipulability loss has a weight.

Lower bounds are weak in this case, so more states may be expanded. The last stride is longer,
because shorter strides would only exploit that the loss is approximated by a sum over pieces.
"""


@dataclass(frozen=True, eq=False)
class CylinderPath:
    """A cylinder path with its end posture and its cost.

    Attributes:
        waypoints: Waypoints, shape (points, n) [m].
        goal_index: Index of the goal posture for which the path was found. Refinement may have
            moved the end to another posture at the same tip position.
        elbow: Elbow branch of the posture at the end, −1 or 1, as in `GoalPostures`.
        free: Free coordinates of the posture at the end, shape (n - 2,) [rad or m], as in
            `GoalPostures`. Refinement may have changed them.
        cost: Cost w₁ E + w₂ T + w₃ switches + w₄ M in the cheapest sequence of mode combinations
            [-].
        pieces: Pieces of the path, if they were computed together with the cost; None otherwise.
    """

    waypoints: FloatArray
    goal_index: int
    elbow: int
    free: FloatArray
    cost: float
    pieces: PathPieces | None = None


@dataclass(eq=False)
class SearchProblem:
    """Problem of the integrated search, and the work done for it; for one thread.

    Attributes:
        machine: The arm without a slewing joint.
        query: Start, goal, cost weights and energy reading.
        full_cost_model: Cost model by which the paths found are priced, leakage included.
        cost_model: Cost model by which paths are compared: `full_cost_model`, or the same model
            without leakage.
        buffers: Working memory for pricing.
        start: Start posture, shape (n,) [rad or m].
        start_modes: Modes in force at the start, uint8, shape (n,).
        start_lengths: Cylinder lengths in the start posture, shape (n,) [m].
        goals: Goal postures.
        goal_lower_bounds: Lower bound on the cost of a path to each goal posture, shape (goals,)
            [-].
        progress: State of the planning loop, with the time limit of the search.
        limits: Limits on the effort.
        began: Time of the problem's creation, by `time.perf_counter` [s].
        expanded: Number of states that lattice searches have expanded.
        priced: Number of steps that lattice searches have priced.
    """

    machine: Machine
    query: PathQuery
    full_cost_model: PathCostModel
    cost_model: PathCostModel
    buffers: PathCostBuffers
    start: FloatArray
    start_modes: ModeArray
    start_lengths: FloatArray
    goals: GoalPostures
    goal_lower_bounds: FloatArray
    progress: PlanProgress
    limits: SearchLimits
    began: float
    expanded: int = 0
    priced: int = 0

    @classmethod
    def create(
        cls,
        machine: Machine,
        query: PathQuery,
        *,
        area: AreaTerm = WITHOUT_AREA,
        counts_leakage: bool = True,
        progress: PlanProgress | None = None,
        limits: SearchLimits | None = None,
    ) -> SearchProblem:
        """Create the problem of a path: sample goal postures, and bound the cost to each.

        Args:
            machine: The arm without a slewing joint.
            query: Start, goal with its region, cost weights and energy reading.
            area: Weight and reference area of the manipulability loss (lost area of the velocity
                polytope).
            counts_leakage: Whether leakage counts when paths are compared. The costs of the
                discrete paths include it in any case.
            progress: State of the planning loop, with the deadline. None means no deadline.
            limits: Limits on the effort for an arm of the paper's size; lengths are scaled to this
                arm. None means default limits, which are larger if `area` has a weight.

        Returns:
            The problem, with its own working memory; no path has been searched yet.

        Raises:
            OutOfWorkspaceError: No tip position has a posture, and the goal is outside the
                workspace.
            InfeasibleGoalError: No posture within joint limits reaches the goal or its region.
            ZoneError: The arm would be too near to an obstacle in every goal posture.
            DeadlineError: The deadline passed before the search could begin.
        """
        began, progress = perf_counter(), progress or PlanProgress()
        limits = limits or (WITH_AREA if area.weight > 0.0 else SearchLimits())
        limits = limits.scaled(machine.relative_size)
        progress.search_deadline.check(SEARCH_TASK)
        start = np.array(query.start_posture, dtype=np.float64)
        modes = np.array(query.start_modes, dtype=np.uint8)
        goals = sample_goal_postures(
            machine, *query.goal_xz, query.goal_psi, limits.psi_spacing, query.goal_region
        )
        progress.search_deadline.check(SEARCH_TASK)
        weights, column = query.weights, ENERGY_COLUMN[query.energy_reading]
        weight = np.array([weights.energy, weights.time, weights.switches], dtype=np.float64)
        full = cost_model(machine, modes, weight, column, area)
        priced_by = full if counts_leakage else without_leakage_cost(full)
        goals = add_postures_near_start(machine, goals, start, priced_by.circuit, weight)
        lengths = machine.cylinder_lengths(start)
        bounds = bound_goal_costs(priced_by, lengths, modes, goals.posture, goals.length)
        progress.search_deadline.check(SEARCH_TASK)
        return cls(
            machine,
            query,
            full,
            priced_by,
            new_path_cost_buffers(priced_by),
            start,
            modes,
            lengths,
            goals,
            bounds,
            progress,
            limits,
            began,
        )

    @cached_property
    def lower_bound(self) -> float:
        """Lower bound on the cost of every path from the start to any posture at the goal [-].

        The first access runs a branch and bound, which is limited to fewer cells if there is a
        deadline. The result is kept.
        """
        return bound_cost_to_goals(
            self.machine,
            self.cost_model.circuit,
            self.start_lengths,
            self.goals,
            self.cost_model.weight,
            max_bound_cells(self.progress),
        )

    def price(self, via: FloatArray, limit: float = math.inf) -> float:
        """Compute the least cost of a cylinder path from the start to rest at its end.

        Args:
            via: Waypoints (cylinder lengths), shape (points, n) [m]; the first is the start.
            limit: Cost at which the path is given up; a lower bound on the path's cost is compared
                with it.

        Returns:
            The cost; inf if the path is inadmissible or its cost reaches the limit.
        """
        return float(price_path(self.cost_model, self.buffers, via, self.start, limit))

    def compute_pieces(self, via: FloatArray) -> PathPieces:
        """Cut a cylinder path from the start to rest into pieces, in the cheapest modes.

        Args:
            via: Waypoints (cylinder lengths), shape (points, n) [m]; the first is the start.

        Returns:
            The pieces. Their `cost` equals the result of `price`; if it is inf, the arrays are
            undefined.
        """
        return PathPieces(*compute_pieces(self.cost_model, self.buffers, via, self.start))

    def path_to_goal(
        self, via: FloatArray, k: int, cost: float, pieces: PathPieces | None = None
    ) -> CylinderPath:
        """Create the cylinder path to goal posture k from its waypoints, cost and pieces."""
        elbow, free = int(self.goals.elbow[k]), self.goals.free[k]
        return CylinderPath(via, k, elbow, free, cost, pieces)

    @property
    def statistics(self) -> SearchStatistics:
        """Work done so far, time since the problem was created, and whether the time is up."""
        spent, is_late = perf_counter() - self.began, self.progress.search_deadline.has_passed
        return SearchStatistics(self.expanded, self.priced, spent, is_late)

    def convert_to_discrete(self, best: CylinderPath) -> DiscretePath:
        """Convert a cylinder path to a discrete path, whose cost always includes leakage.

        The path's own pieces and cost are used if the path has pieces and they include leakage.
        Otherwise the pieces are computed. The path gets the search statistics of this moment.
        """
        full, pieces = self.full_cost_model, best.pieces
        counts_leakage = self.cost_model is full
        if pieces is None or not counts_leakage:
            pieces = PathPieces(*compute_pieces(full, self.buffers, best.waypoints, self.start))
        cost = best.cost if counts_leakage else pieces.cost
        return to_discrete_path(full, pieces, cost, self.start_modes, self.statistics)


@kernel
def bound_goal_costs(
    t: PathCostModel,
    start: FloatArray,
    start_modes: ModeArray,
    posture: FloatArray,
    length: FloatArray,
) -> FloatArray:
    """Compute a lower bound on the cost of a path from the start to rest in each goal posture.

    The bound is `least_move_cost` plus the cost of switching from the modes at the start to modes
    that hold the arm in the goal posture.

    Tested against holding modes in plain Python.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        start: Cylinder lengths at the start, shape (n,) [m].
        start_modes: Modes in force at the start, uint8, shape (n,).
        posture: Goal postures, shape (goals, n) [rad or m].
        length: Cylinder lengths in the goal postures, shape (goals, n) [m].

    Returns:
        Lower bounds on the cost, shape (goals,) [-].
    """
    bound, q, force = np.empty(len(posture)), np.empty(len(start)), np.empty(len(start))
    for k in range(len(posture)):
        copy_row(q, posture[k])
        piston_forces(t.machine, q, force)
        switches = count_switches_to_hold(t.machine, force, start_modes)
        bound[k] = least_move_cost(t, start, length[k]) + t.weight[2] * switches
    return bound
