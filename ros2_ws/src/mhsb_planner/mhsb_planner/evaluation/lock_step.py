"""An arm, a worker and a clock around a `GoalLifecycle`: time passes only when it is told to.

The arm obeys the contract of the hand-over: it takes a command only where it continues its
reference, and tells what is in force. Messages and plans take the time that they are given.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from mhsb_model.arm_reports import HandOverReason
from mhsb_model.command import Command
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import FloatArray
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Report
from mhsb_planner import deadline
from mhsb_planner.deadline import Deadline
from mhsb_planner.online.arm_view import NO_PLAN
from mhsb_planner.online.goal_lifecycle import GoalLifecycle
from mhsb_planner.online.plan_request import PlanRequest
from mhsb_planner.online.replanning import Replan, Replanner
from mhsb_planner.online.settings import Settings

BEGINNING = 1e9
"""By the world's clock [s]; far beyond the processor's, so that no deadline passes by itself."""

STEP = 0.005

DELAY_PERIOD = 0.1
"""From one report of an arm's delay to the next [s]."""

LONGEST_PLANNING = 1.0
"""What a plan that takes a given time may really take [s]."""

LARGEST_JUMP = 1e-6
FIRST_STAMP_NS = 1000 * SECOND_NS
FARTHEST_AHEAD_NS = SECOND_NS // 2
"""How far ahead of its time the arm lets a command wait [ns]."""


@dataclass
class Arm:
    """What follows commands; its clock runs at `speed`, and stands still while it is frozen.

    time_ns   by which it follows commands; its clock less `delay_ns`
    pace      at which it follows them, below 1 while it is slowed
    delay_ns  what this has cost, until a command has come to its end
    """

    machine: Machine
    command: Command
    time_ns: int = FIRST_STAMP_NS
    in_force_ns: int = NO_PLAN
    speed: float = 1.0
    pace: float = 1.0
    delay_ns: int = 0
    frozen: bool = False
    fault: str = ""
    last_stop_ns: int = 0
    jumps: list[float] = field(default_factory=list)
    _sampled: tuple[Command, int, MotionState] | None = field(default=None, init=False)

    @property
    def clock_ns(self) -> int:
        """By its clock, ns."""
        return self.time_ns + self.delay_ns

    def pass_time(self, seconds: float) -> None:
        """Follow the command for so long, by the world's time."""
        passed_ns = round(seconds * self.speed * SECOND_NS)
        followed_ns = round(self.pace * passed_ns)
        self.time_ns += followed_ns
        self.delay_ns += passed_ns - followed_ns
        if self.time_ns > self.command.trajectory.end_ns:
            self.in_force_ns = NO_PLAN
            self.time_ns, self.delay_ns = self.clock_ns, 0

    @property
    def reference(self) -> MotionState:
        """What it follows now; asked for several times in a step, sampled once."""
        if self._sampled is None or self._sampled[:2] != (self.command, self.time_ns):
            state = self.command.trajectory.sample(self.time_ns)
            self._sampled = self.command, self.time_ns, state
        return self._sampled[2]

    @property
    def moves(self) -> bool:
        """Whether its reference moves."""
        return bool(self.reference.velocity.any())

    def take(self, command: Command) -> HandOverReason:
        """Follow a command if it continues the reference; the reason why not."""
        if self.fault:
            return HandOverReason.FAULT
        old, new = self.reference, command.trajectory.sample(self.time_ns)
        jump = max(
            float(np.abs(new.position - old.position).max()),
            float(np.abs(new.velocity - old.velocity).max()),
        )
        if jump > LARGEST_JUMP:
            return HandOverReason.LATE
        self.jumps.append(jump)
        self.command, self.in_force_ns = command, command.stamp_ns
        return HandOverReason.NONE

    def stop_at_once(self) -> None:
        """Hold where it is: how it gets there is not the lifecycle's business."""
        position, modes = self.reference.position, self.command.schedule.modes_at(self.time_ns)
        self.command = Command.hold(self.time_ns, position, modes)
        self.in_force_ns = NO_PLAN
        self.last_stop_ns = self.clock_ns

    def start_anew(self, time_ns: int) -> None:
        """Hold where it is, with its clock at another time."""
        position = self.reference.position
        self.time_ns, self.delay_ns = time_ns, 0
        normal = np.zeros(len(position), dtype=np.uint8)
        self.command = Command.hold(time_ns, position, normal)
        self.in_force_ns = NO_PLAN
        self.last_stop_ns = 0


class World:
    """Events in the order of their times.

    step           s, of time between two looks
    planning_time  s, that a plan takes; None: what it takes here
    transport      s, that a command takes to the arm
    lost           so many of the next commands get lost
    reachable      whether the arm hears commands
    ros_ahead      s, by which ROS's clock is ahead of the arm's
    """

    def __init__(
        self,
        machine: Machine,
        replanner: Replanner,
        settings: Settings,
        *,
        start: FloatArray | None = None,
        step: float = STEP,
    ) -> None:
        """With the arm at rest in a posture [rad], that of the machine file where left out."""
        self.now = BEGINNING
        self.machine = machine
        posture = np.array(machine.config.simulation.start_posture if start is None else start)
        normal = np.zeros(machine.joint_count, dtype=np.uint8)
        self.arm = Arm(machine, Command.hold(FIRST_STAMP_NS, posture, normal))
        self.replanner = replanner
        self.step = step
        self.planning_time: float | None = 0.02
        self.transport = 0.002
        self.lost = 0
        self.reachable = True
        self.ros_ahead = 0.0
        self.reports: list[Report] = []
        self.sent: list[Command] = []
        self.warnings: list[str] = []
        self.asked_arm_to_stop = 0
        self.planned: list[PlanRequest] = []
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._count = 0
        self._delay_told = self.now
        self.life = GoalLifecycle(settings, replanner.stop, self, self)
        self.goals = 0
        self.pass_time(0.5)

    # --- Clock and outbox of the lifecycle -------------------------------------------------------

    def wall(self) -> float:
        """By the world's clock [s]."""
        return self.now

    def ros_ns(self) -> int:
        """The arm's clock, if the two are not apart [ns]."""
        return self.arm.clock_ns + round(self.ros_ahead * SECOND_NS)

    def plan(self, request: PlanRequest) -> None:
        """Answered after the planning time."""
        self.planned.append(request)
        began, left = deadline.now(), LONGEST_PLANNING
        if self.planning_time is None:
            left = request.deadline.instant - request.began
        work = replace(request, deadline=Deadline.after(left))
        made: Replan | Exception | None
        try:
            made = work.answered_by(self.replanner)
        except Exception as error:
            made = error
        if self.planning_time is not None and isinstance(made, Replan):
            made = replace(made, improving=0.0)  # of the time here, which is not the world's
        took = deadline.now() - began if self.planning_time is None else self.planning_time
        self.later(took, lambda: self.life.planned(request, made))

    def send(self, command: Command) -> None:
        """To the arm, which gets it later."""
        self.sent.append(command)
        if self.lost > 0:
            self.lost -= 1
            return
        self.later(self.transport, lambda: self._arrive(command))

    def report(self, report: Report) -> None:
        """Keep it."""
        self.reports.append(report)

    def warn(self, sentence: str) -> None:
        """Keep it."""
        self.warnings.append(sentence)

    def stop_arm(self) -> None:
        """The arm stops a little later."""
        self.asked_arm_to_stop += 1
        self.later(self.transport, self.arm.stop_at_once)

    def connected(self) -> bool:
        """Whether the arm hears commands."""
        return self.reachable

    # --- What happens ----------------------------------------------------------------------------

    def goal(self, *place: float) -> int:
        """Send a goal [m] in `base_link`; its stamp."""
        self.goals += 1
        self.life.goal(Goal.at(self.goals, place))
        return self.goals

    def pass_time(self, seconds: float) -> None:
        """Let everything happen that happens in so many seconds."""
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now += self.step
            if not self.arm.frozen:
                self.arm.pass_time(self.step)
            while self._events and self._events[0][0] <= self.now:
                heapq.heappop(self._events)[2]()
            self._tell()
            self.life.tick()

    def until(self, condition: Callable[[], bool], longest: float = 40.0) -> None:
        """Let time pass until something is so."""
        end = self.now + longest
        while not condition():
            if self.now >= end:
                raise TimeoutError(self.reports[-3:], self.warnings[-2:])
            self.pass_time(self.step)

    def later(self, delay: float, event: Callable[[], None]) -> None:
        """Let something happen later."""
        self._count += 1
        heapq.heappush(self._events, (self.now + delay, self._count, event))

    def verdict(self, stamp: int) -> GoalVerdict:
        """The one verdict on a goal, when it has come."""
        self.until(lambda: bool(self.verdicts(stamp)))
        [verdict] = self.verdicts(stamp)
        return verdict

    def ending(self, stamp: int) -> ExecutionReport:
        """The one execution report on a goal, when it has come."""
        self.until(lambda: bool(self.endings(stamp)))
        [ending] = self.endings(stamp)
        return ending

    def verdicts(self, stamp: int) -> list[GoalVerdict]:
        """All on one goal."""
        return [
            each
            for each in self.reports
            if isinstance(each, GoalVerdict) and each.goal_stamp_ns == stamp
        ]

    def endings(self, stamp: int) -> list[ExecutionReport]:
        """All on one goal."""
        return [
            each
            for each in self.reports
            if isinstance(each, ExecutionReport) and each.goal_stamp_ns == stamp
        ]

    def tip_is_at(self, *place: float) -> bool:
        """Whether the reference rests at a point."""
        tip = self.machine.tip_in_base(self.arm.reference.position)
        return not self.arm.moves and math.dist(tip, place) < 1e-3

    # --- The arm's side --------------------------------------------------------------------------

    def _arrive(self, command: Command) -> None:
        ahead_ns = command.stamp_ns - self.arm.time_ns
        if self.arm.frozen or 0 < ahead_ns <= FARTHEST_AHEAD_NS:  # it waits at the arm
            self.later(self.step, lambda: self._arrive(command))
            return
        reason = HandOverReason.STAMP if ahead_ns > 0 else self.arm.take(command)
        if reason:
            self.later(
                self.transport,
                lambda: self.life.heard_refusal(command.stamp_ns, reason, f"refused: {reason}"),
            )

    def _tell(self) -> None:
        if self.arm.frozen:
            return
        self.life.heard_fault(self.arm.fault)
        self.life.heard_stop(self.arm.last_stop_ns)
        if self.now >= self._delay_told + DELAY_PERIOD or not self.arm.delay_ns:
            self._delay_told = self.now
            self.life.heard_delay(self.arm.delay_ns)
        if self.life.view.in_force_ns != self.arm.in_force_ns:
            self.life.heard_in_force(self.arm.in_force_ns)
        self.life.heard_modes(self.arm.command.schedule.modes_at(self.arm.time_ns))
        self.life.heard_joints(self.arm.reference, self.arm.clock_ns)
        self.life.heard_reference(self.arm.reference, self.arm.clock_ns)
