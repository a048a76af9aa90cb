"""Postures of the posture table: the paper's planner (S2)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from mhsb_model.errors import MhsbError
from mhsb_planner.errors import DeadlineError
from mhsb_planner.goal_region import is_met, tips
from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.planners.path_planner import Candidate, PathPlanner, Task
from mhsb_planner.search import s2_search
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_search import SAME_POINT
from mhsb_planner.search.search_time import SearchTime


class TablePlanner:
    """Path and modes over the graph of the posture table."""

    name = "table"
    summary = "takes the postures of the posture table"
    trajectory: TrajectoryKind = "polynomial"
    weighs_area = False
    rivals: tuple[PathPlanner, ...] = ()
    takes: tuple[str, ...] = ("search", "heuristic_scale")

    def paths(self, graph: StepGraph, task: Task, time: SearchTime) -> Iterator[Candidate]:
        """The path of least cost, or the published search's."""
        yield from map(Candidate, paths_over(graph, task, time))

    def warm_up(self, graph: StepGraph) -> None:
        """Compile what paths run through."""
        s2_search.warm_up(graph)


def paths_over(graph: StepGraph, task: Task, time: SearchTime) -> Iterator[DiscretePath]:
    """Paths over a graph: to the goal itself, and to where in its region it costs least.

    Raises what `s2_search.search` raises of the goal itself where there is no path at all.
    """
    if _is_there(graph, task):
        tip = graph.machine.tip_position(task.departure)
        yield DiscretePath.standing(tip, task.departure, task.modes.modes, 0.0)
        return
    region = task.options.goal_region
    found: list[DiscretePath] = []
    refused: MhsbError | None = None
    for x, z in tips(task.in_plane, region).tolist():
        try:
            path = _path_to((x, z), graph, task, time)
        except MhsbError as error:
            refused = refused or error
            if isinstance(error, DeadlineError):
                break
            continue
        bound = path.lower_bound + graph.machine.arrays.supply_pressure * task.meanwhile.oil
        bound = bound if region is None else task.bound(graph)
        found.append(replace(path, lower_bound=bound))
        if len(found) == 1:
            yield found[0]
    if refused is not None and not found:
        raise refused
    best = min(found, key=lambda path: path.cost)
    if best is not found[0]:
        yield best


def _is_there(graph: StepGraph, task: Task) -> bool:
    options, posture = task.options, task.departure
    if options.goal_region is None:
        return False  # for the search to find
    tip, angle = graph.machine.tip_position(posture), graph.machine.end_link_angle(posture)
    return is_met(
        task.in_plane, options.goal_region, options.goal_psi, tip, angle, SAME_POINT, SAME_POINT
    )


def _path_to(
    tip: tuple[float, float], graph: StepGraph, task: Task, time: SearchTime
) -> DiscretePath:
    options = task.options
    return s2_search.search(
        graph,
        task.departure,
        task.modes.modes,
        tip,
        options.weights,
        options.energy_reading,
        method=options.search,
        heuristic_scale=options.heuristic_scale,
        goal_psi=options.goal_psi,
        deadline=time.until,
        max_expansions=options.max_expansions,
    )
