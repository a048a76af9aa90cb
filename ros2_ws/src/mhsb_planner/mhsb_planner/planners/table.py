"""Table planner, which takes the postures of the posture table, as in the paper (S2)."""

from collections.abc import Iterator
from dataclasses import replace

from mhsb_model.errors import MhsbError
from mhsb_planner.errors import DeadlineError
from mhsb_planner.goal_region import tip_positions
from mhsb_planner.planners.path_planner import PathPlanner, PathProposal, PathRequest
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search import s2_search
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_graph import StepGraph


class TablePlanner(PathPlanner):
    """Planner that searches path and modes in the graph of the posture table."""

    name = "table"
    summary = "takes the postures of the posture table"
    trajectory = "polynomial"
    takes = ("search", "heuristic_scale")

    def paths(
        self, graph: StepGraph, request: PathRequest, progress: PlanProgress
    ) -> Iterator[PathProposal]:
        """Yield paths in the graph of the posture table, by the exact or the published search.

        `options.search` chooses the search. The published search (the paper's) keeps one label per
        node, and may miss the cheapest path.

        Args:
            graph: Step graph (steps between the table's postures).
            request: The request.
            progress: State of the planning loop, with the time limit of the search.

        Yields:
            First a path to the goal itself or, if there is none, to another position of the goal
            region. Then the cheapest path to any position of the region, if it differs from the
            first path.

        Raises:
            MhsbError: There is no path, or the deadline passed before one was found.
        """
        yield from map(PathProposal, yield_graph_paths(graph, request, progress))

    def warm_up(self, graph: StepGraph) -> None:
        """Compile the kernels of the graph search by two short searches."""
        s2_search.warm_up(graph)


def yield_graph_paths(
    graph: StepGraph, request: PathRequest, progress: PlanProgress
) -> Iterator[DiscretePath]:
    """Yield the first path found in a step graph to the goal or its region, then the cheapest path.

    The search runs once for the goal and, if there is a goal region, once for each sampled position
    of the region. The first path found is yielded at once. The cheapest path is yielded at the end,
    unless it is the first. If the departure (posture at rest where the path begins) is in the
    region, the only path has no steps.

    Args:
        graph: Step graph (steps between postures).
        request: The request.
        progress: State of the planning loop. Only its `search_deadline` is read; after this
            deadline, no further position is tried.

    Yields:
        One or two paths.

    Raises:
        MhsbError: There is no path to any position; the error of the search to the goal is raised.
    """
    region = request.options.goal_region
    if region is not None and request.begins_at_goal(graph.machine):  # the search sees a goal alone
        tip = graph.machine.tip_position(request.departure)
        yield DiscretePath.create_without_steps(tip, request.departure, request.modes.modes, 0.0)
        return
    found: list[DiscretePath] = []
    refused: MhsbError | None = None
    for x, z in tip_positions(request.planar_goal, region).tolist():
        try:
            found.append(_search_path_to((x, z), graph, request, progress))
        except MhsbError as error:
            refused = refused or error
            if isinstance(error, DeadlineError):
                break
            continue
        if len(found) == 1:
            yield found[0]
    if refused is not None and not found:
        raise refused
    best = min(found, key=lambda path: path.cost)
    if best is not found[0]:
        yield best


def _search_path_to(
    tip: tuple[float, float], graph: StepGraph, request: PathRequest, progress: PlanProgress
) -> DiscretePath:
    """Search for a path to one tip position in a step graph, by the search that the options name.

    Args:
        tip: Tip position (x, z) [m].
        graph: Step graph (steps between postures).
        request: The request.
        progress: State of the planning loop. Only its `search_deadline` is read.

    Returns:
        Path from the departure (posture at rest where the path begins). If `options.search` is
        `exact`, it is the cheapest path.

    Raises:
        MhsbError: There is no path, or the deadline passed before one was found.
    """
    options = request.options
    return s2_search.search(
        graph,
        replace(request.query, goal_xz=tip, goal_region=None),
        method=options.search,
        heuristic_scale=options.heuristic_scale,
        deadline=progress.search_deadline,
    )
