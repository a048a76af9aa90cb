"""Planner: from a state of motion to a goal in one call.

    machine = load_machine()
    planner = Planner(machine)
    plan = planner.plan((0.55, 0.60), MotionState.at_rest(posture))
    sooner = planner.plan((0.55, 0.60), state, deadline=Deadline.after(0.05))

A path planner (`planners`) proposes discrete paths (S2). A motion is fitted to each path: a smooth
trajectory (S3) and its mode schedule (S4). The cheapest motion becomes the plan. A first motion is
found early, and cheaper motions as long as there is time.
"""

import math
import time
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from mhsb_model.errors import MhsbError, suggest_unit_of_number
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory
from mhsb_model.types import Position
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.errors import DeadlineError, RequestError
from mhsb_planner.kernel_parts import compile_planner, list_parts_for_rest
from mhsb_planner.motion import s3_clearance, s3_trajectory
from mhsb_planner.motion.s3_blend_in import Coasting, compute_coasting
from mhsb_planner.motion.s3_limits import keeps_position_limits
from mhsb_planner.motion.s3_state_to_rest import Steering
from mhsb_planner.motion.s3_trajectory import FitMethod
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.plan import Plan
from mhsb_planner.plan_log import PlanLog
from mhsb_planner.planners.options import DEFAULT_PLANNER, ENERGY_OPTIMAL, PlanOptions
from mhsb_planner.planners.path_planner import PathProposal, PathRequest
from mhsb_planner.planners.path_sources import PathSource, PlanePaths
from mhsb_planner.planners.registry import (
    PLANNER_KINDS,
    REGISTERED_PLANNERS,
    PlannerKind,
    get_planner,
    planners_weighing_area,
)
from mhsb_planner.planning.first_moves import paths_from_anywhere
from mhsb_planner.planning.loop import PlanningLoop
from mhsb_planner.planning.motion_rules import fit_rules
from mhsb_planner.planning.remarks import (
    append_remarks,
    describe_overload,
    describe_start_problems,
)
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search import goal_clearance, manipulability_loss, s2_step
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.manipulability_loss import create_area_cost
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.slewing import among_zones
from mhsb_planner.slewing.slewing import SlewingPaths

__all__ = [
    "DEFAULT_PLANNER",
    "ENERGY_OPTIMAL",
    "PLANNER_KINDS",
    "Plan",
    "PlanOptions",
    "Planner",
    "PlannerKind",
    "fit_rules",
    "warm_up",
]

MAX_REMAINING_TIME, MAX_GOAL_DISTANCE, MAX_STREAMED_GOAL_DISTANCE = 1.0, 5e-3, 0.05
"""Conditions under which a moving arm goes straight to the goal (steering).

The first value is the longest duration of the remaining part of the plan in force [s]. The second
is the largest distance of the plan's end from a goal that stands still [m], and the third from a
goal that moves [m].
"""

MAX_POSTURE_TURN_RATE = 0.2
"""Largest change of the end-link angle between plans to a moving goal, divided by the goal's period
[rad/s].

With this limit, the posture follows the goal without jumps.
"""

_compiled: set[tuple[str, ...]] = set()
"""Parts of the kernels for plans from rest that are compiled, as `list_parts_for_rest` lists them.
"""

_loaded: set[tuple[str, bool]] = set()
"""Path planners whose kernels are compiled and loaded; True for arms that slew."""


class Planner:
    """Planner for one machine and one posture table.

    Attributes:
        machine: Machine for which plans are made.
        graph: Graph of steps between the table's postures in the arm's plane. It is built again
            when the machine changes.
    """

    def __init__(self, machine: Machine, table: PostureTable | None = None) -> None:
        """Store machine and table, and build the graph of steps between the table's postures.

        Args:
            machine: The whole arm.
            table: Posture table of the arm's plane. None loads it from the user's cache, or builds
                it and writes it there; before that, code for the default planner is compiled.
        """
        if table is None:
            self._compile_for_rest(machine, DEFAULT_PLANNER)
            table = load_or_build_table(machine)
        self._table, self._max_modules = table, machine.arrays.module_count
        self.machine = machine
        """Machine for which plans are made."""
        self.graph = StepGraph(machine.planar_arm, table)
        self._settled_in_n = StartModes.create_settled(
            np.full(machine.joint_count, Mode.N, dtype=np.uint8)
        )

    def change_machine(self, machine: Machine) -> None:
        """Replace the machine for which plans are made.

        Payload, supply pressure, V_max (allowed piston speed), zones and number of booster modules
        may change. If the configuration is the same, nothing happens. Otherwise the step graph is
        built again from the posture table. It contains only mode combinations for which the new
        machine has enough modules.

        Args:
            machine: The new machine.

        Raises:
            RequestError: The new machine has more mode combinations than the posture table, because
                it has more booster modules.
        """
        if machine.config == self.machine.config:
            return
        plane, count = machine.planar_arm, machine.arrays.module_count
        if len(plane.patterns) > len(self._table.patterns):
            rule = f"must be at most {self._max_modules}, as for the posture table; build another"
            raise RequestError("number of booster modules", count, rule)
        self.machine = machine
        if len(plane.patterns) == len(self.graph.machine.patterns):
            self.graph = self.graph.create_for(plane)
        else:
            self.graph = StepGraph(plane, self._table.with_patterns(plane.patterns))

    def plan(
        self,
        goal: Position,
        start: MotionState,
        *,
        modes: StartModes | None = None,
        brake: Trajectory | None = None,
        options: PlanOptions | None = None,
        deadline: Deadline = NO_DEADLINE,
        remainder: Trajectory | None = None,
        log: PlanLog | None = None,
    ) -> Plan:
        """Plan a motion to a goal.

        An arm that moves at the start can come to rest in several ways. They are tried in this
        order until there is a plan: steering (one curve straight to the goal), coasting (all joints
        slow down together), and `brake`. If none of them gives a plan, the error of the first one
        is raised. A DeadlineError is raised at once, without further tries. Without a deadline,
        equal requests give equal plans.

        Args:
            goal: Goal of the tip in `base_link`: (x, z) [m], or (x, y, z) if joint 1 slews. The
                options may add a region around it.
            start: State of motion at the start.
            modes: Modes in force at the start. None means that all actuators have long been in mode
                N (main pump alone).
            brake: Braking along the old path (`mhsb_model.braking`). None means that a moving arm
                can only steer or coast.
            options: Options of the plan; None means the defaults.
            deadline: Instant at which the search for cheaper motions ends. The first plan in a
                process compiles code on all processors; this time is added to the deadline.
            remainder: Remaining part of the plan in force, with stamp 0; None if no plan is in
                force. If it ends at the goal, only a motion that is cheaper by MIN_REPLACEMENT_GAIN
                replaces it. Steering is tried only if the remainder lasts at most
                MAX_REMAINING_TIME and ends near the goal.
            log: Log to which entries are added, also if there is no plan. None means a new log,
                which only the plan contains.

        Returns:
            The cheapest plan found.

        Raises:
            OutOfWorkspaceError: The goal is outside the workspace.
            InfeasibleGoalError: No posture within limits reaches the goal.
            ZoneError: The arm would be too near to an obstacle at the goal.
            NoPathError: No path connects start and goal.
            StartError: The start is beyond joint limits, and no motion leads back.
            FitError: No motion along any path keeps the limits.
            DeadlineError: No motion was found before the deadline.
            RequestError: Start or deadline has a wrong type. Goal, start or a via point has a wrong
                number of values. Goal or start is not finite, or the goal region is larger than the
                workspace. The planner does not exist or cannot use `area_weight`.
        """
        options = options or PlanOptions()
        planner = get_planner(options.planner)
        self._check_request(goal, start, deadline, options)
        deadline = self._compile(options.planner, deadline)
        log, refused = log or PlanLog(), None
        plane = PlanePaths(planner, self.graph)
        source = SlewingPaths(self.machine, plane) if self.machine.slews else plane
        for stop in self._list_ways_to_rest(goal, start, brake, remainder, options):
            request = self._create_request(goal, start, modes, stop, options)
            try:
                return self._plan_request(request, source, deadline, remainder, log)
            except MhsbError as error:
                refused = refused or error
                if isinstance(error, DeadlineError):
                    refused = error
                    break
        assert refused is not None
        raise append_remarks(refused, self.machine, self.graph.table, start.position)

    def _plan_request(
        self,
        request: PathRequest,
        source: PathSource,
        deadline: Deadline,
        remainder: Trajectory | None,
        log: PlanLog,
    ) -> Plan:
        """Plan a motion for a request that names one way in which a moving arm comes to rest.

        The lower bound is added to the plan, except if the motion only brakes. A clause on problems
        at the start is added too.

        Args:
            request: The request.
            source: Source of paths of the whole arm.
            deadline: Instant at which the search for cheaper motions ends.
            remainder: Remaining part of the plan in force, or None. If it ends at the goal, it is
                the first incumbent (best plan so far). With via points it never is, because it is
                not known which of these have been passed.
            log: Log to which entries are added.

        Returns:
            The cheapest plan found.

        Raises:
            MhsbError: There is no plan; `plan` lists the errors.
        """
        loop = PlanningLoop(self.machine, request, deadline, log)
        if remainder is not None and not request.options.via:
            end = remainder.position[-1]
            if request.options.is_goal_reached(self.machine, request.goal, end):
                loop.start_with_remainder(remainder)
        deadline.check("planning")
        plan = loop.choose_best(paths_from_anywhere(source, request, loop.progress))
        if plan.motion.method != FitMethod.BRAKING:
            plan = replace(plan, lower_bound=source.bound(request, loop.progress))
        problems = describe_start_problems(self.machine, request.start.position)
        return replace(plan, start_problems=problems)

    def _compile(self, kind: str, deadline: Deadline) -> Deadline:
        """Compile code before the first plan in this process, and postpone a deadline by this time.

        Without a deadline, only kernels for plans from rest are compiled. With a deadline, all
        kernels are compiled and loaded. The latter is done once for each path planner, separately
        for arms with and without a slew.

        Args:
            kind: Name of the path planner.
            deadline: Deadline of the plan.

        Returns:
            The later deadline, or the given one if there was nothing to do.
        """
        if deadline.instant == math.inf:
            self._compile_for_rest(self.machine, kind)
            return deadline
        if (kind, self.machine.slews) in _loaded:
            return deadline
        began = time.monotonic()
        warm_up(self, [kind])
        return deadline.earlier_by(began - time.monotonic())

    @staticmethod
    def _compile_for_rest(machine: Machine, kind: str) -> None:
        """Compile the code for plans from rest, once for each set of parts in `_compiled`.

        Args:
            machine: The whole arm.
            kind: Name of the path planner.
        """
        has_obstacles = bool(machine.obstacles.names)
        parts = list_parts_for_rest(kind, has_obstacles=has_obstacles)
        if parts not in _compiled:
            compile_planner(parts=parts)
            _compiled.add(parts)

    def follow(
        self,
        path: DiscretePath,
        modes: StartModes | None = None,
        options: PlanOptions | None = None,
    ) -> Plan:
        """Plan a motion from rest along a given path, without a search.

        Args:
            path: Discrete path with at least one step.
            modes: Modes in force at the start. None means that all actuators have long been in mode
                N (main pump alone).
            options: Options of the plan; None means the defaults.

        Returns:
            Plan whose motion begins and ends at rest at the ends of the path.

        Raises:
            FitError: No motion along the path keeps the limits.
        """
        start = MotionState.at_rest(path.posture[0])
        goal = tuple(path.tip[-1].tolist())
        options = options or PlanOptions()
        request = self._create_request(goal, start, modes, None, options)
        loop = PlanningLoop(self.machine, request, NO_DEADLINE, PlanLog())
        return loop.choose_best([PathProposal(path, proposer="path")])

    def _check_request(
        self, goal: Position, start: MotionState, deadline: Deadline, options: PlanOptions
    ) -> None:
        """Check goal, goal region, start, deadline, via points and area weight of a request.

        Args:
            goal: Goal of the tip.
            start: State of motion at the start.
            deadline: Deadline of the plan.
            options: Options of the plan.

        Raises:
            RequestError: Start or deadline has a wrong type. Goal, start or a via point has a wrong
                number of values. Goal or start is not finite, or the goal region is larger than the
                workspace. The planner cannot use `area_weight`.
        """
        if not isinstance(start, MotionState):
            rule = "must be a MotionState; at rest: MotionState.at_rest(start)"
            raise RequestError("start", start, rule)
        if not isinstance(deadline, Deadline):
            raise RequestError("deadline", deadline, "must be a Deadline: Deadline.after(seconds)")
        n, slews = self.machine.joint_count, self.machine.slews
        if len(goal) != 2 + slews or not all(math.isfinite(value) for value in goal):
            rule = "three finite numbers, x y z" if slews else "two finite numbers, x z"
            raise RequestError("goal", tuple(goal), f"must be {rule} [m]")
        region, diameter = options.goal_region, 2.0 * self.machine.config.workspace.max_radius
        if region is not None and region.size > diameter:
            rule = f"must be at most {diameter:.4g} m from the goal, the workspace's diameter"
            hint = suggest_unit_of_number(region.size, "m", 0.0, diameter)
            raise RequestError("goal region's farthest point", region.size, rule + hint)
        for point in options.via:
            if len(point) != 2 + slews:
                rule = f"must be {'three numbers, x y z' if slews else 'two numbers, x z'} [m]"
                raise RequestError("via", tuple(point), rule)
        for name in ("position", "velocity", "acceleration"):
            value = np.asarray(getattr(start, name))
            if value.shape != (n,) or not all(map(math.isfinite, value.tolist())):
                rule = f"must be {n} finite numbers, one for each joint"
                raise RequestError(f"start {name}", value.tolist(), rule)
        if options.area_weight > 0.0 and not get_planner(options.planner).weighs_area:
            rule = f"must be 0 for the planner '{options.planner}'"
            rule += f"; {planners_weighing_area()} can weigh the area"
            raise RequestError("area weight", options.area_weight, rule)

    def _list_ways_to_rest(
        self,
        goal: Position,
        start: MotionState,
        brake: Trajectory | None,
        remainder: Trajectory | None,
        options: PlanOptions,
    ) -> list[Trajectory | Coasting | Steering | None]:
        """List the ways in which a moving arm can come to rest, the preferred first.

        1. Steering: one curve straight to the goal. It is listed if the remaining part of the plan
           in force lasts at most MAX_REMAINING_TIME and ends within MAX_GOAL_DISTANCE of the goal.
           If the goal moves (`period` above 0), MAX_STREAMED_GOAL_DISTANCE applies instead.
        2. Coasting: the pistons come to rest within their limits of acceleration and jerk. It is
           listed if the arm then keeps joint limits, workspace and clearance from obstacles, or if
           there is no `brake`.
        3. `brake`, if it is given.

        Args:
            goal: Goal of the tip in `base_link` [m].
            start: State of motion at the start.
            brake: Braking along the old path, or None.
            remainder: Remaining part of the plan in force, or None.
            options: Options of the plan. Only `period` is read.

        Returns:
            The ways. If the arm is at rest at the start, the list is [None].
        """
        if not start.is_moving:
            return [None]
        coast = compute_coasting(self.machine, start)
        stops: list[Trajectory | Coasting | Steering | None] = []
        if remainder is not None and remainder.duration_ns <= MAX_REMAINING_TIME * SECOND_NS:
            away = math.dist(goal, self.machine.tip_in_base(remainder.position[-1]).tolist())
            if away <= (MAX_STREAMED_GOAL_DISTANCE if options.period > 0.0 else MAX_GOAL_DISTANCE):
                stops.append(Steering(remainder))
        if brake is None or keeps_position_limits(self.machine, coast.trajectory):
            stops.append(coast)
        return stops if brake is None else [*stops, brake]

    def _create_request(
        self,
        goal: Position,
        start: MotionState,
        modes: StartModes | None,
        brake: Trajectory | Coasting | Steering | None,
        options: PlanOptions,
    ) -> PathRequest:
        """Create the request for paths.

        The departure is the posture from which paths are searched. If the motion steers to a moving
        goal and the options leave the end-link angle ψ free, the request limits ψ: it may differ
        from its value at the departure by at most MAX_POSTURE_TURN_RATE times the goal's period.

        Args:
            goal: Goal of the tip in `base_link` [m].
            start: State of motion at the start.
            modes: Modes in force at the start. None means that all actuators have long been in mode
                N (main pump alone).
            brake: Way in which a moving arm comes to rest; None if the arm is at rest.
            options: Options of the plan.

        Returns:
            The request. Its departure is the posture in which `brake` comes to rest, or the start's
            posture if `brake` is None.
        """
        area = create_area_cost(options.area_weight, self.graph.table)
        departure = start.position
        if brake is not None:
            departure = brake.position[-1] if isinstance(brake, Trajectory) else brake.posture
        if isinstance(brake, Steering) and options.period > 0.0 and options.goal_psi is None:
            psi, turn = (
                self.machine.end_link_angle(departure),
                MAX_POSTURE_TURN_RATE * options.period,
            )
            options = replace(options, goal_psi=(psi - turn, psi + turn))
        return PathRequest(
            goal, start, modes or self._settled_in_n, brake, departure, options, area
        )


def warm_up(planner: Planner, kinds: Iterable[str] | None = None) -> None:
    """Compile and load all kernels that a plan needs.

    Without this call, the first plan with a deadline does this, only for its path planner.

    Args:
        planner: The planner. Its machine has no obstacles during the call; machine and graph are
            restored at the end.
        kinds: Names of the path planners that will be used; None means all.
    """
    compile_planner()
    kinds = list(REGISTERED_PLANNERS if kinds is None else kinds)
    machine, graph = planner.machine, planner.graph
    planner.change_machine(machine.without_obstacles())
    goal_clearance.warm_up(planner.graph.machine)
    s2_step.warm_up(planner.graph.machine)
    for kind in kinds:
        get_planner(kind).warm_up(planner.graph)
    among_zones.warm_up(planner.machine)
    manipulability_loss.warm_up(planner.machine)
    s3_trajectory.warm_up(planner.machine)
    s3_clearance.warm_up(planner.machine)
    s3_trajectory.warm_up_moving_starts(planner.machine)
    start = np.array(planner.machine.config.simulation.start_posture)
    describe_overload(planner.machine, planner.graph.table, start)
    planner.machine, planner.graph = machine, graph
    _loaded.update((kind, machine.slews) for kind in kinds)
