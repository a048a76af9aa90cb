"""Integrated search from a start posture to a goal point: a first path early, then cheaper ones.

1. Straight lines lead to the goal postures, tried in the order of their lower bounds.
2. A* searches lattices of decreasing spacing, if a cheaper path is still possible.
3. Local changes improve paths: waypoints are removed and moved, and the goal posture is changed.

The first admissible straight line is yielded at once, later paths as they are found
(`anytime_search`). All work is limited, so that the result depends on the clock only if there is a
deadline.
"""

import math
from collections.abc import Iterator

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.integrated import anytime_search, ik_near_start
from mhsb_planner.integrated.goal_postures import sample_goal_postures
from mhsb_planner.integrated.search_problem import SearchLimits, SearchProblem
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.manipulability_loss import WITHOUT_AREA, AreaTerm
from mhsb_planner.search.s2_search import PathQuery, Weights


def yield_paths(problem: SearchProblem) -> Iterator[DiscretePath | None]:
    """Yield ever cheaper discrete paths from the start to the goal.

    Straight paths come first, then paths from lattices and local changes. If the arm starts at the
    goal, one path without steps is yielded.

    Args:
        problem: The search problem. It serves for one search only, because it counts the work done.

    Yields:
        A path, or the value None before work that may take long. At None, the caller can try
        something else.

    Raises:
        NoPathError: The search has ended without any path.
        DeadlineError: The time was up before there was a path.
    """
    if problem.query.begins_at_goal(problem.machine):
        tip, seconds = problem.machine.tip_position(problem.start), problem.statistics.seconds
        yield DiscretePath.create_without_steps(tip, problem.start, problem.start_modes, seconds)
        return
    for best in anytime_search.yield_paths(problem):
        yield None if best is None else problem.convert_to_discrete(best)


def find_best_path(problem: SearchProblem) -> DiscretePath:
    """Run the search to its end, or to its deadline, and return the cheapest path.

    Args:
        problem: The search problem.

    Raises:
        NoPathError: There is no path.
        DeadlineError: The time was up before there was a path.
    """
    return [path for path in yield_paths(problem) if path is not None][-1]


def improve_path(
    problem: SearchProblem, via: FloatArray, spacings: tuple[float, ...]
) -> DiscretePath | None:
    """Improve a given cylinder path by local changes.

    The goal posture nearest to the last waypoint counts as the path's end. The distance of two
    postures is their largest difference of a cylinder length.

    Args:
        problem: The search problem.
        via: Waypoints (cylinder lengths) from the start to a goal posture, shape (points, n) [m].
        spacings: Lattice spacings, in the order of use [m]. Waypoints move by shares of these.

    Returns:
        The improved path, or the given one if nothing improves it; None if the given path is
        inadmissible.
    """
    off = np.abs(problem.goals.length - via[-1]).max(axis=1)
    path = problem.path_to_goal(via, int(np.argmin(off)), problem.price(via))
    if path.cost == math.inf:
        return None
    for spacing in spacings:
        path = anytime_search.refine(problem, path, spacing, problem.limits.max_sweeps)
    return problem.convert_to_discrete(path)


def search(
    machine: Machine,
    query: PathQuery,
    *,
    area: AreaTerm = WITHOUT_AREA,
    deadline: Deadline = NO_DEADLINE,
    effort: SearchLimits | None = None,
) -> DiscretePath:
    """Create a search problem, search it to the end, and return the cheapest path.

    Args:
        machine: The arm without a slewing joint.
        query: Start, goal with its region, cost weights and energy reading.
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
    progress = PlanProgress(deadline)
    return find_best_path(
        SearchProblem.create(machine, query, area=area, progress=progress, limits=effort)
    )


def warm_up(machine: Machine) -> None:
    """Compile all kernels of the integrated search, even those that only some requests need.

    Args:
        machine: Arm without a slewing joint, used for trial calls. Its obstacles are ignored.
    """
    problem = _example_problem(machine)
    search(problem.machine, problem.query, effort=problem.limits)
    for part in (warm_up_pricing, warm_up_paths, warm_up_lattice, warm_up_refinement):
        part(machine)


def warm_up_pricing(machine: Machine) -> None:
    """Compile the kernels that price a cylinder path or find goal postures.

    Args:
        machine: Arm without a slewing joint, used for trial calls. Its obstacles are ignored.
    """
    problem = _example_problem(machine)
    problem.price(_straight_line(problem))
    sample_goal_postures(machine, *problem.goals.tip, None, problem.limits.psi_spacing)
    ik_near_start.warm_up(machine, problem.start, problem.cost_model.circuit)


def warm_up_paths(machine: Machine) -> None:
    """Compile the kernels of the lower bound and of the conversion to a discrete path.

    Args:
        machine: Arm without a slewing joint, used for trial calls. Its obstacles are ignored.
    """
    problem = _example_problem(machine)
    _ = problem.lower_bound
    problem.convert_to_discrete(problem.path_to_goal(_straight_line(problem), 0, 0.0))


def warm_up_lattice(machine: Machine) -> None:
    """Compile the kernels of the A* search over lattices of cylinder lengths.

    Args:
        machine: Arm without a slewing joint, used for trial calls. Its obstacles are ignored.
    """
    problem = _example_problem(machine)
    lattice = anytime_search.create_lattice_search(
        problem, problem.cost_model, np.array([0]), problem.limits.max_first_spacing
    )
    lattice.search(math.inf, problem.limits.max_expansions)


def warm_up_refinement(machine: Machine) -> None:
    """Compile the kernels that improve a cylinder path by local changes.

    Args:
        machine: Arm without a slewing joint, used for trial calls. Its obstacles are ignored.
    """
    problem = _example_problem(machine)
    anytime_search.refine(
        problem,
        problem.path_to_goal(_straight_line(problem), 0, math.inf),
        problem.limits.max_first_spacing,
    )


def _straight_line(problem: SearchProblem) -> FloatArray:
    """Return the waypoints of the straight line to the first goal posture, shape (2, n) [m]."""
    return np.array([problem.start_lengths, problem.goals.length[0]])


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
    modes, weights = np.zeros(machine.joint_count, dtype=np.uint8), Weights(1.0, 1.0, 1.0)
    query = PathQuery(start, modes, (float(x), float(z)), weights, goal_psi=psi)
    return SearchProblem.create(machine, query, area=AreaTerm(1.0, 1.0), limits=effort)
