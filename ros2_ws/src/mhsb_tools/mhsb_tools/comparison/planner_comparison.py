"""Comparison of planners and supplies: each plans the same moves, which are then simulated.

Every motion follows its discrete path (trajectory kind `followed`), so that only path, posture and
modes differ. The simulated energy is what all pumps deliver from the motion's first to its last
instant.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.holding import choose_holding_modes
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import MotionState, Trajectory
from mhsb_model.types import FloatArray
from mhsb_planner.cases.moves import Move
from mhsb_planner.executor import Jobs, SharedStateExecutor, yield_results
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planner import DEFAULT_PLANNER, PLANNER_KINDS, Plan, Planner, PlanOptions
from mhsb_planner.planners.path_planner import PathRequest
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.search.manipulability_loss import WITHOUT_AREA
from mhsb_planner.search.s2_search import Weights
from mhsb_planner.slewing.turned_path import combine_with_slew, compute_even_turning
from mhsb_sim.circuit.audit import sum_energy_by_source
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.comparison.ground_truth import search_ground_truth
from mhsb_tools.comparison.supply_comparison import (
    SIMULATED_SYSTEM,
    UNBOOSTED_MOTION,
    Motions,
    Supplied,
    compute_supply_energies,
)
from mhsb_tools.moves.supply_systems import SupplyEnergy, remove_leakage
from mhsb_tools.study.replay import Replay, replay

BASELINE_PLANNER = "table"
"""Planner with which the others are compared."""
GROUND_TRUTH = "ground truth"
"""Name of the ground truth among the planners."""


@dataclass(frozen=True)
class ComparedMove:
    """A move to be compared.

    Attributes:
        name: Name of the case, or number of the random move.
        move: Start posture and goal.
        with_truth: Whether the ground truth is searched for as well, which takes seconds.
    """

    name: str
    move: Move
    with_truth: bool


@dataclass(frozen=True)
class PlannerResult:
    """Numbers of one planner's plan for a move, and of its simulation.

    Attributes:
        energy_path_j: Energy of the discrete path, reading `paper` [J].
        energy_j: Energy of the motion as planned, reading `paper` [J].
        energy_series_j: Energy of the motion as planned, reading `series` [J].
        energy_simulated_j: Energy that all pumps deliver in the simulator [J].
        lower_bound_j: Proven lower bound on the energy, see `Plan.lower_bound` [J].
        duration_s: Duration of the motion [s].
        switches: Number of mode switches in the schedule.
        largest_step_rad: Largest change of a joint from one waypoint to the next [rad, or m if the
            joint slides].
        joint_travel_rad: Sum of all joints' absolute changes along the path [rad, telescopes m].
        tip_error_rms_mm: Root mean square of the simulated tip's distance from its reference [mm].
        tip_error_max_mm: Largest such distance [mm].
        plan_ms: Wall time of planning, while other work runs on the machine, too [ms].
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
    """Results of all planners for one move.

    Attributes:
        name: Name of the move.
        records: Result by planner name, for planners that found a plan.
        failures: Reason as a sentence by planner name, for planners that found no plan.
        motions: Energy of each motion with every supply. Keys are the planner names, and
            `UNBOOSTED_MOTION`.
    """

    name: str
    records: Mapping[str, PlannerResult]
    failures: Mapping[str, str]
    motions: Motions = field(default_factory=dict)


class PlannerComparer:
    """Planner and simulator of one machine, which compare moves."""

    def __init__(self, machine: Machine, weights: Weights) -> None:
        """Prepare a planner for the machine, and one for a copy of it that never needs boost.

        The copy has its supply pressure P_S at the highest boost pressure. Builds the posture
        tables of both if they are not cached.

        Args:
            machine: The arm.
            weights: Weights of the cost for all planners.

        Raises:
            MhsbError: The highest boost pressure is not allowed as supply pressure, or a posture
                table has no posture.
        """
        self._planner = Planner(machine, load_or_build_table(machine))
        strong = raise_supply_pressure(machine)
        self._direct = Planner(strong, load_or_build_table(strong))
        self._leakproof = remove_leakage(machine)
        self._weights = weights

    def compare(self, request: ComparedMove) -> Comparison:
        """Plan one move by every planner and simulate each motion.

        Every plan starts at rest, in the modes that hold the start posture. If the move asks for
        the ground truth (path of a long offline search), that counts as a further planner. One more
        motion is planned with the main pump's pressure P_S at the highest boost pressure; it is not
        simulated. A planner that finds no plan raises no error.

        Args:
            request: The move.

        Returns:
            Numbers of each plan and its simulation, by planner. For planners without a plan,
            `failures` has a sentence with the reason. `motions` has the energy of each motion with
            every supply; the motion at the highest pressure has the key `UNBOOSTED_MOTION`, if it
            was found.
        """
        records: dict[str, PlannerResult] = {}
        failures: dict[str, str] = {}
        motions: dict[str, Supplied] = {}
        plans: dict[str, Callable[[Move, StartModes], Plan]] = {
            kind: partial(self._plan_move, self._planner, kind) for kind in PLANNER_KINDS
        }
        if request.with_truth:
            plans[GROUND_TRUTH] = self._plan_ground_truth
        for kind, make_plan in plans.items():
            try:
                machine = self._planner.machine
                modes = choose_holding_modes(machine, machine.piston_forces(request.move.start))
                made = make_plan(request.move, StartModes.create_settled(modes))
                records[kind], motions[kind] = self._simulate_plan(request.move.start, made)
            except MhsbError as error:
                failures[kind] = str(error)
        with suppress(MhsbError):  # then the planners' plans have failed as well
            plan = self._plan_move(self._direct, DEFAULT_PLANNER, request.move, None)
            motions[UNBOOSTED_MOTION] = self._compute_supply_energies(plan.motion.trajectory, None)
        return Comparison(request.name, records, failures, motions)

    def _compute_supply_energies(
        self, trajectory: Trajectory, schedule: ModeSchedule | None
    ) -> Supplied:
        return compute_supply_energies(self._planner.machine, self._leakproof, trajectory, schedule)

    def _plan_move(self, planner: Planner, kind: str, move: Move, modes: StartModes | None) -> Plan:
        """Plan a move from rest; the trajectory follows the planned path.

        Args:
            planner: Planner of the machine, or of its copy that never needs boost.
            kind: Method of planning, such as `table`.
            move: Start posture and goal.
            modes: Modes in force at the start; None for all in N.

        Returns:
            The plan.

        Raises:
            MhsbError: No plan was found.
        """
        start = MotionState.at_rest(move.start)
        options = PlanOptions(self._weights, planner=kind, trajectory="followed")
        return planner.plan(move.goal, start, modes=modes, options=options)

    def _plan_ground_truth(self, move: Move, modes: StartModes) -> Plan:
        """Search the ground truth's path and make a plan along it.

        The ground truth is the cheapest path of a long offline search. It is searched in the arm's
        plane. If the arm slews, the slew's turning is distributed evenly over the path afterwards.

        Args:
            move: Start posture and goal.
            modes: Modes in force at the start.

        Returns:
            The plan; its motion follows the path.

        Raises:
            MhsbError: No path or no motion was found.
        """
        machine, options = self._planner.machine, PlanOptions(self._weights, trajectory="followed")
        tip, slew = machine.convert_to_plane(move.goal, move.start[0])
        first = int(machine.slews)  # index of the first joint in the plane
        path = search_ground_truth(
            machine.planar_arm, move.start[first:], modes.modes[first:], tip, self._weights
        )
        if slew is not None:
            start = MotionState.at_rest(move.start)
            task = PathRequest(move.goal, start, modes, None, start.position, options, WITHOUT_AREA)
            turning = compute_even_turning(machine, path, float(move.start[0]), slew)
            path = combine_with_slew(machine, task, path, turning)
        return self._planner.follow(path, modes, options)

    def _simulate_plan(self, start: FloatArray, plan: Plan) -> tuple[PlannerResult, Supplied]:
        """Simulate a plan and evaluate it.

        Args:
            start: Start posture, shape (n,) [rad or m].
            plan: The plan.

        Returns:
            Numbers of the plan and its simulation, and the energy of its motion with every supply.
            Among the energies is the simulated one, as supply `SIMULATED_SYSTEM`. It exists only
            for valves that leak (`leaking`).

        Raises:
            SimulationDivergedError: The simulation diverged.
        """
        command = Command(plan.motion.trajectory, plan.motion.schedule)
        run = replay(Simulator(self._planner.machine, posture=start), [command], plan.duration)
        taken = self._compute_supply_energies(command.trajectory, command.schedule)
        sources = sum_energy_by_source(run.energies).values()
        taken.leaking[SIMULATED_SYSTEM] = SupplyEnergy(
            *(sum(each[kind] for each in sources) for kind in ("hydraulic", "shaft"))
        )
        return self._record(plan, run), taken

    def _record(self, plan: Plan, run: Replay) -> PlannerResult:
        """Collect energies, duration, joint travel and tip errors of a plan and its simulation.

        Args:
            plan: The plan.
            run: Its simulation.

        Returns:
            The numbers. Tip errors are distances of the simulated tip from its reference.
        """
        machine, path = self._planner.machine, plan.path
        error = 1e3 * run.tip_error(machine)
        steps = np.abs(np.diff(path.posture, axis=0))
        return PlannerResult(
            energy_path_j=float(path.energy.sum()),
            energy_j=plan.energy.paper,
            energy_series_j=plan.energy.series,
            energy_simulated_j=run.energies["main_pump"] + run.energies["servo_pumps"],
            lower_bound_j=plan.lower_bound,
            duration_s=plan.duration,
            switches=plan.motion.schedule.switch_count,
            largest_step_rad=float(steps.max(initial=0.0)),
            joint_travel_rad=float(steps.sum()),
            tip_error_rms_mm=float(np.sqrt(np.mean(error**2))),
            tip_error_max_mm=float(error.max()),
            plan_ms=1e3 * plan.planning_time,
        )


def raise_supply_pressure(machine: Machine) -> Machine:
    """Return the machine with P_S at the highest boost pressure, where it never needs boost.

    Raises:
        MachineFileError: This supply pressure is not allowed for the machine.
    """
    return machine.changed(supply_pressure=machine.arrays.max_boost_pressure)


def compare_all(
    machine: Machine, weights: Weights, requests: Iterable[ComparedMove], jobs: Jobs = None
) -> Iterator[Comparison]:
    """Compare moves in parallel processes.

    Args:
        machine: The arm.
        weights: Weights of the cost.
        requests: The moves.
        jobs: Number of processes, or a cluster that does the work. None takes one process for each
            processor.

    Yields:
        Comparisons in the order of the requests, each as soon as it and all before it are done.

    Raises:
        RequestError: The number of processes is below 1.
        ClusterError: The cluster does not answer.
    """
    with SharedStateExecutor(jobs, PlannerComparer, machine, weights) as pool:
        tasks = [pool.submit(PlannerComparer.compare, request) for request in requests]
        yield from yield_results(tasks, in_order=True)


def compute_ratios(
    comparisons: Iterable[Comparison], kind: str, baseline: str = BASELINE_PLANNER
) -> dict[str, FloatArray]:
    """Divide energies and durations of one planner's motions by another planner's values.

    Args:
        comparisons: Results of all planners for each move. Moves that one of the two planners did
            not plan are left out.
        kind: Name of the planner whose values are divided.
        baseline: Name of the planner by whose values they are divided.

    Returns:
        Ratios `kind` / `baseline`, each of shape (moves,), in the order of the comparisons; empty
        if no move was planned by both. Keys:

        - energy, energy_series: of the planned energies, with boosted oil priced as `paper` and as
            `series`
        - energy_simulated: of the simulated energies
        - simulated_over_planned_ratio: `energy_simulated` divided by `energy_series`, 1 if the
            simulation shows the saving that was planned
        - duration: of the durations
    """
    pairs = [
        (each.records[kind], each.records[baseline])
        for each in comparisons
        if kind in each.records and baseline in each.records
    ]
    energy, series, simulated, duration = (
        np.array([getattr(own, name) / getattr(base, name) for own, base in pairs])
        for name in ("energy_j", "energy_series_j", "energy_simulated_j", "duration_s")
    )
    return {
        "energy": energy,
        "energy_series": series,
        "energy_simulated": simulated,
        "simulated_over_planned_ratio": simulated / series,
        "duration": duration,
    }
