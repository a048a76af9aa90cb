"""Integrated planner: decides path, posture and modes together (`mhsb_planner.integrated`).

A motion may cost more than its path. So the planner also proposes paths from other searches, for
comparison:

- the paths of the baselines (table planner and fixed-joint planner), each proposed twice: for the
  baseline's method of making a motion (S3), and for this planner's method;
- if the manipulability loss has a weight, the path that is found without it.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from mhsb_model.machine import Machine
from mhsb_planner.integrated import integrated_search
from mhsb_planner.integrated.search_problem import SearchProblem
from mhsb_planner.planners.fixed import FixedPlanner
from mhsb_planner.planners.path_planner import (
    PathPlanner,
    PathProposal,
    PathRequest,
    propose_in_both_ways,
)
from mhsb_planner.planners.schedule import (
    Proposer,
    schedule_proposers,
    take_turns,
)
from mhsb_planner.planners.table import TablePlanner
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.manipulability_loss import compute_area_along_path
from mhsb_planner.search.s2_graph import StepGraph

BASELINE_PLANNERS: tuple[PathPlanner, ...] = (TablePlanner(), FixedPlanner())
"""Planners that the integrated planner compares itself with, the faster first."""


class IntegratedPlanner(PathPlanner):
    """Planner over the space of cylinder lengths that compares its motion with baselines."""

    name = "integrated"
    summary = "decides postures together with path and modes"
    weighs_area = True
    baselines = BASELINE_PLANNERS

    def paths(
        self, graph: StepGraph, request: PathRequest, progress: PlanProgress
    ) -> Iterator[PathProposal]:
        """Yield paths of the integrated search, and between them paths of other searches.

        The other searches are those of the baselines (table and fixed-joint planner) and variants
        of the integrated search. `planners.schedule` decides the order.

        Args:
            graph: Step graph (steps between postures) of the posture table; provides machine and
                table.
            request: The request. If the manipulability loss has a weight, all baselines have an
                early turn, because the integrated search takes long.
            progress: State of the planning loop, with deadline and log.

        Yields:
            Path proposals. `for_comparison` is False for paths of the integrated search and of its
            variant without leakage. It is True for paths of all other searches.

        Raises:
            MhsbError: The integrated search has failed. Failures of other searches are only logged.
        """
        machine = graph.machine
        problem = SearchProblem.create(machine, request.query, area=request.area, progress=progress)
        found = integrated_search.yield_paths(problem)
        own = Proposer(self.name, (path if path is None else PathProposal(path) for path in found))
        paths = _paths_without_leakage(machine, request, progress)
        leak_free = Proposer(f"{self.name} without leakage", paths)
        baselines = self._create_baselines(graph, request, progress)
        weighs_area = request.area.weight > 0.0
        schedule = schedule_proposers(
            own,
            leak_free,
            baselines,
            progress,
            slew_time=request.slew_demand.time,
            early_count=len(baselines) if weighs_area else 1,
        )
        yield from take_turns(schedule, progress, own)

    def _create_baselines(
        self, graph: StepGraph, request: PathRequest, progress: PlanProgress
    ) -> list[Proposer]:
        """Create the proposers (sources of paths) with which the integrated search is compared.

        There is one for each baseline planner. They do no work before their first turn. Other
        proposers are added:

        - If the manipulability loss has a weight: a search without this weight, as the first.
        - If there is a goal region: this planner with all its proposers, for the request without
          the region. It comes last, and ensures that a region never makes the plan more expensive.

        Args:
            graph: Step graph (steps between postures) of the posture table.
            request: The request.
            progress: State of the planning loop, with deadline and log.

        Returns:
            The proposers, the quickest first.
        """
        compare = partial(_for_comparison, graph.machine, request)
        baselines = [
            Proposer(each.name, compare(_baseline_paths(each, graph, request, progress)))
            for each in self.baselines
        ]
        if request.area.weight > 0.0:
            paths = compare(_path_without_area(graph.machine, request, progress))
            baselines.insert(0, Proposer(f"{self.name} without area", paths))
        if request.options.goal_region is not None:
            paths = self._paths_to_goal_alone(graph, request, progress)
            baselines.append(Proposer(f"{self.name} to the goal alone", paths))
        return baselines

    def _paths_to_goal_alone(
        self, graph: StepGraph, request: PathRequest, progress: PlanProgress
    ) -> Iterator[PathProposal]:
        """Yield this planner's paths to the goal itself, as if the request had no goal region.

        The paths come from all proposers, baselines included.

        Args:
            graph: Step graph (steps between postures) of the posture table.
            request: The request with its goal region.
            progress: State of the planning loop, with deadline and log.

        Yields:
            Path proposals with `for_comparison` set. Their proposers' names end with "to the goal
            alone".

        Raises:
            MhsbError: There is no path, or the deadline passed before one was found.
        """
        alone = replace(request, options=replace(request.options, goal_region=None))
        for proposal in self.paths(graph, alone, progress):
            proposer = f"{proposal.proposer} to the goal alone"
            yield proposal._replace(for_comparison=True, proposer=proposer)

    def warm_up(self, graph: StepGraph) -> None:
        """Compile the kernels of this planner and of its baselines.

        Args:
            graph: Step graph (steps between postures) of the posture table; provides the machine.
        """
        integrated_search.warm_up(graph.machine)
        for planner in self.baselines:
            planner.warm_up(graph)


def _paths_without_leakage(
    machine: Machine, request: PathRequest, progress: PlanProgress
) -> Iterator[PathProposal]:
    """Yield the paths of an integrated search that ignores leakage when it compares paths.

    This search is useful if the slew takes longer than the path, because leakage then costs the
    same on each path.

    Args:
        machine: The arm without a slewing joint.
        request: The request.
        progress: State of the planning loop.

    Yields:
        Path proposals. Their costs include leakage.
    """
    problem = SearchProblem.create(
        machine, request.query, area=request.area, counts_leakage=False, progress=progress
    )
    for path in integrated_search.yield_paths(problem):
        if path is not None:
            yield PathProposal(path)


def _path_without_area(
    machine: Machine, request: PathRequest, progress: PlanProgress
) -> Iterator[PathProposal]:
    """Yield the path that is cheapest if the manipulability loss has no weight.

    Args:
        machine: The arm without a slewing joint.
        request: The request.
        progress: State of the planning loop.

    Yields:
        One path proposal. Its cost does not contain the manipulability loss.

    Raises:
        MhsbError: There is no path.
    """
    problem = SearchProblem.create(machine, request.query, progress=progress)
    yield PathProposal(integrated_search.find_best_path(problem))


def _baseline_paths(
    baseline: PathPlanner, graph: StepGraph, request: PathRequest, progress: PlanProgress
) -> Iterator[PathProposal]:
    """Yield each path of a baseline twice, for two methods of making a motion of it.

    A baseline is a planner to compare with. The trajectory stage (S3) fits a polynomial to a path,
    or follows the path. Each path is yielded first for the method of the planner that the request
    names, then for the baseline's method. If the options name a method, each path is yielded only
    once.

    Args:
        baseline: The baseline.
        graph: Step graph (steps between postures) of the posture table.
        request: The request.
        progress: State of the planning loop.

    Yields:
        Path proposals.
    """
    for proposal in baseline.paths(graph, request, progress):
        yield from propose_in_both_ways(proposal, baseline, request)


def _for_comparison(
    machine: Machine, request: PathRequest, proposals: Iterator[PathProposal]
) -> Iterator[PathProposal]:
    """Mark proposals as made for comparison, and add the manipulability loss to their costs.

    The weight times the loss along the path is added to each cost. Without a weight, costs stay as
    they are.

    Args:
        machine: The arm without a slewing joint.
        request: The request. Only `area` is read.
        proposals: Proposals whose costs do not contain the manipulability loss.

    Yields:
        The proposals, all with `for_comparison` set.
    """
    for proposal in proposals:
        path = proposal.path
        if request.area.weight > 0.0:
            shortfall = compute_area_along_path(machine, path).compute_area_loss(
                request.area.reference
            )
            path = replace(path, cost=path.cost + request.area.weight * shortfall)
        yield proposal._replace(path=path, for_comparison=True)
