"""Paths through via points, planned leg by leg and joined to one path."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mhsb_planner.motion.resting import insert_rests
from mhsb_planner.planners.path_planner import UNEXPLAINED_END, PathProposal, PathRequest
from mhsb_planner.planners.path_sources import PathSource
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.s2_search import SEARCH_TASK


def paths_through_via_points(
    source: PathSource, request: PathRequest, progress: PlanProgress
) -> Iterator[PathProposal]:
    """Yield paths from the request's departure through all via points, in order, to its goal.

    The departure is the posture at rest where the path begins. A leg leads to the next via point,
    the last leg to the goal. Each leg is planned without regard to the next. There are two rounds.
    In the first round, each leg to a via point is the first path that the source finds. In the
    second round, it is the cheapest path. Each path that the source finds for the last leg is
    joined to these legs. Each whole path is yielded twice: without and with rests at the via
    points. There is no version with rests if no via point lies between its steps. Without rests,
    the tip may miss the via points, because ramps cut the corners.

    Args:
        source: Source of the paths of each leg.
        request: The request. Without via points, the source's own paths are yielded.
        progress: State of the planning loop, with the time limit of the searches.

    Yields:
        Path proposals.

    Raises:
        MhsbError: The source found no path for a leg; its error is raised.
    """
    if not request.options.via:
        yield from source.paths(request, progress)
        return
    for thorough in (False, True):
        legs: list[DiscretePath] = []
        onward = replace(request, options=request.options.for_via_point)
        for point in request.options.via:
            legs.append(plan_leg(source, replace(onward, goal=point), progress, thorough))
            onward = onward.continued_from(legs[-1])
        last = replace(onward, goal=request.goal, options=request.options.for_last_leg)
        for candidate in source.paths(last, progress):
            whole = join_paths([*legs, candidate.path])
            yield candidate._replace(path=whole)
            before = np.cumsum([leg.steps for leg in legs])
            before = np.unique(before[(before > 0) & (before < whole.steps)])
            if len(before) > 0:
                rested = insert_rests(source.machine, whole, before, request.options.weights)
                yield candidate._replace(path=rested)


def plan_leg(
    source: PathSource, request: PathRequest, progress: PlanProgress, cheapest: bool
) -> DiscretePath:
    """Plan the path of one leg, which ends at a via point.

    Args:
        source: Source of paths.
        request: Request whose goal is the via point.
        progress: State of the planning loop, with the time limit of the search.
        cheapest: True to take the cheapest of all paths, False to take the first.

    Returns:
        Path from the departure (posture at rest where the path begins) to the via point.

    Raises:
        MhsbError: The source found no path; its error is raised.
        DeadlineError: The source gave no path before the deadline of the search.
        ValueError: The source proposed nothing and raised nothing, which is a fault of the planner.
    """
    found = (candidate.path for candidate in source.paths(request, progress))
    first = next(found, None)
    if first is None:
        progress.search_deadline.check(SEARCH_TASK)
        raise ValueError(UNEXPLAINED_END)
    return min([first, *found], key=lambda path: path.cost) if cheapest else first


def join_paths(legs: Sequence[DiscretePath]) -> DiscretePath:
    """Join successive paths to one path.

    Costs, holding switches and search statistics are added, but `out_of_time` becomes False. The
    start modes are those of the first path.

    Args:
        legs: The paths in order. Each begins in the posture and the modes in which the previous
            path ends.

    Returns:
        One path.
    """
    first = legs[0]

    def concatenate_nodes(name: str) -> np.ndarray:
        """Concatenate one field of all paths in `legs` that has a row for each node.

        Except for the first path, the first node of a path is dropped, because it repeats the last
        node of the previous path.

        Args:
            name: Field of `DiscretePath`.

        Returns:
            Array with one row for each node of the joined path.
        """
        rest = (getattr(leg, name)[1:] for leg in legs[1:])
        return np.concatenate([getattr(first, name), *rest])

    def concatenate_steps(name: str) -> np.ndarray:
        """Concatenate one field of all paths in `legs` that has a row for each step."""
        return np.concatenate([getattr(leg, name) for leg in legs])

    return DiscretePath(
        tip=concatenate_nodes("tip"),
        posture=concatenate_nodes("posture"),
        modes=concatenate_steps("modes"),
        duration=concatenate_steps("duration"),
        energy=concatenate_steps("energy"),
        energy_series=concatenate_steps("energy_series"),
        cost=sum(leg.cost for leg in legs),
        start_modes=first.start_modes,
        statistics=SearchStatistics(
            sum(leg.statistics.expanded for leg in legs),
            sum(leg.statistics.generated for leg in legs),
            sum(leg.statistics.seconds for leg in legs),
        ),
        holding_switches=sum(leg.holding_switches for leg in legs),
    )
