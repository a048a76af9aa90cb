"""Planner and simulator in lock-step, without a ROS graph, as fast as possible.

Each goal is planned at its time from the command in force, by the same code as in the nodes. The
plan reaches the simulator through the same receiver. Planning takes no simulated time.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields

import numpy as np

from mhsb_model.arm_reports import HandOverOutcome
from mhsb_model.command import Command
from mhsb_model.goal import Goal, format_position
from mhsb_model.kernels.pool import compile_ahead
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray, ModeArray, Position
from mhsb_planner import kernel_parts as planner_kernels
from mhsb_planner.deadline import Deadline
from mhsb_planner.motion.motion_profile import compute_motion_profile
from mhsb_planner.online.commit_horizon import compute_offline_horizon
from mhsb_planner.online.replanning import Replan, Replanner
from mhsb_planner.planner import PlanOptions
from mhsb_sim.errors import HandOverError
from mhsb_sim.simulation import kernel_parts as simulator_kernels
from mhsb_sim.simulation.plan_receiver import PlanReceiver
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.moves.move import MoveRecord
from mhsb_tools.moves.supply_systems import compute_single_supply
from mhsb_tools.study.energy_comparison import EnergyPart

SAMPLE_NS = SECOND_NS // 100
"""Time from one sample to the next [ns]; 10 ms."""

SUPPLY_NAMES = {"by the main pump": "main pump", "by the servo pumps": "servo pumps"}
"""Name in the energy flow diagram of each part that delivers energy."""
TOTAL_NAME = "delivered"
"""Part that is the sum of others and therefore left out."""


def compile_kernels(report_progress: Callable[[str], None] | None = None) -> None:
    """Compile all kernels of planner and simulator that are not in the cache yet.

    Args:
        report_progress: Function that gets a line of progress after each part; None shows a bar.
    """
    parts = (*simulator_kernels.KERNEL_PARTS, *planner_kernels.KERNEL_PARTS)
    compile_ahead(parts, report_progress)


@dataclass(frozen=True)
class TimedGoal:
    """A goal and the time until the next one.

    Attributes:
        position: Tip position in `base_link`, (x, z) or (x, y, z) [m].
        time: Time from this goal to the next [s].
    """

    position: Position
    time: float

    @property
    def goal(self) -> Goal:
        """The position as a goal with stamp 0."""
        return Goal.at(0, self.position)


@dataclass(frozen=True, eq=False)
class Samples:
    """Simulated signals of n joints at k instants, 10 ms apart.

    Attributes:
        time: Instants, shape (k,) [s].
        reference: Reference joint positions, shape (k, n) [rad or m].
        position: Measured joint positions, shape (k, n) [rad or m].
        reference_velocity: Reference joint velocities, shape (k, n) [rad/s or m/s].
        velocity: Measured joint velocities, shape (k, n) [rad/s or m/s].
        tip_error: Distance of the measured tip from the reference's, shape (k,) [m].
        modes: Modes in force, shape (k, n), uint8.
        cap_pressure: Pressures in the cap-side chambers, shape (k, n) [Pa].
        rod_pressure: Pressures in the rod-side chambers, shape (k, n) [Pa].
        supply_pressure: Pressures in the actuators' supply lines, shape (k, n) [Pa].
        valve_opening: Valve openings from −1 to 1, shape (k, n).
        reference_acceleration: Reference joint accelerations, shape (k, n) [rad/s² or m/s²].
    """

    time: FloatArray
    reference: FloatArray
    position: FloatArray
    reference_velocity: FloatArray
    velocity: FloatArray
    tip_error: FloatArray
    modes: ModeArray
    cap_pressure: FloatArray
    rod_pressure: FloatArray
    supply_pressure: FloatArray
    valve_opening: FloatArray
    reference_acceleration: FloatArray

    def column_names(self) -> list[str]:
        """Return the names of the columns of `table`.

        A field of shape (k,) is one column, such as `time`. A field of shape (k, n) is n columns,
        numbered from 1, such as `reference_1`.

        Returns:
            The names in the order of the columns.
        """
        names: list[str] = []
        for field in fields(self):
            values = getattr(self, field.name)
            if values.ndim == 1:
                names.append(field.name)
            else:
                names += [f"{field.name}_{j + 1}" for j in range(values.shape[1])]
        return names

    def table(self) -> FloatArray:
        """Return all values as one array, shape (k, columns)."""
        return np.column_stack([getattr(self, field.name) for field in fields(self)])


@dataclass(frozen=True, eq=False)
class GoalRun:
    """State of a headless run when the time of one goal is up.

    Attributes:
        goal: The goal.
        replan: The plan made for it; None if the arm was there already, or on its way there.
        goal_distance: Distance of the measured tip from the goal [m].
        reference_jump: Largest jump of a joint's reference at the hand-over of the plan [rad or m];
            0 without a plan.
        overdue: Time since the planned end of the motion in force [s]; negative before that end.
    """

    goal: TimedGoal
    replan: Replan | None
    goal_distance: float
    reference_jump: float
    overdue: float


class HeadlessRun:
    """Simulator and planner in lock-step, with a record of the signals."""

    def __init__(
        self,
        simulator: Simulator,
        replanner: Replanner,
        options: PlanOptions,
        budget: float = math.inf,
    ) -> None:
        """Begin a run; the arm holds the simulator's present reference position.

        Args:
            simulator: The simulated arm.
            replanner: Planner that continues the motion in force.
            options: Options of every plan.
            budget: Largest wall time of planning for each goal [s]; infinity sets no limit.
        """
        self.simulator = simulator
        self._budget = budget
        self._replanner = replanner
        self._options = options
        self._receiver = PlanReceiver(simulator.machine, simulator)
        self._rows: list[tuple[object, ...]] = []
        start = simulator.reference.position
        self._command = Command.hold(simulator.time_ns, start, simulator.modes)
        self._current_goal: Goal | None = None

    @property
    def machine(self) -> Machine:
        """The simulated machine."""
        return self.simulator.machine

    def run(self, goals: list[TimedGoal]) -> Iterator[GoalRun]:
        """Plan and simulate goals one after the other; a goal's time may end before it is reached.

        Args:
            goals: The goals, each with the time until the next one.

        Yields:
            The result of each goal at the end of its time, before the next one is planned.

        Raises:
            MhsbError: A goal cannot be planned, the simulated arm refused a plan, or the simulation
                diverged.
        """
        for goal in goals:
            yield self._run_goal(goal)

    def samples(self) -> Samples:
        """Return the signals of everything simulated so far."""
        return Samples(*(np.array(column) for column in zip(*self._rows, strict=True)))

    def _run_goal(self, goal: TimedGoal) -> GoalRun:
        """Plan a goal, give the plan to the simulated arm, and simulate until the next goal is due.

        A sample of the signals is stored every 10 ms of simulated time.

        Args:
            goal: The goal. Its `time` is the duration of the simulation [s].

        Returns:
            The goal, its plan, the reference's jump at the hand-over, and the state of the arm at
            the end of that duration. The plan is None if the arm was at the goal already, or on its
            way there.

        Raises:
            MhsbError: The goal cannot be planned, the simulated arm refused the plan, or the
                simulation diverged.
        """
        simulator = self.simulator
        end_ns = simulator.time_ns + round(goal.time * SECOND_NS)
        replan = self._plan(goal.goal)
        jump = self._hand_over(replan.command) if replan is not None else 0.0
        while simulator.time_ns < end_ns:
            if simulator.time_ns % SAMPLE_NS == 0:
                self._sample()
            simulator.step()
        tip = self.machine.tip_in_base(simulator.joint_state.position)
        distance = float(np.linalg.norm(tip - goal.position))
        overdue = (simulator.time_ns - self._command.trajectory.end_ns) / SECOND_NS
        return GoalRun(goal, replan, distance, jump, overdue)

    def _plan(self, goal: Goal) -> Replan | None:
        """Plan how the motion in force continues to a goal.

        If the last plan has ended, the delay by speed scaling is first set to 0
        (`Simulator.catch_up`).

        Args:
            goal: The goal.

        Returns:
            The plan. None if the motion in force leads to this goal already, or the arm is there.

        Raises:
            MhsbError: The goal cannot be planned.
        """
        if self._current_goal is not None and goal.is_at_same_position(self._current_goal):
            return None
        self.simulator.catch_up()
        now_ns = self.simulator.plan_time_ns
        deadline = Deadline.after(self._budget)
        horizon = compute_offline_horizon(self.machine)
        replan = self._replanner.replan(
            self._command, now_ns, goal.position, horizon, self._options, deadline
        )
        self._current_goal = goal
        return replan

    def _hand_over(self, command: Command) -> float:
        """Give a plan to the simulated arm, and simulate until the plan takes over.

        No signals are sampled during that time. Afterwards the plan is the motion in force.

        Args:
            command: Trajectory and mode schedule of the plan; it takes over at its stamp.

        Returns:
            Largest jump of a joint's reference when the plan took over [rad or m].

        Raises:
            HandOverError: The simulated arm refused the plan.
        """
        simulator, receiver = self.simulator, self._receiver
        reports = receiver.add_trajectory(command.trajectory, 0.0)
        reports += receiver.add_schedule(command.schedule, 0.0)
        while simulator.plan_time_ns < command.stamp_ns:
            simulator.step()
        reports += receiver.update(0.0)
        for report in reports:
            if report.outcome is not HandOverOutcome.APPLIED:
                raise HandOverError(report.sentence)
        self._command = command
        return reports[-1].position_jump

    def _sample(self) -> None:
        """Store the simulator's present signals as a new row.

        The row has time, reference, true joint motion, tip error, modes and hydraulics, in the
        order of the fields of `Samples`.
        """
        simulator, machine = self.simulator, self.machine
        wanted, measured = simulator.reference, simulator.joint_state
        hydraulics = simulator.actuator_states
        error = machine.tip_in_base(measured.position) - machine.tip_in_base(wanted.position)
        self._rows.append(
            (
                simulator.time_ns / SECOND_NS,
                wanted.position,
                measured.position,
                wanted.velocity,
                measured.velocity,
                float(np.linalg.norm(error)),
                simulator.modes,
                hydraulics.cap_pressure,
                hydraulics.rod_pressure,
                hydraulics.supply_pressure,
                hydraulics.valve_opening,
                wanted.acceleration,
            )
        )


def convert_to_move(
    machine: Machine, samples: Samples, goals: list[TimedGoal], elements: list[EnergyPart]
) -> MoveRecord:
    """Convert a simulated run to one move.

    Args:
        machine: The arm that the planner knows.
        samples: The simulated signals; the move goes from the first to the last sample.
        goals: The goals, for the title and for marks in the picture.
        elements: Planned and simulated energy of each part; only the simulated energies are used.

    Returns:
        The move, beginning at time 0. Its piston forces are p_A A − p_B a, with pressure p and area
        A or a of cap side and rod side.
    """
    m = machine.arrays
    energy = {
        SUPPLY_NAMES.get(each.name, each.name): -each.simulated
        if each.name in SUPPLY_NAMES
        else each.simulated
        for each in elements
        if each.name != TOTAL_NAME
    }
    given = -sum(energy[name] for name in SUPPLY_NAMES.values())
    time = samples.time - samples.time[0]
    followed = Trajectory(
        0,
        np.rint(SECOND_NS * time).astype(np.int64),
        samples.reference,
        samples.reference_velocity,
        samples.reference_acceleration,
    )
    places = ", ".join(format_position(goal.position, "g") for goal in goals)
    return MoveRecord(
        machine=machine,
        title=f"To {places}, as simulated",
        goals=tuple(goal.position for goal in goals),
        time=time,
        position=samples.position,
        reference=samples.reference,
        modes=samples.modes,
        speed=compute_motion_profile(machine, samples.position, samples.velocity).speed,
        force=samples.cap_pressure * m.cap_area - samples.rod_pressure * m.rod_area,
        supply=samples.supply_pressure,
        chambers={"cap side": samples.cap_pressure, "rod side": samples.rod_pressure},
        energy=energy,
        energy_title="energy as simulated:\n"
        + compute_single_supply(machine, followed).describe_saving(given),
    )
