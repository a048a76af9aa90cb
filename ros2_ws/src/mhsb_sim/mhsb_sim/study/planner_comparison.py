"""Planners and supplies side by side: the same moves, planned by each and then simulated.

Every motion follows its path (S3 `followed`), so that what differs is path, posture and modes. The
simulated energy is what all pumps deliver from the motion's first to its last instant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.holding import holding_modes
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import MotionState, Trajectory
from mhsb_model.types import FloatArray
from mhsb_planner.evaluation.ground_truth import ground_truth
from mhsb_planner.evaluation.moves import Move
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planner import ONLINE_PLANNER, PLANNER_KINDS, Plan, Planner, PlanOptions
from mhsb_planner.planners.path_planner import Task
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_planner.search.area_shortfall import WITHOUT_AREA
from mhsb_planner.search.s2_search import Weights
from mhsb_planner.slewing.turned_path import turned, turning_evenly
from mhsb_planner.workers import Jobs, Prepared, results_of
from mhsb_sim.circuit.audit import energy_by_source
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.study.replay import Replay, replay
from mhsb_sim.study.supply_comparison import DIRECT, SIMULATED, Motions, Supplied, supplied
from mhsb_sim.study.supply_systems import Taken, tight

BASELINE = "table"
GROUND_TRUTH = "ground truth"


@dataclass(frozen=True)
class Request:
    """A move to be compared, and whether its ground truth is sought as well."""

    name: str
    move: Move
    with_truth: bool


@dataclass(frozen=True)
class Record:
    """One planner's plan for a move, and its simulation.

    energy_path_j      of the discrete path, reading `paper`
    energy_j, energy_series_j  of the motion as planned, in both readings
    energy_simulated_j delivered by all pumps in the simulator
    lower_bound_j      see `Plan.lower_bound`
    largest_step_rad   largest change of a joint from one point of the path to the next
    joint_travel_rad   sum of all joints' changes along the path
    plan_ms            wall time of the plan, beside whatever else the machine does
    """

    energy_path_j: float
    energy_j: float
    energy_series_j: float
    energy_simulated_j: float
    lower_bound_j: float
    duration_s: float
    switches: int
    largest_step_rad: float
    joint_travel_rad: float
    tip_error_rms_mm: float
    tip_error_max_mm: float
    plan_ms: float


@dataclass(frozen=True)
class Comparison:
    """A move's records by planner, and why planners have none.

    motions  what each of the planners' motions, and `DIRECT`, takes with every supply
    """

    name: str
    records: Mapping[str, Record]
    failures: Mapping[str, str]
    motions: Motions = field(default_factory=dict)


class Comparer:
    """Plans and simulates moves on one machine."""

    def __init__(self, machine: Machine, weights: Weights) -> None:
        self._planner = Planner(machine, table_for(machine))
        strong = at_highest_pressure(machine)
        self._direct = Planner(strong, table_for(strong))
        self._sealed = tight(machine)
        self._weights = weights

    def compare(self, request: Request) -> Comparison:
        """One move by all planners, and by the ground truth where that is asked for."""
        records: dict[str, Record] = {}
        failures: dict[str, str] = {}
        motions: dict[str, Supplied] = {}
        plans: dict[str, Callable[[Move, StartModes], Plan]] = {
            kind: partial(self._planned, kind) for kind in PLANNER_KINDS
        }
        if request.with_truth:
            plans[GROUND_TRUTH] = self._truth
        for kind, plan in plans.items():
            try:
                machine = self._planner.machine
                modes = holding_modes(machine, machine.piston_forces(request.move.start))
                made = plan(request.move, StartModes.settled(modes))
                records[kind], motions[kind] = self._judged(request.move.start, made)
            except MhsbError as error:
                failures[kind] = str(error)
        with suppress(MhsbError):  # what it would have been compared with has failed, too
            motions[DIRECT] = self._supplied(self._direct_motion(request.move), None)
        return Comparison(request.name, records, failures, motions)

    def _supplied(self, trajectory: Trajectory, schedule: ModeSchedule | None) -> Supplied:
        return supplied(self._planner.machine, self._sealed, trajectory, schedule)

    def _direct_motion(self, move: Move) -> Trajectory:
        options = PlanOptions(self._weights, planner=ONLINE_PLANNER, trajectory="followed")
        plan = self._direct.plan(move.goal, MotionState.at_rest(move.start), options=options)
        return plan.motion.trajectory

    def _planned(self, kind: str, move: Move, modes: StartModes) -> Plan:
        start = MotionState.at_rest(move.start)
        options = PlanOptions(self._weights, planner=kind, trajectory="followed")
        return self._planner.plan(move.goal, start, modes, options=options)

    def _truth(self, move: Move, modes: StartModes) -> Plan:
        """The plan along the ground truth's path in the arm's plane, which turns meanwhile."""
        machine, options = self._planner.machine, PlanOptions(self._weights, trajectory="followed")
        tip, slew = machine.in_plane(move.goal, move.start[0])
        first = int(machine.slews)  # joint of the plane
        path = ground_truth(
            machine.plane, move.start[first:], modes.modes[first:], tip, self._weights
        )
        if slew is not None:
            start = MotionState.at_rest(move.start)
            task = Task(move.goal, start, modes, None, start.position, options, WITHOUT_AREA)
            turning = turning_evenly(machine, path, float(move.start[0]), slew)
            path = turned(machine, task, path, turning)
        return self._planner.follow(path, modes, options)

    def _judged(self, start: FloatArray, plan: Plan) -> tuple[Record, Supplied]:
        """A plan's record, its simulation included, and what its motion takes."""
        command = Command(plan.motion.trajectory, plan.motion.schedule)
        run = replay(Simulator(self._planner.machine, posture=start), [command], plan.duration)
        taken = self._supplied(command.trajectory, command.schedule)
        taken.leaking[SIMULATED] = _simulated(run)
        return self._record(plan, run), taken

    def _record(self, plan: Plan, run: Replay) -> Record:
        machine, path = self._planner.machine, plan.path
        error = 1e3 * run.tip_error(machine)
        steps = np.abs(np.diff(path.posture, axis=0))
        return Record(
            energy_path_j=float(path.energy.sum()),
            energy_j=plan.energy.paper,
            energy_series_j=plan.energy.series,
            energy_simulated_j=run.energies["main_pump"] + run.energies["servo_pumps"],
            lower_bound_j=plan.lower_bound,
            duration_s=plan.duration,
            switches=plan.motion.schedule.switches,
            largest_step_rad=float(steps.max(initial=0.0)),
            joint_travel_rad=float(steps.sum()),
            tip_error_rms_mm=float(np.sqrt(np.mean(error**2))),
            tip_error_max_mm=float(error.max()),
            plan_ms=1e3 * plan.took,
        )


def _simulated(run: Replay) -> Taken:
    """What the simulated pumps gave to the oil, and took at their shafts."""
    sources = energy_by_source(run.energies).values()
    return Taken(*(sum(each[kind] for each in sources) for kind in ("hydraulic", "shaft")))


def at_highest_pressure(machine: Machine) -> Machine:
    """The machine with a main pump at the highest boost pressure, which never needs boost."""
    return machine.changed(supply_pressure=machine.arrays.max_boost_pressure)


def compare_all(
    machine: Machine, weights: Weights, requests: Iterable[Request], jobs: Jobs = None
) -> Iterator[Comparison]:
    """Comparisons in the order of the requests, each done by one of `jobs`."""
    with Prepared(jobs, Comparer, machine, weights) as pool:
        tasks = [pool.submit(Comparer.compare, request) for request in requests]
        yield from results_of(tasks, in_order=True)


@dataclass(frozen=True)
class Ratios:
    """One planner's figures over the baseline's, for all moves that both have.

    energy, series, simulated, duration   float64[moves], as planned in both readings, as simulated
    """

    energy: FloatArray
    series: FloatArray
    simulated: FloatArray
    duration: FloatArray

    @property
    def proportion(self) -> FloatArray:
        """Simulated over planned ratio, series reading, float64[moves]: 1 where it is kept."""
        return self.simulated / self.series


def ratios(comparisons: Iterable[Comparison], kind: str, baseline: str = BASELINE) -> Ratios:
    """What a planner takes over what another one takes."""
    pairs = [
        (each.records[kind], each.records[baseline])
        for each in comparisons
        if kind in each.records and baseline in each.records
    ]

    def of(name: str) -> FloatArray:
        return np.array([getattr(own, name) / getattr(base, name) for own, base in pairs])

    return Ratios(
        of("energy_j"), of("energy_series_j"), of("energy_simulated_j"), of("duration_s")
    )
