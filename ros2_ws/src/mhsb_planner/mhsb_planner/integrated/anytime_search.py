"""Stages of the integrated search: straight lines, lattices of decreasing spacing, local changes.

Every stage starts from the cheapest path so far, the incumbent. A coarse lattice takes a
millisecond or two. After its waypoints have been moved, its path mostly costs as little as that of
a fine lattice, which takes a second. Fine lattices follow while there is time, and skip everything
that cannot be cheaper.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mhsb_model.types import IntArray, frozen
from mhsb_planner.errors import DeadlineError, NoPathError
from mhsb_planner.integrated.cylinder_path import PathCostModel, price_path
from mhsb_planner.integrated.lattice import (
    Lattice,
    LatticeSearch,
    lattice_even_in_angles,
    lattice_even_in_lengths,
)
from mhsb_planner.integrated.refinement import (
    Strides,
    SweptPath,
    remove_waypoints,
    sweep_waypoints,
)
from mhsb_planner.integrated.search_problem import CylinderPath, SearchProblem
from mhsb_planner.search.s2_search import SEARCH_TASK
from mhsb_planner.search.s2_step import Postures

GOOD_ENOUGH = 1e-3
"""Relative gap to the lower bound below which a path is not improved further. A sweep with a
smaller relative gain ends the sweeps with a stride.
"""

WORTH_A_LATTICE = 1e-2
"""Relative gap to the lower bound below which no lattice is searched."""

WORTH_A_MOTION = 5e-3
"""Relative gain over the last path yielded, above which an intermediate path is yielded."""

MAX_COARSE_PIECE_STROKE = 5e-3
"""Largest stroke within the pieces by which long strides are priced, for an arm of the paper's size
[m].
"""

WORTH_FINDING, WORTH_REFINING = 1.25, 1.5
"""Cost limits of a path over a lattice, as factors on the incumbent's cost.

The first limits the search by the lattice's prices. The second limits the path at the real prices,
before refinement. Both exceed 1 because most lattice paths cost more than needed.
"""

STRAIGHT_GOAL_STRIDE = 3
"""Every how many goal postures a straight line is tried first."""

MAX_TURN_PER_SPACING = 6.0
"""Largest motion of the arm per step of an even-angle lattice, as a factor on the lattice spacing.
"""

FIRST_HEURISTIC_WEIGHT = 2.0
"""Heuristic weight of the search for a first path."""

DEADLINE_HEURISTIC_WEIGHT = 1.3
"""Heuristic weight with a deadline and four joints or more, if there is an incumbent."""

FIRST_STATES = 2000
"""Number of states to expand for a first path; beyond it any path is accepted at any cost."""

MAX_LATTICE_POINTS, SPACING_GROWTH = 2**26, 1.25
"""Largest number of lattice points, and factor by which the spacing grows until it is kept. Only
longer chains than the suite's reach it.
"""

QUICK_LATTICE_COUNT = 3
"""Number of lattices to search before the caller gets an opportunity to try something else."""

FIRST_LINES = 8
"""Number of straight lines to try before the caller gets an opportunity to try something else."""


@dataclass
class SearchWork:
    """Work done by the lattice searches of one request.

    Attributes:
        expanded: Number of states expanded.
        priced: Number of steps priced.
    """

    expanded: int = 0
    priced: int = 0

    def add(self, search: LatticeSearch) -> None:
        """Add the work of a lattice search that has ended."""
        self.expanded += search.expanded_count
        self.priced += search.priced_count


def yield_paths(task: SearchProblem, work: SearchWork) -> Iterator[CylinderPath | None]:
    """Yield ever cheaper cylinder paths, the first as early as possible.

    Runs straight lines, then lattices, then a last refinement. A stage is skipped if the time is
    up, or if the incumbent's gap to the lower bound is small. Small is WORTH_A_LATTICE for the
    lattices and GOOD_ENOUGH for the refinement. Improvements below WORTH_A_MOTION are not yielded
    until the end.

    Args:
        task: The search problem.
        work: Updated in place with the work done so far.

    Yields:
        A path that is cheaper than all before, or None before work that may take long, so that the
        caller can try something else.

    Raises:
        NoPathError: The search has ended without any path.
        DeadlineError: The time was up before there was a path.
    """
    best: CylinderPath | None = None
    last_yielded: CylinderPath | None = None
    for route in yield_straight_paths(task):
        if best is None:
            last_yielded = route
            yield last_yielded
        best = route
    if may_be_improved(task, best, WORTH_A_LATTICE):
        for route in yield_lattice_paths(task, best, work):
            best = route or best
            if route is None:
                yield None
            elif last_yielded is None or route.cost < (1.0 - WORTH_A_MOTION) * last_yielded.cost:
                last_yielded = route
                yield last_yielded
    if best is None:
        if task.progress.search_deadline.has_passed:
            raise DeadlineError(SEARCH_TASK)
        x, z = task.machine.tip_position(task.start)
        raise NoPathError((float(x), float(z)), task.goals.tip, task.machine.obstacles.names)
    if may_be_improved(task, best, GOOD_ENOUGH):
        best = refine(task, best, lattice_spacings(task, best)[-1], task.limits.max_sweeps)
    if last_yielded is None or best.cost < last_yielded.cost:
        yield best


def may_be_improved(task: SearchProblem, best: CylinderPath | None, share: float) -> bool:
    """Return whether a noticeably cheaper path is possible and there is time to look for it.

    Args:
        task: The search problem.
        best: Incumbent; None if there is none, which always leaves room.
        share: Relative gap to the lower bound above which a cheaper path counts as possible.

    Returns:
        False if the gap is smaller or the time is up.
    """
    room = best is None or best.cost > (1.0 + share) * task.lower_bound
    return room and not task.progress.search_deadline.has_passed


# --- Straight lines ------------------------------------------------------------------------------


def yield_straight_paths(task: SearchProblem) -> Iterator[CylinderPath | None]:
    """Yield ever cheaper straight lines to goal postures.

    First it tries one in STRAIGHT_GOAL_STRIDE goal postures, in the order of their lower bounds.
    Then it tries the skipped goal postures next to the best one.

    Args:
        task: The search problem.

    Yields:
        A line that is cheaper than all before. None if there is no line after the first FIRST_LINES
        trials, and again after the first round, so that the caller can try something else.
    """
    numbers = np.arange(len(task.goal_lower_bounds))
    sparse = numbers % STRAIGHT_GOAL_STRIDE == 0
    order = _sort_by_lower_bound(task, numbers[sparse])
    best: CylinderPath | None = None
    for part in (order[:FIRST_LINES], order[FIRST_LINES:]):
        for line in _yield_cheaper_lines(task, part, best):
            best = line
            yield line
        if best is None:
            yield None
    if best is not None:
        beside = np.abs(numbers - best.goal_index) < STRAIGHT_GOAL_STRIDE
        yield from _yield_cheaper_lines(
            task, _sort_by_lower_bound(task, numbers[~sparse & beside]), best
        )


def _sort_by_lower_bound(task: SearchProblem, numbers: IntArray) -> IntArray:
    """Sort goal postures by the lower bound on the cost of a path to them.

    Args:
        task: The search problem.
        numbers: Indices of goal postures.

    Returns:
        The indices, the least bound first.
    """
    return numbers[np.argsort(task.goal_lower_bounds[numbers], kind="stable")]


def _yield_cheaper_lines(
    task: SearchProblem, numbers: IntArray, best: CylinderPath | None
) -> Iterator[CylinderPath]:
    """Yield straight lines to given goal postures, each cheaper than all before.

    It ends once a lower bound reaches the incumbent's cost, or the time is up.

    Args:
        task: The search problem.
        numbers: Indices of goal postures in the order of their lower bounds.
        best: Incumbent; None if there is none.

    Yields:
        The paths.
    """
    for k in numbers.tolist():
        limit = math.inf if best is None else best.cost
        if task.goal_lower_bounds[k] >= limit or task.progress.search_deadline.has_passed:
            break
        via = np.array([task.start_lengths, task.goals.postures.length[k]])
        cost = task.price(via, limit)
        if cost < limit:
            best = task.path_to_goal(via, k, cost)
            yield best


# --- Lattices ------------------------------------------------------------------------------------


def lattice_spacings(task: SearchProblem, best: CylinderPath | None) -> list[float]:
    """Return the spacings of the lattices, in a decreasing geometric sequence.

    With an incumbent they depend on the largest stroke from the start to its waypoints or to a goal
    posture that may be cheaper. The first is a third of this stroke, at most `max_first_spacing`
    and not below the last. The last is the stroke over `finest_step_count`, between `min_spacing`
    and `max_last_spacing`. Without an incumbent the spacings run from `max_first_spacing` to
    `max_last_spacing`. The ratio of successive spacings is at most `spacing_ratio`. These limits
    are fields of `SearchLimits`.

    Args:
        task: The search problem.
        best: Incumbent; None if there is none.

    Returns:
        Spacings [m].
    """
    effort = task.limits
    if best is None:
        first, last = effort.max_first_spacing, effort.max_last_spacing
    else:
        worth = np.vstack(
            [best.waypoints, task.goals.postures.length[task.goal_lower_bounds < best.cost]]
        )
        stroke = float(np.max(np.abs(worth - task.start_lengths)))
        last = min(
            effort.max_last_spacing, max(effort.min_spacing, stroke / effort.finest_step_count)
        )
        first = min(effort.max_first_spacing, max(last, stroke / 3.0))
    count = math.ceil(math.log(first / last) / math.log(effort.spacing_ratio) - 1e-9) + 1
    return [first * (last / first) ** (k / max(1, count - 1)) for k in range(count)]


def yield_lattice_paths(
    task: SearchProblem, best: CylinderPath | None, work: SearchWork
) -> Iterator[CylinderPath | None]:
    """Search lattices of decreasing spacing and yield ever cheaper paths.

    Before each lattice the incumbent is refined with strides of its spacing. Each lattice is
    searched with the cost models of `_lattice_cost_models` one after the other. If the first finds
    nothing and there is no incumbent, the next lattice follows.

    A path over the lattice is refined, too. It is not if it costs no less than the incumbent and
    all its waypoints lie within one spacing of the incumbent's line. The search ends if the
    incumbent is close to the lower bound, or the time is up. With an incumbent it also ends once
    the expansions are used up.

    Args:
        task: The search problem.
        best: Incumbent; None if there is none.
        work: Updated in place with the work done so far.

    Yields:
        The incumbent after each refinement, even if it did not change, and each cheaper path. None
        comes once after QUICK_LATTICE_COUNT lattices, and before every lattice once half of the
        time is gone. The caller can then try something else.
    """
    for number, spacing in enumerate(lattice_spacings(task, best)):
        if number == QUICK_LATTICE_COUNT or task.progress.is_half_over:
            yield None
        if best is not None and may_be_improved(task, best, WORTH_A_LATTICE):
            best = refine(task, best, spacing)
            yield best
        for priced_by in _lattice_cost_models(task.cost_model, best):
            spent = best is not None and work.expanded >= task.limits.max_expansions
            if spent or not may_be_improved(task, best, WORTH_A_LATTICE):
                return
            found = search_lattice(task, priced_by, best, spacing, work)
            if found is None and best is None:
                break
            if found is not None and (best is None or not _runs_beside(found, best, spacing)):
                found = refine(task, found, spacing)
                if best is None or found.cost < best.cost:
                    best = found
                    yield best


def _lattice_cost_models(t: PathCostModel, best: CylinderPath | None) -> tuple[PathCostModel, ...]:
    """Return the cost models by which a lattice is searched, one after the other.

    The first does not boost loads that are held. On a lattice a slow cylinder rests in between,
    which in a motion would need no boost. Without an incumbent switches are free at first, so that
    each point is expanded once.

    Args:
        t: Cost model of the search problem.
        best: Incumbent; None if there is none.

    Returns:
        Two cost models; the second is `t` itself.
    """
    without = t._replace(circuit=t.circuit._replace(rest_speed=0.0))
    if best is None:
        return without._replace(weight=frozen(t.weight * [1.0, 1.0, 0.0])), t
    return without, t


def search_lattice(
    task: SearchProblem,
    priced_by: PathCostModel,
    best: CylinderPath | None,
    spacing: float,
    work: SearchWork,
) -> CylinderPath | None:
    """Search one lattice for a path that may be cheaper than the incumbent.

    Without an incumbent, a weighted A* expands FIRST_STATES states. If these are not enough, a
    second search accepts any path, without a limit on its states. The path found is priced with the
    real cost model.

    Args:
        task: The search problem.
        priced_by: Cost model by which the lattice is searched.
        best: Incumbent; None if there is none.
        spacing: Spacing of the lattice [m].
        work: Updated in place with the work done.

    Returns:
        The path. None if none was found, it is inadmissible at the real prices, or it costs
        WORTH_REFINING times the incumbent or more.
    """
    limit = math.inf if best is None else best.cost
    worth = np.flatnonzero(task.goal_lower_bounds < limit)
    search = create_lattice_search(task, priced_by, worth, spacing)
    if best is not None:
        left = task.limits.max_expansions - work.expanded
        heuristic_weight = (
            DEADLINE_HEURISTIC_WEIGHT
            if task.progress.has_deadline and len(task.start_lengths) > 3
            else 1.0
        )
        found = search.search(
            WORTH_FINDING * limit, left, task.progress.search_deadline, heuristic_weight
        )
        work.add(search)
    else:
        found = search.search(
            math.inf, FIRST_STATES, task.progress.search_deadline, FIRST_HEURISTIC_WEIGHT
        )
        work.add(search)
        if found is None and not search.exhausted:
            search = create_lattice_search(task, priced_by, worth, spacing)
            found = search.search(
                math.inf,
                sys.maxsize,
                task.progress.search_deadline,
                FIRST_HEURISTIC_WEIGHT,
                reachability_only=True,
            )
            work.add(search)
    if found is None:
        return None
    via, k = found
    cost = task.price(via, WORTH_REFINING * limit)
    return task.path_to_goal(via, int(worth[k]), cost) if cost < math.inf else None


def _runs_beside(found: CylinderPath, best: CylinderPath, spacing: float) -> bool:
    """Return whether a path costs no less than the incumbent and runs close to it.

    Args:
        found: The path.
        best: Incumbent.
        spacing: Greatest admissible distance of the path's waypoints from the incumbent's polyline,
            in each cylinder's length [m].

    Returns:
        True if refining the path would probably lead to the incumbent.
    """
    if found.cost < best.cost:
        return False
    start, way = best.waypoints[:-1], np.diff(best.waypoints, axis=0)
    off = found.waypoints[:, None] - start
    share = np.clip((off * way).sum(-1) / np.maximum((way * way).sum(-1), 1e-12), 0.0, 1.0)
    nearest = np.abs(off - share[..., None] * way).max(axis=-1).min(axis=1)
    return bool(nearest.max() < spacing)


def create_lattice_search(
    task: SearchProblem, priced_by: PathCostModel, goal_indices: IntArray, spacing: float
) -> LatticeSearch:
    """Create the search over a lattice to a selection of the goal postures.

    The spacing is increased if the lattice would have more than MAX_LATTICE_POINTS points.

    Args:
        task: The search problem.
        priced_by: Cost model by which the lattice is searched.
        goal_indices: Indices of the goal postures.
        spacing: Spacing of the lattice [m].

    Returns:
        A search that has not begun.
    """
    goals = Postures(*(column[goal_indices] for column in task.goals.postures))
    points = _create_lattice(task, spacing)
    while points.shape.prod() > MAX_LATTICE_POINTS:
        spacing *= SPACING_GROWTH
        points = _create_lattice(task, spacing)
    return LatticeSearch(priced_by, task.buffers, points, goals)


def _create_lattice(task: SearchProblem, spacing: float) -> Lattice:
    """Create the lattice of a search problem with a given spacing.

    With obstacles it is even in the joint positions, otherwise in the cylinder lengths.

    Args:
        task: The search problem.
        spacing: Spacing of the cylinder lengths [m]. With obstacles, no part of the arm moves by
            more than MAX_TURN_PER_SPACING · spacing in one step of one joint.

    Returns:
        The lattice.
    """
    if len(task.cost_model.obstacles) > 0:
        return lattice_even_in_angles(task.machine, task.start, MAX_TURN_PER_SPACING * spacing)
    return lattice_even_in_lengths(task.machine, task.start, spacing)


# --- Small changes -------------------------------------------------------------------------------


def _end_tip(task: SearchProblem, route: CylinderPath) -> tuple[float, float]:
    """Return the tip position at the end of a cylinder path.

    Args:
        task: The search problem.
        route: The path.

    Returns:
        Position (x, z) [m].
    """
    x, z = task.goals.tips[route.goal_index].tolist()
    return x, z


def refine(
    task: SearchProblem, best: CylinderPath, spacing: float, fine_sweeps: int = 1
) -> CylinderPath:
    """Improve a cylinder path by local changes in proportion to a lattice spacing.

    Removes waypoints, splits a straight line into three segments, and runs a compass search with
    decreasing strides. A sweep tries to move each waypoint by the stride. With all strides but the
    last, the sweeps price paths with coarse pieces. Their result is kept only if its cost with fine
    pieces is lower, too.

    Args:
        task: The search problem.
        best: The path.
        spacing: Lattice spacing, the unit of the strides [m].
        fine_sweeps: Largest number of sweeps with the last stride.

    Returns:
        The improved path; `best` itself if it is not cheaper.
    """
    via, _ = remove_waypoints(
        task.cost_model,
        task.buffers,
        best.waypoints,
        task.start,
        best.cost,
        task.progress.search_deadline,
    )
    if len(via) == 2:
        via = via[0] + np.linspace(0.0, 1.0, 4)[:, None] * (via[1] - via[0])
    route = replace(best, waypoints=via, cost=task.price(via))
    effort, last = task.limits, task.cost_model.max_piece_stroke
    rough = MAX_COARSE_PIECE_STROKE * task.machine.relative_size
    for stride in effort.stride_shares[:-1]:
        route = _sweep_with_stride(task, route, spacing, stride, effort.max_sweeps, rough)
    route = _sweep_with_stride(task, route, spacing, effort.stride_shares[-1], fine_sweeps, last)
    return route if route.cost < best.cost else best


def _sweep_with_stride(
    task: SearchProblem,
    route: CylinderPath,
    spacing: float,
    stride: float,
    rounds: int,
    piece: float,
) -> CylinderPath:
    """Run sweeps of a compass search with one stride over a path.

    The real cost is that by the problem's own cost model. The sweeps end early if the real cost
    rises above that of the best path. They also end if a sweep lowers the cost by less than
    GOOD_ENOUGH of it.

    Args:
        task: The search problem.
        route: The path.
        spacing: Lattice spacing [m].
        stride: Stride as a share of the spacing [-].
        rounds: Largest number of sweeps.
        piece: Largest stroke within the pieces by which the sweeps are priced [m].

    Returns:
        The path with the least real cost, the given one included.
    """
    t, w, until = task.cost_model, task.buffers, task.progress.search_deadline
    rough = t._replace(max_piece_stroke=piece)
    strides = Strides(stride * spacing, task.limits.goal_turn * stride * task.goals.free_units)
    via, free = route.waypoints.copy(), route.free.copy()
    path = SweptPath(via, task.start, _end_tip(task, route), route.elbow, free)
    cost = float(price_path(rough, w, via, task.start, math.inf))
    for _ in range(rounds):
        before = cost
        cost = sweep_waypoints(rough, w, path, cost, strides, until)
        counts = cost if piece == t.max_piece_stroke else task.price(via, route.cost)
        if counts < route.cost:
            route = replace(route, waypoints=via.copy(), free=free.copy(), cost=counts)
        if counts > route.cost or cost > (1.0 - GOOD_ENOUGH) * before:
            break
    return route
