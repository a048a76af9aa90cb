"""Planner and simulator in lock-step, without a ROS graph, as fast as it goes.

Each goal is planned at its time from the command in force, by the same code as in the nodes, and
handed to the simulator through the same receiver. Planning takes no simulated time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from mhsb_model.arm_reports import HandOverOutcome
from mhsb_model.command import Command
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, ModeArray, Position
from mhsb_planner.deadline import Deadline
from mhsb_planner.online.lead import OFFLINE_LEAD
from mhsb_planner.online.replanning import Replan, Replanner
from mhsb_planner.planner import PlanOptions
from mhsb_sim.errors import HandOverError
from mhsb_sim.simulation.plan_receiver import PlanReceiver
from mhsb_sim.simulation.simulator import Simulator

SAMPLE_NS = SECOND_NS // 100


@dataclass(frozen=True)
class TimedGoal:
    """A tip position [m] in `base_link` and the time until the next goal [s]."""

    position: Position
    time: float

    @property
    def goal(self) -> Goal:
        """Where to."""
        return Goal.at(0, self.position)


@dataclass(frozen=True, eq=False)
class Samples:
    """What was simulated, k instants 10 ms apart, n joints.

    time                float64[k], s
    reference           float64[k, n], rad
    position            float64[k, n], rad
    reference_velocity  float64[k, n], rad/s
    velocity            float64[k, n], rad/s
    tip_error           float64[k], m, measured against reference
    modes               uint8[k, n]
    cap_pressure        float64[k, n], Pa
    rod_pressure        float64[k, n], Pa
    supply_pressure     float64[k, n], Pa
    valve_opening       float64[k, n], -1 to 1
    reference_acceleration  float64[k, n], rad/s²
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

    @classmethod
    def collect(cls, rows: list[tuple[object, ...]]) -> Samples:
        """From one row for each instant, in the order of the fields."""
        return cls(*(np.array(column) for column in zip(*rows, strict=True)))

    def column_names(self) -> list[str]:
        """A name for each number of a row: `time`, `reference_1`, …"""
        names: list[str] = []
        for field in fields(self):
            values = getattr(self, field.name)
            if values.ndim == 1:
                names.append(field.name)
            else:
                names += [f"{field.name}_{j + 1}" for j in range(values.shape[1])]
        return names

    def table(self) -> FloatArray:
        """All numbers as float64[k, columns]."""
        return np.column_stack([getattr(self, field.name) for field in fields(self)])


@dataclass(frozen=True, eq=False)
class GoalRun:
    """One goal: its plan, and where the arm was when its time was up.

    replan          None where the arm was there already, or on its way there
    goal_distance   m, measured tip to goal at the end of the goal's time
    reference_jump  rad, of the reference at the hand-over
    overdue         s, since the motion in force should have ended; negative where it goes on
    """

    goal: TimedGoal
    replan: Replan | None
    goal_distance: float
    reference_jump: float
    overdue: float


class HeadlessRun:
    """A simulator, a planner, and the record of what they do together."""

    def __init__(
        self,
        simulator: Simulator,
        replanner: Replanner,
        options: PlanOptions,
        budget: float = math.inf,
    ) -> None:
        """budget: for each plan, as the node has it [s]; by default a plan takes what it takes."""
        self.simulator = simulator
        self._budget = budget
        self._replanner = replanner
        self._options = options
        self._receiver = PlanReceiver(simulator.machine, simulator)
        self._rows: list[tuple[object, ...]] = []
        start = simulator.reference.position
        self._command = Command.hold(simulator.time_ns, start, simulator.modes)
        self._bound_for: Goal | None = None

    @property
    def machine(self) -> Machine:
        """The simulated machine."""
        return self.simulator.machine

    def run(self, goals: list[TimedGoal]) -> Iterator[GoalRun]:
        """Run all goals, one after the other; raises what planning and simulating raise."""
        for goal in goals:
            yield self._one(goal)

    def samples(self) -> Samples:
        """Everything so far."""
        return Samples.collect(self._rows)

    def _one(self, goal: TimedGoal) -> GoalRun:
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
        """A plan from what is in force; None where that leads to the goal already."""
        if self._bound_for is not None and goal.same_place(self._bound_for):
            return None
        self.simulator.catch_up()
        now_ns = self.simulator.plan_time_ns
        deadline = Deadline.after(self._budget)
        replan = self._replanner.replan(
            self._command, now_ns, goal.position, OFFLINE_LEAD, self._options, deadline
        )
        self._bound_for = goal
        return replan

    def _hand_over(self, command: Command) -> float:
        """Give a command to the simulator when its time has come; the jump of the reference."""
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
