"""S2 to S4 in one call: from a state of motion to a goal.

    machine = load_machine()
    planner = Planner(machine, build_posture_table(machine))
    plan = planner.plan((0.55, 0.60), MotionState.at_rest(posture))
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import MotionState, Trajectory, standstill
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner import fixed_j3, s2_search, s3_trajectory
from mhsb_planner.discrete_path import DiscretePath
from mhsb_planner.energy import Energy, motion_energy
from mhsb_planner.integrated import integrated_search
from mhsb_planner.s1_posture_table import PostureTable
from mhsb_planner.s2_graph import StepGraph
from mhsb_planner.s2_published import DEFAULT_HEURISTIC_SCALE
from mhsb_planner.s2_search import SearchMethod, Weights, search
from mhsb_planner.s2_step import EnergyReading
from mhsb_planner.s3_trajectory import (
    FitRules,
    FittedMotion,
    TrajectoryKind,
    fit_braking,
    fit_trajectory,
)
from mhsb_planner.s4_mode_schedule import StartModes

ENERGY_OPTIMAL = Weights(0.5, 0.0, 2.0)
"""Weights of the paper's energy-optimal cases."""


PlannerKind = Literal["table", "fixed", "integrated"]
PLANNER_KINDS: tuple[PlannerKind, ...] = ("table", "fixed", "integrated")


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

    @property
    def fit_rules(self) -> FitRules:
        """What S3 may do."""
        followed = self.planner == "integrated"
        return FitRules(self.trajectory or ("followed" if followed else "polynomial"))


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion and where it comes from.

    path     S2's discrete path; without steps where braking alone led to the goal
    motion   S3's trajectory with S4's mode schedule, both with stamp 0
    energy   of the motion [J], in both readings
    seconds  time taken by `search`, `fit` and `energy` [s]
    """

    path: DiscretePath
    motion: FittedMotion
    energy: Energy
    seconds: MappingProxyType[str, float] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def lower_bound(self) -> float:
        """No plan from the path's start to the goal's postures takes less energy [J]."""
        return self.path.lower_bound


class Planner:
    """Plans for one machine on one posture table; the step graph follows the machine's changes."""

    def __init__(self, machine: Machine, table: PostureTable) -> None:
        self.graph = StepGraph(machine, table)

    @property
    def machine(self) -> Machine:
        """The machine that plans are made for."""
        return self.graph.machine

    def change(self, machine: Machine) -> None:
        """Plan for another payload, supply pressure or V_max from now on; keeps the table."""
        if machine.hash != self.machine.hash:
            self.graph = self.graph.changed(machine)

    def plan(
        self,
        goal: tuple[float, float],
        start: MotionState,
        modes: StartModes | None = None,
        brake: Trajectory | None = None,
        options: PlanOptions | None = None,
    ) -> Plan:
        """Plan to the tip position `goal` (x, z) m.

        modes  in force at the start; all N where left out
        brake  how a moving start comes to rest (`mhsb_model.braking`)

        Raises OutOfWorkspaceError, InfeasibleGoalError, NoPathError, FitError, DeadlineError.
        """
        options = options or PlanOptions()
        modes = modes or StartModes.settled(np.full(self.machine.joint_count, Mode.N))
        began = time.perf_counter()
        departure = start.position if brake is None else brake.position[-1]
        path = self._path(departure, modes.modes, goal, options)
        searched = time.perf_counter()
        if path.steps > 0:
            motion = fit_trajectory(self.machine, path, start, modes, brake, options.fit_rules)
        else:
            motion = fit_braking(self.machine, brake or standstill(start.position), modes)
        fitted = time.perf_counter()
        total = motion_energy(self.machine, motion.trajectory, motion.schedule)
        seconds = {
            "search": searched - began,
            "fit": fitted - searched,
            "energy": time.perf_counter() - fitted,
        }
        return Plan(path, motion, total, MappingProxyType(seconds))

    def _path(
        self,
        departure: FloatArray,
        modes: ModeArray,
        goal: tuple[float, float],
        options: PlanOptions,
    ) -> DiscretePath:
        """S2, or what takes its place, from a posture at rest [rad]."""
        if options.planner == "integrated":
            return integrated_search.search(
                self.machine,
                departure,
                modes,
                goal,
                options.weights,
                options.energy_reading,
                goal_psi=options.goal_psi,
                budget=options.budget,
            )
        return search(
            self._graph_for(departure, options),
            departure,
            modes,
            goal,
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
        j3 = float(posture[2]) if options.initial_j3 is None else options.initial_j3
        elbow = fixed_j3.elbow_side(self.machine, posture)
        return fixed_j3.fixed_j3_graph(self.machine, self.graph.table, j3, elbow)


def warm_up(planner: Planner) -> None:
    """Compile everything that a plan runs through."""
    s2_search.warm_up(planner.graph)
    fixed_j3.warm_up(planner.graph)
    integrated_search.warm_up(planner.machine)
    s3_trajectory.warm_up(planner.machine)
