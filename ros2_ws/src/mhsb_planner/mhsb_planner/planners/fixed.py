"""Joint 3, or all but two, stay where they are: the conventional method (`fixed_j3`)."""

from __future__ import annotations

from collections.abc import Iterator

from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.planners.path_planner import Candidate, PathPlanner, Task
from mhsb_planner.planners.table import paths_over
from mhsb_planner.search import fixed_j3
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.search_time import SearchTime


class FixedPlanner:
    """Path and modes over a graph that depends on the start and is made for it."""

    name = "fixed"
    summary = "keeps joint 3 and changes it by 1 degree at a time where the others have no solution"
    trajectory: TrajectoryKind = "polynomial"
    weighs_area = False
    rivals: tuple[PathPlanner, ...] = ()
    takes: tuple[str, ...] = ("search", "heuristic_scale", "initial_j3")

    def paths(self, graph: StepGraph, task: Task, time: SearchTime) -> Iterator[Candidate]:
        """The path of least cost, or the published search's."""
        machine, j3 = graph.machine, task.options.initial_j3
        kept = fixed_j3.kept_angles(machine, task.departure)  # noise may put a start beyond limits
        own = fixed_j3.fixed_j3_graph(
            machine,
            graph.table,
            kept if j3 is None else j3,
            fixed_j3.elbow_side(machine, task.departure),
            grid=graph.grid,
            deadline=time.until,
        )
        yield from map(Candidate, paths_over(own, task, time))

    def warm_up(self, graph: StepGraph) -> None:
        """Compile what paths run through."""
        fixed_j3.warm_up(graph)
