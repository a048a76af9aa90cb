"""Sources of paths for the whole arm: a planner with its step graph, at V_max or below it.

A search plans each step at V_max, or as fast as pumps and pressures allow. At high speed, valves
take more pressure, so that boost and mode switches may be needed. There may also be no pressure
left for the ramps, so that the motion needs boost, or much more time than its path. A path at a
lower speed has modes that suit this speed. It is cheaper if leakage costs little.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

from mhsb_model.machine import Machine
from mhsb_model.types import frozen
from mhsb_planner.errors import NoPathError
from mhsb_planner.integrated.lower_bound import bound_energy_to_goal, max_bound_cells
from mhsb_planner.planners.path_planner import PathPlanner, PathProposal, PathRequest
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.s2_graph import StepGraph

SPEED_FACTORS = (0.5, 0.25, 0.125)
"""Factors on V_max, in the order of trial [-]."""


class PathSource(Protocol):
    """Interface of a source of paths for the whole arm, its slew included."""

    @property
    def machine(self) -> Machine:
        """The whole arm."""

    @property
    def graph(self) -> StepGraph:
        """Step graph of the arm's plane, with its posture table."""

    def bound(self, request: PathRequest, progress: PlanProgress) -> float:
        """Return a lower bound on the energy of every plan for a request of the whole arm [J].

        Args:
            request: The request of the whole arm.
            progress: State of the planning loop. With a deadline, less effort is spent.
        """

    def paths(self, request: PathRequest, progress: PlanProgress) -> Iterator[PathProposal]:
        """Yield paths of the whole arm without via points: the first early, then cheaper paths.

        The paths lead from the departure (posture at rest where the path begins) to the goal.

        Args:
            request: The request of the whole arm.
            progress: State of the planning loop, with the time limit of the search.

        Yields:
            Path proposals for the whole arm.

        Raises:
            MhsbError: There is no path, or the deadline passed before one was found.
        """


@dataclass(frozen=True, eq=False)
class PlanePaths:
    """Source of paths for an arm that does not slew: a planner and its step graph.

    Attributes:
        planner: The planner.
        graph: Step graph for the planner.
    """

    planner: PathPlanner
    graph: StepGraph

    @property
    def machine(self) -> Machine:
        """The arm, which does not slew."""
        return self.graph.machine

    def bound(self, request: PathRequest, progress: PlanProgress) -> float:
        """Compute a lower bound on the energy of every plan for a request in the arm's plane.

        The bound holds for all postures with the tip at the goal or at a sampled position of the
        goal region. Oil and least time of the slew are included.

        Args:
            request: The request in the arm's plane.
            progress: State of the planning loop. With a deadline, less effort is spent.

        Returns:
            The bound [J]; inf if no posture reaches the goal.
        """
        return bound_energy_to_goal(
            self.machine,
            request.start.position,
            request.planar_goal,
            request.options.goal_psi,
            request.options.goal_region,
            request.slew_demand,
            max_bound_cells(progress),
        )

    def paths(self, request: PathRequest, progress: PlanProgress) -> Iterator[PathProposal]:
        """Yield the planner's paths at V_max, and at lower piston speeds if they may help.

        V_max is the allowed piston speed. Lower speeds are tried if there is no path, because
        slower steps need less pressure. If there is one, they are tried as long as slower motions
        may be cheaper (`progress.min_speed_factor`). The factors of SPEED_FACTORS are tried one
        after the other until the deadline of the search. Errors at lower speeds are only logged. A
        `NoPathError` at V_max is only logged if there is a path.

        Args:
            request: The request.
            progress: State of the planning loop.

        Yields:
            Path proposals.

        Raises:
            NoPathError: There is no path at V_max, and none at a lower speed.
            MhsbError: The planner has failed at V_max for another reason; lower speeds are not
                tried.
        """
        has_path = False
        refused: NoPathError | None = None
        try:
            for proposal in self.planner.paths(self.graph, request, progress):
                has_path = True
                yield proposal._replace(proposer=proposal.proposer or self.planner.name)
        except NoPathError as error:
            refused = error
            progress.log.add_failure(self.planner.name, error)
        for factor in SPEED_FACTORS:
            is_needed = factor > progress.min_speed_factor if has_path else refused is not None
            if not is_needed or progress.search_deadline.has_passed:
                break
            name = f"at {factor:g} V_max"
            with progress.log.record_failure(f"{self.planner.name} {name}"):
                slower = self.graph.create_for(limit_speeds(self.graph.machine, factor))
                for proposal in self.planner.paths(slower, request, progress):
                    has_path = True
                    proposer = f"{proposal.proposer or self.planner.name} {name}"
                    yield proposal._replace(proposer=proposer)
        if not has_path and refused is not None:
            raise refused


def limit_speeds(machine: Machine, factor: float) -> Machine:
    """Return a copy of a machine with a lower V_max of each actuator, for path searches only.

    Args:
        machine: The arm without a slewing joint; it stays unchanged.
        factor: Factor on V_max (allowed piston speed) of each actuator [-].

    Returns:
        The slower machine. Only its `arrays` have the lower V_max; `config` still has the old
        V_max.
    """
    speed = frozen(factor * machine.arrays.max_piston_speed)
    return replace(machine, arrays=machine.arrays._replace(max_piston_speed=speed))
