"""Paths of an arm that slews, from the paths of any planner in the arm's plane.

The arm's plane is the vertical plane that turns with the slew. Without zones in space, the slew
turns at an even speed along each path of the planner. With zones there are three methods. The
shadow of a zone, for a range of slew angles, is an obstacle in the arm's plane. A posture that is
clear of the shadow is clear of the zone at all slew angles in the range.

1. Direct: plan as if there were no zones, then find a clear slew motion (`among_zones`).
2. Past shadows: plan among the shadows that the zones have for the whole turn of the slew.
3. Carried: plan through a via point at which the slew may make its whole turn. Before the via
   point, the obstacles are the shadows at the slew angle of the start. After it they are the
   shadows at the slew angle of the goal.

If zones raise the cost of the direct path by at most FREE_COST_FACTOR, the other methods are
dropped. Methods 2 and 3 are also used with the planner's baselines, that is, other planners.

`schedule_in_turn` decides the order of work. Method 1 has the first turn. Two proposers are quick:
methods 2 and 3 with the first baseline, or with the planner itself if it has no baselines. Until a
motion is found, the first quick proposer has all turns; after its end, the second has them. Once a
motion is found, the two quick proposers share all turns until one has ended. The other then has
every second turn, and the slower proposers share the rest.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import clearances
from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.errors import DeadlineError, NoPathError
from mhsb_planner.motion.resting import insert_rests
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planners.path_planner import (
    NOTHING_ELSE,
    PathPlanner,
    PathProposal,
    PathRequest,
    propose_in_both_ways,
)
from mhsb_planner.planners.path_sources import PlanePaths
from mhsb_planner.planners.schedule import Proposer, schedule_in_turn, take_turns
from mhsb_planner.planners.via_paths import join_paths, plan_leg
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.goal_clearance import check_tip_clearance
from mhsb_planner.search.lower_bound import bound_costs_between
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_search import SEARCH_TASK
from mhsb_planner.slewing.among_zones import find_clear_turning
from mhsb_planner.slewing.slew_distribution import compute_slew_demand
from mhsb_planner.slewing.turned_path import (
    REST_STEP,
    combine_with_slew,
    compute_even_turning,
    find_rest_steps,
)

MIN_GRID_DISTANCE = 3.0
"""Least distance between the tips of two carrying postures, in grid spacings [-]."""


def yield_carrying_postures(
    machine_among_shadows: Machine, graph: StepGraph, request: PathRequest
) -> Iterator[FloatArray]:
    """Yield postures in which the arm can slew from start to goal without collision.

    The postures come from the posture table, with all actuators in mode N, and are clear of the
    shadows of all zones. The shadow of a zone is an obstacle in the arm's plane. A posture that is
    clear of the shadow is clear of the zone at all slew angles of the turn.

    Postures are sorted by a lower bound on the cost from the start through the posture to the goal,
    the least first. Each tip is at least MIN_GRID_DISTANCE grid spacings away from the tips of all
    postures yielded before.

    Args:
        machine_among_shadows: Arm without its slew. Its obstacles are the shadows of the zones for
            the slew's turn (`Machine.make_planar_arm_with_shadows`).
        graph: Step graph of the arm without its slew, with the posture table.
        request: Path request in the arm's plane.

    Yields:
        Posture without the slew, float64[n], [rad or m]. Nothing is yielded if no posture is clear.
    """
    postures, tips = _list_node_postures(graph)
    rows = machine_among_shadows.obstacles.path_rows
    clear = clearances(machine_among_shadows.arrays, rows, frozen(postures))[0] >= 0.0
    postures, tips = postures[clear], tips[clear]
    if len(postures) == 0:
        return
    weights = request.options.weights
    weight = frozen(np.array([weights.energy, weights.time, weights.switches]))
    lengths = frozen(np.array([machine_among_shadows.cylinder_lengths(q) for q in postures]))
    ends = (
        machine_among_shadows.cylinder_lengths(request.departure),
        _find_goal_lengths(graph, request.goal),
    )
    over = [bound_costs_between(graph.circuit, end, lengths, weight) for end in ends]
    left = np.argsort(over[0] + over[1], kind="stable")
    while len(left) > 0:
        best = left[0]
        yield postures[best]
        away = np.linalg.norm(tips[left] - tips[best], axis=1)
        left = left[away >= MIN_GRID_DISTANCE * graph.table.spacing]


def _list_node_postures(graph: StepGraph) -> tuple[FloatArray, FloatArray]:
    """List the table's postures of mode combination N, N, …, N, and their tip positions.

    Nodes without such a posture have no row in the result.

    Args:
        graph: Step graph with the posture table.

    Returns:
        Postures, float64[k, n], [rad or m], and tip positions (x, z), float64[k, 2], [m].
    """
    postures = graph.table.posture[:, 0]
    feasible = np.isfinite(postures).all(axis=1)
    tips = graph.table.nodes[feasible].astype(np.float64) * graph.table.spacing
    return postures[feasible], tips


def _find_goal_lengths(graph: StepGraph, goal: tuple[float, ...]) -> FloatArray:
    """Return the cylinder lengths in the posture of the table whose tip is nearest to the goal.

    Args:
        graph: Step graph with the posture table.
        goal: Goal (x, z) in the arm's plane [m].

    Returns:
        Length of each cylinder but the slew's, float64[n], [m].
    """
    postures, tips = _list_node_postures(graph)
    nearest = np.argmin(np.linalg.norm(tips - np.array(goal), axis=1))
    return graph.machine.cylinder_lengths(postures[nearest])


MAX_CARRYING_POSTURES = 4
"""Largest number of via points that the method "carried" tries."""

FREE_COST_FACTOR = 1.005
"""Limit for the ratio of the direct path's cost with zones to its cost without zones [-].

Up to this limit, the methods "past shadows" and "carried" end early."""

MAX_CARRYING_PSI_DEVIATION = 0.15
"""Largest difference of end-link angles between the via point and its carrying posture [rad]."""


@dataclass(frozen=True, eq=False)
class SlewingPaths:
    """Source of paths of the whole arm, for an arm that slews."""

    machine: Machine
    """Whole arm, which slews."""

    plane: PlanePaths
    """Source of paths in the arm's plane."""

    @property
    def graph(self) -> StepGraph:
        """Step graph of the arm's plane."""
        return self.plane.graph

    def bound(self, request: PathRequest, progress: PlanProgress) -> float:
        """Compute a lower bound on the energy of every plan for a request, slew included.

        The bound is computed in the arm's plane, with oil and least time of the slew added.

        Args:
            request: Path request of the whole arm.
            progress: State of the planning loop. With a deadline, less effort is spent.

        Returns:
            Energy [J].

        Raises:
            OutOfWorkspaceError: The slew's limits do not allow the goal.
        """
        in_plane, _ = self._convert_to_plane(request)
        return self.plane.bound(in_plane, progress)

    def paths(self, request: PathRequest, progress: PlanProgress) -> Iterator[PathProposal]:
        """Yield paths of the whole arm from the start posture to the goal.

        The planner finds paths in the arm's vertical plane, which turns with the slew. Without
        zones in space, each planar path is combined with a slew at an even speed. With zones,
        several methods search for paths on which the arm keeps clear.

        Args:
            request: Path request of the whole arm, with the goal (x, y, z) in `base_link`.
            progress: State of the planning loop, with the deadline of the search.

        Yields:
            Paths of the whole arm, as proposals.

        Raises:
            MhsbError: The tip at the goal is too near to a zone, there is no path at all, or no
                path was found before the deadline.
        """
        in_plane, slew = self._convert_to_plane(request)
        if not self.machine.obstacles.is_in_space.any():
            for candidate in self.plane.paths(in_plane, progress):
                yield candidate._replace(path=self._turn_evenly(request, candidate.path, slew))
            return
        check_tip_clearance(self.machine, request.goal)
        yield from self._yield_paths_among_zones(request, in_plane, slew, progress)

    def _turn_evenly(
        self, request: PathRequest, path: DiscretePath, end_angle: float
    ) -> DiscretePath:
        """Combine a planar path with a slew at an even speed, without regard to zones.

        Args:
            request: Path request of the whole arm.
            path: Path in the arm's plane.
            end_angle: Slew angle at the goal [rad].

        Returns:
            Path of the whole arm; its steps last longer if the slew cannot keep up.
        """
        began = float(request.departure[0])
        return combine_with_slew(
            self.machine, request, path, compute_even_turning(self.machine, path, began, end_angle)
        )

    def _yield_paths_among_zones(
        self, request: PathRequest, in_plane: PathRequest, slew: float, progress: PlanProgress
    ) -> Iterator[PathProposal]:
        """Yield clear paths of the whole arm among zones in space, by three methods.

        The methods yield paths alternately, in the order of `schedule_in_turn`:

        - Direct: planar paths as if there were no zones.
        - Past shadows: planar paths that are clear at every slew angle between start and goal. A
          zone's shadow is the part of the arm's plane that is in the zone at any of these angles.
        - Carried: planar paths through a via point at which the arm may slew.

        Each planar path is combined with a slew motion on which the arm keeps clear. If there is no
        such slew motion, the planar path is skipped. A path with a via point, or with steps in
        which the slew turns alone, is yielded a second time, with rests at these places.

        If zones raise the cost of a direct path by no more than FREE_COST_FACTOR, the other methods
        end. An error ends only its own method. After the deadline the function returns if a path
        has been found.

        Args:
            request: Path request of the whole arm.
            in_plane: Path request in the arm's plane.
            slew: Slew angle at the goal [rad].
            progress: State of the planning loop, with the deadline of the search.

        Yields:
            Paths of the whole arm, as proposals.

        Raises:
            MhsbError: No method has given a clear path: DeadlineError after the deadline, otherwise
                the error of the direct method, or NoPathError.
        """
        began = float(request.departure[0])
        own, turn = self.plane.planner, (began, slew)
        direct, baselines = Proposer(own.name, self.plane.paths(in_plane, progress)), own.baselines
        others = [
            Proposer(f"{planner.name}, {name}", find_paths(planner, in_plane, turn, progress))
            for planner in (*baselines[:1], own, *baselines[1:])
            for name, find_paths in (
                ("past shadows", self._yield_paths_past_shadows),
                ("carried", self._yield_carried_paths),
            )
        ]
        found, schedule = False, schedule_in_turn(direct, others[:2], others[2:], progress)
        for candidate in take_turns(schedule, progress):
            turning = find_clear_turning(self.machine, candidate.path, began, slew)
            if turning is not None:
                found, whole = (
                    True,
                    combine_with_slew(self.machine, request, candidate.path, turning),
                )
                if (
                    candidate is direct.last
                    and whole.cost
                    <= FREE_COST_FACTOR * self._turn_evenly(request, candidate.path, slew).cost
                ):
                    for other in others:
                        other.has_ended = True
                yield candidate._replace(path=whole)
                if candidate.via_step is not None or REST_STEP in turning.step:
                    before = find_rest_steps(turning, candidate.via_step)
                    rested = insert_rests(self.machine, whole, before, request.options.weights)
                    yield candidate._replace(path=rested)
            if found and progress.search_deadline.has_passed:
                return
        if not found:
            raise self._create_error(request, direct.error, progress)

    def _create_error(
        self, request: PathRequest, refused: MhsbError | None, progress: PlanProgress
    ) -> MhsbError:
        """Choose the error to raise if no method has given a clear path.

        Args:
            request: Path request of the whole arm.
            refused: Error that ended the direct method; None without an error.
            progress: State of the planning loop, with the deadline of the search.

        Returns:
            DeadlineError after the deadline. Otherwise `refused`, or NoPathError if `refused` is
            None.
        """
        if progress.search_deadline.has_passed:
            return DeadlineError(SEARCH_TASK)
        start = tuple(self.machine.tip_in_base(request.departure).tolist())
        return refused or NoPathError(start, request.goal, self.machine.obstacles.names)

    def _yield_paths_past_shadows(
        self,
        planner: PathPlanner,
        in_plane: PathRequest,
        slew_angles: tuple[float, float],
        progress: PlanProgress,
    ) -> Iterator[PathProposal]:
        """Yield planar paths on which the arm is clear of zones at every slew angle of the turn.

        The obstacles of these paths are the shadows of the zones in the arm's plane. A posture that
        is clear of a zone's shadow is clear of the zone at all slew angles of the turn.

        Args:
            planner: The planner itself, or a baseline (planner for comparison).
            in_plane: Path request in the arm's plane.
            slew_angles: Slew angles at start and goal [rad].
            progress: State of the planning loop, with the deadline of the search.

        Yields:
            Planar paths without a via point, as proposals. A path of a baseline may come twice, for
            two methods of fitting a trajectory to it.
        """
        for path in self._create_source_among_shadows(planner, *slew_angles).paths(
            in_plane, progress
        ):
            yield from self._yield_proposals(planner, path, in_plane)

    def _yield_carried_paths(
        self,
        planner: PathPlanner,
        in_plane: PathRequest,
        slew_angles: tuple[float, float],
        progress: PlanProgress,
    ) -> Iterator[PathProposal]:
        """Yield planar paths through a via point at which the arm may slew without collision.

        Before the via point, zones are avoided at the slew angle of the start. After it they are
        avoided at the slew angle of the goal. The via points are the tips of at most
        MAX_CARRYING_POSTURES postures of the table, and are tried in two rounds. The first round
        takes the first path found on each side of the via point, the second round the cheapest. Via
        points without a path are skipped.

        Args:
            planner: The planner itself, or a baseline (planner for comparison).
            in_plane: Path request in the arm's plane.
            slew_angles: Slew angles at start and goal [rad].
            progress: State of the planning loop, with the deadline of the search.

        Yields:
            Planar paths as proposals, each with the index of the step after its via point
            (`via_step`). A path of a baseline may come twice, for two methods of fitting a
            trajectory to it.
        """
        turning = self.machine.make_planar_arm_with_shadows(*slew_angles)
        postures = list(
            islice(yield_carrying_postures(turning, self.graph, in_plane), MAX_CARRYING_POSTURES)
        )
        ends = (
            self._create_source_among_shadows(planner, slew_angles[0], slew_angles[0]),
            self._create_source_among_shadows(planner, slew_angles[1], slew_angles[1]),
        )
        for thorough in (False, True):
            for posture in postures:
                with progress.log.record_failure(f"{planner.name}, carried"):
                    legs = self._plan_over_via_point(posture, ends, in_plane, progress, thorough)
                    path = PathProposal(join_paths(legs), via_step=legs[0].steps)
                    yield from self._yield_proposals(planner, path, in_plane)

    def _yield_proposals(
        self, planner: PathPlanner, path: PathProposal, in_plane: PathRequest
    ) -> Iterator[PathProposal]:
        """Yield a path as one proposal, or a baseline's path as one or two proposals.

        A trajectory is fitted to a path (S3) by one of two methods: a polynomial, or following the
        path with ramps. `planner` may be the planner that the request names, or a baseline (another
        planner, for comparison). A path of a baseline is proposed twice: first with the method of
        the request's planner, then with the baseline's own method. Both proposals have
        `for_comparison` set. The second is left out if the options name a method.

        Args:
            planner: Planner that has made the path.
            path: Path in the arm's plane.
            in_plane: Path request in the arm's plane.

        Yields:
            One or two proposals, without the name of a proposer.
        """
        path = path._replace(proposer="")
        if planner is self.plane.planner:
            yield path
        else:
            yield from propose_in_both_ways(path._replace(for_comparison=True), planner, in_plane)

    def _plan_over_via_point(
        self,
        posture: FloatArray,
        ends: tuple[PlanePaths, PlanePaths],
        in_plane: PathRequest,
        progress: PlanProgress,
        thorough: bool,
    ) -> tuple[DiscretePath, DiscretePath]:
        """Plan a planar path to a via point, and a path from rest at the via point to the goal.

        The arm may slew in the carrying posture, and the via point is the tip position of this
        posture. The end-link angle at the via point may differ from that of the carrying posture by
        MAX_CARRYING_PSI_DEVIATION. Both paths are planned without the oil and time of the slew.

        Args:
            posture: Carrying posture of the planar arm's n joints, without the slew, float64[n],
                [rad or m].
            ends: Path source among the zones at the slew angle of the start, and path source among
                the zones at the slew angle of the goal.
            in_plane: Path request in the arm's plane.
            progress: State of the planning loop, with the deadline of the search.
            thorough: True for the cheapest path of each part, False for the first path found.

        Returns:
            Path to the via point and path from there to the goal.

        Raises:
            MhsbError: There is no path to the via point, or no path from the via point to the goal.
        """
        plane = self.machine.planar_arm
        x, z = plane.tip_position(posture).tolist()
        psi = plane.end_link_angle(posture)
        alike = (psi - MAX_CARRYING_PSI_DEVIATION, psi + MAX_CARRYING_PSI_DEVIATION)
        options = replace(in_plane.options.for_via_point, goal_psi=alike)
        leg = replace(in_plane, goal=(x, z), options=options, slew_demand=NOTHING_ELSE)
        first = plan_leg(ends[0], leg, progress, thorough)
        onward = replace(leg.continued_from(first), goal=in_plane.goal, options=in_plane.options)
        return first, plan_leg(ends[1], onward, progress, thorough)

    def _create_source_among_shadows(
        self, planner: PathPlanner, start_angle: float, end_angle: float
    ) -> PlanePaths:
        """Create a source of planar paths that are clear of zones at all slew angles of a turn.

        The shadow of a zone is an obstacle in the arm's plane. A posture that is clear of it is
        clear of the zone at all slew angles of the turn.

        Args:
            planner: Planner that finds the paths.
            start_angle: Slew angle at one end of the turn [rad].
            end_angle: Slew angle at the other end [rad]; equal angles mean that the slew rests.

        Returns:
            Path source whose obstacles are the shadows of the zones for these slew angles.
        """
        among = self.machine.make_planar_arm_with_shadows(start_angle, end_angle)
        return PlanePaths(planner, self.graph.create_for(among))

    def _convert_to_plane(self, request: PathRequest) -> tuple[PathRequest, float]:
        """Convert a path request of the whole arm into a path request in the arm's plane.

        The result contains the oil and the least time that the slew needs (`slew_demand`). In the
        result `brake` is None, because braking is planned for the whole arm.

        Args:
            request: Path request of the whole arm.

        Returns:
            Path request in the arm's plane, and the slew angle at the goal [rad].

        Raises:
            OutOfWorkspaceError: The slew's limits do not allow the goal.
        """
        start, modes = request.start, request.modes
        tip, slew = self.machine.convert_to_plane(request.goal, float(request.departure[0]))
        assert slew is not None
        slew_demand = compute_slew_demand(self.machine, start.position[0], slew)
        alone = MotionState(start.position[1:], start.velocity[1:], start.acceleration[1:])
        in_plane = replace(
            request,
            goal=tip,
            start=alone,
            modes=StartModes(modes.modes[1:], modes.age[1:]),
            brake=None,
            departure=request.departure[1:],
            slew_demand=slew_demand,
        )
        return in_plane, slew
