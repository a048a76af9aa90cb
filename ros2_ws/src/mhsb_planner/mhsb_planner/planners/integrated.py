"""Integrated planner: decides path, posture and modes together (`mhsb_planner.integrated`).

A motion may cost more than the estimate for its path. The planner therefore proposes other paths
for comparison, too:

- the paths of the baselines (the table planner and the fixed-joint planner), each fitted by the
  baseline's method of S3 and by this planner's method;
- the path that is cheapest if each second costs TIME_PRICE [W] more;
- if the area has a weight, the path that is found without it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain, islice

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_planner.deadline import SearchTime
from mhsb_planner.integrated import integrated_search
from mhsb_planner.integrated.integrated_search import IntegratedSearch
from mhsb_planner.integrated.search_problem import SearchLimits
from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.planners.fixed import FixedPlanner
from mhsb_planner.planners.path_planner import (
    PathPlanner,
    PathProposal,
    PathRequest,
    propose_in_both_ways,
)
from mhsb_planner.planners.table import TablePlanner
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.manipulability_loss import WITHOUT_AREA, AreaTerm, area_along_path
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_search import PathQuery

TIME_PRICE = 2.0
"""Power at which time is charged in an additional search [W].

Of two paths of nearly equal cost, the shorter usually makes the cheaper motion. The value stands
for the energy of a motion's ramps and switches.
"""

HURRIED_STATES = 4000
"""Largest number of lattice states that the additional search may expand."""


BASELINE_PLANNERS: tuple[PathPlanner, ...] = (TablePlanner(), FixedPlanner())
"""Planners whose motions are compared with its own, the faster first."""


class IntegratedPlanner:
    """Planner over the space of cylinder lengths that compares its motion with baselines."""

    name = "integrated"
    summary = "decides postures together with path and modes"
    trajectory: TrajectoryKind = "followed"
    weighs_area = True
    baselines: tuple[PathPlanner, ...] = BASELINE_PLANNERS
    takes: tuple[str, ...] = ()

    def paths(
        self, graph: StepGraph, task: PathRequest, time: SearchTime
    ) -> Iterator[PathProposal]:
        """Yield the planner's own paths and, in between, paths of the baselines for comparison.

        With a deadline, but without an area weight or another motion that follows, the order of
        work is that of `_schedule_for_deadline`. Otherwise it is that of
        `_schedule_without_deadline`. Without an area weight, the path that is cheapest if time
        costs TIME_PRICE more comes next. With a goal region, everything is repeated for the goal
        alone, because the result must cost no more than without the region. All paths carry the
        lower bound of the first search.

        Args:
            graph: Step graph of the posture table; provides machine and table.
            task: The request.
            time: Time limit; the consumer sets its `has_motion` once there is a motion.

        Yields:
            Path proposals; `for_comparison` marks all that are not from the planner's main search
            to the goal or region.
        """
        own = _create_search(graph.machine, task, time, task.area)
        if time.has_deadline and task.area.weight == 0.0 and task.options.period == 0.0:
            yield from _schedule_for_deadline(own, graph, task, time)
        else:
            yield from _schedule_without_deadline(own, graph, task, time)
        if task.area.weight == 0.0:
            for path in _path_with_time_price(graph.machine, task, time):
                yield PathProposal(replace(path, lower_bound=own.lower_bound), True)
        if task.options.goal_region is not None:  # must cost no more than to the goal itself
            alone = replace(task, options=replace(task.options, goal_region=None))
            with suppress(MhsbError):
                for candidate in self.paths(graph, alone, time):
                    path = replace(candidate.path, lower_bound=own.lower_bound)
                    yield candidate._replace(path=path, for_comparison=True)

    def warm_up(self, graph: StepGraph) -> None:
        """Compile the kernels of this planner and of its baselines.

        Args:
            graph: Step graph of the posture table; provides the machine.
        """
        integrated_search.warm_up(graph.machine)
        for planner in self.baselines:
            planner.warm_up(graph)


def _schedule_without_deadline(
    own: IntegratedSearch, graph: StepGraph, task: PathRequest, time: SearchTime
) -> Iterator[PathProposal]:
    """Yield own paths and the baselines' paths, without a tight schedule.

    The paths of the next baseline come after an own path if there is no motion yet, or if half of
    the time is gone. They also come before a long stage of the own search. With an area weight the
    paths of all baselines come after the first own path, because lower bounds are weak then and the
    search is long. After the first own path that is shorter than the slew's least time, paths that
    ignore leakage follow. The remaining baselines come last.

    Args:
        own: The planner's own search.
        graph: Step graph of the posture table.
        task: The request.
        time: Time limit; `has_motion` is True once the consumer has a motion.

    Yields:
        Path proposals.
    """
    waits, weighed = False, task.area.weight > 0.0
    others = list(BASELINE_PLANNERS)
    for path in own.paths():
        if path is not None:
            yield PathProposal(path)
            if not waits and task.slew_demand.time > path.duration.sum():
                waits = True
                yield from _paths_ignoring_leakage(own, graph, task, time)
        if others and (path is None or not time.has_motion or time.is_half_over or weighed):
            now = others if weighed else others[:1]
            others = others[len(now) :]
            yield from _comparison_paths(graph, task, time, own.lower_bound, now)
    yield from _comparison_paths(graph, task, time, own.lower_bound, others)


def _schedule_for_deadline(
    own: IntegratedSearch, graph: StepGraph, task: PathRequest, time: SearchTime
) -> Iterator[PathProposal]:
    """Yield own paths and the baselines' paths in the order for a deadline.

    The table planner's first path comes right after the first own path, or before it if that takes
    long. It takes a millisecond or two, and no plan may cost more than the table planner's. All
    other baseline paths wait for the end of the own search. They come earlier if half of the time
    is gone without a motion. The fixed-joint planner may take longer than there is time, and the
    table's polynomial seldom keeps the limits. After the first own path that is shorter than the
    slew's least time, paths that ignore leakage follow.

    Args:
        own: The planner's own search.
        graph: Step graph of the posture table.
        task: The request.
        time: Time limit; `has_motion` is True once the consumer has a motion.

    Yields:
        Path proposals.
    """
    waits, looked = False, False
    table, fixed = (
        _comparison_paths(graph, task, time, own.lower_bound, [planner])
        for planner in BASELINE_PLANNERS
    )
    for path in own.paths():
        if path is not None:
            yield PathProposal(path)
        if not looked:
            looked = True
            yield from islice(table, 1)
        elif not time.has_motion and time.is_half_over:
            yield from _until_motion_found(chain(table, fixed), time)
        if path is not None and not waits and task.slew_demand.time > path.duration.sum():
            waits = True
            yield from _paths_ignoring_leakage(own, graph, task, time)
    yield from chain(table, fixed)


def _until_motion_found(
    candidates: Iterator[PathProposal], time: SearchTime
) -> Iterator[PathProposal]:
    """Yield proposals until the consumer has made a motion of one of them.

    Args:
        candidates: Path proposals.
        time: Time limit; `has_motion` is True once the consumer has a motion.

    Yields:
        The proposals up to the first one that has given a motion; all if none has.
    """
    for candidate in candidates:
        yield candidate
        if time.has_motion:
            return


def _create_search(
    machine: Machine,
    task: PathRequest,
    time: SearchTime,
    area: AreaTerm,
    effort: SearchLimits | None = None,
    *,
    leaks: bool = True,
) -> IntegratedSearch:
    """Create an integrated search for a request.

    Args:
        machine: The arm in its plane.
        task: The request.
        time: Time limit, shared with the caller.
        area: Area term to search with; it may differ from the request's.
        effort: Limits on the number of states that the search expands; None: defaults.
        leaks: Whether leakage counts when paths are compared.

    Returns:
        The search, which has not begun.
    """
    options = task.options
    query = PathQuery(
        task.departure,
        task.modes.modes,
        task.planar_goal,
        options.weights,
        options.energy_reading,
        options.goal_psi,
    )
    return IntegratedSearch(
        machine,
        query,
        goal_region=options.goal_region,
        bound_from=task.start.position,
        area=area,
        slew_demand=task.slew_demand,
        counts_leakage=leaks,
        time=time,
        limits=effort,
    )


def _paths_ignoring_leakage(
    own: IntegratedSearch, graph: StepGraph, task: PathRequest, time: SearchTime
) -> Iterator[PathProposal]:
    """Yield the paths of an own search that ignores leakage when it compares paths.

    If the slew determines the duration, leakage flows for that duration on every path. These paths
    are then the cheapest. Errors of the search end the generator without a message.

    Args:
        own: The planner's own search, whose lower bound the paths carry.
        graph: Step graph of the posture table.
        task: The request.
        time: Time limit of the search.

    Yields:
        Path proposals, with the cost that the search without leakage states.
    """
    with suppress(MhsbError):
        search = _create_search(graph.machine, task, time, task.area, leaks=False)
        for path in search.paths():
            if path is not None:
                yield PathProposal(replace(path, lower_bound=own.lower_bound))


def _path_with_time_price(
    machine: Machine, task: PathRequest, time: SearchTime
) -> Iterator[DiscretePath]:
    """Yield the path that is cheapest if each second costs as much as TIME_PRICE joules more.

    The cost that the path states does not contain this surcharge. Nothing is yielded if energy has
    no weight or another motion is to follow. The area is ignored. At most HURRIED_STATES states are
    expanded. Errors of the search end the generator without a message.

    Args:
        machine: The arm in its plane.
        task: The request.
        time: Time limit of the search.

    Yields:
        At most one path.
    """
    weights = task.options.weights
    time_price = TIME_PRICE * weights.energy
    if time_price == 0.0 or task.options.period > 0.0:
        return
    options = replace(task.options, weights=replace(weights, time=weights.time + time_price))
    effort = SearchLimits(max_expansions=HURRIED_STATES)
    with suppress(MhsbError):
        path = _create_search(
            machine, replace(task, options=options), time, WITHOUT_AREA, effort
        ).best_path()
        yield replace(path, cost=path.cost - time_price * float(path.duration.sum()))


def _comparison_paths(
    graph: StepGraph,
    task: PathRequest,
    time: SearchTime,
    lower_bound: float,
    planners: Sequence[PathPlanner],
) -> Iterator[PathProposal]:
    """Yield paths for comparison, with the given lower bound.

    If the area has a weight, each path's cost grows by that weight times the path's area shortfall.

    Args:
        graph: Step graph of the posture table.
        task: The request.
        time: Time limit of the searches.
        lower_bound: Lower bound on the energy that the paths are to carry [J].
        planners: Baselines that propose paths.

    Yields:
        Path proposals, all with `for_comparison` set.
    """
    for candidate in _unpriced_comparison_paths(graph, task, time, planners):
        path = replace(candidate.path, lower_bound=lower_bound)
        if task.area.weight > 0.0:
            shortfall = area_along_path(graph.machine, path).compute_area_loss(task.area.reference)
            path = replace(path, cost=path.cost + task.area.weight * shortfall)
        yield PathProposal(path, True, candidate.trajectory)


def _unpriced_comparison_paths(
    graph: StepGraph, task: PathRequest, time: SearchTime, planners: Sequence[PathPlanner]
) -> Iterator[PathProposal]:
    """Yield paths for comparison, with costs and lower bounds as their searches state them.

    With an area weight, two paths come first: the one found without the area, and the one for which
    time costs TIME_PRICE more. The baselines' paths follow, each proposed twice if the options
    leave S3's method open (`propose_in_both_ways`). Errors of one search do not prevent the next.

    Args:
        graph: Step graph of the posture table.
        task: The request.
        time: Time limit of the searches.
        planners: Baselines that propose paths.

    Yields:
        Path proposals.
    """
    if task.area.weight > 0.0 and planners:
        with suppress(MhsbError):
            yield PathProposal(_create_search(graph.machine, task, time, WITHOUT_AREA).best_path())
        yield from map(PathProposal, _path_with_time_price(graph.machine, task, time))
    for planner in planners:
        with suppress(MhsbError):
            for candidate in planner.paths(graph, task, time):
                yield from propose_in_both_ways(candidate, planner, task)
