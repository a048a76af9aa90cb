"""S2 to S4 in one call: from a state of motion to a goal.

    machine = load_machine()
    planner = Planner(machine, build_posture_table(machine))
    plan = planner.plan((0.55, 0.60), MotionState.at_rest(posture))
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType
from typing import Literal

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, standstill
from mhsb_model.types import FloatArray
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.errors import NoPathError, RequestError, ZoneError
from mhsb_planner.integrated import integrated_search
from mhsb_planner.motion import s3_trajectory
from mhsb_planner.motion.energy import Energy, motion_energy
from mhsb_planner.motion.s3_trajectory import (
    FitError,
    FitRules,
    FittedMotion,
    TrajectoryKind,
    fit_braking,
    fit_trajectory,
)
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search import area_shortfall, fixed_j3, goal_clearance, s2_search
from mhsb_planner.search.area_shortfall import (
    WITHOUT_AREA,
    AreaTerm,
    area_along_motion,
    area_along_path,
    area_term,
)
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_published import DEFAULT_HEURISTIC_SCALE
from mhsb_planner.search.s2_search import SearchMethod, Weights, search
from mhsb_planner.search.s2_step import EnergyReading

ENERGY_OPTIMAL = Weights(0.5, 0.0, 2.0)
"""Weights of the paper's energy-optimal cases."""

PROMISE_KEPT = 0.85
"""A motion costs at least this share of what its path promises, or it is not looked at."""

COMPARED_WITHIN = 0.6
"""Share of a budget after which there is no time left for a comparison with another path."""

PlannerKind = Literal["table", "fixed", "integrated"]
PLANNER_KINDS: tuple[PlannerKind, ...] = ("table", "fixed", "integrated")
ONLINE_PLANNER: PlannerKind = "integrated"
"""What the node plans with unless told otherwise; cases keep the planner that they name."""


@dataclass(frozen=True)
class PlanOptions:
    """What a plan is to be like.

    weights          of energy, time and mode switches
    energy_reading   `paper` or `series`
    goal_psi         rad, end-link angle at the goal; None leaves it free
    budget           s, for the search; None takes what it needs
    planner          where postures come from: the posture `table`, J3 `fixed` (`fixed_j3`), or
                     decided with path and modes, `integrated`
    trajectory       how S3 begins, with the published `polynomial` or with the path `followed`;
                     None: followed for the integrated planner, polynomial for the others
    initial_j3       rad, at which J3 is kept if it is fixed; None keeps it as at the start
    search           `exact` or `published`
    heuristic_scale  of the published search [1/m]
    max_expansions   of the search; None takes what it needs
    area_weight      w₄ of the velocity polytope's area (`area_shortfall`) [1/m], for the integrated
                     planner; 0 leaves the area out

    Raises RequestError for a weight that is negative or not finite.
    """

    weights: Weights = ENERGY_OPTIMAL
    energy_reading: EnergyReading = "paper"
    goal_psi: float | None = None
    budget: float | None = None
    planner: PlannerKind = "table"
    trajectory: TrajectoryKind | None = None
    initial_j3: float | None = None
    search: SearchMethod = "exact"
    heuristic_scale: float = DEFAULT_HEURISTIC_SCALE
    max_expansions: int | None = None
    area_weight: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.area_weight) and self.area_weight >= 0.0):
            raise RequestError("area weight", self.area_weight, "must be finite and not negative")

    @property
    def fit_rules(self) -> FitRules:
        """What S3 may do."""
        kind = self.trajectory or ("followed" if self.planner == "integrated" else "polynomial")
        return FitRules.following() if kind == "followed" else FitRules()


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion and where it comes from.

    path     S2's discrete path; without steps where braking alone led to the goal
    motion   S3's trajectory with S4's mode schedule, both with stamp 0
    energy   of the motion [J], in both readings
    seconds  time taken by `search`, `fit`, `energy`; the integrated planner's `comparison` with
             the table's path too [s]
    area_shortfall  of the motion (`area_shortfall`) [m]; 0 where the area has no weight
    """

    path: DiscretePath
    motion: FittedMotion
    energy: Energy
    seconds: MappingProxyType[str, float] = field(default_factory=lambda: MappingProxyType({}))
    area_shortfall: float = 0.0

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

    def cost(self, options: PlanOptions) -> float:
        """w₁ E + w₂ T + w₄ M of the motion."""
        energy = self.energy.paper if options.energy_reading == "paper" else self.energy.series
        duration = self.motion.trajectory.duration_ns / SECOND_NS
        cost = options.weights.energy * energy + options.weights.time * duration
        return cost + options.area_weight * self.area_shortfall


@dataclass(frozen=True, eq=False)
class _Task:
    """What is asked of `Planner.plan`."""

    goal: tuple[float, float]
    start: MotionState
    modes: StartModes
    brake: Trajectory | None
    options: PlanOptions
    area: AreaTerm

    @property
    def departure(self) -> FloatArray:
        """Posture at rest from which the path begins [rad]."""
        return self.start.position if self.brake is None else self.brake.position[-1]


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
    ) -> Plan:
        """Plan to the tip position `goal` (x, z) m.

        modes  in force at the start; all N where left out
        brake  how a moving start comes to rest (`mhsb_model.braking`)

        The integrated planner's motion is compared with that along the table's path, where the
        area has a weight also with that which has none, unless the budget is nearly over, and the
        best one taken. Raises OutOfWorkspaceError, InfeasibleGoalError, ZoneError, NoPathError,
        FitError, DeadlineError; RequestError where the area has a weight and the planner cannot
        weigh it.
        """
        options = options or PlanOptions()
        if deadline is not NEVER:
            options = replace(options, budget=max(1e-6, deadline.left))
        if options.area_weight > 0.0 and options.planner != "integrated":
            rule = f"must be 0 for the planner '{options.planner}'; 'integrated' can weigh the area"
            raise RequestError("area weight", options.area_weight, rule)
        task = self._task(goal, start, modes, brake, options)
        if options.planner == "integrated":
            return self._decided_together(task)
        return self._along(task, partial(self._searched, task))

    def _decided_together(self, task: _Task) -> Plan:
        """The integrated planner's plan, or a better one along another path."""
        options, began = task.options, time.perf_counter()
        late = math.inf if options.budget is None else began + COMPARED_WITHIN * options.budget
        table = partial(self._searched, replace(task, options=replace(options, planner="table")))
        others = [table]
        if task.area.weight > 0.0:
            half = None if options.budget is None else 0.5 * options.budget
            plain = replace(task, options=replace(options, budget=half), area=WITHOUT_AREA)
            others.append(partial(self._integrated, plain))
        try:
            found = self._along(task, partial(self._integrated, task))
        except (NoPathError, FitError) as error:
            try:
                return self._along(task, table)
            except ZoneError:  # in the table's postures alone
                raise error from None
        for other in others:
            if time.perf_counter() < late:
                found = self._or_cheaper(task, found, other)
        return found

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
        task = self._task((x, z), start, modes, None, options or PlanOptions())
        return self._along(task, lambda: path)

    def _along(self, task: _Task, search_path: Callable[[], DiscretePath]) -> Plan:
        """The plan along the path that a search finds."""
        began = time.perf_counter()
        path = search_path()
        searched = time.perf_counter()
        if path.steps > 0:
            rules = task.options.fit_rules
            motion = fit_trajectory(self.machine, path, task.start, task.modes, task.brake, rules)
        else:
            still = task.brake or standstill(task.start.position)
            motion = fit_braking(self.machine, still, task.modes)
        fitted = time.perf_counter()
        total = motion_energy(self.machine, motion.trajectory, motion.schedule)
        shortfall = 0.0
        if task.area.weight > 0.0:
            along = area_along_motion(self.machine, motion.trajectory, motion.schedule)
            shortfall = along.shortfall(task.area.reference)
        seconds = {
            "search": searched - began,
            "fit": fitted - searched,
            "energy": time.perf_counter() - fitted,
            "first_motion": time.perf_counter() - began,
        }
        return Plan(path, motion, total, MappingProxyType(seconds), shortfall)

    def _or_cheaper(
        self, task: _Task, found: Plan, other_path: Callable[[], DiscretePath]
    ) -> Plan:
        """The plan found, or the one along another path where that motion costs less.

        The other is fitted only where its path is cheap enough. What a plan costs here is
        `Plan.cost` of its motion: a path's promise is not always kept by its motion.
        """
        options, began = task.options, time.perf_counter()
        earlier = found.seconds.get("comparison", 0.0)
        with suppress(MhsbError):
            path = other_path()
            if task.area.weight > 0.0:
                shortfall = area_along_path(self.machine, path).shortfall(task.area.reference)
                path = replace(path, cost=path.cost + task.area.weight * shortfall)
            promised = path.cost - options.weights.switches * path.switches
            if PROMISE_KEPT * promised < found.cost(options):
                path = replace(path, lower_bound=found.lower_bound)
                other = self._along(task, lambda: path)
                if other.cost(options) < found.cost(options):
                    found = other
        spent = earlier + time.perf_counter() - began
        seconds = {**found.seconds, "comparison": spent}
        return replace(found, seconds=MappingProxyType(seconds))

    def _task(
        self,
        goal: tuple[float, float],
        start: MotionState,
        modes: StartModes | None,
        brake: Trajectory | None,
        options: PlanOptions,
    ) -> _Task:
        modes = modes or StartModes.settled(np.full(self.machine.joint_count, Mode.N))
        area = area_term(options.area_weight, self.graph.table)
        return _Task(goal, start, modes, brake, options, area)

    def _integrated(self, task: _Task) -> DiscretePath:
        """Path, posture and modes decided together."""
        options = task.options
        return integrated_search.search(
            self.machine,
            task.departure,
            task.modes.modes,
            task.goal,
            options.weights,
            options.energy_reading,
            goal_psi=options.goal_psi,
            budget=options.budget,
            certified_from=task.start.position,
            area=task.area,
        )

    def _searched(self, task: _Task) -> DiscretePath:
        """S2: a path over the graph of the postures that the planner takes."""
        options = task.options
        return search(
            self._graph_for(task.departure, options),
            task.departure,
            task.modes.modes,
            task.goal,
            options.weights,
            options.energy_reading,
            method=options.search,
            heuristic_scale=options.heuristic_scale,
            goal_psi=options.goal_psi,
            budget=options.budget,
            max_expansions=options.max_expansions,
        )

    def _graph_for(self, posture: FloatArray, options: PlanOptions) -> StepGraph:
        """The steps to choose from; those with J3 fixed depend on the start and are made for it."""
        if options.planner == "table":
            return self.graph
        limits = self.machine.arrays.joint_min[2], self.machine.arrays.joint_max[2]
        j3 = options.initial_j3
        if j3 is None:  # a start that noise has put beyond a limit is led inside
            j3 = float(np.clip(posture[2], *limits))
        elbow = fixed_j3.elbow_side(self.machine, posture)
        return fixed_j3.fixed_j3_graph(self.machine, self.graph.table, j3, elbow)


def warm_up(planner: Planner) -> None:
    """Compile everything that a plan runs through, with nothing in its way."""
    graph = planner.graph
    planner.change(planner.machine.without_obstacles())
    goal_clearance.warm_up(planner.machine)
    s2_search.warm_up(planner.graph)
    fixed_j3.warm_up(planner.graph)
    integrated_search.warm_up(planner.machine)
    area_shortfall.warm_up(planner.machine)
    s3_trajectory.warm_up(planner.machine)
    planner.graph = graph
