"""S2 to S4 in one call: from a state of motion to a goal.

    machine = load_machine()
    planner = Planner(machine, build_posture_table(machine))
    plan = planner.plan((0.55, 0.60), MotionState.at_rest(posture))
    sooner = planner.plan((0.55, 0.60), state, deadline=Deadline.after(0.05))

A planner (`planners`) gives paths; each is made a motion (S3, S4), and the cheapest motion so far
is the plan: there is one soon, and it gets better while there is time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from time import perf_counter

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory
from mhsb_model.types import Position
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.errors import DeadlineError, RequestError
from mhsb_planner.first_moves import paths_from_anywhere, start_remarks
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.motion import s3_trajectory
from mhsb_planner.motion.s3_coasting import Coasting, coasting
from mhsb_planner.motion.s3_limits import stays_inside
from mhsb_planner.motion.s3_steered import Steering
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.plan import Plan
from mhsb_planner.plan_making import PlanMaking, fit_rules
from mhsb_planner.planners.legs import PathSource, PlanePaths
from mhsb_planner.planners.options import ENERGY_OPTIMAL, PlanOptions
from mhsb_planner.planners.path_planner import Candidate, Task
from mhsb_planner.planners.registry import (
    ONLINE_PLANNER,
    PLANNER_KINDS,
    PLANNERS,
    PlannerKind,
    planner_named,
    weighing_area,
)
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search import area_shortfall, goal_clearance
from mhsb_planner.search.area_shortfall import area_term
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.slewing import among_zones
from mhsb_planner.slewing.slewing import SlewingPaths

__all__ = [
    "ENERGY_OPTIMAL",
    "ONLINE_PLANNER",
    "PLANNER_KINDS",
    "Plan",
    "PlanOptions",
    "Planner",
    "PlannerKind",
    "fit_rules",
    "warm_up",
]

LONGEST_REST, CLOSE, NEAR = 1.0, 5e-3, 0.05
"""A motion steers straight to its goal where the rest of the plan in force lasts no longer [s] and
ends no farther from it [m]: NEAR where the motion is soon to be followed by another."""

TURNING = 0.2
"""By so much the end link's angle may change where one motion soon follows the other [rad/s]: the
posture follows the goal, too, and does not flip to and fro."""


class Planner:
    """Plans for one machine on one posture table; the step graph follows the machine's changes."""

    def __init__(self, machine: Machine, table: PostureTable) -> None:
        self._table = table
        self.machine = machine
        """The machine that plans are made for."""
        self.graph = StepGraph(machine.plane, table)

    def change(self, machine: Machine) -> None:
        """Plan for another payload, supply pressure, V_max, zones or number of booster modules.

        The table stays; where modules are lost, what it has for patterns that need them is left
        out, which takes a new graph.
        """
        if machine.config == self.machine.config:
            return
        self.machine, plane = machine, machine.plane
        if len(plane.patterns) == len(self.graph.machine.patterns):
            self.graph = self.graph.changed(plane)
        else:
            self.graph = StepGraph(plane, self._table.with_patterns(plane.patterns))

    def plan(
        self,
        goal: Position,
        start: MotionState,
        modes: StartModes | None = None,
        brake: Trajectory | None = None,
        options: PlanOptions | None = None,
        deadline: Deadline = NEVER,
        rest: Trajectory | None = None,
    ) -> Plan:
        """Plan to the tip position `goal` in `base_link`, (x, z) m or, where joint 1 slews,
        (x, y, z) m, or what the options say will do as well.

        modes     in force at the start; all N where left out
        brake     how a moving start comes to rest (`mhsb_model.braking`) where it cannot coast;
                  without it, it has to
        deadline  until when cheaper motions are looked for; what takes longer is dropped
        rest      of the plan in force, with stamp 0. Where it leads to the goal it stays, unless
                  another motion is cheaper by WORTH_LEAVING; where it ends near the goal, the
                  motion steers there

        Without a deadline the same request gives the same plan. Raises OutOfWorkspaceError,
        InfeasibleGoalError, ZoneError, NoPathError, FitError; DeadlineError where there is no
        motion in time; RequestError where goal or start are not finite, or the planner is not
        there or cannot weigh the area.
        """
        options = options or PlanOptions()
        planner = planner_named(options.planner)
        self._check(goal, start, options)
        deadline.check("planning")
        began, refused = perf_counter(), None
        source: PathSource = PlanePaths(planner, self.graph)
        if self.machine.slews:
            source = SlewingPaths(self.machine, planner, self.graph)
        for stop in self._stops(goal, start, brake, rest, options):
            task = self._task(goal, start, modes, stop, options)
            making = PlanMaking(self.machine, task, deadline, began)
            if rest is not None and self._leads_to(goal, rest, options):
                making.go_on(rest, source.bound(task))
            try:
                paths = paths_from_anywhere(
                    self.machine, source, self.graph.table, task, making.time
                )
                plan = making.best_along(paths)
                return replace(plan, start_in=start_remarks(self.machine, start.position))
            except DeadlineError as error:
                raise self._with_remarks(error, start) from None
            except MhsbError as error:
                refused = refused or error
        assert refused is not None
        raise self._with_remarks(refused, start)

    def _with_remarks(self, error: MhsbError, start: MotionState) -> MhsbError:
        """Return the error, its sentence ending with what is wrong with the start, if anything."""
        remarks = start_remarks(self.machine, start.position)
        if remarks and remarks not in str(error):
            error.args = (f"{error}; {remarks}",)
        return error

    def follow(
        self,
        path: DiscretePath,
        modes: StartModes | None = None,
        options: PlanOptions | None = None,
    ) -> Plan:
        """The plan along a path that was found elsewhere, from rest; S2 is left out.

        modes  in force at the start; all N where left out

        Raises FitError.
        """
        start = MotionState.at_rest(path.posture[0])
        goal = tuple(path.tip[-1].tolist())
        options = options or PlanOptions()
        task = self._task(goal, start, modes, None, options)
        return PlanMaking(self.machine, task, NEVER, perf_counter()).best_along([Candidate(path)])

    def _check(self, goal: Position, start: MotionState, options: PlanOptions) -> None:
        """Raise RequestError where something is asked for that makes no sense."""
        n, slews = self.machine.joint_count, self.machine.slews
        if len(goal) != 2 + slews or not all(math.isfinite(value) for value in goal):
            rule = "three finite numbers, x y z" if slews else "two finite numbers, x z"
            raise RequestError("goal", tuple(goal), f"must be {rule} [m]")
        for point in options.via:
            if len(point) != 2 + slews:
                rule = f"must be {'three numbers, x y z' if slews else 'two numbers, x z'} [m]"
                raise RequestError("via", tuple(point), rule)
        for name in ("position", "velocity", "acceleration"):
            value = np.asarray(getattr(start, name))
            if value.shape != (n,) or not np.isfinite(value).all():
                rule = f"must be {n} finite numbers, one for each joint"
                raise RequestError(f"start {name}", value.tolist(), rule)
        if options.area_weight > 0.0 and not planner_named(options.planner).weighs_area:
            rule = f"must be 0 for the planner '{options.planner}'"
            rule += f"; {weighing_area()} can weigh the area"
            raise RequestError("area weight", options.area_weight, rule)

    def _stops(
        self,
        goal: Position,
        start: MotionState,
        brake: Trajectory | None,
        rest: Trajectory | None,
        options: PlanOptions,
    ) -> list[Trajectory | Coasting | Steering | None]:
        """Ways in which the start comes to rest, the better one first; None: it rests already."""
        if not (start.velocity.any() or start.acceleration.any()):
            return [None]
        coast = coasting(self.machine, start)
        stops: list[Trajectory | Coasting | Steering | None] = []
        if rest is not None and rest.duration_ns <= LONGEST_REST * SECOND_NS:
            away = math.dist(goal, self.machine.tip_in_base(rest.position[-1]).tolist())
            if away <= (NEAR if options.period > 0.0 else CLOSE):
                stops.append(Steering(start, rest))
        if brake is None or stays_inside(self.machine, coast.trajectory):
            stops.append(coast)
        return stops if brake is None else [*stops, brake]

    def _leads_to(self, goal: Position, rest: Trajectory, options: PlanOptions) -> bool:
        """Whether the rest of a plan ends at the goal; what it passed on its way is not known."""
        return options.is_met(self.machine, goal, rest.position[-1]) and not options.via

    def _task(
        self,
        goal: Position,
        start: MotionState,
        modes: StartModes | None,
        brake: Trajectory | Coasting | Steering | None,
        options: PlanOptions,
    ) -> Task:
        modes = modes or StartModes.settled(np.full(self.machine.joint_count, Mode.N))
        area = area_term(options.area_weight, self.graph.table)
        departure = start.position
        if brake is not None:
            departure = brake.position[-1] if isinstance(brake, Trajectory) else brake.posture
        if isinstance(brake, Steering) and options.period > 0.0 and options.goal_psi is None:
            psi, turn = self.machine.end_link_angle(departure), TURNING * options.period
            options = replace(options, goal_psi=(psi - turn, psi + turn))
        return Task(goal, start, modes, brake, departure, options, area)


def warm_up(planner: Planner, kinds: Iterable[str] | None = None) -> None:
    """Compile everything that a plan runs through, and load it, with nothing in its way.

    kinds  planners that plans will be asked of; all that there are where it is left out
    """
    compile_planner()
    machine, graph = planner.machine, planner.graph
    planner.change(machine.without_obstacles())
    goal_clearance.warm_up(planner.graph.machine)
    for kind in PLANNERS if kinds is None else kinds:
        planner_named(kind).warm_up(planner.graph)
    among_zones.warm_up(planner.machine)
    area_shortfall.warm_up(planner.machine)
    s3_trajectory.warm_up(planner.machine)
    planner.machine, planner.graph = machine, graph
