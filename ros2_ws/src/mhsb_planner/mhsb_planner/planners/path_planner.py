"""Interface of planners, with the request that they get and the paths that they propose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState, Trajectory
from mhsb_model.types import FloatArray, Position
from mhsb_planner.motion.s3_blend_in import Coasting
from mhsb_planner.motion.s3_state_to_rest import Steering
from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planners.options import PlanOptions
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.manipulability_loss import AreaTerm
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_search import PathQuery


class SlewDemand(NamedTuple):
    """Least oil and time that the slew needs, for lower bounds on the energy of a plan.

    Attributes:
        oil: Oil volume that the slew takes [m³].
        time: Least time that the slew takes [s].
    """

    oil: float
    time: float


NOTHING_ELSE = SlewDemand(0.0, 0.0)
"""Slew demand of an arm that does not slew or need not slew."""

UNEXPLAINED_END = "a planner that gives no path must say why"
"""Sentence of the ValueError for a planner that proposes nothing and raises nothing."""


@dataclass(frozen=True, eq=False)
class PathRequest:
    """Request for paths from a start to a goal, for the whole arm or for the arm in its plane.

    Attributes:
        goal: Goal (x, z) in the arm's plane [m]. For a whole arm with a slew: (x, y, z) in
            `base_link` [m].
        start: Positions, velocities and accelerations of the joints at the start.
        modes: Modes in force at the start, with their ages.
        brake: Motion that brings a moving arm to rest. None means that the arm is at rest at the
            start.
        departure: Posture at rest from which the path begins, shape (n,) [rad or m].
        options: Options of the plan.
        area: Weight of the manipulability loss and the reference area.
        slew_demand: Oil and least time that the slew needs; the graph does not include the slew.
    """

    goal: Position
    start: MotionState
    modes: StartModes
    brake: Trajectory | Coasting | Steering | None
    departure: FloatArray
    options: PlanOptions
    area: AreaTerm
    slew_demand: SlewDemand = NOTHING_ELSE

    @property
    def planar_goal(self) -> tuple[float, float]:
        """Goal (x, z) in the arm's plane [m]; raises ValueError for a goal (x, y, z)."""
        x, z = self.goal
        return x, z

    def begins_at_goal(self, machine: Machine) -> bool:
        """Return whether the posture `departure` is at the goal already.

        Args:
            machine: The arm without a slewing joint.

        Returns:
            True if the tip is within SAME_POINT of the goal or in its region, and the end-link
            angle ψ is within SAME_POINT of an admissible angle.
        """
        return self.query.begins_at_goal(machine)

    @property
    def query(self) -> PathQuery:
        """Query of a path in the arm's plane from the departure to the goal or its region."""
        options = self.options
        return PathQuery(
            self.departure,
            self.modes.modes,
            self.planar_goal,
            options.weights,
            options.energy_reading,
            options.goal_psi,
            options.goal_region,
        )

    def continued_from(self, path: DiscretePath) -> PathRequest:
        """Return the request for a path that continues where another path ends.

        Args:
            path: The other path. The new start is at rest in its last posture, with its last modes.

        Returns:
            Copy of this request with the new start. Goal and options are unchanged.
        """
        last = path.modes[-1] if path.steps > 0 else path.start_modes
        start = MotionState.at_rest(path.posture[-1])
        modes = StartModes.create_settled(last)
        return replace(self, start=start, modes=modes, brake=None, departure=start.position)


class PathProposal(NamedTuple):
    """Path that a planner proposes, with the method of making a motion of it.

    Attributes:
        path: The path.
        for_comparison: True if the path does not come from the planner's own search.
        trajectory: Method by which the trajectory stage (S3) makes a motion of this path, unless
            the options name a method. None means the method of the planner that the request names.
        proposer: Name of the proposer in the log; empty means the name of the planner.
        via_step: Index of the first step after the via point at which the slew may turn alone; None
            if there is no such point.
    """

    path: DiscretePath
    for_comparison: bool = False
    trajectory: TrajectoryKind | None = None
    proposer: str = ""
    via_step: int | None = None


class PathPlanner(Protocol):
    """Interface of a planner, which proposes paths; the planning loop fits motions to them.

    A planner derives from this class and inherits the default values of attributes that it does not
    set.

    Attributes:
        name: Name by which requests choose the planner.
        summary: Clause for messages that says where the postures come from; it follows the name.
        trajectory: Method by which the trajectory stage (S3) makes motions, unless the options name
            a method: "followed" (along the path) or "polynomial".
        weighs_area: Whether the area weight w₄ may be above 0.
        baselines: Other planners whose motions are compared with those of this planner, the fastest
            first.
        takes: Names of the options that this planner uses but some others do not, from `search`,
            `heuristic_scale` and `initial_j3`.
    """

    name: str
    summary: str
    trajectory: TrajectoryKind = "followed"
    weighs_area: bool = False
    baselines: tuple[PathPlanner, ...] = ()
    takes: tuple[str, ...] = ()

    def paths(
        self, graph: StepGraph, request: PathRequest, progress: PlanProgress
    ) -> Iterator[PathProposal]:
        """Propose paths from the request's departure to its goal: one early, then cheaper paths.

        The departure is the posture at rest where the path begins. If the arm is already at the
        goal (`begins_at_goal`), the planner yields a path without steps. A path starts within 1e-9
        rad of the departure and ends at the goal or in its region. Joints move linearly in a step,
        so a step should move no cylinder by more than about 5 mm.

        The consumer fits a motion to each path before it requests the next path, and may stop at
        any time. A planner calls `progress.search_deadline.check` about every millisecond. The
        error that this raises ends the search, and the motions found so far are kept. An error
        after the first path is only logged.

        `price_path` chooses modes and computes costs. A planner that makes a path by itself must
        set both energies and the cost. The cost counts the energy reading of the options, w3 for
        each switch, including those into the first step, and w4 for the manipulability loss.

        Args:
            graph: The machine, its posture table, and the steps between the table's postures.
            request: The request.
            progress: State of the planning loop.

        Yields:
            Path proposals.

        Raises:
            MhsbError: There is no path, or the deadline passed before one was found.
        """

    def warm_up(self, graph: StepGraph) -> None:
        """Compile the kernels of this planner by short trial calls, if it has kernels.

        Kernels of `price_path` and `compute_step_costs` are compiled for all planners.

        Args:
            graph: The machine, its posture table, and the steps between the table's postures.
        """


def propose_in_both_ways(
    path: PathProposal, baseline: PathPlanner, request: PathRequest
) -> Iterator[PathProposal]:
    """Yield a baseline's path twice, for two methods of making a motion of it.

    The trajectory stage (S3) fits a polynomial to a path, or follows the path. The first proposal
    is for the method of the planner that the request names, the second for the baseline's method.
    If the options name a method, there is no second proposal.

    Args:
        path: Proposal of the baseline.
        baseline: The baseline (planner to compare with).
        request: The request.

    Yields:
        The proposal as it is, then with the baseline's method in `trajectory`.
    """
    yield path
    if request.options.trajectory is None:
        yield path._replace(trajectory=baseline.trajectory)
