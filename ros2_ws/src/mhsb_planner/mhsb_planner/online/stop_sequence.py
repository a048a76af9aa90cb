"""Stop of the arm: braking commands for this planner's plan, calls of the arm's own ~/stop.

A stop is finished when the arm is measured at rest. It is also finished when the arm has confirmed
a braking command and the time at which it will rest is known. The time of plans is the arm's clock
minus the delay that speed scaling has caused.
"""

import math
from collections.abc import Callable

from mhsb_model.command import Command
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Outcome
from mhsb_planner.online.arm_state import NO_PLAN
from mhsb_planner.online.arm_stops import ArmStops
from mhsb_planner.online.commit_horizon import LATE_PLAN_FACTOR
from mhsb_planner.online.execution import ExecutionResult
from mhsb_planner.online.hand_over import HandOver
from mhsb_planner.online.lifecycle_state import LifecycleState
from mhsb_planner.online.pending_goal import PendingGoal
from mhsb_planner.online.plan_request import UnconfirmedPlan
from mhsb_planner.online.rest_detector import REST_TIME
from mhsb_planner.online.zone_ahead import make_braking_for_obstacle

STOP_TIMEOUT = 5.0
"""Longest time for the arm to confirm a braking command or to answer its ~/stop [s]."""

REST_TIMEOUT = 15.0
"""Longest time for the arm to come to rest after the answer of its ~/stop [s]."""

CALL_PERIOD = 1.0
"""Time without an answer after which the arm's ~/stop is called again [s]."""

MAX_BRAKING_COMMANDS = 3
"""Number of braking commands that are sent before the arm's own ~/stop is called."""

BRAKING_TIMEOUT = 1.0
"""Time after the beginning of a stop in which braking commands are sent [s].

After this time, the arm's own ~/stop is called.
"""

SETTLING_TIME = 0.3
"""Time from the end of the reference's motion until the measured arm counts as at rest [s].

On all machine files the measured speed falls below 0.005 rad/s before the reference has stopped.
"""

LATE_SHARE = 0.5
"""Largest share of the commit horizon that computing a braking for an obstacle may take [-].

If the computation takes longer, it is repeated with a longer horizon. With a larger share, more
braking commands would come too late.
"""

STOP_ASKED = "the planner was asked to stop"
"""Reason of a stop that was requested from the planner."""

ARM_STOPPED = "the arm was asked to stop"
"""Reason of a stop that was requested from the arm."""

AT_REST = "the arm stands still"
"""Sentence of a stop that has succeeded."""

Brake = Callable[[Command, int, float], tuple[Command, int]]
"""Function that makes a braking command.

Its arguments are the command in force, the earliest stamp of the braking command [ns], and the time
from stamp to braking [s]. The result is the braking command and the time at which braking begins
[ns]. Times [ns] are in the time of plans (the arm's clock minus the delay that speed scaling has
caused)."""


class StopSequence:
    """Stop that is under way: it brakes the arm or calls the arm's ~/stop, and finds the result.

    While the stop is under way, the goal lifecycle calls `take_step` and `find_result` after each
    event. It calls `confirm_braking` when the arm has confirmed a braking command, and `finish` as
    soon as there is a result.

    Attributes:
        goal_after_stop: Goal to plan for after the arm has stopped; None for no goal.
    """

    def __init__(
        self,
        state: LifecycleState,
        hand_over: HandOver,
        arm_stops: ArmStops,
        brake: Brake,
        reason: str,
        goal_after_stop: PendingGoal | None,
    ) -> None:
        """Begin a stop.

        Args:
            state: State of the lifecycle. At the end `execution` is written.
            hand_over: Sender of braking commands, which chooses their stamp and commit horizon.
            arm_stops: Caller of the arm's own ~/stop.
            brake: Function that makes a braking command.
            reason: Reason of the stop, as execution reports state it. Empty for an obstacle: the
                reason then becomes a sentence on the place of rest.
            goal_after_stop: Goal to plan for after the arm has stopped; None for no goal.
        """
        self._on_finished: list[Callable[[bool, str], None]] = []
        self._goals: list[PendingGoal] = []
        self.goal_after_stop = goal_after_stop
        self._state = state
        self._hand_over = hand_over
        self._arm_stops = arm_stops
        self._brake = brake
        self._reason = reason
        self._started_at = state.now
        self._tries = 0
        self._is_braking_confirmed = False
        self._last_call_at = -math.inf
        self._answer: tuple[bool, str] | None = None
        self._answered_at = math.inf
        self._obstacle = ""
        self._obstacle_set_ns = 0
        self._last_obstacle_sentence = ""

    def join(self, done: Callable[[bool, str], None], goals: list[PendingGoal]) -> None:
        """Join a user's request to stop with this stop, which is under way.

        No goal is planned for after the stop any more: `goal_after_stop` also ends with the stop.

        Args:
            done: Called once with success and sentence when the stop is finished.
            goals: Goals that end with the stop.
        """
        self._on_finished.append(done)
        self._goals += goals
        if self.goal_after_stop is not None:
            self._goals.append(self.goal_after_stop)
            self.goal_after_stop = None

    def brake_for(self, obstacle: str) -> None:
        """Brake for an obstacle that lies ahead on the motion in force.

        A new braking command is made even if the arm has already confirmed one of this stop,
        because that one did not consider the obstacle.

        Args:
            obstacle: Name of the obstacle.
        """
        self._obstacle, self._obstacle_set_ns = obstacle, self._state.now_ns
        self._is_braking_confirmed = False

    # --- Steps -----------------------------------------------------------------------------------

    def take_step(self) -> None:
        """Take the next step to bring the arm to rest.

        The first of these cases decides:

        1. A braking command can help (`_may_brake`): it is sent, unless another command is still
           without an answer. Each further braking command has a longer commit horizon (time until
           braking begins).
        2. The arm has confirmed a braking command: nothing happens.
        3. Otherwise the arm's own ~/stop is called, at most every `CALL_PERIOD`, until it has
           answered.
        """
        own = self._state.arm_state.own_command
        if own is None or not self._may_brake():
            if not self._is_braking_confirmed:
                self._call_until_answered()
        elif self._state.unconfirmed is None:
            self._tries += 1
            self._hand_over.send(self._make_braking(own))

    def _may_brake(self) -> bool:
        """Return whether a braking command can be the next step of the stop.

        Returns:
            True if all of these conditions are met:

            - The arm executes a command of this planner.
            - The arm has no fault, and its reference has one publisher.
            - No braking command is confirmed, and fewer than `MAX_BRAKING_COMMANDS` were made.
            - The stop began at most `BRAKING_TIMEOUT` ago.
            - No other node sends plans, which could replace the braking command. For an obstacle,
              this condition is left out, because the arm's ~/stop would not consider the obstacle.
        """
        state, arm = self._state, self._state.arm_state
        is_late = state.now - self._started_at > BRAKING_TIMEOUT
        if self._is_braking_confirmed or self._tries >= MAX_BRAKING_COMMANDS or is_late:
            return False
        if arm.publisher_conflict or arm.fault:
            return False
        if not self._obstacle and state.outbox.must_call_arm_stop():
            return False
        return arm.executes_own(state.now_ns)

    def _call_until_answered(self) -> None:
        """Call the arm's ~/stop if it has not answered and the last call is `CALL_PERIOD` ago."""

        def store_answer(success: bool, sentence: str) -> None:
            """Store the arm's answer, and its time."""
            self._answer, self._answered_at = (success, sentence), self._state.now

        is_due = self._state.now - self._last_call_at >= CALL_PERIOD
        if self._answer is None and is_due and self._arm_stops.call(store_answer):
            self._last_call_at = self._state.now

    def _make_braking(self, own: Command) -> UnconfirmedPlan:
        """Make a command that brakes along the path of the command in force.

        If the stop is for an obstacle, the arm comes to rest before the obstacle if possible. The
        reason of the stop then becomes a sentence on the place of rest, which is also logged. If
        the choice takes more than `LATE_SHARE` of the commit horizon (time until braking begins),
        it is repeated with a longer horizon.

        Args:
            own: Command that the arm executes.

        Returns:
            The command, ready to be sent.
        """
        state, at_ns = self._state, self._hand_over.choose_stamp()
        machine, since_ns = state.settings.machine, self._obstacle_set_ns
        horizon = self._hand_over.choose_braking_horizon(self._tries - 1)
        sentence = ""
        if not self._obstacle:
            command, change_ns = self._brake(own, at_ns, horizon)
        else:
            braking = make_braking_for_obstacle(machine, own, at_ns, horizon, since_ns)
            took = (state.now_ns - at_ns) / SECOND_NS
            if took > LATE_SHARE * horizon:  # the rest is too short for transport
                braking = make_braking_for_obstacle(
                    machine, own, state.now_ns, horizon + LATE_PLAN_FACTOR * took, since_ns
                )
            command, change_ns = braking.command, braking.change_ns
            sentence = braking.describe(self._obstacle)
            self._report_obstacle(sentence)
        return UnconfirmedPlan(
            command,
            change_ns,
            state.now,
            state.now,
            braking_machine=machine,
            obstacle_sentence=sentence,
        )

    def confirm_braking(self, sent: UnconfirmedPlan) -> tuple[bool, str] | None:
        """Store that the arm has confirmed a braking command.

        Args:
            sent: The braking command.

        Returns:
            True and a sentence with the time until the arm rests; the stop can be finished with
            this result. None if this time is not known, because the reference governor has delayed
            plans or the arm does not report which plan it executes. Then only a measured rest
            finishes the stop.
        """
        arm = self._state.arm_state
        self._is_braking_confirmed = True
        if sent.obstacle_sentence:
            self._report_obstacle(sent.obstacle_sentence)
        if arm.plan_delay_ns != 0 or arm.plan_in_force_ns is None:
            return None
        left = max(0.0, (sent.command.trajectory.end_ns - self._state.now_ns) / SECOND_NS)
        left = left / min(1.0, arm.clock_estimator.speed) + SETTLING_TIME
        return True, f"the arm stands still in {left:.2f} s"

    # --- End -------------------------------------------------------------------------------------

    def find_result(self) -> tuple[bool, str] | None:
        """Find the result of the stop: the arm rests, or it cannot be brought to rest.

        The stop succeeds if the arm is measured at rest and will stay at rest, and no command is
        unconfirmed (sent, without an answer). It fails in three cases:

        - The arm's ~/stop answers without success.
        - After `STOP_TIMEOUT`, the arm has neither confirmed a braking command nor answered ~/stop.
        - After `REST_TIMEOUT`, the arm is still not at rest.

        Returns:
            Success and sentence. None while the arm may still come to rest.
        """
        now, rest_detector = self._state.now, self._state.arm_state.rest_detector
        waited = now - self._started_at
        if self._will_stay_at_rest(waited) and rest_detector.is_at_rest(now):
            return (True, AT_REST) if self._state.unconfirmed is None else None
        if self._answer is not None and not self._answer[0]:
            return False, f"the arm does not stop: {self._answer[1]}"
        if waited <= STOP_TIMEOUT:
            return None
        motion = rest_detector.describe_motion(now)
        if self._answer is None and not self._is_braking_confirmed:
            problem = f"was not answered within {STOP_TIMEOUT:g} s"
            if self._last_call_at == -math.inf:
                problem = "is not there to be called"
            return False, f"the arm's own ~/stop {problem}; {motion}"
        if waited > REST_TIMEOUT:
            return False, f"the arm was asked to stop {waited:.0f} s ago, but {motion}"
        return None

    def _will_stay_at_rest(self, waited: float) -> bool:
        """Return whether an arm that is measured at rest will stay at rest.

        Args:
            waited: Time since the stop began [s].

        Returns:
            True after a confirmed braking command. Without one, the answer of the arm's ~/stop
            decides:

            - It answered with success: True if the answer is at least `REST_TIME` old, and the arm
              executes no command of this planner. The age is needed because a motion that has just
              begun is as slow as rest, and decelerates only after the answer. If several publishers
              send the arm's reference, the second condition is left out.
            - It answered without success: False.
            - It has not answered: True if three conditions are met. The service could not be called
              or `STOP_TIMEOUT` has passed, only one publisher sends the reference, and no plan is
              reported as in force.
        """
        state, arm = self._state, self._state.arm_state
        if self._is_braking_confirmed:
            return True
        if self._answer is not None:
            is_held = bool(arm.publisher_conflict) or not arm.executes_own(state.now_ns)
            return self._answer[0] and is_held and state.now - self._answered_at >= REST_TIME
        is_unreachable = self._last_call_at == -math.inf or waited > STOP_TIMEOUT
        has_no_plan = arm.plan_in_force_ns in (None, NO_PLAN)
        return is_unreachable and not arm.publisher_conflict and has_no_plan

    def finish(self, result: tuple[bool, str]) -> None:
        """Finish the stop: end its goals, then call all functions that wait for the result.

        If the stop has succeeded, the execution of the plan in force ends. The goal of this plan
        ends as reached if the tip is at the goal, otherwise as stopped. The goal to plan for after
        the stop does not end. Goals that `join` added end as stopped, even without success. If the
        stop was for an obstacle and no braking command was confirmed, this is logged.

        Args:
            result: Success and sentence, passed to the functions that wait. Success means that the
                arm rests or has confirmed that it brakes.
        """
        success, sentence = result
        state, execution = self._state, self._state.execution
        if self._obstacle and not self._is_braking_confirmed:
            self._report_obstacle(
                f"the arm took no command that brakes for {self._obstacle}: {sentence}"
            )
        if success and execution is not None:
            state.execution = None
            if execution.pending_goal is not self.goal_after_stop:
                ending = execution.judge(
                    state.settings.machine, state.arm_state, state.now_ns, is_last=True
                )
                if ending is None or ending.outcome is not Outcome.REACHED:
                    ending = ExecutionResult(Outcome.STOPPED, self._reason)
                state.reports.report_end(execution.pending_goal, *ending)
        for goal in self._goals:
            state.reports.report_end(goal, Outcome.STOPPED, self._reason)
        for done in self._on_finished:
            done(success, sentence)

    # --- Log -------------------------------------------------------------------------------------

    def report_waiting(self) -> None:
        """Log that braking for an obstacle must wait for the arm's answer to the last plan.

        Nothing happens if the stop already has a reason, for example because a braking command was
        made.
        """
        if not self._reason:
            self._report_obstacle(
                f"{self._obstacle} was set across the way; the arm brakes once it has answered "
                "the last plan"
            )

    def _report_obstacle(self, sentence: str) -> None:
        """Store a sentence on an obstacle ahead as the reason of the stop, and log it.

        A stop that was requested from the planner or from the arm keeps its own reason. A sentence
        that equals the previous sentence is not logged again.

        Args:
            sentence: Sentence on the obstacle and the braking.
        """
        if self._reason not in (STOP_ASKED, ARM_STOPPED):
            self._reason = sentence
        if sentence != self._last_obstacle_sentence:
            self._last_obstacle_sentence = sentence
            self._state.outbox.warn(sentence)
