"""Postures of the posture table: the paper's planner (S2)."""

from __future__ import annotations

from collections.abc import Iterator

from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.planners.path_planner import Candidate, Task
from mhsb_planner.search import s2_search
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.search_time import SearchTime


class TablePlanner:
    """Path and modes over the graph of the posture table."""

    name = "table"
    summary = "takes the postures of the posture table"
    trajectory: TrajectoryKind = "polynomial"
    weighs_area = False

    def paths(self, graph: StepGraph, task: Task, time: SearchTime) -> Iterator[Candidate]:
        """The path of least cost, or the published search's."""
        yield Candidate(path_over(graph, task, time))

    def warm_up(self, graph: StepGraph) -> None:
        """Compile what paths run through."""
        s2_search.warm_up(graph)


def path_over(graph: StepGraph, task: Task, time: SearchTime) -> DiscretePath:
    """The path over a graph; raises what `s2_search.search` raises."""
    options = task.options
    return s2_search.search(
        graph,
        task.departure,
        task.modes.modes,
        task.goal,
        options.weights,
        options.energy_reading,
        method=options.search,
        heuristic_scale=options.heuristic_scale,
        goal_psi=options.goal_psi,
        deadline=time.until,
        max_expansions=options.max_expansions,
    )
