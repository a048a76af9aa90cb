"""Queue of goals without a sent plan: the goal that waits, and the goal that is planned for.

The time of plans is the arm's clock minus the delay that speed scaling has caused.
"""

from __future__ import annotations

import math

from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.verdict import Verdict
from mhsb_planner.online.arm_state import NO_PLAN, ArmState
from mhsb_planner.online.execution import EARLY_NS
from mhsb_planner.online.goal_reports import GoalReports
from mhsb_planner.online.goal_stream import GoalStream
from mhsb_planner.online.hand_over import LONGEST_WAIT
from mhsb_planner.online.pending_goal import PendingGoal
from mhsb_planner.online.plan_request import PlanRequest
from mhsb_planner.online.planner_io import Clock, PlannerIO
from mhsb_planner.online.settings import Settings
from mhsb_planner.online.start_state import MovingError, OtherMachineError
from mhsb_planner.online.verdicts import find_verdict_code
from mhsb_planner.search import goal_clearance

FIRST_REPORT = 1.2
"""Time after the arm's first state for which goals wait until the arm reports its machine [s].

It reports the machine every second."""

START_UP = 6.0
"""Time after the planner's start during which goals wait for the arm's first state [s].

For as long after this state, the planner does not warn that the arm does not report its machine. On
a busy machine the discovery of a running arm, and of each of its topics, takes seconds.
"""


class GoalQueue:
    """Queue of goals without a sent plan: at most one waits, and one is being planned for.

    A new goal enters with `admit`, and a goal that must be planned for again with `put_back`. When
    planning begins, the lifecycle of goals clears `waiting` and sets `request`. A newer goal
    supersedes the waiting one. Some events, such as a stop, make a plan void while it is being
    made. The counter `epoch` counts these events.

    Attributes:
        waiting: Goal that waits for planning to begin; None if there is none.
        request: Request for the plan that is being made; None if there is none.
        settings: Settings for goals that come without settings.
        epoch: Number of events so far that made void a plan that was being made.
        stream: Estimator of the velocity of a moving goal.
        void_until: Time by the steady clock [s]. Goals sent up to it are refused, because of a
            stop.
        void_reason: Sentence for these goals: who was asked to stop.
    """

    def __init__(
        self,
        settings: Settings,
        arm_state: ArmState,
        clock: Clock,
        outbox: PlannerIO,
        reports: GoalReports,
    ) -> None:
        """Begin without a goal.

        Args:
            settings: Settings for goals that come without settings.
            arm_state: Arm state.
            clock: Source of the present time.
            outbox: Interface that reports whether the arm is connected.
            reports: Sender of verdicts.
        """
        self.waiting: PendingGoal | None = None
        self.request: PlanRequest | None = None
        self.settings = settings
        self.epoch = 0
        self.stream = GoalStream()
        self.void_until = -math.inf
        self.void_reason = ""
        self._arm_state = arm_state
        self._clock = clock
        self._outbox = outbox
        self._reports = reports
        self._started_at = clock.steady_time()
        self._arm_stop_called = False

    @property
    def goals(self) -> list[PendingGoal]:
        """Goals that wait or are being planned for, the waiting one first."""
        planned = None if self.request is None else self.request.pending_goal
        return [each for each in (self.waiting, planned) if each is not None]

    # --- Goals that come and go ------------------------------------------------------------------

    def admit(self, pending_goal: PendingGoal, executed: PendingGoal | None) -> bool:
        """Let a new goal wait for planning, or refuse it at once.

        The goal is refused if the arm reports a fault or another machine file. It is refused if it
        is out of reach, or if its options do not fit. It is also refused if it was sent before the
        last stop (`void_goals`). An older waiting goal ends as superseded, unless the arm executes
        a plan for it.

        Args:
            pending_goal: The new goal.
            executed: Goal for which the arm executes a plan; None if there is none.

        Returns:
            True if the new goal waits; False if it was refused.
        """
        for code, sentence in (
            (Verdict.FAULT, self._arm_state.fault),
            (Verdict.MACHINE, self._arm_state.machine_difference),
            (Verdict.STOPPED, self.void_reason * (pending_goal.sent_at <= self.void_until)),
        ):
            if sentence:
                self._reports.end(pending_goal, code, sentence)
                return False
        try:
            self.check_place(pending_goal)
        except MhsbError as error:
            self._reports.end(pending_goal, find_verdict_code(error), str(error))
            return False
        self.stream.add_goal(pending_goal.goal, pending_goal.received_at)
        if self.waiting is not None and self.waiting is not executed:
            self._reports.supersede(self.waiting)
        self.waiting = pending_goal
        self._arm_stop_called = False
        return True

    def void_goals(self, sent_until: float, reason: str) -> None:
        """Refuse goals that were sent before a stop, but come or are read after it.

        Args:
            sent_until: Latest time of sending of such a goal, by the steady clock [s]. An earlier
                call with a later time stays in force.
            reason: Sentence for these goals: who was asked to stop.
        """
        if sent_until > self.void_until:
            self.void_until, self.void_reason = sent_until, reason

    def check_place(self, pending_goal: PendingGoal) -> None:
        """Check that the tip can be at the goal, and that the goal's options fit.

        Args:
            pending_goal: The goal. Its own settings are derived and cached if necessary.

        Raises:
            MhsbError: The goal lies outside the workspace, is too near to an obstacle, or has
                options that do not fit.
        """
        machine, goal = pending_goal.get_settings(self.settings).machine, pending_goal.goal
        machine.check_in_workspace(goal.position)
        goal_clearance.check_tip_clearance(machine, goal.position)

    def put_back(self, pending_goal: PendingGoal) -> None:
        """Let a goal wait for a new plan.

        Args:
            pending_goal: The goal. Its `waiting_since` is set to the present time.
        """
        pending_goal.waiting_since = self._clock.steady_time()
        self.waiting = pending_goal

    def withdraw(self, pending_goal: PendingGoal) -> None:
        """Remove a goal from the queue.

        The goal no longer waits. If a plan for it is being made, the plan will be ignored.

        Args:
            pending_goal: The goal. If it is not in the queue, nothing happens.
        """
        if self.waiting is pending_goal:
            self.waiting = None
        if self.request is not None and self.request.pending_goal is pending_goal:
            self.request = None

    def clear(self) -> None:
        """Remove all goals from the queue. A plan that is being made will not be used."""
        self.waiting = self.request = None
        self.epoch += 1

    # --- Begin of planning -----------------------------------------------------------------------

    def must_wait(self, pending_goal: PendingGoal, stamps_are_ahead: bool) -> bool:
        """Return whether planning for the waiting goal must not begin yet.

        The goal waits until all of these conditions are met, but for at most `LONGEST_WAIT`:

        - The arm is connected so that it would receive a plan.
        - If the arm sends a reference, it has also reported which plan it executes.
        - The arm has reported its machine, or `FIRST_REPORT` has passed since its first state.
        - The last stamp sent is not ahead of the time of plans.

        Args:
            pending_goal: The waiting goal.
            stamps_are_ahead: True if the last stamp sent is ahead of the time of plans (the arm's
                clock minus the arm's delay behind its plans).

        Returns:
            True if the goal must wait.
        """
        arm, now = self._arm_state, self._clock.steady_time()
        is_half_known = arm.reference is not None and arm.plan_in_force_ns is None
        is_unknown = not arm.is_machine_known and now - arm.first_state_at < FIRST_REPORT
        is_ready = self._outbox.is_arm_connected() and not is_half_known and not is_unknown
        return (
            not is_ready or stamps_are_ahead
        ) and now - pending_goal.waiting_since < LONGEST_WAIT

    def needs_arm_stop(self, error: MhsbError) -> bool:
        """Return whether the caller must call the arm's own ~/stop so that planning can begin.

        Args:
            error: Error that says why no plan can start.

        Returns:
            True if the arm moves under a command that this planner did not send. For each goal,
            True is returned only once.
        """
        foreign = isinstance(error, MovingError) and self._arm_state.plan_in_force_ns != NO_PLAN
        is_needed = foreign and not self._arm_stop_called
        self._arm_stop_called = self._arm_stop_called or is_needed
        return is_needed

    def postpone(self, pending_goal: PendingGoal, error: MhsbError) -> None:
        """Let the waiting goal wait on because no plan can start, or refuse it.

        The goal is refused at once if the arm has another machine file. Otherwise it is refused
        when it has waited for `LONGEST_WAIT`. If the arm has never sent a state, it is not refused
        within `START_UP` after the planner's start.

        Args:
            pending_goal: The waiting goal.
            error: Error that says why no plan can start. It gives code and sentence of a refusal.
        """
        now = self._clock.steady_time()
        starts = self._arm_state.first_state_at == math.inf and now - self._started_at < START_UP
        waited = now - pending_goal.waiting_since >= LONGEST_WAIT
        if isinstance(error, OtherMachineError) or (waited and not starts):
            self.waiting = None
            self._reports.end(pending_goal, find_verdict_code(error), str(error))

    def choose_target(
        self, pending_goal: PendingGoal, commit_horizon: float, dead_time: float
    ) -> tuple[Goal, float]:
        """Choose the place to which a plan for a goal leads, and return it with the goal's period.

        For a moving goal it is extrapolated (`GoalStream.extrapolate`). If the goal has stopped, or
        its `needs_exact_place` is set, it is the goal's own place. The period of a stopped goal is
        still returned, so that the planner keeps the posture near the present one.

        Args:
            pending_goal: The goal.
            commit_horizon: Commit horizon (time until the new plan takes over) in real time,
                without the dead time [s].
            dead_time: Dead time of the machine in real time [s].

        Returns:
            Target, and period of the goal: median time between its last messages [s]. If its last
            messages give no velocity, the target is the goal itself and the period is 0.
        """
        stream, goal, now = self.stream, pending_goal.goal, self._clock.steady_time()
        if not any(stream.velocity):
            return goal, 0.0
        if pending_goal.needs_exact_place or not stream.is_moving(now):
            return goal, stream.period
        age = now - pending_goal.received_at
        return stream.extrapolate(goal, age, commit_horizon, dead_time), stream.period

    def is_valid(self, request: PlanRequest, now_ns: int) -> bool:
        """Return whether the plan of a request can still be sent.

        Args:
            request: The request.
            now_ns: Time of plans [ns]: the arm's clock minus the arm's delay behind its plans.

        Returns:
            True if two conditions are met. First, no event since the request has made the plan void
            (`epoch`). Second, the arm still executes the plan that it executed at the request. If
            this was the request's `start_command`, the arm may also hold its position at the end of
            this command, at most `EARLY_NS` before it.
        """
        start, in_force_ns = request.start_command, self._arm_state.plan_in_force_ns
        has_ended = now_ns >= start.trajectory.end_ns - EARLY_NS
        return request.epoch == self.epoch and (
            in_force_ns == request.in_force_ns
            or (has_ended and in_force_ns == NO_PLAN and request.in_force_ns == start.stamp_ns)
        )
