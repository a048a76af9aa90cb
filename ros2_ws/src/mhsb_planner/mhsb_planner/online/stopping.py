"""Stop of the arm that is under way, and calls of the arm's own ~/stop.

A stop is finished when the arm is measured at rest. It is also finished when the arm has confirmed
a braking command, if the time at which the arm will rest is known. The time of plans is the arm's
clock less the delay by which speed scaling has slowed plans.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from mhsb_planner.online.arm_state import NO_PLAN, ArmState
from mhsb_planner.online.pending_goal import PendingGoal
from mhsb_planner.online.planner_io import Clock, PlannerIO

STOP_TIMEOUT = 5.0
"""Longest time for the arm to confirm a braking command or to answer its ~/stop [s]."""

REST_TIMEOUT = 15.0
"""Longest time for the arm to come to rest once its ~/stop has been answered [s]."""

CALL_PERIOD = 1.0
"""Time without an answer after which the arm's ~/stop is called again [s]."""

OWN_REPORT = 2.0
"""Time after an own call of ~/stop within which the arm reports that stop [s]."""

MAX_BRAKING_COMMANDS = 3
"""Number of braking commands that are sent before the arm's own ~/stop is called."""

BRAKING_TIMEOUT = 1.0
"""Time after the begin of a stop for which braking commands are sent [s].

After it the arm's own ~/stop is called.
"""

SETTLING_TIME = 0.3
"""Time from the reference's end of braking until the measured arm counts as at rest [s].

On all machine files the measured speed falls below 0.005 rad/s before the reference has stopped.
"""

STOP_ASKED = "the planner was asked to stop"
"""Reason of a stop that was asked for at the planner."""

ARM_STOPPED = "the arm was asked to stop"
"""Reason of a stop that was asked for at the arm."""

AT_REST = "the arm stands still"
"""Sentence of a stop that has succeeded."""


@dataclass
class Stopping:
    """Stop that is under way.

    Attributes:
        reason: Why the arm is stopped, as execution reports state it.
        started_at: Time at which it began, by the steady clock [s].
        on_finished: Functions to call once with success and sentence when the stop is finished.
        goals: Goals that end with the stop.
        goal_after_stop: Goal to plan for once the arm is stopped, or None.
        tries: Number of braking commands sent so far.
        is_braking_confirmed: Whether the arm has confirmed one of them.
        last_call_at: Time of the last call of the arm's own ~/stop, by the steady clock [s].
        answer: Success and sentence of the arm's own ~/stop; None before it has answered.
        obstacle: Name of the obstacle ahead that is braked for; empty without one.
        obstacle_set_ns: Time at which that obstacle was set, in the time of plans [ns].
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
    obstacle: str = ""
    obstacle_set_ns: int = 0

    def may_brake(self, arm_state: ArmState, now_ns: int, steady_time: float) -> bool:
        """Return whether a braking command is the next step.

        Args:
            arm_state: Arm state.
            now_ns: Present time of plans [ns].
            steady_time: Present time by the steady clock [s].

        Returns:
            True if all of these hold: the arm executes a command of this planner; it has no fault
            and one publisher; no braking command is confirmed; fewer than `MAX_BRAKING_COMMANDS`
            were sent; and the stop began at most `BRAKING_TIMEOUT` ago.
        """
        given_up = (
            self.tries >= MAX_BRAKING_COMMANDS or steady_time - self.started_at > BRAKING_TIMEOUT
        )
        if self.is_braking_confirmed or given_up or arm_state.publisher_conflict or arm_state.fault:
            return False
        return arm_state.executes_own(now_ns)

    def get_result(
        self, arm_state: ArmState, now_ns: int, steady_time: float
    ) -> tuple[bool, str] | None:
        """Return how the stop has ended, once the arm rests or cannot be brought to rest.

        The stop succeeds if the arm is measured at rest and will stay there. It fails if the arm's
        ~/stop answers without success. It fails after `STOP_TIMEOUT` if the arm has neither
        confirmed a braking command nor answered, and after `REST_TIMEOUT` in any case.

        Args:
            arm_state: Arm state.
            now_ns: Present time of plans [ns].
            steady_time: Present time by the steady clock [s].

        Returns:
            Success and sentence; None while the arm may still come to rest.
        """
        waited = steady_time - self.started_at
        if self._will_stay_at_rest(
            arm_state, now_ns, waited
        ) and arm_state.rest_detector.is_at_rest(steady_time):
            return True, AT_REST
        if self.answer is not None and not self.answer[0]:
            return False, f"the arm does not stop: {self.answer[1]}"
        if self.answer is None and not self.is_braking_confirmed and waited > STOP_TIMEOUT:
            return (
                False,
                f"{self._describe_missing_answer()}; "
                f"{arm_state.rest_detector.describe_motion(steady_time)}",
            )
        if waited > REST_TIMEOUT:
            return False, (
                f"the arm was asked to stop {waited:.0f} s ago, but "
                f"{arm_state.rest_detector.describe_motion(steady_time)}"
            )
        return None

    def _will_stay_at_rest(self, arm_state: ArmState, now_ns: int, waited: float) -> bool:
        """Return whether an arm that is measured at rest will stay at rest.

        Args:
            arm_state: Arm state.
            now_ns: Present time of plans [ns].
            waited: Time since the stop began [s].

        Returns:
            True after a confirmed braking command. After an answer of the arm's ~/stop, True if it
            reports success and the arm executes no command of this planner. With several publishers
            success suffices. Without an answer, True if three things hold: ~/stop could not be
            called or `STOP_TIMEOUT` has passed, the arm has one publisher, and it has no plan in
            force or reports none.
        """
        if self.is_braking_confirmed:
            return True
        if self.answer is not None:
            return self.answer[0] and (
                bool(arm_state.publisher_conflict) or not arm_state.executes_own(now_ns)
            )
        unreachable = self.last_call_at == -math.inf or waited > STOP_TIMEOUT
        return (
            unreachable
            and not arm_state.publisher_conflict
            and arm_state.plan_in_force_ns in (None, NO_PLAN)
        )

    def _describe_missing_answer(self) -> str:
        """Return why the arm's own ~/stop gave no answer.

        Returns:
            A sentence: the service is not there, or did not answer within `STOP_TIMEOUT`.
        """
        if self.last_call_at == -math.inf:
            return "the arm's own ~/stop is not there to be called"
        return f"the arm's own ~/stop was not answered within {STOP_TIMEOUT:g} s"


class ArmStopCaller:
    """Caller of the arm's own ~/stop, which recognizes the arm's reports of its own calls."""

    def __init__(self, clock: Clock, outbox: PlannerIO) -> None:
        """Begin without a call.

        Args:
            clock: Source of the present time.
            outbox: Calls the arm's ~/stop.
        """
        self._clock = clock
        self._out = outbox
        self._called_at = -math.inf
        self._unreported = 0
        self._last_stop_ns = 0

    def call(self, on_answer: Callable[[bool, str], None]) -> bool:
        """Call the arm's ~/stop once.

        Args:
            on_answer: Called with success and sentence when the arm answers.

        Returns:
            False if the service is not there.
        """
        if not self._out.stop_arm(on_answer):
            return False
        self._called_at = self._clock.steady_time()
        self._unreported += 1
        return True

    def call_until_answered(self, stopping: Stopping) -> None:
        """Call the arm's ~/stop, at most every `CALL_PERIOD` until it has answered.

        The caller repeats this while the stop is under way. After an answer nothing is called.

        Args:
            stopping: The stop. Writes `last_call_at` if ~/stop was called, and `answer` when the
                arm answers.
        """

        def store_answer(success: bool, sentence: str) -> None:
            """Store the arm's answer in the stop."""
            stopping.answer = success, sentence

        wall = self._clock.steady_time()
        due = wall - stopping.last_call_at >= CALL_PERIOD
        if stopping.answer is None and due and self.call(store_answer):
            stopping.last_call_at = wall

    def is_stop_by_others(self, stop_ns: int) -> bool:
        """Return whether a reported stop is new and was not called for by this planner.

        Each own call accounts for one new report. After `OWN_REPORT` since the last own call, new
        reports count as stops by others. Changes the record of reported stops.

        Args:
            stop_ns: Time at which the arm was last asked to stop, by its clock [ns]; 0 means never.

        Returns:
            True if so; False also if `stop_ns` is 0 or equals that of the last report.
        """
        if stop_ns in (0, self._last_stop_ns):
            return False
        self._last_stop_ns = stop_ns
        if self._clock.steady_time() - self._called_at > OWN_REPORT:
            self._unreported = 0
        if self._unreported:
            self._unreported -= 1
            return False
        return True
