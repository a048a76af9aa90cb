"""Ground truth for the integrated planner: the same problem searched offline, in several ways.

The planner's own search runs with normal settings, and with far more work: lattices down to 2 mm,
end-link angles ψ every half degree. Other code (`search_least_cost`) finds cheapest paths over a
lattice that is about as fine. It runs twice: cylinders at rest whose load P_S does not carry are
boosted, or not. These paths may show what the planner's search leaves out. They are improved by
small changes and priced by the planner. The cheapest of all paths is the ground truth.
"""

import math
from operator import attrgetter

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.integrated.integrated_search import improve_path, search
from mhsb_planner.integrated.lower_bound import bound_energy_to_goal
from mhsb_planner.integrated.search_problem import SearchLimits, SearchProblem
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_search import PathQuery, Weights
from mhsb_planner.search.s2_step import EnergyReading
from mhsb_tools.comparison.least_cost import search_least_cost

EXHAUSTIVE_LIMITS = SearchLimits(
    psi_spacing=math.radians(0.5),
    finest_step_count=40,
    spacing_ratio=1.3,
    max_last_spacing=2e-3,
    max_expansions=100_000,
    stride_shares=(0.5, 0.25, 0.125, 0.0625),
    max_sweeps=20,
)
"""Settings of the planner's search with far more work than online."""

REFINEMENT_SPACINGS = (10e-3, 2.5e-3)
"""Lattice spacings with which paths of `search_least_cost` are improved [m].

They are those for an arm of the paper's size."""

NEAR_THE_BOUND = 2e-3
"""A path that exceeds the lower bound by less than this share of its cost is taken as optimal."""

MAY_BE_IMPROVED = 1.25
"""Paths of `search_least_cost` are improved up to this factor times the incumbent's cost."""


def search_ground_truth(
    machine: Machine,
    start: FloatArray,
    start_modes: ModeArray,
    goal: tuple[float, float],
    weights: Weights,
    energy_reading: EnergyReading = "paper",
) -> DiscretePath:
    """Search long for the cheapest path from a posture to a tip position; takes seconds.

    First, the planner's search runs twice: with normal settings, and with far finer ones. The
    cheaper path is the incumbent (best path so far). Then independent code, `search_least_cost`,
    searches twice. In one search, a cylinder at rest is priced as boosted if the main pump's
    pressure P_S does not carry its load. In the other search it is not. Each path of these two
    searches is improved by small changes if it costs at most 1.25 times as much as the incumbent.

    `search_least_cost` does not run in four cases: boosted oil is priced as `series`, an actuator
    is boosted at the start, there are obstacles, or the incumbent is within 0.2 % of a lower bound.

    Args:
        machine: The planar arm (without the slewing joint).
        start: Start posture, shape (n,) [rad or m].
        start_modes: Modes in force at the start, shape (n,).
        goal: Tip position (x, z) [m].
        weights: Weights of the cost.
        energy_reading: How boosted oil is priced, `paper` or `series`.

    Returns:
        The cheapest path found; it is not proven to be optimal.

    Raises:
        OutOfWorkspaceError: The goal is outside the workspace.
        InfeasibleGoalError: No posture at the goal is within the joint limits.
        ZoneError: The arm would be too near to an obstacle in every goal posture.
        NoPathError: The planner's own search found no path.
    """
    query = PathQuery(start, start_modes, goal, weights, energy_reading)
    best = min(
        (search(machine, query, effort=e) for e in (None, EXHAUSTIVE_LIMITS)),
        key=attrgetter("cost"),
    )
    if energy_reading != "paper" or np.any(start_modes) or len(machine.obstacles.path_rows) > 0:
        return best
    lower_bound = bound_energy_to_goal(machine, start, goal)
    if weights.energy * lower_bound >= (1.0 - NEAR_THE_BOUND) * best.cost:
        return best
    for holding in (True, False):
        known = MAY_BE_IMPROVED * best.cost
        _, via = search_least_cost(machine, start, goal, weights, known, holding)
        if via is not None:
            spacings = tuple(machine.relative_size * spacing for spacing in REFINEMENT_SPACINGS)
            problem = SearchProblem.create(machine, query, limits=EXHAUSTIVE_LIMITS)
            path = improve_path(problem, via, spacings)
            best = best if path is None else min(best, path, key=attrgetter("cost"))
    return best
