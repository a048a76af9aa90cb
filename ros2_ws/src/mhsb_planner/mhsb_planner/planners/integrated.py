"""Path, posture and modes decided together (`mhsb_planner.integrated`).

The motion is compared with that along the table planner's path and, where the area has a weight,
along the path that is found without: what a path promises is not always kept by its motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_planner.integrated import integrated_search
from mhsb_planner.integrated.integrated_search import IntegratedSearch
from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.planners.path_planner import Candidate, Task
from mhsb_planner.planners.table import path_over
from mhsb_planner.search.area_shortfall import WITHOUT_AREA, AreaTerm, area_along_path
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.search_time import SearchTime


class IntegratedPlanner:
    """Ever cheaper routes in the space of cylinder lengths, and others to compare them with."""

    name = "integrated"
    summary = "decides postures together with path and modes"
    trajectory: TrajectoryKind = "followed"
    weighs_area = True

    def paths(self, graph: StepGraph, task: Task, time: SearchTime) -> Iterator[Candidate]:
        """Own paths; in between, as soon as these have no motion, or last, the others.

        With the area weighed lower bounds say little and the search is long: the others come
        before it.
        """
        machine = graph.machine
        own = _search(machine, task, time, task.area)
        others = [lambda: path_over(graph, task, time)]
        if task.area.weight > 0.0:
            others.append(lambda: _search(machine, task, time, WITHOUT_AREA).last())
        for path in own.paths():
            if path is not None:
                yield Candidate(path)
            if task.area.weight > 0.0 or not time.found:
                yield from _compared(machine, task, own.lower_bound, others)
                others = []
        yield from _compared(machine, task, own.lower_bound, others)
        if task.options.goal_region is not None:  # no dearer than to the goal itself
            alone = replace(task, options=replace(task.options, goal_region=None))
            with suppress(MhsbError):
                for candidate in self.paths(graph, alone, time):
                    path = replace(candidate.path, lower_bound=own.lower_bound)
                    yield candidate._replace(path=path, compared=True)

    def warm_up(self, graph: StepGraph) -> None:
        """Compile what paths run through."""
        integrated_search.warm_up(graph.machine)


def _search(machine: Machine, task: Task, time: SearchTime, area: AreaTerm) -> IntegratedSearch:
    options = task.options
    return IntegratedSearch(
        machine,
        task.departure,
        task.modes.modes,
        task.goal,
        options.weights,
        options.energy_reading,
        goal_psi=options.goal_psi,
        goal_region=options.goal_region,
        certified_from=task.start.position,
        area=area,
        time=time,
    )


def _compared(
    machine: Machine,
    task: Task,
    lower_bound: float,
    others: list[Callable[[], DiscretePath]],
) -> Iterator[Candidate]:
    """Paths found elsewhere, as far as they are, with what they give up of the area."""
    for other in others:
        try:
            path = replace(other(), lower_bound=lower_bound)
        except MhsbError:
            continue
        if task.area.weight > 0.0:
            shortfall = area_along_path(machine, path).shortfall(task.area.reference)
            path = replace(path, cost=path.cost + task.area.weight * shortfall)
        yield Candidate(path, compared=True)
