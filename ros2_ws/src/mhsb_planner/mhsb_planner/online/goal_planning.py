"""Planning of goals: from a waiting goal to the plan that is sent for it, or to its refusal.

A command is a joint trajectory with its mode schedule. The commit horizon is the time from the
stamp of a command until it deviates from the previous command. The time of plans is the arm's clock
minus the delay that speed scaling has caused.
"""

import math

from mhsb_model.arm_reports import HandOverReason
from mhsb_model.circuit.dead_time import compute_dead_time
from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Verdict
from mhsb_planner.deadline import Deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.online.arm_state import NO_PLAN
from mhsb_planner.online.arm_stops import ArmStops
from mhsb_planner.online.commit_horizon import LATE_PLAN_FACTOR
from mhsb_planner.online.execution import EARLY_NS
from mhsb_planner.online.execution_monitor import ExecutionMonitor
from mhsb_planner.online.goal_reports import compose_acceptance_sentence, find_verdict_code
from mhsb_planner.online.hand_over import LONGEST_WAIT, MAX_LATE_PLANS, HandOver
from mhsb_planner.online.lifecycle_state import LifecycleState
from mhsb_planner.online.pending_goal import Adjustment, PendingGoal, summarize_plan
from mhsb_planner.online.plan_request import PlanRequest, UnconfirmedPlan
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.start_state import (
    MovingError,
    NoStateError,
    OtherMachineError,
    find_start_command,
)

FIRST_REPORT = 1.2
"""Longest time after the arm's first state for which goals wait for the report of its machine [s].

The arm reports its machine every second."""

START_UP = 6.0
"""Time after the planner's start during which goals wait for the arm's first state [s].

After this state, goals wait for the same time for the other topics of the arm, and the planner
before it warns that the arm does not report its machine. On a busy computer, the discovery of a
running arm and of each of its topics takes seconds.
"""

AHEAD_NS = SECOND_NS // 10
"""Largest time by which the last sent stamp may be ahead of the time of plans [ns]."""

FINAL_REFUSALS = {
    HandOverReason.FAULT: Verdict.FAULT,
    HandOverReason.INVALID: Verdict.INTERNAL,
    HandOverReason.STOPPED: Verdict.STOPPED,
}
"""Reasons of a refusal by the arm after which a goal is not planned for again, and the goal's
verdict.
"""


class GoalPlanning:
    """Planner of goals: it begins to plan, and sends the plan or ends the goal.

    Planning begins with `start`, and goes on with `handle_answer`. If the arm refuses or drops the
    plan, `handle_refusal` decides whether another plan is made.
    """

    def __init__(
        self,
        state: LifecycleState,
        monitor: ExecutionMonitor,
        hand_over: HandOver,
        arm_stops: ArmStops,
    ) -> None:
        """Store the other parts of the lifecycle, and the time of the planner's start.

        Args:
            state: State of the lifecycle. `waiting` and `request` are written.
            monitor: Monitor of the plan in force, which a goal may take over.
            hand_over: Sender of plans, which chooses stamps and commit horizons.
            arm_stops: Caller of the arm's own ~/stop.
        """
        self._state = state
        self._monitor = monitor
        self._hand_over = hand_over
        self._arm_stops = arm_stops
        self._started_at = state.now
        self._stopped_for: PendingGoal | None = None

    # --- Begin of planning -----------------------------------------------------------------------

    def start(self) -> None:
        """Begin to plan for the waiting goal, if nothing prevents it.

        The first of these cases that applies decides:

        - A plan is being made or is unconfirmed (sent, without an answer): nothing happens.
        - The arm is not ready, for example not connected (`_must_wait`): the goal waits.
        - No plan can start from the arm's state: the goal keeps waiting or is refused
          (`_postpone`).
        - The plan in force already leads to the goal: the goal takes over this plan.
        - Otherwise a plan is requested.

        In the last three cases, a warning is logged if the arm has not reported its machine within
        `START_UP` after its first state. The arm is then assumed to be the planner's machine.
        """
        state, pending_goal = self._state, self._state.waiting
        if pending_goal is None or state.request or state.unconfirmed:
            return
        if self._must_wait(pending_goal):
            return
        is_overdue = state.now - state.arm_state.first_state_at >= START_UP
        if is_overdue and state.arm_state.machine_difference is None:
            state.store_arm_machine(None)
        try:
            start = find_start_command(state.arm_state, state.now, state.now_ns)
        except (OtherMachineError, NoStateError, MovingError) as error:
            self._postpone(pending_goal, error)
            return
        state.waiting = None
        if not self._monitor.take_over(pending_goal):
            state.request = self._build_request(pending_goal, start)
            state.outbox.start_planning(state.request)

    def _must_wait(self, pending_goal: PendingGoal) -> bool:
        """Return whether the waiting goal must wait longer before planning begins.

        The goal waits until all of these conditions are met, but for at most `LONGEST_WAIT`, or
        `START_UP` if the arm's first state came less than `START_UP` ago:

        - The arm is connected so that it would receive a plan.
        - If the arm sends a reference, it has also reported which plan it executes.
        - The arm has reported its machine, or `FIRST_REPORT` has passed since its first state.
        - The last stamp sent is at most `AHEAD_NS` ahead of the time of plans.

        Args:
            pending_goal: The waiting goal.

        Returns:
            True if the goal must wait.
        """
        state, arm = self._state, self._state.arm_state
        is_half_known = arm.reference is not None and arm.plan_in_force_ns is None
        may_report = state.now - arm.first_state_at < FIRST_REPORT
        is_unknown = arm.machine_difference is None and may_report
        is_ahead = self._hand_over.last_stamp_ns > state.now_ns + AHEAD_NS
        is_ready = state.outbox.is_arm_connected() and not (is_half_known or is_unknown or is_ahead)
        is_new = 0.0 <= state.now - arm.first_state_at < START_UP
        longest = START_UP if is_new else LONGEST_WAIT
        return not is_ready and state.now - pending_goal.waiting_since < longest

    def _postpone(self, pending_goal: PendingGoal, error: MhsbError) -> None:
        """Refuse a goal for which no plan can start, or keep it waiting.

        The goal is refused at once if the arm has another machine file. Otherwise it is refused
        when it has waited for `LONGEST_WAIT`. If the arm has never sent a state, the goal is
        refused at the earliest `START_UP` after the planner's start. If the arm moves under a
        command that this planner did not send, the arm's own ~/stop is called, once for each goal.

        Args:
            pending_goal: The waiting goal.
            error: Error that says why no plan can start. The error gives code and sentence of a
                refusal.
        """
        state, now = self._state, self._state.now
        is_foreign = isinstance(error, MovingError) and state.arm_state.plan_in_force_ns != NO_PLAN
        if is_foreign and self._stopped_for is not pending_goal:
            self._stopped_for = pending_goal
            self._arm_stops.call(lambda success, sentence: None)
        is_starting = now - self._started_at < START_UP
        may_come = is_starting and state.arm_state.first_state_at == math.inf
        has_waited = now - pending_goal.waiting_since >= LONGEST_WAIT
        if isinstance(error, OtherMachineError) or (has_waited and not may_come):
            state.end(pending_goal, find_verdict_code(error), str(error))

    # --- Requests --------------------------------------------------------------------------------

    def build_trial_request(
        self, goal: Goal, adjust_settings: Adjustment, horizon_factor: float = 1.0
    ) -> PlanRequest:
        """Build the request for a plan that will not be executed.

        This is the request for a goal that does not move and comes now. Goals and plans in progress
        are not affected.

        Args:
            goal: Place to which the tip would go.
            adjust_settings: Function that derives this goal's settings from the settings for all
                goals.
            horizon_factor: Factor on the commit horizon (time until a new plan takes over) [-].

        Returns:
            Request for the planning worker.

        Raises:
            MhsbError: The goal is out of reach, its options do not fit, or no plan can start from
                the arm's state.
        """
        state, now = self._state, self._state.now
        pending_goal = PendingGoal(
            goal,
            now,
            now,
            now,
            horizon_factor=horizon_factor,
            needs_exact_place=True,
            adjust_settings=adjust_settings,
        )
        self._state.check_place(pending_goal)
        return self._build_request(
            pending_goal, find_start_command(state.arm_state, now, state.now_ns)
        )

    def _build_request(self, pending_goal: PendingGoal, start: Command) -> PlanRequest:
        """Build the request for a plan to a goal.

        The arm counts as moving until the trajectory of `start` has ended. The commit horizon (time
        until the new plan takes over) then covers planning, transport, confirmation and the
        machine's dead time. For an arm at rest the horizon does not cover planning, because the
        plan is stamped when it is ready. The deadline is always computed as for a moving arm: the
        horizon without its part for transport. A moving goal is extrapolated.

        Args:
            pending_goal: The goal.
            start: Command that the plan continues.

        Returns:
            The request, with the commit horizon by the arm's clock and the deadline by the steady
            clock.
        """
        state, hand_over, now = self._state, self._hand_over, self._state.now
        settings = pending_goal.get_settings(state.settings)
        horizon = hand_over.choose_horizon(pending_goal)
        from_rest = start.trajectory.end_ns <= state.now_ns
        target, period = self._choose_target(pending_goal, horizon.total)
        return PlanRequest(
            state.epoch,
            pending_goal,
            target,
            period,
            settings,
            start,
            state.arm_state.plan_in_force_ns,
            hand_over.choose_stamp(),
            hand_over.choose_arm_horizon(pending_goal, starts_from_rest=from_rest),
            now,
            Deadline(now + horizon.total - horizon.transport_reserve),
            hand_over.find_plan_of_command(start, settings),
        )

    def _choose_target(
        self, pending_goal: PendingGoal, commit_horizon: float
    ) -> tuple[Goal, float]:
        """Choose the place to which a plan for a goal leads, and return it with the goal's period.

        For a moving goal the place is extrapolated (`GoalStream.extrapolate`) in real time. If the
        goal has stopped, or its `needs_exact_place` is set, the place is the goal's own. Even for a
        stopped goal the period is returned, so that the planner prefers postures near the present
        posture.

        Args:
            pending_goal: The goal.
            commit_horizon: Commit horizon (time until the new plan takes over) in real time,
                without the dead time [s].

        Returns:
            Target, and period of the goal: median time between its last messages [s]. If its last
            messages give no velocity, the target is the goal itself and the period is 0.
        """
        state, stream, goal = self._state, self._state.stream, pending_goal.goal
        if not any(stream.velocity):
            return goal, 0.0
        if pending_goal.needs_exact_place or not stream.is_moving(state.now):
            return goal, stream.period
        age = state.now - pending_goal.received_at
        clock_rate = state.arm_state.clock_estimator.convert_duration(1.0)
        dead_time = compute_dead_time(state.settings.machine) / clock_rate
        return stream.extrapolate(goal, age, commit_horizon, dead_time), stream.period

    # --- Answers ---------------------------------------------------------------------------------

    def handle_answer(self, request: PlanRequest, answer: Replan | Exception | None) -> None:
        """Handle the answer to the request for the plan that is being made.

        If an event has made the plan void (`epoch` has changed), or if the plan in force has
        changed, the goal is planned for again. Otherwise the answer decides:

        - A plan: it is sent. A warning is logged if one of the planners failed after it had found a
          motion.
        - None: the arm is at the goal already, and the goal ends.
        - `DeadlineError`: the goal is planned for again with a longer commit horizon (time until a
          new plan takes over). It is refused after `MAX_LATE_PLANS` tries at the longest horizon.
        - Another `MhsbError`: if the arm executes a plan to the same goal, that plan continues. If
          the target was extrapolated from a moving goal, the goal's own place is planned for.
          Otherwise the goal is refused.
        - Any other exception: the goal is refused with `INTERNAL`.

        After a plan, the time until its first motion becomes a sample of `horizon_estimator`. After
        a `DeadlineError`, the sample is `LATE_PLAN_FACTOR` times the time since the request.

        Args:
            request: Request that was answered.
            answer: The plan, the error that planning raised, or None.
        """
        state, pending_goal = self._state, request.pending_goal
        state.request = None
        took, lost_pumps = state.now - request.requested_at, state.settings.lost_pumps_clause
        if not self._is_valid(request):
            self._state.put_back(pending_goal)
        elif isinstance(answer, DeadlineError):
            self._hand_over.horizon_estimator.add_first_motion(LATE_PLAN_FACTOR * took)
            self._plan_late_goal_again(request, Verdict.NOT_FOUND, f"{answer}{lost_pumps}")
        elif isinstance(answer, MhsbError) and state.executes(pending_goal):
            state.accept_plan_end()
        elif isinstance(answer, MhsbError) and request.target is not pending_goal.goal:
            pending_goal.needs_exact_place = True
            self._state.put_back(pending_goal)
        elif isinstance(answer, MhsbError):
            code = find_verdict_code(answer)
            why = lost_pumps if code is Verdict.INFEASIBLE else ""
            self._state.end(pending_goal, code, f"{answer}{why}")
        elif isinstance(answer, Exception):
            kind = type(answer).__name__
            self._state.end(pending_goal, Verdict.INTERNAL, f"planning failed with {kind}")
        elif answer is None:
            self._state.reports.report_at_goal(pending_goal)
        else:
            self._hand_over.horizon_estimator.add_first_motion(took - answer.improvement_time)
            state.reports.warn_of_failed_planner(answer.plan.log)
            self._send_plan(request, answer)

    def _is_valid(self, request: PlanRequest) -> bool:
        """Return whether the plan of a request can still be sent.

        Args:
            request: The request.

        Returns:
            True if two conditions are met. First, no event since the request has made the plan void
            (`epoch`). Second, the arm executes the same plan as at the request. If this plan was
            the request's `start_command`, the arm may instead hold, but not earlier than `EARLY_NS`
            before the end of that command.
        """
        state, start = self._state, request.start_command
        in_force_ns = state.arm_state.plan_in_force_ns
        has_ended = state.now_ns >= start.trajectory.end_ns - EARLY_NS
        return request.epoch == state.epoch and (
            in_force_ns == request.in_force_ns
            or (has_ended and in_force_ns == NO_PLAN and request.in_force_ns == start.stamp_ns)
        )

    def _send_plan(self, request: PlanRequest, replan: Replan) -> None:
        """Send a plan, and accept its goal if the goal has no verdict yet.

        A plan that starts from rest first gets the present time as its stamp. If the previous
        command still moves at this time, the goal is planned for again instead. The change is the
        time at which the plan deviates from the previous command. If the change has passed, the
        plan is too late and is not sent. If the plan is sent, `attempts`, `plan_stamp_ns` and
        `lead_ms` of the goal are updated.

        Args:
            request: Request of the plan.
            replan: The plan.
        """
        state, hand_over, pending_goal = self._state, self._hand_over, request.pending_goal
        now, now_ns = state.now, state.now_ns
        if replan.starts_from_rest:
            horizon = hand_over.choose_arm_horizon(pending_goal, starts_from_rest=True)
            stamped = replan.with_stamp(hand_over.choose_stamp(), horizon)
            if stamped is None:
                self._state.put_back(pending_goal)
                return
            replan = stamped
        if now_ns >= replan.change_ns:
            late = (now_ns - replan.change_ns) / SECOND_NS
            sentence = f"the plan was ready {late:.3f} s after its change"
            self._plan_late_goal_again(request, Verdict.DEADLINE, sentence)
            return
        elapsed = 1e3 * (now - pending_goal.received_at)
        ahead = 1e3 * (replan.change_ns - now_ns) / SECOND_NS
        pending_goal.attempts += 1
        pending_goal.plan_stamp_ns = replan.command.stamp_ns
        pending_goal.lead_ms = elapsed + ahead / state.arm_state.clock_estimator.convert_duration(
            1.0
        )
        planned_at = min(now, request.deadline.instant)
        hand_over.send(
            UnconfirmedPlan(replan.command, replan.change_ns, planned_at, now, replan, request)
        )
        if not pending_goal.has_verdict:
            plan = summarize_plan(replan, elapsed, pending_goal.lead_ms)
            sentence = compose_acceptance_sentence(replan, pending_goal.goal)
            self._state.reports.accept(pending_goal, sentence, plan)

    def handle_refusal(
        self, request: PlanRequest, replan: Replan, reason: HandOverReason, sentence: str
    ) -> None:
        """Handle that the arm refused or dropped a plan and continues the previous command.

        The first of these cases decides:

        1. The plan's goal has ended: nothing happens.
        2. The reason is in `FINAL_REFUSALS`: the goal ends.
        3. A newer goal waits: the goal ends as superseded, unless the arm executes an earlier plan
           for it.
        4. The plan starts from rest, the arm is still at the plan's start, no event has made the
           plan void, and the arm did not refuse its stamp: the plan gets a new stamp and is sent
           again.
        5. Otherwise a new plan for the goal is made, with a longer commit horizon (time until the
           plan takes over). After a refused stamp, the goal waits until the arm's time has come to
           that stamp, since the stamps of commands increase.

        Cases 4 and 5 count as a late plan; after too many of them the goal ends.

        Args:
            request: Request of the plan.
            replan: The plan.
            reason: Reason code; it is `LATE` if the arm gave no answer in time.
            sentence: The reason in words.
        """
        pending_goal = request.pending_goal
        if pending_goal.has_ended:
            return
        if reason in FINAL_REFUSALS:
            self._state.end(pending_goal, FINAL_REFUSALS[reason], sentence)
        elif self._state.waiting is not None:
            self._state.put_back(pending_goal)
        else:
            needs_new_plan = (HandOverReason.JUMP, HandOverReason.RESET, HandOverReason.STAMP)
            is_usable = reason not in needs_new_plan and self._is_valid(request)
            anew = replan.starts_from_rest and is_usable
            self._plan_late_goal_again(
                request, Verdict.DEADLINE, sentence, replan if anew else None
            )

    def _plan_late_goal_again(
        self, request: PlanRequest, code: Verdict, sentence: str, replan: Replan | None = None
    ) -> None:
        """Plan for a goal again with a longer commit horizon, or end it after too many tries.

        The commit horizon is the time until a new plan takes over. The goal ends after
        `MAX_LATE_PLANS` failures at the longest horizon.

        Args:
            request: Request of the plan that was too late.
            code: Verdict if the goal is refused. If the goal was accepted before, it is aborted
                with `DEADLINE` instead.
            sentence: What went wrong. The report's sentence begins with it.
            replan: Plan from rest that gets a new stamp and is sent again. None means that a new
                plan is made.
        """
        pending_goal = request.pending_goal
        if not self._hand_over.lengthen_horizon(pending_goal):
            if pending_goal.has_verdict:
                code = Verdict.DEADLINE
            spent = self._state.now - pending_goal.received_at
            tries = f"{MAX_LATE_PLANS} tries at the longest commit horizon, {spent:.1f} s in all"
            self._state.end(pending_goal, code, f"{sentence}, in {tries}")
        elif replan is not None:
            self._send_plan(request, replan)
        else:
            self._state.put_back(pending_goal)
