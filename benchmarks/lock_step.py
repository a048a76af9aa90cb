"""Simulated arm, planning worker and clock around a `GoalLifecycle`, advanced in lock step.

Time passes only when the test lets it pass. The arm keeps the contract of the hand-over: it takes a
command only if the command continues its reference, and reports which one is in force. Messages and
plans take given times.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from mhsb_model.arm_reports import HandOverReason
from mhsb_model.command import MAX_HAND_OVER_JUMP, Command
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import FloatArray
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Report
from mhsb_planner import deadline
from mhsb_planner.deadline import Deadline
from mhsb_planner.online.arm_state import NO_PLAN
from mhsb_planner.online.goal_lifecycle import GoalLifecycle
from mhsb_planner.online.plan_request import PlanRequest
from mhsb_planner.online.replanning import Replan, Replanner
from mhsb_planner.online.settings import Settings

START_TIME = 1e9
"""Time of the world's clock at the start [s]. It is far beyond the processor's clock, so that no
deadline passes by itself.
"""

TIME_STEP = 0.005
"""Default time step of the world [s]."""

DELAY_PERIOD = 0.1
"""Period of the arm's reports of its delay [s]."""

LONGEST_PLANNING = 1.0
"""Largest processor time of a plan whose simulated planning time is given [s]."""

FIRST_STAMP_NS = 1000 * SECOND_NS
"""The arm's time at the start [ns]."""
FARTHEST_AHEAD_NS = SECOND_NS // 2
"""Largest time by which a command may come before its stamp and wait at the arm [ns]."""


@dataclass
class SimulatedArm:
    """Simulated arm that follows commands exactly.

    Its clock runs at `clock_rate` and stands still while the arm is frozen.

    Attributes:
        machine: The machine.
        command: Command in force, or the one that holds the arm.
        time_ns: Time of plans at which the arm follows its command [ns]: its clock less `delay_ns`.
        in_force_ns: Stamp of the command in force [ns]; NO_PLAN if there is none.
        clock_rate: Rate of the arm's clock relative to the world's.
        speed_scaling: Speed scaling: rate at which commands are followed; below 1 the arm is
            slowed.
        delay_ns: Delay that the speed scaling has caused in the command in force [ns].
        frozen: Whether the arm neither moves nor communicates.
        fault: Fault of the arm as a sentence; empty if it is healthy.
        last_stop_ns: Clock time of the last stop [ns]; 0 if there was none.
        jumps: Largest difference between reference and command, in position or velocity of any
            joint, at each hand-over so far [rad, rad/s or m, m/s].
    """

    machine: Machine
    command: Command
    time_ns: int = FIRST_STAMP_NS
    in_force_ns: int = NO_PLAN
    clock_rate: float = 1.0
    speed_scaling: float = 1.0
    delay_ns: int = 0
    frozen: bool = False
    fault: str = ""
    last_stop_ns: int = 0
    jumps: list[float] = field(default_factory=list)
    _sampled: tuple[Command, int, MotionState] | None = field(default=None, init=False)

    @property
    def clock_ns(self) -> int:
        """Time of the arm's clock [ns]."""
        return self.time_ns + self.delay_ns

    def pass_time(self, seconds: float) -> None:
        """Follow the command for some time.

        The arm's clock advances by `clock_rate`, and the time on the command by `speed_scaling`
        times as much. The difference is added to `delay_ns`. When the command ends, it is no longer
        in force and the delay is set to 0.

        Args:
            seconds: Time by the world's clock [s].
        """
        passed_ns = round(seconds * self.clock_rate * SECOND_NS)
        followed_ns = round(self.speed_scaling * passed_ns)
        self.time_ns += followed_ns
        self.delay_ns += passed_ns - followed_ns
        if self.time_ns > self.command.trajectory.end_ns:
            self.in_force_ns = NO_PLAN
            self.time_ns, self.delay_ns = self.clock_ns, 0

    @property
    def reference(self) -> MotionState:
        """Position, velocity and acceleration of `command` at `time_ns`.

        They are cached until the command or the time changes.
        """
        time_ns = min(self.time_ns, self.command.trajectory.end_ns + 1)  # later it is the same
        if self._sampled is None or self._sampled[:2] != (self.command, time_ns):
            state = self.command.trajectory.sample(time_ns)
            self._sampled = self.command, time_ns, state
        return self._sampled[2]

    @property
    def joint_state(self) -> MotionState:
        """Measured position, velocity and acceleration, which equal the reference."""
        return self.reference

    @property
    def is_moving(self) -> bool:
        """True if the reference moves."""
        return bool(self.reference.velocity.any())

    def accept(self, command: Command) -> HandOverReason:
        """Take a command if it continues the reference, within MAX_HAND_OVER_JUMP.

        `command`, `in_force_ns` and `jumps` are then updated.

        Args:
            command: The command.

        Returns:
            NONE if the command was taken. FAULT if the arm has a fault, LATE if the command does
            not continue the reference.
        """
        if self.fault:
            return HandOverReason.FAULT
        old, new = self.reference, command.trajectory.sample(self.time_ns)
        jump = max(
            float(np.abs(new.position - old.position).max()),
            float(np.abs(new.velocity - old.velocity).max()),
        )
        if jump > MAX_HAND_OVER_JUMP:
            return HandOverReason.LATE
        self.jumps.append(jump)
        self.command, self.in_force_ns = command, command.stamp_ns
        return HandOverReason.NONE

    def stop_at_once(self) -> None:
        """Stop without deceleration and hold the present position and modes.

        `command` becomes a hold, `in_force_ns` NO_PLAN, and `last_stop_ns` the clock's time.
        `delay_ns` and `jumps` do not change.
        """
        position, modes = self.reference.position, self.command.schedule.modes_at(self.time_ns)
        self.command = Command.hold(self.time_ns, position, modes)
        self.in_force_ns = NO_PLAN
        self.last_stop_ns = self.clock_ns

    def restart(self, time_ns: int) -> None:
        """Hold the present position in mode N and set the clock, as after a restart of the arm.

        The delay and the time of the last stop become 0, and no plan is in force.

        Args:
            time_ns: New time of the clock [ns].
        """
        position = self.reference.position
        self.time_ns, self.delay_ns = time_ns, 0
        normal = np.zeros(len(position), dtype=np.uint8)
        self.command = Command.hold(time_ns, position, normal)
        self.in_force_ns = NO_PLAN
        self.last_stop_ns = 0


class LockStepWorld:
    """Discrete-event world of a planner node: clock, transport, arm and lifecycle.

    The world is the clock and the outbox of its `GoalLifecycle`. Attributes may be changed at any
    time.

    Attributes:
        now: Time of the world's clock [s].
        machine: The machine.
        arm: The simulated arm.
        replanner: Makes the plans.
        step: Time step [s].
        planning_time: Simulated time that a plan takes [s]; None: the time that it really takes.
        transport: Time that a command takes to the arm [s].
        lost: Number of the next commands that get lost.
        reachable: Whether the arm receives commands.
        has_other_planner: Whether another node is said to send plans, too.
        report_delay: Time by which the arm's reports of faults and stops arrive late [s].
        in_force_delay: Time by which the arm's reports of the command in force arrive late [s].
        second_lag: Time by which the clock of a second publisher of references is behind [s]; 0:
            there is no such publisher.
        ros_ahead: Time by which the ROS clock is ahead of the arm's [s].
        reports: Verdicts and execution reports so far.
        sent: Commands sent so far, lost ones included.
        warnings: Log sentences so far.
        asked_arm_to_stop: Number of calls of the arm's own stop.
        planned: Plan requests so far.
        life: The lifecycle.
        goals: Number of goals sent, which is the stamp of the last.
    """

    def __init__(
        self,
        machine: Machine,
        replanner: Replanner,
        settings: Settings,
        *,
        start: FloatArray | None = None,
        step: float = TIME_STEP,
        arm: SimulatedArm | None = None,
    ) -> None:
        """Create the world with the arm at rest, and let half a second pass.

        Args:
            machine: The machine.
            replanner: Makes the plans.
            settings: Settings of the lifecycle.
            start: Start posture, shape (n,) [rad or m]; None: the one in the machine file.
            step: Time step [s].
            arm: The arm, at rest; None: one that follows commands exactly.
        """
        self.now = START_TIME
        self.machine = machine
        posture = np.array(machine.config.simulation.start_posture if start is None else start)
        normal = np.zeros(machine.joint_count, dtype=np.uint8)
        hold = Command.hold(FIRST_STAMP_NS, posture, normal)
        self.arm = arm or SimulatedArm(machine, hold)
        self.replanner = replanner
        self.step = step
        self.planning_time: float | None = 0.02
        self.transport = 0.002
        self.lost = 0
        self.reachable = True
        self.has_other_planner = False
        self.report_delay = self.in_force_delay = 0.0
        self._told_until = {"report": self.now, "in_force": self.now}
        self.second_lag = 0.0
        self.ros_ahead = 0.0
        self.reports: list[Report] = []
        self.sent: list[Command] = []
        self.warnings: list[str] = []
        self.asked_arm_to_stop = 0
        self.planned: list[PlanRequest] = []
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._count = 0
        self._delay_told = self.now
        self.life = GoalLifecycle(settings, replanner.make_braking_command, self)
        self.goals = 0
        self.pass_time(0.5)

    # --- Clock and outbox of the lifecycle -------------------------------------------------------

    def steady_time(self) -> float:
        """Return the time of the world's clock [s]."""
        return self.now

    def ros_ns(self) -> int:
        """Return the time of the ROS clock [ns]: the arm's clock plus `ros_ahead`."""
        return self.arm.clock_ns + round(self.ros_ahead * SECOND_NS)

    def start_planning(self, request: PlanRequest) -> None:
        """Make a plan now and deliver the answer after the planning time.

        With a given `planning_time`, making the plan may really take up to LONGEST_PLANNING. With
        None, its deadline is as long after now as that of the request was after the request, and
        the answer comes after the real time. An exception is delivered as the answer.

        Args:
            request: The request.
        """
        self.planned.append(request)
        began, left = deadline.now(), LONGEST_PLANNING
        if self.planning_time is None:
            left = request.deadline.instant - request.requested_at
        work = replace(request, deadline=Deadline.after(left))
        made: Replan | Exception | None
        try:
            made = work.make_plan(self.replanner)
        except Exception as error:
            made = error
        if self.planning_time is not None and isinstance(made, Replan):
            made = replace(made, improvement_time=0.0)  # real time, which is not the world's
        took = deadline.now() - began if self.planning_time is None else self.planning_time
        self.schedule(took, lambda: self.life.handle_plan_answer(request, made))

    def send(self, command: Command) -> None:
        """Send a command to the arm, which arrives after `transport` unless it is lost.

        It is lost if `lost` is above 0, which then decreases by one.

        Args:
            command: The command.
        """
        self.sent.append(command)
        if self.lost > 0:
            self.lost -= 1
            return
        self.schedule(self.transport, lambda: self._deliver_command(command))

    def report(self, report: Report) -> None:
        """Keep a report."""
        self.reports.append(report)

    def warn(self, sentence: str) -> None:
        """Keep a log sentence."""
        self.warnings.append(sentence)

    def stop_arm(self, on_answer: Callable[[bool, str], None]) -> bool:
        """Call the arm's own stop, which takes effect after the time `transport`.

        A frozen arm stops when it runs again.

        Args:
            on_answer: Called with success and sentence when the arm answers.

        Returns:
            True: the service is always there.
        """
        self.asked_arm_to_stop += 1
        self.schedule(self.transport, lambda: self._stop_arm(on_answer))
        return True

    def _stop_arm(self, on_answer: Callable[[bool, str], None]) -> None:
        """Stop the arm and send its answer; a frozen arm is tried again after a time step.

        Args:
            on_answer: Called with success and sentence when the arm answers.
        """
        if self.arm.frozen:
            self.schedule(self.step, lambda: self._stop_arm(on_answer))
            return
        self.arm.stop_at_once()
        self.schedule(self.transport, lambda: on_answer(True, "the arm holds"))

    def must_call_arm_stop(self) -> bool:
        """Return whether another planner is said to send plans; see `has_other_planner`."""
        return self.has_other_planner

    def describe_publisher_conflict(self) -> str:
        """Return a sentence that names both publishers of references; "" if there is only one."""
        return "reference comes from 2 publishers whose clocks differ" if self.second_lag else ""

    def is_arm_connected(self) -> bool:
        """Return whether the arm receives commands."""
        return self.reachable

    # --- What happens ----------------------------------------------------------------------------

    @property
    def is_idle(self) -> bool:
        """True if all goals have ended, no command is unconfirmed, and no stop is under way."""
        state = self.life.state
        return not (state.goals_in_progress or state.unconfirmed or self.life.is_stopping)

    def send_goal(self, *place: float) -> int:
        """Send a goal to the lifecycle, which handles it at once.

        Args:
            place: Coordinates in `base_link` [m].

        Returns:
            Stamp of the goal: its number, from 1.
        """
        self.goals += 1
        self.life.add_goal(Goal.at(self.goals, place))
        return self.goals

    def pass_time(self, seconds: float) -> None:
        """Advance the world in time steps.

        In each step the arm follows its command, due events are handled, the arm sends its reports,
        and the lifecycle ticks.

        Args:
            seconds: Time to pass [s].
        """
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now += self.step
            if not self.arm.frozen:
                self.arm.pass_time(self.step)
            while self._events and self._events[0][0] <= self.now:
                heapq.heappop(self._events)[2]()
            self._send_arm_reports()
            self.life.tick()

    def pass_time_until(self, condition: Callable[[], bool], longest: float = 40.0) -> None:
        """Let time pass until a condition holds.

        Args:
            condition: Function that is called before each time step; True ends the wait.
            longest: Time after which the wait is given up [s].

        Raises:
            TimeoutError: The condition does not hold in time. The error carries the last 3 reports
                and 2 warnings.
        """
        end = self.now + longest
        while not condition():
            if self.now >= end:
                raise TimeoutError(self.reports[-3:], self.warnings[-2:])
            self.pass_time(self.step)

    def schedule(self, delay: float, event: Callable[[], None]) -> None:
        """Schedule a function to be called by `pass_time` at a later time.

        Events of equal time keep the order in which they were scheduled.

        Args:
            delay: Time until the call [s].
            event: Function to call.
        """
        self._count += 1
        heapq.heappush(self._events, (self.now + delay, self._count, event))

    def verdict(self, stamp: int) -> GoalVerdict:
        """Let time pass until a goal has its verdict; there must be exactly one.

        Args:
            stamp: Stamp of the goal, as `send_goal` returned it.

        Returns:
            The verdict.

        Raises:
            TimeoutError: The verdict does not come in time.
        """
        self.pass_time_until(lambda: bool(self.verdicts(stamp)))
        [verdict] = self.verdicts(stamp)
        return verdict

    def execution_report(self, stamp: int) -> ExecutionReport:
        """Let time pass until a goal has its execution report; there must be exactly one.

        Args:
            stamp: Stamp of the goal, as `send_goal` returned it.

        Returns:
            The report.

        Raises:
            TimeoutError: The report does not come in time.
        """
        self.pass_time_until(lambda: bool(self.execution_reports(stamp)))
        [ending] = self.execution_reports(stamp)
        return ending

    def verdicts(self, stamp: int) -> list[GoalVerdict]:
        """Return all verdicts so far on the goal with the given stamp."""
        return [
            each
            for each in self.reports
            if isinstance(each, GoalVerdict) and each.goal_stamp_ns == stamp
        ]

    def execution_reports(self, stamp: int) -> list[ExecutionReport]:
        """Return all execution reports so far on the goal with the given stamp."""
        return [
            each
            for each in self.reports
            if isinstance(each, ExecutionReport) and each.goal_stamp_ns == stamp
        ]

    def tip_is_at(self, *place: float) -> bool:
        """Return whether the reference rests with the tip at a point.

        Args:
            place: Coordinates in `base_link` [m].

        Returns:
            True if the tip is within 1 mm of the point and the reference does not move.
        """
        tip = self.machine.tip_in_base(self.arm.reference.position)
        return not self.arm.is_moving and math.dist(tip, place) < 1e-3

    # --- The arm's side --------------------------------------------------------------------------

    def _deliver_command(self, command: Command) -> None:
        """Deliver a command to the arm.

        A command that comes at most FARTHEST_AHEAD_NS before its stamp is tried again after a time
        step. While the arm is frozen, every command is. A command that comes earlier is refused
        with STAMP. Otherwise `SimulatedArm.accept` decides. A refusal is reported after the time
        `transport`.

        Args:
            command: The command.
        """
        ahead_ns = command.stamp_ns - self.arm.time_ns
        if self.arm.frozen or 0 < ahead_ns <= FARTHEST_AHEAD_NS:  # it waits at the arm
            self.schedule(self.step, lambda: self._deliver_command(command))
            return
        reason = HandOverReason.STAMP if ahead_ns > 0 else self.arm.accept(command)
        if reason:
            self.schedule(
                self.transport,
                lambda: self.life.handle_plan_refusal(
                    command.stamp_ns, reason, f"refused: {reason}"
                ),
            )

    def _send_arm_reports(self) -> None:
        """Send the arm's reports to the lifecycle; a frozen arm sends none.

        The reports are fault, last stop, delay, command in force, modes, joint state and reference.
        Fault and last stop arrive `report_delay` late, the command in force `in_force_delay` late,
        all else at once. The delay is sent every
        DELAY_PERIOD, and in every step while it is 0. The command in force is sent if it differs
        from what the lifecycle knows. If `second_lag` is not 0, a second publisher sends a
        reference at rest with all joints at 0. It is stamped `second_lag` before the arm's clock.
        """
        if self.arm.frozen:
            return
        fault, stop_ns, in_force_ns = self.arm.fault, self.arm.last_stop_ns, self.arm.in_force_ns
        self._deliver_in_order(
            "report", self.report_delay, lambda: self._send_fault_and_stop(fault, stop_ns)
        )
        if self.now >= self._delay_told + DELAY_PERIOD or not self.arm.delay_ns:
            self._delay_told = self.now
            self.life.arm_state.plan_delay_ns = self.arm.delay_ns
        if self.life.arm_state.plan_in_force_ns != in_force_ns:
            self._deliver_in_order(
                "in_force", self.in_force_delay, lambda: self.life.handle_plan_in_force(in_force_ns)
            )
        self.life.arm_state.modes = self.arm.command.schedule.modes_at(self.arm.time_ns)
        self.life.arm_state.add_measurement(self.arm.joint_state, self.now)
        self.life.handle_reference(self.arm.reference, self.arm.clock_ns)
        if self.second_lag:
            behind_ns = self.arm.clock_ns - round(self.second_lag * SECOND_NS)
            elsewhere = MotionState.at_rest(0.0 * self.arm.reference.position)
            self.life.handle_reference(elsewhere, behind_ns)

    def _send_fault_and_stop(self, fault: str, stop_ns: int) -> None:
        """Report fault and last stop of the arm to the lifecycle, and that its machine file agrees.

        Args:
            fault: Fault of the arm; empty if it is healthy.
            stop_ns: Clock time of the arm's last stop [ns].
        """
        self.life.state.store_arm_machine("")
        self.life.handle_arm_fault(fault)
        self.life.handle_arm_stop(stop_ns)

    def _deliver_in_order(self, topic: str, delay: float, event: Callable[[], None]) -> None:
        """Deliver a message after a delay, but never before earlier messages of its topic.

        Args:
            topic: Key of the topic: "report" or "in_force".
            delay: Delay [s].
            event: Function that delivers the message.
        """
        at = max(self.now + delay, self._told_until[topic])
        self._told_until[topic] = at
        if at <= self.now:
            event()
        else:
            self.schedule(at - self.now, event)
