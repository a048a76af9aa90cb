"""Stages of the integrated search: straight lines, lattices of decreasing spacing, local changes.

Every stage starts from the cheapest path so far, the incumbent. A coarse lattice is searched in one
or two milliseconds, a fine lattice in a second. After local changes, a path from a coarse lattice
mostly costs as little as a path from a fine lattice. Fine lattices are searched while there is time
and while a cheaper path is possible.
"""

import math
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mhsb_model.types import IntArray, frozen
from mhsb_planner.errors import DeadlineError, NoPathError
from mhsb_planner.integrated.cylinder_path import PathCostModel, price_path
from mhsb_planner.integrated.lattice import (
    Lattice,
    lattice_even_in_angles,
    lattice_even_in_lengths,
)
from mhsb_planner.integrated.lattice_search import LatticeSearch
from mhsb_planner.integrated.refinement import (
    Strides,
    SweptPath,
    remove_waypoints,
    sweep_waypoints,
)
from mhsb_planner.integrated.search_problem import CylinderPath, SearchProblem
from mhsb_planner.search.s2_search import SEARCH_TASK
from mhsb_planner.search.s2_step import describe_postures

MIN_RELATIVE_GAIN = 1e-3
"""Gap between a path's cost and the lower bound, as a share of the bound, below which the path is
not improved further [-]. Sweeps with one stride end when a sweep saves less than this share of the
cost.
"""

MIN_LATTICE_GAP = 1e-2
"""Gap between incumbent and lower bound, as a share of the bound, below which no lattice is
searched [-].
"""

WORTH_A_MOTION = 5e-3
"""Least saving for which a path from a lattice is yielded at once, as a share of the cost of the
last yielded path [-].
"""

MAX_COARSE_PIECE_STROKE = 5e-3
"""Largest stroke of a cylinder within one piece in coarse sweeps (all but those with the last
stride), for an arm of the paper's size [m].
"""

MAX_SEARCHED_COST_RATIO, MAX_REFINED_COST_RATIO = 1.25, 1.5
"""Limits on the cost of a path over a lattice, as factors on the incumbent's cost [-].

The first limits the cost during the lattice search, by its cost model. The second limits the cost
of the path found, by the cost model of the search problem. Both exceed 1, because refinement makes
most paths over lattices cheaper.
"""

STRAIGHT_GOAL_STRIDE = 3
"""Step between the indices of goal postures in the first round of straight lines [-]."""

MAX_MOTION_PER_SPACING = 6.0
"""Largest distance that any part of the arm moves if one joint makes one step, divided by the
lattice spacing [-]. It applies to lattices with evenly spaced joint positions.
"""

FIRST_HEURISTIC_WEIGHT = 2.0
"""Heuristic weight of lattice searches without an incumbent [-]."""

DEADLINE_HEURISTIC_WEIGHT = 1.3
"""Heuristic weight of lattice searches with an incumbent, if there is a deadline and the arm has
four joints or more [-].
"""

FIRST_STATES = 2000
"""Largest number of states that a lattice search without an incumbent expands. If it finds no path,
a second search takes any path.
"""

TOO_DEAR_EFFORT = 0.25
"""Share of the states that lattice searches may expand while the incumbent is too dear for the
planning loop [-]. This is common at lower speeds than V_max. Coarse lattices are then searched.
"""

MAX_LATTICE_POINTS, SPACING_GROWTH = 2**26, 1.25
"""Largest number of lattice points, and factor by which the spacing of a larger lattice is
increased until it fits. Only arms with more joints than the suite's have such lattices.
"""

QUICK_LATTICE_COUNT = 3
"""Number of lattices after which `yield_lattice_paths` yields None, so that the caller can try
something else.
"""

FIRST_LINES = 8
"""Number of straight lines after which `yield_straight_paths` yields None if none is admissible, so
that the caller can try something else.
"""


def yield_paths(problem: SearchProblem) -> Iterator[CylinderPath | None]:
    """Yield ever cheaper cylinder paths, the first as early as possible.

    A cylinder path is a polyline of cylinder lengths. There are three stages: straight lines,
    lattices of decreasing spacing, and a last local refinement. The lattices are skipped if the
    incumbent (cheapest path so far) costs at most (1 + MIN_LATTICE_GAP) times the lower bound. The
    refinement is skipped if the incumbent costs at most (1 + MIN_RELATIVE_GAIN) times the lower
    bound. Lattices and refinement are also skipped when the time is up, or if the lower bound
    reaches the cost from which paths are useless (`progress.max_path_cost`).

    The first straight line is yielded at once; later, cheaper lines become the incumbent without
    being yielded. A path from a lattice is yielded at once if it is cheaper than the last yielded
    path by more than the share WORTH_A_MOTION. At the end, the cheapest path of all is yielded,
    unless it has been yielded already.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.

    Yields:
        A path that is cheaper than all earlier paths, or the value None before a lattice is
        searched. At None, the caller can try something else.

    Raises:
        NoPathError: The search has ended without any path.
        DeadlineError: The time was up before there was a path.
    """
    best: CylinderPath | None = None
    last_yielded: CylinderPath | None = None
    for path in yield_straight_paths(problem):
        if best is None:
            last_yielded = path
            yield last_yielded
        best = path
    if may_be_improved(problem, best, MIN_LATTICE_GAP):
        for path in yield_lattice_paths(problem, best):
            best = path or best
            if path is None:
                yield None
            elif last_yielded is None or path.cost < (1.0 - WORTH_A_MOTION) * last_yielded.cost:
                last_yielded = path
                yield last_yielded
    if best is None:
        if problem.progress.search_deadline.has_passed:
            raise DeadlineError(SEARCH_TASK)
        x, z = problem.machine.tip_position(problem.start)
        raise NoPathError((float(x), float(z)), problem.goals.tip, problem.machine.obstacles.names)
    if may_be_improved(problem, best, MIN_RELATIVE_GAIN):
        best = refine(problem, best, lattice_spacings(problem, best)[-1], problem.limits.max_sweeps)
    if last_yielded is None or best.cost < last_yielded.cost:
        yield best


def may_be_improved(problem: SearchProblem, best: CylinderPath | None, share: float) -> bool:
    """Return whether the incumbent is still too expensive, and there is time to improve it.

    The first call with an incumbent computes the lower bound of `problem` by branch and bound. If
    this bound exceeds `max_path_cost` of the planning loop, the loop would skip every further path.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.
        best: Incumbent (cheapest path so far); None if there is none.
        share: The incumbent is good enough if it costs at most (1 + share) times the lower bound
            [-].

    Returns:
        False if the deadline of the search has passed, if the incumbent is good enough, or if no
        path is cheap enough for the loop. Otherwise True, also without an incumbent.
    """
    progress = problem.progress
    if best is not None:
        max_bound = min(best.cost / (1.0 + share), progress.max_path_cost)
        if problem.lower_bound >= max_bound:
            return False
    return not progress.search_deadline.has_passed


# --- Straight lines ------------------------------------------------------------------------------


def yield_straight_paths(problem: SearchProblem) -> Iterator[CylinderPath | None]:
    """Yield ever cheaper straight cylinder paths, to a choice of goal postures.

    The first round tries every STRAIGHT_GOAL_STRIDE-th goal posture. The goal posture with the
    least lower bound on the cost comes first. If a line was found, the second round tries the
    skipped neighbours of the goal posture where the best line ends. A round ends early, without an
    error, at the first goal posture whose lower bound is not below the cost of the best line. It
    also ends early when the search deadline has passed.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.

    Yields:
        Lines, each cheaper than all earlier lines. While there is no line, the value None is
        yielded twice: after FIRST_LINES trials and at the end of the first round. The caller can
        then try something else. If the search deadline has passed, None comes without trials.
    """
    count = len(problem.goal_lower_bounds)
    order = _sort_by_lower_bound(problem, np.arange(0, count, STRAIGHT_GOAL_STRIDE))
    best: CylinderPath | None = None
    for part in (order[:FIRST_LINES], order[FIRST_LINES:]):
        for line in _yield_cheaper_lines(problem, part, best):
            best = line
            yield line
        if best is None:
            yield None
    if best is not None:
        first, last = (best.goal_index + side * (STRAIGHT_GOAL_STRIDE - 1) for side in (-1, 1))
        beside = np.arange(max(0, first), min(count, last + 1))
        beside = beside[beside % STRAIGHT_GOAL_STRIDE > 0]
        yield from _yield_cheaper_lines(problem, _sort_by_lower_bound(problem, beside), best)


def _sort_by_lower_bound(problem: SearchProblem, numbers: IntArray) -> IntArray:
    """Sort goal postures by the lower bound on the cost of a path to them.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.
        numbers: Indices of goal postures.

    Returns:
        The indices in ascending order of the bound.
    """
    return numbers[np.argsort(problem.goal_lower_bounds[numbers], kind="stable")]


def _yield_cheaper_lines(
    problem: SearchProblem, numbers: IntArray, best: CylinderPath | None
) -> Iterator[CylinderPath]:
    """Yield ever cheaper straight cylinder paths to given goal postures.

    Goal postures are tried in the given order. The trials end at the first goal posture whose lower
    bound is not below the incumbent's cost, or when the time is up.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.
        numbers: Indices of goal postures, the least lower bound on the cost first.
        best: Incumbent (cheapest path so far); None if there is none.

    Yields:
        Admissible paths, each cheaper than `best` and all earlier paths. If `best` is None, the
        first path has its `pieces`, because it is converted at once. In all other paths, `pieces`
        is None.
    """
    for k in numbers.tolist():
        limit = math.inf if best is None else best.cost
        if problem.goal_lower_bounds[k] >= limit or problem.progress.search_deadline.has_passed:
            break
        via = np.array([problem.start_lengths, problem.goals.length[k]])
        pieces = (
            problem.compute_pieces(via) if best is None else None
        )  # the first path is converted
        cost = problem.price(via, limit) if pieces is None else pieces.cost
        if cost < limit:
            best = problem.path_to_goal(via, k, cost, pieces)
            yield best


# --- Lattices ------------------------------------------------------------------------------------


def lattice_spacings(problem: SearchProblem, best: CylinderPath | None) -> list[float]:
    """Return the spacings of the lattices, in a decreasing geometric sequence.

    With an incumbent (cheapest path so far), the spacings depend on `stroke`: the largest
    difference of a cylinder length between the start and any of these points [m]:

    - the incumbent's waypoints,
    - goal postures with a lower bound below the incumbent's cost.

    The sequence then leads from `first` to `last` [m]; all other names are fields of
    `SearchLimits`:

        last = min(max_last_spacing, max(min_spacing, stroke / finest_step_count))
        first = min(max_first_spacing, max(last, stroke / 3))

    Without an incumbent the spacings run from `max_first_spacing` to `max_last_spacing`. The ratio
    of successive spacings is at most `spacing_ratio`.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.
        best: Incumbent; None if there is none.

    Returns:
        Spacings [m] from `first` to `last`, both included; one spacing if they are equal.
    """
    effort = problem.limits
    if best is None:
        first, last = effort.max_first_spacing, effort.max_last_spacing
    else:
        worth = np.vstack(
            [best.waypoints, problem.goals.length[problem.goal_lower_bounds < best.cost]]
        )
        stroke = float(np.max(np.abs(worth - problem.start_lengths)))
        last = min(
            effort.max_last_spacing, max(effort.min_spacing, stroke / effort.finest_step_count)
        )
        first = min(effort.max_first_spacing, max(last, stroke / 3.0))
    count = math.ceil(math.log(first / last) / math.log(effort.spacing_ratio) - 1e-9) + 1
    return [first * (last / first) ** (k / max(1, count - 1)) for k in range(count)]


def yield_lattice_paths(
    problem: SearchProblem, best: CylinderPath | None
) -> Iterator[CylinderPath | None]:
    """Search lattices of decreasing spacing and yield ever cheaper cylinder paths.

    A lattice is a regular grid of cylinder lengths. Before each lattice the incumbent (cheapest
    path so far) is refined: its waypoints are moved by shares of the lattice's spacing. Each
    lattice is searched first with a simpler cost model, then with the real model. The second search
    is skipped if the first finds nothing and there is no incumbent.

    A path found on a lattice is then refined. The path is discarded instead if it costs no less
    than the incumbent and runs within one spacing of it.

    The function ends after the finest lattice, with or without a path. It ends earlier if the
    incumbent is close to the lower bound (MIN_LATTICE_GAP) or the time is up. All searches together
    may expand `_max_expansions` states. With an incumbent, the function also ends if no more are
    left than the search before by the same cost model took, since finer lattices take more.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.
        best: Incumbent; None if there is none.

    Yields:
        Before each lattice, the refined incumbent, even if it is unchanged; then each cheaper path
        from the lattice. The value None is yielded after QUICK_LATTICE_COUNT lattices, and before
        each lattice in the second half of the time. The caller can then try something else.
    """
    taken = [0, 0]
    for number, spacing in enumerate(lattice_spacings(problem, best)):
        if number == QUICK_LATTICE_COUNT or problem.progress.is_half_over:
            yield None
        if best is not None and may_be_improved(problem, best, MIN_LATTICE_GAP):
            best = refine(problem, best, spacing)
            yield best
        for k, priced_by in enumerate(_lattice_cost_models(problem.cost_model, best)):
            before = problem.expanded
            lacks = best is not None and taken[k] >= _max_expansions(problem, best) - before
            if lacks or not may_be_improved(problem, best, MIN_LATTICE_GAP):
                return
            found = search_lattice(problem, priced_by, best, spacing)
            taken[k] = problem.expanded - before
            if found is None and best is None:
                break
            if found is not None and (best is None or not _runs_beside(found, best, spacing)):
                found = refine(problem, found, spacing)
                if best is None or found.cost < best.cost:
                    best = found
                    yield best


def _max_expansions(problem: SearchProblem, best: CylinderPath) -> int:
    """Return the number of states that all lattice searches of a problem may expand together.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.
        best: Incumbent (cheapest path so far).

    Returns:
        `max_expansions` of the problem's limits. If the planning loop would skip a path of the
        incumbent's cost, TOO_DEAR_EFFORT times as much.
    """
    most = problem.limits.max_expansions
    return most if best.cost <= problem.progress.max_path_cost else int(TOO_DEAR_EFFORT * most)


def _lattice_cost_models(t: PathCostModel, best: CylinderPath | None) -> tuple[PathCostModel, ...]:
    """Return the two cost models by which a lattice is searched one after the other.

    In the real model, a cylinder with a speed up to `t.circuit.rest_speed` counts as held and may
    need boost for its load. The first model is simpler: it does not have this rule. If there is no
    incumbent, mode switches also cost nothing in the first model.

    Args:
        t: Cost model of the search problem.
        best: Incumbent (cheapest path so far); None if there is none.

    Returns:
        Two cost models; the second is `t` itself.
    """
    without = t._replace(circuit=t.circuit._replace(rest_speed=0.0))
    if best is None:
        return without._replace(weight=frozen(t.weight * [1.0, 1.0, 0.0])), t
    return without, t


def search_lattice(
    problem: SearchProblem,
    priced_by: PathCostModel,
    best: CylinderPath | None,
    spacing: float,
) -> CylinderPath | None:
    """Search one lattice for a cylinder path that may be cheaper than the incumbent.

    A lattice is a regular grid of cylinder lengths, and its points are the possible waypoints.

    With an incumbent, A* looks for a path below MAX_SEARCHED_COST_RATIO times the incumbent's cost.
    Only goal postures with a lower bound below the incumbent's cost are goals. The search expands
    at most `_max_expansions` − `problem.expanded` states. Its heuristic weight is 1, or
    DEADLINE_HEURISTIC_WEIGHT for an arm of more than three joints if there is a deadline.

    Without an incumbent, A* with the heuristic weight FIRST_HEURISTIC_WEIGHT expands at most
    FIRST_STATES states. If it stops there without a path, a second search without a limit of states
    keeps only the first path to each lattice point. The second search finds some path quickly, but
    not the cheapest. The work of all searches is added to `problem.expanded` and `problem.priced`.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.
        priced_by: Cost model of the search; it replaces the cost model of `problem`.
        best: Incumbent (cheapest path so far); None if there is none.
        spacing: Spacing of the lattice [m].

    Returns:
        The path, priced with the cost model of `problem`. None if no path was found, or if the path
        is inadmissible by that model or costs at least MAX_REFINED_COST_RATIO times the incumbent.
        Also None, without creating a lattice, if no goal posture has a lower bound below the
        incumbent's cost.
    """
    limit = math.inf if best is None else best.cost
    worth = np.flatnonzero(problem.goal_lower_bounds < limit)
    if len(worth) == 0:
        return None
    search = create_lattice_search(problem, priced_by, worth, spacing)
    if best is not None:
        left = _max_expansions(problem, best) - problem.expanded
        heuristic_weight = (
            DEADLINE_HEURISTIC_WEIGHT
            if problem.progress.has_deadline and len(problem.start_lengths) > 3
            else 1.0
        )
        found = search.search(
            MAX_SEARCHED_COST_RATIO * limit,
            left,
            problem.progress.search_deadline,
            heuristic_weight,
        )
    else:
        found = search.search(
            math.inf, FIRST_STATES, problem.progress.search_deadline, FIRST_HEURISTIC_WEIGHT
        )
        if found is None and not search.exhausted:
            _count_work(problem, search)
            search = create_lattice_search(problem, priced_by, worth, spacing)
            found = search.search(
                math.inf,
                sys.maxsize,
                problem.progress.search_deadline,
                FIRST_HEURISTIC_WEIGHT,
                reachability_only=True,
            )
    _count_work(problem, search)
    if found is None:
        return None
    via, k = found
    cost = problem.price(via, MAX_REFINED_COST_RATIO * limit)
    return problem.path_to_goal(via, int(worth[k]), cost) if cost < math.inf else None


def _count_work(problem: SearchProblem, search: LatticeSearch) -> None:
    """Add the counts of a lattice search to the problem's work, once after its end."""
    problem.expanded += search.expanded_count
    problem.priced += search.priced_count


def _runs_beside(found: CylinderPath, best: CylinderPath, spacing: float) -> bool:
    """Return whether a path runs close to the incumbent without being cheaper.

    Args:
        found: The path.
        best: Incumbent (cheapest path so far).
        spacing: The path is close if the distance of each waypoint from the incumbent's polyline is
            smaller than this [m]. The distance of two points is their largest difference of a
            cylinder length.

    Returns:
        True if both conditions hold; refining the path would then probably give the incumbent.
    """
    if found.cost < best.cost:
        return False
    start, way = best.waypoints[:-1], np.diff(best.waypoints, axis=0)
    off = found.waypoints[:, None] - start
    share = np.clip((off * way).sum(-1) / np.maximum((way * way).sum(-1), 1e-12), 0.0, 1.0)
    nearest = np.abs(off - share[..., None] * way).max(axis=-1).min(axis=1)
    return bool(nearest.max() < spacing)


def create_lattice_search(
    problem: SearchProblem, priced_by: PathCostModel, goal_indices: IntArray, spacing: float
) -> LatticeSearch:
    """Create the search over a lattice to a selection of the goal postures.

    A lattice is a regular grid of cylinder lengths. The spacing is increased in steps of
    SPACING_GROWTH until the lattice has at most MAX_LATTICE_POINTS points.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.
        priced_by: Cost model of the search; it replaces the cost model of `problem`.
        goal_indices: Indices of the goal postures of `problem` to search for. The search numbers
            them anew from 0 in this order.
        spacing: Spacing of the lattice [m].

    Returns:
        A search that has expanded nothing. It uses the working memory of `problem`.
    """
    goals = describe_postures(problem.machine.arrays, problem.goals.posture[goal_indices])
    points = _create_lattice(problem, spacing)
    while points.shape.prod() > MAX_LATTICE_POINTS:
        spacing *= SPACING_GROWTH
        points = _create_lattice(problem, spacing)
    return LatticeSearch(priced_by, problem.buffers, points, goals)


def _create_lattice(problem: SearchProblem, spacing: float) -> Lattice:
    """Create the lattice of a search problem with a given spacing.

    Without obstacles the spacing is equal in all cylinder lengths. With obstacles the positions of
    each joint are evenly spaced, more closely for inner joints.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.
        spacing: Spacing of the cylinder lengths [m]. With obstacles, the spacing of each joint is
            chosen so that no part of the arm moves by more than MAX_MOTION_PER_SPACING · spacing in
            one step.

    Returns:
        The lattice; the start is one of its points.
    """
    if len(problem.cost_model.obstacles) > 0:
        return lattice_even_in_angles(
            problem.machine, problem.start, MAX_MOTION_PER_SPACING * spacing
        )
    return lattice_even_in_lengths(problem.machine, problem.start, spacing)


# --- Small changes -------------------------------------------------------------------------------


def _end_tip(problem: SearchProblem, path: CylinderPath) -> tuple[float, float]:
    """Return the tip position at the end of a cylinder path.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.
        path: The path; its `goal_index` is read.

    Returns:
        Position (x, z) [m].
    """
    x, z = problem.goals.tips[path.goal_index].tolist()
    return x, z


def refine(
    problem: SearchProblem, best: CylinderPath, spacing: float, fine_sweeps: int = 1
) -> CylinderPath:
    """Improve a cylinder path: remove waypoints, then move them by shares of a lattice spacing.

    First, inner waypoints are left out as long as the path does not become more expensive. If one
    straight segment is left, it is split into three. Then a compass search moves each waypoint by a
    stride, in sweeps with ever smaller strides (`stride_shares` of `SearchLimits`, times the
    spacing). The last waypoint moves by a change of the goal posture. Only sweeps with the last
    stride price paths exactly; earlier sweeps price them coarsely. A change found by coarse pricing
    is kept only if exact pricing confirms that it is cheaper. No change is tried after the
    deadline.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.
        best: The path.
        spacing: Lattice spacing, the unit of the strides [m].
        fine_sweeps: Largest number of sweeps with the last stride; each other stride has up to
            `max_sweeps` of `SearchLimits`.

    Returns:
        The improved path; `best` itself if no cheaper path was found.
    """
    via, _ = remove_waypoints(
        problem.cost_model,
        problem.buffers,
        best.waypoints,
        problem.start,
        best.cost,
        problem.progress.search_deadline,
    )
    if len(via) == 2:
        via = via[0] + np.linspace(0.0, 1.0, 4)[:, None] * (via[1] - via[0])
    path = replace(best, waypoints=via, cost=problem.price(via), pieces=None)
    effort, last = problem.limits, problem.cost_model.max_piece_stroke
    rough = MAX_COARSE_PIECE_STROKE * problem.machine.relative_size
    for stride in effort.stride_shares[:-1]:
        path = _sweep_with_stride(problem, path, spacing, stride, effort.max_sweeps, rough)
    path = _sweep_with_stride(problem, path, spacing, effort.stride_shares[-1], fine_sweeps, last)
    return path if path.cost < best.cost else best


def _sweep_with_stride(
    problem: SearchProblem,
    path: CylinderPath,
    spacing: float,
    stride: float,
    rounds: int,
    piece: float,
) -> CylinderPath:
    """Run sweeps of a compass search with one stride over a cylinder path.

    A sweep tries to move each waypoint but the start by the stride and keeps each move that makes
    the path cheaper. The last waypoint moves to another goal posture instead. Sweeps price the path
    coarsely, in pieces in which no cylinder moves by more than `piece`. After each sweep, the
    problem's own cost model gives the real cost of the path. The sweeps end if the real cost
    exceeds the best real cost so far. They also end if a sweep lowers the coarse cost by less than
    the share MIN_RELATIVE_GAIN, or at the deadline, within a sweep.

    Args:
        problem: The search problem: start, goal postures, cost model, effort limits and deadline.
        path: The path; it is not changed.
        spacing: Lattice spacing [m].
        stride: Stride as a share of the spacing [-].
        rounds: Largest number of sweeps.
        piece: Largest stroke of a cylinder within the pieces by which the sweeps price paths [m].

    Returns:
        The path with the least real cost among `path` and the results of the sweeps.
    """
    t, w, until = problem.cost_model, problem.buffers, problem.progress.search_deadline
    rough = t._replace(max_piece_stroke=piece)
    strides = Strides(
        stride * spacing, problem.limits.goal_turn * stride * problem.goals.free_units
    )
    via, free = path.waypoints.copy(), path.free.copy()
    swept = SweptPath(via, problem.start, _end_tip(problem, path), path.elbow, free)
    cost = float(price_path(rough, w, via, problem.start, math.inf))
    for _ in range(rounds):
        before = cost
        cost = sweep_waypoints(rough, w, swept, cost, strides, until)
        counts = cost if piece == t.max_piece_stroke else problem.price(via, path.cost)
        if counts < path.cost:
            path = replace(path, waypoints=via.copy(), free=free.copy(), cost=counts, pieces=None)
        if counts > path.cost or cost > (1.0 - MIN_RELATIVE_GAIN) * before:
            break
    return path
