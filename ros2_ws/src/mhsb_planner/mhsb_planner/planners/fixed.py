"""Planner by the conventional method: all joints except two keep their angles."""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from mhsb_model.types import FloatArray
from mhsb_planner.deadline import Deadline
from mhsb_planner.planners.path_planner import PathPlanner, PathProposal, PathRequest
from mhsb_planner.planners.table import yield_graph_paths
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search import fixed_j3
from mhsb_planner.search.s2_graph import StepGraph


class FixedPlanner(PathPlanner):
    """Planner that keeps joint 3 at its start angle, and searches a graph built for that angle."""

    name = "fixed"
    summary = "keeps joint 3 and changes it by 1 degree at a time where the others have no solution"
    trajectory = "polynomial"
    takes = ("search", "heuristic_scale", "initial_j3")
    _newest: ClassVar[tuple[tuple[PostureTable, bytes, int] | None, StepGraph | None]] = None, None
    """Posture table, kept joints and elbow side of the newest graph, and this graph."""

    def paths(
        self, graph: StepGraph, request: PathRequest, progress: PlanProgress
    ) -> Iterator[PathProposal]:
        """Yield paths in the graph of kept joints, by the exact or the published search.

        In this graph, all joints except two keep their start angles, clipped to the limits. If
        `options.initial_j3` is given, joint 3 keeps this angle. `options.search` chooses the
        search. The published search (the paper's) keeps one label per node, and may miss the
        cheapest path.

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
        own = self._find_graph(graph, request, progress.search_deadline)
        yield from map(PathProposal, yield_graph_paths(own, request, progress))

    def _find_graph(self, graph: StepGraph, request: PathRequest, deadline: Deadline) -> StepGraph:
        """Return the graph of kept joints for the start of a request.

        The newest graph is kept for later calls with the same posture table, kept joints and elbow
        side. For another machine on that table only its steps are priced anew.

        Args:
            graph: Step graph of the posture table.
            request: The request.
            deadline: Instant at which the work is given up.

        Returns:
            The graph, with all steps priced.

        Raises:
            RequestError: `options.initial_j3` has the wrong length or is beyond a joint limit.
            DeadlineError: The deadline passed.
        """
        machine, j3 = graph.machine, request.options.initial_j3
        kept: float | FloatArray = (
            fixed_j3.read_kept_angles(machine, request.departure)  # noisy, it may be beyond limits
            if j3 is None
            else j3
        )
        elbow = fixed_j3.find_elbow_side(machine, request.departure)
        key = graph.table, np.asarray(kept, dtype=np.float64).tobytes(), elbow
        known, own = FixedPlanner._newest
        if known != key or own is None:
            own = fixed_j3.build_fixed_j3_graph(
                machine, graph.table, kept, elbow, grid=graph.grid, deadline=deadline
            )
        elif own.machine is not machine:
            own = own.create_for(machine)
            own.steps.price_all(deadline)
        FixedPlanner._newest = key, own
        return own

    def warm_up(self, graph: StepGraph) -> None:
        """Compile the kernels of the conventional method."""
        fixed_j3.warm_up(graph)
