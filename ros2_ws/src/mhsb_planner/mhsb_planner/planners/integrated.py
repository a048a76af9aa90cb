"""Path, posture and modes decided together (`mhsb_planner.integrated`).

The motion is compared with those of the table planner and of the one that keeps joint 3, along
their paths in their own way and in this one's, with that along the path that is found where time
costs a little more, and, where the area has a weight, with that along the path that is found
without: what a path promises is not always kept by its motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain, islice

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_planner.integrated import integrated_search
from mhsb_planner.integrated.integrated_search import IntegratedSearch
from mhsb_planner.integrated.task import Effort
from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.planners.fixed import FixedPlanner
from mhsb_planner.planners.path_planner import Candidate, PathPlanner, Task, in_both_ways
from mhsb_planner.planners.table import TablePlanner
from mhsb_planner.search.area_shortfall import WITHOUT_AREA, AreaTerm, area_along_path
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.search_time import SearchTime

HURRY = 2.0
"""Of paths that cost nearly the same the shorter makes the cheaper motion, as a rule: it is sought
once more with so much energy a second [W], for which a motion's ramps and switches are taken."""

HURRIED_STATES = 4000
"""States of lattices that this may take."""


RIVALS: tuple[PathPlanner, ...] = (TablePlanner(), FixedPlanner())
"""Their motions are compared with its own."""


class IntegratedPlanner:
    """Ever cheaper routes in the space of cylinder lengths, and others to compare them with."""

    name = "integrated"
    summary = "decides postures together with path and modes"
    trajectory: TrajectoryKind = "followed"
    weighs_area = True
    rivals: tuple[PathPlanner, ...] = RIVALS
    takes: tuple[str, ...] = ()

    def paths(self, graph: StepGraph, task: Task, time: SearchTime) -> Iterator[Candidate]:
        """Own paths; in between, as soon as these have no motion or take long, or half the time is
        gone, the table planner's, at the next occasion the other's, which take longer to find.
        Where what moves meanwhile takes longer than the first path, paths that leakage does not
        hurry come next.

        With the area weighed lower bounds say little and the search is long: the others come
        before it. For what comes when with a deadline see `_soon`.
        """
        own = _search(graph.machine, task, time, task.area)
        if time.ends and task.area.weight == 0.0 and task.options.period == 0.0:
            yield from _soon(own, graph, task, time)
        else:
            yield from _thoroughly(own, graph, task, time)
        if task.area.weight == 0.0:
            for path in _hurried(graph.machine, task, time):
                yield Candidate(replace(path, lower_bound=own.lower_bound), True)
        if task.options.goal_region is not None:  # no dearer than to the goal itself
            alone = replace(task, options=replace(task.options, goal_region=None))
            with suppress(MhsbError):
                for candidate in self.paths(graph, alone, time):
                    path = replace(candidate.path, lower_bound=own.lower_bound)
                    yield candidate._replace(path=path, compared=True)

    def warm_up(self, graph: StepGraph) -> None:
        """Compile what paths run through."""
        integrated_search.warm_up(graph.machine)
        for planner in self.rivals:
            planner.warm_up(graph)


def _thoroughly(
    own: IntegratedSearch, graph: StepGraph, task: Task, time: SearchTime
) -> Iterator[Candidate]:
    """Own paths and the other planners', as `IntegratedPlanner.paths` says."""
    waits, weighed = False, task.area.weight > 0.0
    others = list(RIVALS)
    for path in own.paths():
        if path is not None:
            yield Candidate(path)
            if not waits and task.meanwhile.time > path.duration.sum():
                waits = True
                yield from _patient(own, graph, task, time)
        if others and (path is None or not time.found or time.half_gone or weighed):
            now = others if weighed else others[:1]
            others = others[len(now):]
            yield from _others(graph, task, time, own.lower_bound, now)
    yield from _others(graph, task, time, own.lower_bound, others)


def _soon(
    own: IntegratedSearch, graph: StepGraph, task: Task, time: SearchTime
) -> Iterator[Candidate]:
    """With a deadline: the table planner's path comes right after the first own one, or before it
    where that takes long. It is there within a millisecond or two, and no plan is to be dearer.

    All else of others waits until the own search has ended, or half the time is gone without a
    motion: the other planner's path may take longer than there is time, and the table's polynomial
    is seldom kept.
    """
    waits, looked = False, False
    table, fixed = (
        _others(graph, task, time, own.lower_bound, [planner])
        for planner in RIVALS
    )
    for path in own.paths():
        if path is not None:
            yield Candidate(path)
        if not looked:
            looked = True
            yield from islice(table, 1)
        elif not time.found and time.half_gone:
            yield from _until_found(chain(table, fixed), time)
        if path is not None and not waits and task.meanwhile.time > path.duration.sum():
            waits = True
            yield from _patient(own, graph, task, time)
    yield from chain(table, fixed)


def _until_found(candidates: Iterator[Candidate], time: SearchTime) -> Iterator[Candidate]:
    """As many of them as it takes until there is a motion."""
    for candidate in candidates:
        yield candidate
        if time.found:
            return


def _search(
    machine: Machine,
    task: Task,
    time: SearchTime,
    area: AreaTerm,
    effort: Effort | None = None,
    *,
    leaks: bool = True,
) -> IntegratedSearch:
    options = task.options
    return IntegratedSearch(
        machine,
        task.departure,
        task.modes.modes,
        task.in_plane,
        options.weights,
        options.energy_reading,
        goal_psi=options.goal_psi,
        goal_region=options.goal_region,
        certified_from=task.start.position,
        area=area,
        others=task.meanwhile,
        leaks=leaks,
        time=time,
        effort=effort,
    )


def _patient(
    own: IntegratedSearch, graph: StepGraph, task: Task, time: SearchTime
) -> Iterator[Candidate]:
    """Paths that are cheapest where others take their time: leakage goes on anyway."""
    with suppress(MhsbError):
        search = _search(graph.machine, task, time, task.area, leaks=False)
        for path in search.paths():
            if path is not None:
                yield Candidate(replace(path, lower_bound=own.lower_bound))


def _hurried(machine: Machine, task: Task, time: SearchTime) -> Iterator[DiscretePath]:
    """The path that is cheapest where time costs a little, with what it costs where it does not.

    Not for a motion that is soon to be followed by another.
    """
    weights = task.options.weights
    haste = HURRY * weights.energy
    if haste == 0.0 or task.options.period > 0.0:
        return
    options = replace(task.options, weights=replace(weights, time=weights.time + haste))
    effort = Effort(expansions=HURRIED_STATES)
    with suppress(MhsbError):
        path = _search(machine, replace(task, options=options), time, WITHOUT_AREA, effort).last()
        yield replace(path, cost=path.cost - haste * float(path.duration.sum()))


def _others(
    graph: StepGraph,
    task: Task,
    time: SearchTime,
    lower_bound: float,
    planners: Sequence[PathPlanner],
) -> Iterator[Candidate]:
    """Paths found elsewhere, as far as they are, with what they give up of the area."""
    for candidate in _elsewhere(graph, task, time, planners):
        path = replace(candidate.path, lower_bound=lower_bound)
        if task.area.weight > 0.0:
            shortfall = area_along_path(graph.machine, path).shortfall(task.area.reference)
            path = replace(path, cost=path.cost + task.area.weight * shortfall)
        yield Candidate(path, True, candidate.trajectory)


def _elsewhere(
    graph: StepGraph, task: Task, time: SearchTime, planners: Sequence[PathPlanner]
) -> Iterator[Candidate]:
    if task.area.weight > 0.0 and planners:
        with suppress(MhsbError):
            yield Candidate(_search(graph.machine, task, time, WITHOUT_AREA).last())
        yield from map(Candidate, _hurried(graph.machine, task, time))
    for planner in planners:
        with suppress(MhsbError):
            for candidate in planner.paths(graph, task, time):
                yield from in_both_ways(candidate, planner, task)
