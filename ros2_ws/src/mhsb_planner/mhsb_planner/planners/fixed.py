"""Planner by the conventional method: all joints except two keep their angles."""

from collections.abc import Iterator

from mhsb_planner.planners.path_planner import PathPlanner, PathProposal, PathRequest
from mhsb_planner.planners.table import yield_graph_paths
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search import fixed_j3
from mhsb_planner.search.s2_graph import StepGraph


class FixedPlanner(PathPlanner):
    """Planner that keeps joint 3 at its start angle, and searches a graph built for that angle."""

    name = "fixed"
    summary = "keeps joint 3 and changes it by 1 degree at a time where the others have no solution"
    trajectory = "polynomial"
    takes = ("search", "heuristic_scale", "initial_j3")

    def paths(
        self, graph: StepGraph, request: PathRequest, progress: PlanProgress
    ) -> Iterator[PathProposal]:
        """Yield paths in the graph of kept joints, by the exact or the published search.

        In this graph, all joints except two keep their start angles, clipped to the limits. If
        `options.initial_j3` is given, joint 3 keeps this angle. Each call builds the graph and
        prices all its steps. `options.search` chooses the search. The published search (the
        paper's) keeps one label per node, and may miss the cheapest path.

        Args:
            graph: Step graph of the posture table; only machine, posture table and grid are read.
            request: The request.
            progress: State of the planning loop, with the time limit of the search.

        Yields:
            First a path to the goal itself or, if there is none, to another position of the goal
            region. Then the cheapest path to any position of the region, if it differs from the
            first path.

        Raises:
            MhsbError: There is no path, or the deadline passed before one was found.
        """
        machine, j3 = graph.machine, request.options.initial_j3
        kept = fixed_j3.read_kept_angles(
            machine, request.departure
        )  # a noisy start may be beyond limits
        own = fixed_j3.build_fixed_j3_graph(
            machine,
            graph.table,
            kept if j3 is None else j3,
            fixed_j3.find_elbow_side(machine, request.departure),
            grid=graph.grid,
            deadline=progress.search_deadline,
        )
        yield from map(PathProposal, yield_graph_paths(own, request, progress))

    def warm_up(self, graph: StepGraph) -> None:
        """Compile the kernels of the conventional method."""
        fixed_j3.warm_up(graph)
