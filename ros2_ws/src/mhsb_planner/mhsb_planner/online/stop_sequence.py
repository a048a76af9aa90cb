"""Stop of the arm: braking commands for this planner's plan, calls of the arm's own ~/stop.

A stop is finished when the arm is measured at rest. It is also finished when the arm has confirmed
a braking command, if it is known when the arm will rest. The time of plans is the arm's clock minus
the delay that speed scaling has caused.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Outcome
from mhsb_planner.online.arm_state import NO_PLAN, ArmState
from mhsb_planner.online.commit_horizon import LATE_PLAN_FACTOR
from mhsb_planner.online.execution import Execution, ExecutionResult
from mhsb_planner.online.goal_reports import GoalReports
from mhsb_planner.online.hand_over import HandOver
from mhsb_planner.online.pending_goal import PendingGoal
from mhsb_planner.online.plan_request import UnconfirmedPlan
from mhsb_planner.online.planner_io import Clock, PlannerIO
from mhsb_planner.online.rest_detector import REST_TIME
from mhsb_planner.online.settings import Settings
from mhsb_planner.online.zone_ahead import (
    describe_missing_braking,
    describe_waiting,
    find_obstacle_ahead,
    make_braking_for_obstacle,
)

STOP_TIMEOUT = 5.0
"""Longest time for the arm to confirm a braking command or to answer its ~/stop [s]."""

REST_TIMEOUT = 15.0
"""Longest time for the arm to come to rest once its ~/stop has been answered [s]."""

CALL_PERIOD = 1.0
"""Time without an answer after which the arm's ~/stop is called again [s]."""

OWN_REPORT = 2.0
"""Time after this planner's call of ~/stop within which the arm reports the stop [s]."""

MAX_BRAKING_COMMANDS = 3
"""Number of braking commands that are sent before the arm's own ~/stop is called."""

BRAKING_TIMEOUT = 1.0
"""Time after the beginning of a stop in which braking commands are sent [s].

After it the arm's own ~/stop is called.
"""

SETTLING_TIME = 0.3
"""Time from the end of the reference's motion until the measured arm counts as at rest [s].

On all machine files the measured speed falls below 0.005 rad/s before the reference has stopped.
"""

LATE_SHARE = 0.5
"""Largest share of the commit horizon in which a braking for an obstacle may be computed [-].

If it takes longer, it is computed again with a longer horizon. With a larger share, more of these
commands would come too late.
"""

OLD_STOP = 1.0
"""Time after a stop of the arm in which goals are void if they were sent before its report [s].

It covers the delay with which the arm's clock is known from its messages."""

LATE_REPORT = 0.1
"""Delay of the report of a stop above which this process must have been suspended [s].

A report takes some milliseconds, also if the planner is busy, because the middleware receives it. A
process that was suspended receives all messages at once when it goes on, in any order.
"""

STOP_ASKED = "the planner was asked to stop"
"""Reason of a stop that a user has requested from the planner."""

ARM_STOPPED = "the arm was asked to stop"
"""Reason of a stop that somebody has requested from the arm."""

AT_REST = "the arm stands still"
"""Sentence of a stop that has succeeded."""


@dataclass
class _Stop:
    """Stop that is under way.

    Attributes:
        reason: Reason of the stop, as execution reports state it.
        started_at: Time at which the stop began, by the steady clock [s].
        on_finished: Functions to call once with success and sentence when the stop is finished.
        goals: Goals that end with the stop.
        goal_after_stop: Goal to plan for after the arm has stopped; None for no goal.
        tries: Number of braking commands made so far.
        is_braking_confirmed: True if the arm has confirmed one of these commands.
        last_call_at: Time of the last call of the arm's own ~/stop, by the steady clock [s]; -inf
            if there was no call.
        answer: Success and sentence of the arm's own ~/stop; None before it has answered.
        answered_at: Time of that answer, by the steady clock [s]; infinite before.
        obstacle: Name of the obstacle for which the arm brakes; empty if there is none.
        obstacle_set_ns: Time at which this obstacle was set, in the time of plans [ns].
    """

    reason: str
    started_at: float
    on_finished: list[Callable[[bool, str], None]] = field(default_factory=list)
    goals: list[PendingGoal] = field(default_factory=list)
    goal_after_stop: PendingGoal | None = None
    tries: int = 0
    is_braking_confirmed: bool = False
    last_call_at: float = -math.inf
    answer: tuple[bool, str] | None = None
    answered_at: float = math.inf
    obstacle: str = ""
    obstacle_set_ns: int = 0


class StopSequence:
    """Sequence of steps that brings the arm to rest: brake, call its own ~/stop, find the result.

    A stop begins with `begin`, `join` or `begin_for_obstacle`. While it is under way, the goal
    lifecycle calls `take_step` and `find_result` after each event. It calls `confirm_braking` when
    the arm has taken a braking command, and `finish` as soon as there is a result.
    """

    def __init__(
        self,
        arm_state: ArmState,
        brake: Callable[[Command, int, float], tuple[Command, int]],
        clock: Clock,
        outbox: PlannerIO,
        hand_over: HandOver,
    ) -> None:
        """Begin without a stop.

        Args:
            arm_state: Arm state.
            brake: Function that makes a braking command. Its arguments are the command in force,
                the earliest stamp of the braking command [ns], and the time from stamp to braking
                [s]. It returns the braking command and the time at which braking begins [ns]. Times
                [ns] are in the time of plans (the arm's clock minus the arm's delay behind its
                plans).
            clock: Source of the present time.
            outbox: Interface that calls the arm's ~/stop and writes the log.
            hand_over: Record of sent commands. It chooses stamp and commit horizon of braking
                commands.
        """
        self._arm_state = arm_state
        self._brake = brake
        self._clock = clock
        self._outbox = outbox
        self._hand_over = hand_over
        self._stop: _Stop | None = None
        self._last_obstacle_sentence = ""
        self._unreported_calls: deque[float] = deque()
        self._last_stop_ns: int | None = None

    @property
    def is_under_way(self) -> bool:
        """True while the arm is being brought to rest."""
        return self._stop is not None

    # --- Begin -----------------------------------------------------------------------------------

    def begin(self, reason: str) -> _Stop:
        """Begin a stop, unless one is under way, and return the stop under way.

        Args:
            reason: Reason of the stop, as execution reports state it. It is ignored if a stop is
                under way already.
        """
        self._stop = self._stop or _Stop(reason, self._clock.steady_time())
        return self._stop

    def join(self, done: Callable[[bool, str], None], goals: list[PendingGoal]) -> None:
        """Begin a stop that a user has requested, or join the stop under way.

        If a goal was to be planned for after the stop under way, it now ends with the stop.

        Args:
            done: Called once with success and sentence when the stop is finished.
            goals: Goals that end with the stop.
        """
        stop = self.begin(STOP_ASKED)
        stop.on_finished.append(done)
        stop.goals += goals
        if stop.goal_after_stop is not None:
            stop.goals.append(stop.goal_after_stop)
            stop.goal_after_stop = None

    def begin_for_obstacle(self, machine: Machine, goal_after_stop: PendingGoal | None) -> bool:
        """Begin a stop if an obstacle lies ahead on the motion in force.

        If a stop is under way already, it goes on, but now brakes for the obstacle. If the arm has
        already confirmed a braking command of that stop, a new one is made all the same: the first
        one did not consider the obstacle.

        Args:
            machine: Machine with the zones in force.
            goal_after_stop: Goal to plan for after the arm has stopped; None for no goal. It is
                ignored if a stop is under way already.

        Returns:
            True if there is an obstacle. False if there is none, or if the arm executes no command
            of this planner.
        """
        own, now_ns = self._arm_state.own_command, self._now_ns()
        if own is None or not self._arm_state.executes_own(now_ns):
            return False
        obstacle = find_obstacle_ahead(machine, own, now_ns)
        if obstacle is None:
            return False
        if self._stop is None:
            self.begin("").goal_after_stop = goal_after_stop
            self._last_obstacle_sentence = ""
        stop = self.begin("")
        stop.obstacle, stop.obstacle_set_ns = obstacle, now_ns
        stop.is_braking_confirmed = False  # one in force was not made for this obstacle
        return True

    def call_arm_stop(self, on_answer: Callable[[bool, str], None]) -> bool:
        """Call the arm's own ~/stop once, and store the time of the call.

        Args:
            on_answer: Called with success and sentence when the arm answers.

        Returns:
            True if the service was called, False if it is not available.
        """
        if not self._outbox.stop_arm(on_answer):
            return False
        self._unreported_calls.append(self._clock.steady_time())
        return True

    def find_void_time(
        self, stop_ns: int, age: float = 0.0, received_at: float | None = None
    ) -> float | None:
        """Find the time up to which goals are void, after the arm's report of its last stop.

        Void goals end as stopped. They were sent before the report was received, and not later than
        `OLD_STOP` after the stop. If this is the first report, they were sent before the stop: the
        first messages that a planner receives may be seconds old, and the stop is then older
        than it seems. A stop that this planner called for (~/stop) makes no goal void. Each call
        accounts for one reported stop, unless the stop came before the call, or the last call is
        more than `OWN_REPORT` ago.

        If the report came more than `LATE_REPORT` after its stop, this process was suspended. Goals
        that came in this time may still be unread. The report then counts as received `LATE_REPORT`
        later than now, so that these goals are void, too.

        Args:
            stop_ns: Time of the stop by the arm's clock [ns]; 0 means never.
            age: Time from the stop to the report, by the arm's clock [s].
            received_at: Time of receipt of the report by the steady clock [s]; None means now.

        Returns:
            Latest time at which a void goal was sent, by the steady clock [s]. None if there was no
            stop, if the stop was reported before, or if this planner has called for it.
        """
        now, arm = self._clock.steady_time(), self._arm_state
        before, self._last_stop_ns = self._last_stop_ns, stop_ns
        if stop_ns in (0, before):
            return None
        received_at = now if received_at is None else received_at
        speed = arm.clock_estimator.convert_duration(1.0)
        ago = (self._now_ns() + arm.plan_delay_ns - stop_ns) / SECOND_NS / speed
        ago = max(ago, age / speed + now - received_at)
        if self._unreported_calls and now - self._unreported_calls[-1] > OWN_REPORT:
            self._unreported_calls.clear()
        if self._unreported_calls and now - ago + OLD_STOP > self._unreported_calls[0]:
            self._unreported_calls.popleft()
            return None
        if ago - (now - received_at) > LATE_REPORT:
            received_at = now + LATE_REPORT
        return min(received_at, now - ago + (OLD_STOP if before is not None else 0.0))

    # --- Steps -----------------------------------------------------------------------------------

    def take_step(self, settings: Settings) -> UnconfirmedPlan | None:
        """Take the next step to bring the arm to rest.

        The first of these cases decides:

        1. No stop is under way: nothing happens.
        2. A braking command can help (`_may_brake`): it is made, unless another command was sent
           and not answered yet. Each further braking command has a longer commit horizon (time
           until braking begins).
        3. The arm has confirmed a braking command: nothing happens.
        4. Otherwise the arm's own ~/stop is called, at most every `CALL_PERIOD`, until it has
           answered.

        Args:
            settings: Settings for all goals.

        Returns:
            Braking command to send; None if there is nothing to send now.
        """
        stop, own = self._stop, self._arm_state.own_command
        if stop is None:
            return None
        if own is None or not self._may_brake(stop):
            if not stop.is_braking_confirmed:
                self._call_until_answered(stop)
            return None
        if self._hand_over.unconfirmed is not None:
            return None
        stop.tries += 1
        return self._make_braking(stop, own, settings)

    def _may_brake(self, stop: _Stop) -> bool:
        """Return whether a braking command can be the next step of a stop.

        Args:
            stop: The stop under way.

        Returns:
            True if all of these conditions are met:

            - The arm executes a command of this planner.
            - The arm has no fault, and its reference has one publisher.
            - No braking command is confirmed, and fewer than `MAX_BRAKING_COMMANDS` were made.
            - The stop began at most `BRAKING_TIMEOUT` ago.
            - No other node sends plans that could replace the braking command. This does not count
              if an obstacle is braked for, since the arm's ~/stop does not know the obstacle.
        """
        arm, waited = self._arm_state, self._clock.steady_time() - stop.started_at
        given_up = stop.tries >= MAX_BRAKING_COMMANDS or waited > BRAKING_TIMEOUT
        if stop.is_braking_confirmed or given_up or arm.publisher_conflict or arm.fault:
            return False
        if not stop.obstacle and self._outbox.must_call_arm_stop():
            return False
        return arm.executes_own(self._now_ns())

    def _call_until_answered(self, stop: _Stop) -> None:
        """Call the arm's ~/stop if it has not answered and the last call is `CALL_PERIOD` ago.

        Args:
            stop: The stop. Its `last_call_at` is written if ~/stop was called, and its `answer`
                later, when the arm answers.
        """

        def store_answer(success: bool, sentence: str) -> None:
            """Store the arm's answer in the stop, and its time."""
            stop.answer = success, sentence
            stop.answered_at = self._clock.steady_time()

        now = self._clock.steady_time()
        is_due = now - stop.last_call_at >= CALL_PERIOD
        if stop.answer is None and is_due and self.call_arm_stop(store_answer):
            stop.last_call_at = now

    def _make_braking(self, stop: _Stop, own: Command, settings: Settings) -> UnconfirmedPlan:
        """Make a command that brakes along the path of the command in force.

        If the stop has an obstacle, a braking is chosen that rests before it, if there is one. The
        reason of the stop then becomes a sentence on the place of rest, which is also logged. If
        this takes more than `LATE_SHARE` of the commit horizon (time until braking begins), it is
        repeated with a longer horizon.

        Args:
            stop: The stop under way.
            own: Command that the arm executes.
            settings: Settings for all goals.

        Returns:
            The command, ready to be sent.
        """
        at_ns, machine = self._hand_over.choose_stamp(self._now_ns()), settings.machine
        horizon = self._hand_over.choose_braking_horizon(stop.tries - 1, settings)
        sentence = ""
        if not stop.obstacle:
            command, change_ns = self._brake(own, at_ns, horizon)
        else:
            since_ns = stop.obstacle_set_ns
            braking = make_braking_for_obstacle(machine, own, at_ns, horizon, since_ns)
            took = (self._now_ns() - at_ns) / SECOND_NS
            if took > LATE_SHARE * horizon:  # the rest is too short for transport
                braking = make_braking_for_obstacle(
                    machine, own, self._now_ns(), horizon + LATE_PLAN_FACTOR * took, since_ns
                )
            command, change_ns = braking.command, braking.change_ns
            sentence = braking.describe(stop.obstacle)
            self._report_obstacle(sentence)
        now = self._clock.steady_time()
        return UnconfirmedPlan(
            command, change_ns, now, now, braking_machine=machine, obstacle_sentence=sentence
        )

    def confirm_braking(self, sent: UnconfirmedPlan) -> tuple[bool, str] | None:
        """Store that the arm has confirmed a braking command.

        Args:
            sent: The braking command.

        Returns:
            True and a sentence with the time until the arm rests; with this result the stop can be
            finished. None if this time is not known: the reference governor has delayed plans, or
            the arm does not report which plan it executes. Only a measured rest then finishes the
            stop. None also if no stop is under way.
        """
        if sent.obstacle_sentence:
            self._report_obstacle(sent.obstacle_sentence)
        if self._stop is None:
            return None
        self._stop.is_braking_confirmed = True
        if self._arm_state.plan_delay_ns != 0 or self._arm_state.plan_in_force_ns is None:
            return None
        left = max(0.0, (sent.command.trajectory.end_ns - self._now_ns()) / SECOND_NS)
        left = left / min(1.0, self._arm_state.clock_estimator.speed) + SETTLING_TIME
        return True, f"the arm stands still in {left:.2f} s"

    # --- End -------------------------------------------------------------------------------------

    def find_result(self) -> tuple[bool, str] | None:
        """Find the result of the stop: the arm rests, or it cannot be brought to rest.

        The stop succeeds if the arm is measured at rest and will stay there, and no command is
        unconfirmed (sent, without an answer). It fails in three cases:

        - The arm's ~/stop answers without success.
        - After `STOP_TIMEOUT`, the arm has neither confirmed a braking command nor answered ~/stop.
        - After `REST_TIMEOUT`, the arm is still not at rest.

        Returns:
            Success and sentence. None while the arm may still come to rest, or if no stop is under
            way.
        """
        stop, arm, now = self._stop, self._arm_state, self._clock.steady_time()
        if stop is None:
            return None
        waited = now - stop.started_at
        if self._will_stay_at_rest(stop, waited) and arm.rest_detector.is_at_rest(now):
            return (True, AT_REST) if self._hand_over.unconfirmed is None else None
        if stop.answer is not None and not stop.answer[0]:
            return False, f"the arm does not stop: {stop.answer[1]}"
        if waited <= STOP_TIMEOUT:
            return None
        motion = arm.rest_detector.describe_motion(now)
        if stop.answer is None and not stop.is_braking_confirmed:
            problem = f"was not answered within {STOP_TIMEOUT:g} s"
            if stop.last_call_at == -math.inf:
                problem = "is not there to be called"
            return False, f"the arm's own ~/stop {problem}; {motion}"
        if waited > REST_TIMEOUT:
            return False, f"the arm was asked to stop {waited:.0f} s ago, but {motion}"
        return None

    def _will_stay_at_rest(self, stop: _Stop, waited: float) -> bool:
        """Return whether an arm that is measured at rest will stay at rest.

        Args:
            stop: The stop under way.
            waited: Time since the stop began [s].

        Returns:
            True after a confirmed braking command. Without one, the answer of the arm's ~/stop
            decides:

            - It answered with success: True if that was at least `REST_TIME` ago, and the arm
              executes no command of this planner. A motion that has just begun is too slow to be
              told from rest, and decelerates after the answer. If several publishers send the
              arm's reference, its reports are useless and the time alone decides.
            - It answered without success: False.
            - It has not answered: True if three conditions are met. The service could not be called
              or `STOP_TIMEOUT` has passed, only one publisher sends the reference, and no plan is
              reported as in force.
        """
        arm = self._arm_state
        if stop.is_braking_confirmed:
            return True
        if stop.answer is not None:
            is_held = bool(arm.publisher_conflict) or not arm.executes_own(self._now_ns())
            since = self._clock.steady_time() - stop.answered_at
            return stop.answer[0] and is_held and since >= REST_TIME
        is_unreachable = stop.last_call_at == -math.inf or waited > STOP_TIMEOUT
        has_no_plan = arm.plan_in_force_ns in (None, NO_PLAN)
        return is_unreachable and not arm.publisher_conflict and has_no_plan

    def finish(
        self,
        result: tuple[bool, str],
        execution: Execution | None,
        machine: Machine,
        reports: GoalReports,
    ) -> PendingGoal | None:
        """Finish the stop: end its goals, then call all functions that wait for it.

        The goal of `execution` ends as reached if the tip is at the goal, otherwise as stopped. If
        it is the goal to plan for after the stop, it does not end.

        Args:
            result: Success and sentence, passed to the functions that wait. Success means that the
                arm rests or has confirmed that it brakes.
            execution: Execution that ends with the stop; None if there is none.
            machine: Machine from which the tip position is computed.
            reports: Sender of execution reports.

        Returns:
            Goal to plan for now; None if there is no such goal, or if no stop was under way.
        """
        stop = self._stop
        if stop is None:
            return None
        if stop.obstacle and not stop.is_braking_confirmed:
            self._report_obstacle(describe_missing_braking(stop.obstacle, result[1]))
        self._stop = None
        if execution is not None and execution.pending_goal is not stop.goal_after_stop:
            ending = execution.judge(machine, self._arm_state, self._now_ns(), is_last=True)
            if ending is None or ending.outcome is not Outcome.REACHED:
                ending = ExecutionResult(Outcome.STOPPED, stop.reason)
            reports.report_end(execution.pending_goal, *ending)
        for goal in stop.goals:
            reports.report_end(goal, Outcome.STOPPED, stop.reason)
        for done in stop.on_finished:
            done(*result)
        return stop.goal_after_stop

    # --- Log -------------------------------------------------------------------------------------

    def report_waiting(self) -> None:
        """Log that the arm will brake for an obstacle after its answer to the last plan.

        Nothing happens if no stop is under way, or if the stop has a reason already, for example
        because a braking command was made.
        """
        if self._stop is not None and not self._stop.reason:
            self._report_obstacle(describe_waiting(self._stop.obstacle))

    def _report_obstacle(self, sentence: str) -> None:
        """Store a sentence on an obstacle ahead as the reason of the stop, and log it.

        A stop that was requested from the planner or from the arm keeps its own reason. A sentence
        that equals the last one is not logged again.

        Args:
            sentence: Sentence on the obstacle and the braking.
        """
        if self._stop is not None and self._stop.reason not in (STOP_ASKED, ARM_STOPPED):
            self._stop.reason = sentence
        if sentence != self._last_obstacle_sentence:
            self._last_obstacle_sentence = sentence
            self._outbox.warn(sentence)

    def _now_ns(self) -> int:
        """Return the time of plans: the arm's clock minus the arm's delay behind its plans [ns]."""
        return self._arm_state.get_plan_time_ns(self._clock.steady_time(), self._clock.ros_ns())
