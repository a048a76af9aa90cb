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
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from time import perf_counter
from types import MappingProxyType

import numpy as np

from mhsb_model.cavitation import Cavitation
from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, standstill
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.errors import DeadlineError, RequestError
from mhsb_planner.goal_region import AT_GOAL_ANGLE, AT_GOAL_DISTANCE, is_met
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.motion import s3_trajectory
from mhsb_planner.motion.cavitation import cavitations_of
from mhsb_planner.motion.energy import Energy, motion_energy
from mhsb_planner.motion.s3_coasting import Coasting, coasting
from mhsb_planner.motion.s3_limits import stays_inside
from mhsb_planner.motion.s3_steered import Steering
from mhsb_planner.motion.s3_trajectory import (
    FitError,
    FitMethod,
    FitRules,
    FittedMotion,
    TrajectoryKind,
    fit_braking,
    fit_rest,
    fit_trajectory,
)
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planners.legs import paths_by_way
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
from mhsb_planner.search.area_shortfall import area_along_motion, area_term
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.search_time import SearchTime

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

PROMISE_KEPT = 0.85
"""A motion costs at least this share of what its path promises, or it is not looked at."""

SLOWER = (1.5, 2.2, 3.4)
"""Factors on the duration of ramps that are compared with the shortest."""

WORTH_LEAVING = 0.02
"""By this share another motion has to be cheaper than the rest of the plan in force."""

LONGEST_REST, CLOSE, NEAR = 1.0, 5e-3, 0.05
"""A motion steers straight to its goal where the rest of the plan in force lasts no longer [s] and
ends no farther from it [m]: NEAR where the motion is soon to be followed by another."""

TURNING = 0.2
"""By so much the end link's angle may change where one motion soon follows the other [rad/s]: the
posture follows the goal, too, and does not flip to and fro."""

LASTING = 1.5
"""A motion that is soon to be followed by another takes so many times the time until then."""

BEHIND = 0.1
"""By so much of that time a cheaper one may take longer."""

ROUNDING = 1e-9
"""Costs that differ by no more than this share are equal."""


def fit_rules(options: PlanOptions, of_path: TrajectoryKind | None = None) -> FitRules:
    """What S3 may do; `of_path` is how it begins on a path, unless it is told.

    Only where polynomials are what is asked for may they pass V_max.
    """
    own = options.trajectory or planner_named(options.planner).trajectory
    rules = FitRules.following()
    if (options.trajectory or of_path or own) == "polynomial":
        asked = own == "polynomial"
        rules = FitRules(max_excess=options.max_speed_excess if asked else rules.max_excess)
    passing = tuple((x, z, options.via_tolerance) for x, z in options.via)
    return replace(rules, least_duration=LASTING * options.period, passing=passing)


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion and where it comes from.

    path     S2's discrete path; without steps where braking alone led to the goal
    motion   S3's trajectory with S4's mode schedule, both with stamp 0
    energy   of the motion [J], in both readings
    seconds  time taken by `search`, `fit` and `energy`, and by the integrated planner's
             `comparison` with others' paths; `first_motion` is when, since the call, there was a
             motion at all [s]
    area_shortfall  of the motion (`area_shortfall`) [m]; 0 where the area has no weight
    cavitations     of actuators whose static loads drive them faster than inlets fill
    """

    path: DiscretePath
    motion: FittedMotion
    energy: Energy
    seconds: MappingProxyType[str, float] = field(default_factory=lambda: MappingProxyType({}))
    area_shortfall: float = 0.0
    cavitations: tuple[Cavitation, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the motion asks of the machine beyond its limits; one sentence for each."""
        return tuple(map(str, (*self.motion.overloads, *self.cavitations)))

    @property
    def lower_bound(self) -> float:
        """No plan from the start to the goal's postures takes less energy [J].

        Of the integrated planner: to any posture at the goal; of the others: to those they allow.
        """
        return self.path.lower_bound

    @property
    def gap(self) -> float:
        """Share by which the motion's energy, reading `paper`, exceeds the lower bound."""
        return self.energy.paper / self.lower_bound - 1.0 if self.lower_bound > 0.0 else 0.0

    @property
    def took(self) -> float:
        """Time that making the plan took [s]."""
        return sum(value for name, value in self.seconds.items() if name != "first_motion")

    @property
    def duration(self) -> float:
        """Of the motion [s]."""
        return self.motion.trajectory.duration_ns / SECOND_NS

    @property
    def joint_travel(self) -> float:
        """How far all joints turn together [rad]."""
        return float(np.abs(np.diff(self.motion.trajectory.position, axis=0)).sum())

    def energy_read(self, options: PlanOptions) -> float:
        """In the reading that is asked for [J]."""
        return self.energy.paper if options.energy_reading == "paper" else self.energy.series

    def cost(self, options: PlanOptions) -> float:
        """w₁ E + w₂ T + w₃ switches + w₄ M of the motion."""
        weights = options.weights
        cost = weights.energy * self.energy_read(options) + weights.time * self.duration
        cost += weights.switches * self.motion.schedule.switches
        return cost + options.area_weight * self.area_shortfall


class Planner:
    """Plans for one machine on one posture table; the step graph follows the machine's changes."""

    def __init__(self, machine: Machine, table: PostureTable) -> None:
        self.graph = StepGraph(machine, table)

    @property
    def machine(self) -> Machine:
        """The machine that plans are made for."""
        return self.graph.machine

    def change(self, machine: Machine) -> None:
        """Plan for another payload, supply pressure, V_max or zones; keeps the table."""
        if machine.config != self.machine.config:
            self.graph = self.graph.changed(machine)

    def plan(
        self,
        goal: tuple[float, float],
        start: MotionState,
        modes: StartModes | None = None,
        brake: Trajectory | None = None,
        options: PlanOptions | None = None,
        deadline: Deadline = NEVER,
        rest: Trajectory | None = None,
    ) -> Plan:
        """Plan to the tip position `goal` (x, z) m, or what the options say will do as well.

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
        for stop in self._stops(goal, start, brake, rest, options):
            task = self._task(goal, start, modes, stop, options)
            making = _Making(self.machine, task, deadline, began)
            if rest is not None and self._leads_to(goal, rest, options):
                making.go_on(rest, task.bound(self.graph))
            try:
                return making.best_along(paths_by_way(planner, self.graph, task, making.time))
            except DeadlineError:
                raise
            except MhsbError as error:
                refused = refused or error
        assert refused is not None
        raise refused

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
        x, z = path.tip[-1].tolist()
        start = MotionState.at_rest(path.posture[0])
        options = options or PlanOptions()
        self._check((x, z), start, options)
        task = self._task((x, z), start, modes, None, options)
        return _Making(self.machine, task, NEVER, perf_counter()).best_along([Candidate(path)])

    def _check(
        self, goal: tuple[float, float], start: MotionState, options: PlanOptions
    ) -> None:
        """Raise RequestError where something is asked for that makes no sense."""
        n = self.machine.joint_count
        if not all(math.isfinite(value) for value in goal):
            raise RequestError("goal", tuple(goal), "must be two finite numbers [m]")
        for name in ("position", "velocity", "acceleration"):
            value = np.asarray(getattr(start, name))
            if value.shape != (n,) or not np.all(np.isfinite(value)):
                rule = f"must be {n} finite numbers, one for each joint"
                raise RequestError(f"start {name}", value.tolist(), rule)
        if options.area_weight > 0.0 and not planner_named(options.planner).weighs_area:
            rule = f"must be 0 for the planner '{options.planner}'"
            rule += f"; {weighing_area()} can weigh the area"
            raise RequestError("area weight", options.area_weight, rule)

    def _stops(
        self,
        goal: tuple[float, float],
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
            away = math.dist(goal, self.machine.tip_position(rest.position[-1]).tolist())
            if away <= (NEAR if options.period > 0.0 else CLOSE):
                stops.append(Steering(start, rest))
        if brake is None or stays_inside(self.machine, coast.trajectory):
            stops.append(coast)
        return stops if brake is None else [*stops, brake]

    def _leads_to(
        self, goal: tuple[float, float], rest: Trajectory, options: PlanOptions
    ) -> bool:
        """Whether the rest of a plan ends at the goal; what it passed on its way is not known."""
        end = rest.position[-1]
        tip, angle = self.machine.tip_position(end), float(end.sum())
        region, psi = options.goal_region, options.goal_psi
        there = is_met(goal, region, psi, tip, angle, AT_GOAL_DISTANCE, AT_GOAL_ANGLE)
        return there and not options.via

    def _task(
        self,
        goal: tuple[float, float],
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
            psi, turn = float(departure.sum()), TURNING * options.period
            options = replace(options, goal_psi=(psi - turn, psi + turn))
        return Task(goal, start, modes, brake, departure, options, area)


class _Making:
    """A plan being made: paths come in, the cheapest motion so far stays.

    time   what the search may take of the time until the deadline
    began  when the plan was asked for
    """

    def __init__(self, machine: Machine, task: Task, deadline: Deadline, began: float) -> None:
        self._machine, self._task = machine, task
        self.time = SearchTime(deadline)
        self._best: Plan | None = None
        self._refused: FitError | None = None
        self._seconds = {"search": 0.0, "fit": 0.0, "energy": 0.0}
        self._began = self._since = began

    def go_on(self, rest: Trajectory, bound: float) -> None:
        """Begin with the rest of the plan in force, where it keeps all limits.

        bound: no plan takes less energy [J]
        """
        task = self._task
        rules = fit_rules(task.options)
        with suppress(FitError, DeadlineError):
            motion = fit_rest(self._machine, rest, task.modes, rules, self.time.deadline)
            tip, end = self._machine.tip_position(rest.position[-1]), rest.position[-1]
            path = DiscretePath.standing(tip, end, task.modes.modes, 0.0)
            self._best = self._priced(replace(path, lower_bound=bound), motion, NEVER)
            self.time.found = True
        self._spend("fit")
        self._seconds["first_motion"] = self._since - self._began

    def best_along(self, candidates: Iterable[Candidate]) -> Plan:
        """The plan along the best of these paths; raises what they raise where there is none."""
        in_time = True
        try:
            for candidate in candidates:
                self._spend("comparison" if candidate.compared else "search")
                self._consider(candidate)
        except DeadlineError:
            if self._best is None:
                raise
            in_time = False
        except MhsbError:
            if self._best is None:
                raise
        self._spend("search")
        if self._best is None:
            raise self._refused or ValueError("a planner that gives no path must say why")
        path = self._best.path
        out_of_time = not in_time or self.time.until.passed
        statistics = replace(path.statistics, out_of_time=out_of_time)
        return replace(
            self._best,
            path=replace(path, statistics=statistics),
            cavitations=cavitations_of(self._machine, self._best.motion.trajectory),
            seconds=MappingProxyType(self._seconds),
        )

    def _consider(self, candidate: Candidate) -> None:
        """Make the path a motion, where it may be cheaper, and keep it if it is."""
        path, options, best = candidate.path, self._task.options, self._best
        promised = path.cost - options.weights.switches * path.switches
        if best is not None and PROMISE_KEPT * promised > best.cost(options):
            return
        began = self._since
        try:
            motion = self._motion(path, fit_rules(options, candidate.trajectory))
        except FitError as error:
            self._refused = self._refused or error
            if best is None and isinstance(self._task.brake, Steering):
                raise  # another way of setting out will do better than another path
            return
        finally:
            self._spend("comparison" if candidate.compared else "fit")
        kept = self._kept(candidate, motion)
        if best is None:
            self._seconds["first_motion"] = self._since - self._began
        self.time.found = True
        self.time.reserve = max(self.time.reserve, self._since - began)
        for rules in self._others(path, motion) if kept else ():
            with suppress(FitError):
                motion = self._motion(path, rules)
                self._spend("comparison")
                self._kept(candidate, motion)

    def _kept(self, candidate: Candidate, motion: FittedMotion) -> bool:
        """Price a motion along a path, keep it if it is the cheapest so far, and say so."""
        best = self._best
        plan = self._priced(candidate.path, motion, NEVER if best is None else self.time.deadline)
        self._spend("comparison" if candidate.compared else "energy")
        if best is not None and not self._takes_over(plan, best):
            return False
        self._best = plan
        return True

    def _takes_over(self, plan: Plan, best: Plan) -> bool:
        """Whether a plan is better than the best so far, and by enough."""
        options = self._task.options
        if not _is_cheaper(plan, best, options):
            return False
        if options.period > 0.0 and plan.duration > best.duration + BEHIND * options.period:
            return False
        share = WORTH_LEAVING if best.motion.method == FitMethod.CONTINUED else 0.0
        return plan.cost(options) <= (1.0 - share) * best.cost(options)

    def _others(self, path: DiscretePath, motion: FittedMotion) -> Iterator[FitRules]:
        """Other ways along a path that may be cheaper than this motion.

        A polynomial that V_max makes slow against following the path, and where inertia calls for
        boost, as more switches than the path's tell, slower ramps.
        """
        asked = fit_rules(self._task.options)
        if self._task.options.period > 0.0 and motion.method != FitMethod.POLYNOMIAL:
            return  # slower ones would fall behind
        following = replace(
            FitRules.following(), least_duration=asked.least_duration, passing=asked.passing
        )
        if motion.method == FitMethod.POLYNOMIAL:
            if motion.stretch > 1.0 and self._task.options.trajectory is None:
                yield following
        elif motion.schedule.switches > path.switches:
            for slower in SLOWER:
                yield replace(following, slowness=(slower,))

    def _motion(self, path: DiscretePath, rules: FitRules) -> FittedMotion:
        task = self._task
        if path.steps == 0:
            brake = task.brake or standstill(task.start.position)
            brake = brake if isinstance(brake, Trajectory) else brake.trajectory
            return fit_braking(self._machine, brake, task.modes)
        return fit_trajectory(
            self._machine,
            path,
            task.start,
            task.modes,
            task.brake,
            rules,
            self.time.deadline,
        )

    def _priced(self, path: DiscretePath, motion: FittedMotion, deadline: Deadline) -> Plan:
        machine, area, shortfall = self._machine, self._task.area, 0.0
        deadline.check("the comparison of motions")
        energy = motion_energy(machine, motion.trajectory, motion.schedule)
        if area.weight > 0.0:
            along = area_along_motion(machine, motion.trajectory, motion.schedule, deadline)
            shortfall = along.shortfall(area.reference)
        return Plan(path, motion, energy, area_shortfall=shortfall)

    def _spend(self, stage: str) -> None:
        """Put down the time since the last look to a stage."""
        now = perf_counter()
        self._seconds[stage] = self._seconds.get(stage, 0.0) + now - self._since
        self._since = now


def _is_cheaper(plan: Plan, other: Plan, options: PlanOptions) -> bool:
    """Whether a plan costs less than another; ties go by energy, time, joint travel."""
    for measure in (
        lambda each: each.cost(options),
        lambda each: each.energy_read(options),
        lambda each: each.duration,
        lambda each: each.joint_travel,
    ):
        new, known = measure(plan), measure(other)
        if abs(new - known) > ROUNDING * known:
            return bool(new < known)
    return False


def warm_up(planner: Planner) -> None:
    """Compile everything that a plan runs through, and load it, with nothing in its way."""
    compile_planner()
    graph = planner.graph
    planner.change(planner.machine.without_obstacles())
    goal_clearance.warm_up(planner.machine)
    for kind in PLANNERS.values():
        kind.warm_up(planner.graph)
    area_shortfall.warm_up(planner.machine)
    s3_trajectory.warm_up(planner.machine)
    planner.graph = graph
