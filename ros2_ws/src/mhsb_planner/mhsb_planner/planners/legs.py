"""Paths through points on the way: leg by leg, joined to one path that need not stop there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from mhsb_model.machine import Machine
from mhsb_planner.planners.path_planner import Candidate, PathPlanner, Task
from mhsb_planner.planners.resting import with_rests
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.search_time import SearchTime


class PathSource(Protocol):
    """Where paths of the whole arm come from."""

    @property
    def machine(self) -> Machine:
        """The whole arm."""

    def bound(self, task: Task) -> float:
        """No plan takes less energy [J]."""

    def paths(self, task: Task, time: SearchTime) -> Iterator[Candidate]:
        """Paths from the task's departure to its goal; see `PathPlanner.paths`."""


@dataclass(frozen=True, eq=False)
class PlanePaths:
    """Those of a planner of an arm that moves in the graph's plane alone."""

    planner: PathPlanner
    graph: StepGraph

    @property
    def machine(self) -> Machine:
        """That of the graph."""
        return self.graph.machine

    def bound(self, task: Task) -> float:
        """No plan takes less energy [J]."""
        return task.bound(self.graph)

    def paths(self, task: Task, time: SearchTime) -> Iterator[Candidate]:
        """What the planner has."""
        return self.planner.paths(self.graph, task, time)


def paths_by_way(source: PathSource, task: Task, time: SearchTime) -> Iterator[Candidate]:
    """Paths from the task's departure to its goal, through the points on the way in their order.

    First with what each leg begins with, then with the cheapest path of each. A leg ends in the
    posture that is best for itself. Each path comes once more with rests at these points, for arms
    whose motion would else pass them by. Raises what the source's paths raise.
    """
    if not task.options.via:
        yield from source.paths(task, time)
        return
    bound = source.bound(task)
    for thorough in (False, True):
        legs: list[DiscretePath] = []
        onward = replace(task, options=task.options.on_the_way)
        for point in task.options.via:
            legs.append(path_of_leg(source, replace(onward, goal=point), time, thorough))
            onward = onward.from_rest(legs[-1])
        last = replace(onward, goal=task.goal, options=task.options.at_the_end)
        for candidate in source.paths(last, time):
            whole = replace(joined([*legs, candidate.path]), lower_bound=bound)
            yield candidate._replace(path=whole)
            before = np.cumsum([leg.steps for leg in legs])
            before = np.unique(before[(before > 0) & (before < whole.steps)])
            if len(before) > 0:
                rested = with_rests(source.machine, whole, before, task.options.weights)
                yield candidate._replace(path=rested)


def path_of_leg(
    source: PathSource, task: Task, time: SearchTime, thorough: bool
) -> DiscretePath:
    """The first path to a point on the way, or the cheapest."""
    found = (candidate.path for candidate in source.paths(task, time))
    first = next(found)
    return min([first, *found], key=lambda path: path.cost) if thorough else first


def joined(legs: Sequence[DiscretePath]) -> DiscretePath:
    """One path of several, each of which begins where and in the modes in which the last ended.

    Its lower bound is the first one's.
    """
    first = legs[0]

    def through(name: str) -> np.ndarray:
        """Places of all legs; each begins in the last one's last."""
        rest = (getattr(leg, name)[1:] for leg in legs[1:])
        return np.concatenate([getattr(first, name), *rest])

    def steps(name: str) -> np.ndarray:
        return np.concatenate([getattr(leg, name) for leg in legs])

    return DiscretePath(
        tip=through("tip"),
        posture=through("posture"),
        modes=steps("modes"),
        duration=steps("duration"),
        energy=steps("energy"),
        energy_series=steps("energy_series"),
        cost=sum(leg.cost for leg in legs),
        start_modes=first.start_modes,
        lower_bound=first.lower_bound,
        statistics=SearchStatistics(
            sum(leg.statistics.expanded for leg in legs),
            sum(leg.statistics.generated for leg in legs),
            sum(leg.statistics.seconds for leg in legs),
        ),
    )
