"""Lifecycle of goals: waiting, being planned for, sent, in force, ended; without ROS.

At most one goal waits (the newest), one is being planned for, one plan is unconfirmed, and one is
in force. A plan replaces the plan in force only when the arm has confirmed it. Stops, faults, clock
jumps and new settings make a plan void while it is being made. An epoch counter counts these
events.

Every goal gets one verdict, and every accepted goal gets one execution report. A plan that comes
too late is made again with a longer commit horizon, unless a newer goal has come. A plan from rest
only gets a new stamp. `goal_states` has a table of the effect of each event on a goal.

A command is a joint trajectory with its mode schedule. From its stamp on it repeats the previous
command. At its change, one commit horizon later, it leaves the previous command. The time of plans
is the arm's clock minus the delay that speed scaling has caused.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from mhsb_model.arm_reports import HandOverReason
from mhsb_model.circuit.dead_time import compute_dead_time
from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import ModeArray
from mhsb_model.verdict import Outcome, Report, Verdict
from mhsb_planner.deadline import Deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.online.arm_state import ArmState
from mhsb_planner.online.commit_horizon import LATE_PLAN_FACTOR, CommitHorizonEstimator
from mhsb_planner.online.execution import Execution
from mhsb_planner.online.goal_queue import START_UP, GoalQueue
from mhsb_planner.online.goal_reports import GoalReports
from mhsb_planner.online.goal_states import GoalState
from mhsb_planner.online.hand_over import LONGEST_WAIT, MAX_LATE_PLANS, HandOver
from mhsb_planner.online.pending_goal import (
    Adjustment,
    PendingGoal,
    ignore_report,
    keep_settings,
    summarize_plan,
)
from mhsb_planner.online.plan_request import PlanRequest, UnconfirmedPlan
from mhsb_planner.online.planner_io import Clock, PlannerIO
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.settings import Settings
from mhsb_planner.online.stamp_order import Order, StampOrder
from mhsb_planner.online.start_state import (
    MovingError,
    NoStateError,
    OtherMachineError,
    find_start_command,
)
from mhsb_planner.online.stop_sequence import ARM_STOPPED, STOP_ASKED, StopSequence
from mhsb_planner.online.verdicts import compose_acceptance_sentence, find_verdict_code

REFERENCE_TIMEOUT = 0.1
"""Silence of the arm above which the execution of a plan is not judged [s].

The arm may have stopped moving, or its messages may be late."""

FINAL_REFUSALS = {
    HandOverReason.FAULT: Verdict.FAULT,
    HandOverReason.INVALID: Verdict.INTERNAL,
    HandOverReason.STOPPED: Verdict.STOPPED,
}
"""Reasons of the arm's refusal after which a goal is not planned for again, and its verdict."""


class GoalLifecycle:
    """State machine of goals, from their arrival to their execution report.

    Goals and the arm's messages come in as events. Plan requests, commands and reports go out.
    Every public method handles one event, and none of them takes long. Three other classes keep
    the state: `GoalQueue` before a plan is sent, `HandOver` until the arm has confirmed it, and
    `StopSequence` while the arm is stopped. The `Execution` of the plan in force is kept here.

    Attributes:
        arm_state: What is known of the arm.
        execution: Execution of the plan that the arm has confirmed; None if it has ended or there
            is none.
    """

    def __init__(
        self,
        settings: Settings,
        brake: Callable[[Command, int, float], tuple[Command, int]],
        clock: Clock,
        outbox: PlannerIO,
    ) -> None:
        """Begin without a goal and without knowledge of the arm.

        Args:
            settings: Settings for goals that come without settings.
            brake: Function that makes a braking command. Its arguments are the command in force,
                the earliest stamp of the braking command [ns], and the time from stamp to braking
                [s]. It returns the braking command and the time at which braking begins [ns]. Times
                [ns] are in the time of plans (the arm's clock minus the arm's delay behind its
                plans).
            clock: Steady clock and ROS clock.
            outbox: Interface that carries out decisions: make a plan, send a command, send a
                report.
        """
        self.arm_state = ArmState(settings.machine.joint_count)
        self.execution: Execution | None = None
        self._clock = clock
        self._outbox = outbox
        self._reports = GoalReports(clock, outbox)
        self._queue = GoalQueue(settings, self.arm_state, clock, outbox, self._reports)
        self._hand_over = HandOver(self.arm_state, clock, outbox)
        self._stop = StopSequence(self.arm_state, brake, clock, outbox, self._hand_over)
        self._stamp_order = StampOrder(outbox.describe_publisher_conflict)

    @property
    def settings(self) -> Settings:
        """Settings for goals that come without settings."""
        return self._queue.settings

    @property
    def horizon_estimator(self) -> CommitHorizonEstimator:
        """Estimator of the commit horizon."""
        return self._hand_over.horizon_estimator

    @property
    def unconfirmed_command(self) -> Command | None:
        """Command that has been sent and not confirmed; None if there is none."""
        sent = self._hand_over.unconfirmed
        return None if sent is None else sent.command

    @property
    def is_stopping(self) -> bool:
        """True while the arm is being brought to rest."""
        return self._stop.is_under_way

    @property
    def is_idle(self) -> bool:
        """True if all goals have ended, no command is unconfirmed, and no stop is under way."""
        return not (
            self._queue.goals
            or self._hand_over.unconfirmed
            or self.execution
            or self._stop.is_under_way
        )

    def get_state(self, pending_goal: PendingGoal) -> GoalState:
        """Return the state of a goal: waiting, being planned for, and so on.

        Several plans may be made for one goal, so that several states may apply.

        Args:
            pending_goal: The goal.

        Returns:
            The first state that applies, in this order: `ENDED`; `STOPPING` or `EXECUTING`;
            `PLANNING`; `WAITING`; `REVOKED` (a stop has made its plan void); `UNCONFIRMED` (its
            plan was sent, and the arm has not answered).
        """
        if pending_goal.has_ended:
            return GoalState.ENDED
        if self._is_being_executed(pending_goal):
            return GoalState.STOPPING if self._stop.is_under_way else GoalState.EXECUTING
        sent, request = self._hand_over.unconfirmed, self._queue.request
        if request is not None and request.pending_goal is pending_goal:
            return GoalState.PLANNING
        if self._queue.waiting is pending_goal:
            return GoalState.WAITING
        return GoalState.REVOKED if sent is None or sent.is_void else GoalState.UNCONFIRMED

    # --- Goals -----------------------------------------------------------------------------------

    def add_goal(
        self,
        goal: Goal,
        received_at: float | None = None,
        sent_at: float | None = None,
        adjust_settings: Adjustment = keep_settings,
        on_report: Callable[[Report], None] = ignore_report,
    ) -> PendingGoal:
        """Accept a goal for planning or refuse it, and begin to plan if nothing prevents it.

        Args:
            goal: Place to which the tip must go.
            received_at: Time of receipt by the steady clock [s]; None means now.
            sent_at: Time of sending by the steady clock [s]; None means the time of receipt.
            adjust_settings: Function that derives this goal's settings from the settings for all
                goals.
            on_report: Called with each report on this goal. The outbox gets the reports, too.

        Returns:
            Record of the goal, also if the goal was refused.
        """
        now = self._clock.steady_time()
        received_at = now if received_at is None else received_at
        sent_at = received_at if sent_at is None else sent_at
        pending_goal = PendingGoal(
            goal, received_at, sent_at, now, adjust_settings=adjust_settings, on_report=on_report
        )
        executed = None if self.execution is None else self.execution.pending_goal
        if self._queue.admit(pending_goal, executed):
            self._start_planning()
        return pending_goal

    def build_trial_request(
        self, goal: Goal, adjust_settings: Adjustment, horizon_factor: float = 1.0
    ) -> PlanRequest:
        """Build the request for a plan that will not be executed.

        It is the request that a goal at rest would get if it came now. Goals and plans in progress
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
        now, now_ns = self._clock.steady_time(), self._now_ns()
        pending_goal = PendingGoal(
            goal,
            now,
            now,
            now,
            horizon_factor=horizon_factor,
            needs_exact_place=True,
            adjust_settings=adjust_settings,
        )
        self._queue.check_place(pending_goal)
        start = find_start_command(self.arm_state, now, now_ns)
        return self._build_request(pending_goal, start, now, now_ns)

    def tick(self) -> None:
        """Handle the passing of time. The method must be called periodically.

        The steps come in this order:

        1. Give up a sent command that the arm has not confirmed in time.
        2. If a moving goal has stopped, let it wait for a plan to its exact place.
        3. End the execution of a plan if the arm's reports say that it is over.
        4. Begin a stop if the newest goal was cancelled.
        5. Take the next step of a stop that is under way.
        6. Begin to plan for a waiting goal.
        """
        sent = self._hand_over.unconfirmed
        if sent is not None and self._hand_over.is_overdue(sent, self._now_ns()):
            self._handle_refused_command(
                sent, HandOverReason.LATE, "the arm did not take the plan in time"
            )
        self._plan_to_stopped_goal()
        self._judge_execution()
        self._stop_for_cancelled_goal()
        self._continue_stop()
        self._start_planning()

    def _start_planning(self) -> None:
        """Begin to plan for the waiting goal, if nothing prevents it.

        The first of these cases that applies decides:

        - A plan is being made or is unconfirmed (sent, without an answer), or the arm is being
          stopped: nothing happens.
        - The arm is not ready, for example not connected (`GoalQueue.must_wait`): the goal waits.
        - No plan can start from the arm's state: the goal waits on or is refused
          (`GoalQueue.postpone`). If the arm moves under a command that this planner did not send,
          the arm's own ~/stop is called, once for each goal.
        - The plan in force leads to the goal already: the goal takes over this plan.
        - Otherwise a plan is requested.
        """
        queue, pending_goal = self._queue, self._queue.waiting
        is_busy = queue.request or self._hand_over.unconfirmed or self._stop.is_under_way
        if pending_goal is None or is_busy:
            return
        now, now_ns = self._clock.steady_time(), self._now_ns()
        if queue.must_wait(pending_goal, self._hand_over.is_ahead(now_ns)):
            return
        is_overdue = now - self.arm_state.first_state_at >= START_UP
        if is_overdue and not self.arm_state.is_machine_known:
            self.handle_arm_machine(None)
        try:
            start = find_start_command(self.arm_state, now, now_ns)
        except (OtherMachineError, NoStateError, MovingError) as error:
            if queue.needs_arm_stop(error):
                self._stop.call_arm_stop(lambda success, sentence: None)
            queue.postpone(pending_goal, error)
            return
        queue.waiting = None
        if not self._take_over_plan_in_force(pending_goal, now_ns):
            queue.request = self._build_request(pending_goal, start, now, now_ns)
            self._outbox.start_planning(queue.request)

    def _build_request(
        self, pending_goal: PendingGoal, start: Command, steady_time: float, now_ns: int
    ) -> PlanRequest:
        """Build the request for a plan to a goal.

        The arm counts as moving until the trajectory of `start` has ended. The commit horizon (time
        until the new plan takes over) then covers planning, transport, confirmation and the
        machine's dead time. For an arm at rest the horizon does not cover planning, because the
        plan is stamped when it is ready. The deadline is the same in both cases: the horizon of a
        moving arm without its part for transport. A moving goal is extrapolated.

        Args:
            pending_goal: The goal.
            start: Command that the plan continues.
            steady_time: Present time by the steady clock [s].
            now_ns: Time of plans [ns]: the arm's clock minus the arm's delay behind its plans.

        Returns:
            The request. Its commit horizon is by the arm's clock, its deadline by the steady clock.
        """
        hand_over, common_settings = self._hand_over, self.settings
        settings = pending_goal.get_settings(common_settings)
        horizon = hand_over.choose_horizon(pending_goal, common_settings)
        seconds = horizon.total
        if start.trajectory.end_ns <= now_ns:
            seconds = hand_over.choose_horizon_from_rest(horizon, common_settings)
        rate = self.arm_state.clock_estimator.convert_duration(1.0)
        dead_time = compute_dead_time(common_settings.machine) / rate
        target, period = self._queue.choose_target(pending_goal, horizon.total, dead_time)
        return PlanRequest(
            self._queue.epoch,
            pending_goal,
            target,
            period,
            settings,
            start,
            self.arm_state.plan_in_force_ns,
            hand_over.choose_stamp(now_ns),
            hand_over.convert_horizon(seconds, common_settings),
            steady_time,
            Deadline(steady_time + horizon.total - horizon.transport_reserve),
            hand_over.find_plan_of_command(start, settings),
        )

    def _take_over_plan_in_force(self, pending_goal: PendingGoal, now_ns: int) -> bool:
        """Let a goal take over the plan in force if this plan leads to the goal already.

        Four conditions must hold. The arm still executes a plan of this planner. The plan's target
        is within 0.1 mm of the goal. Plan and goal have the same settings. The goal does not move.

        The earlier goal of the plan then ends as replaced. This goal is accepted, with `continued`
        set in its plan summary. If both are the same goal, nothing is reported.

        Args:
            pending_goal: The goal.
            now_ns: Time of plans [ns]: the arm's clock minus the arm's delay behind its plans.

        Returns:
            True if the goal needs no new plan. This includes a goal that is being executed already.
        """
        execution, now = self.execution, self._clock.steady_time()
        if (
            execution is None
            or not self.arm_state.executes_own(now_ns)
            or execution.command is not self.arm_state.own_command
            or not pending_goal.goal.is_at_same_position(execution.target)
            or execution.settings is not pending_goal.get_settings(self.settings)
            or self._queue.stream.is_moving(now)
        ):
            return False
        if execution.pending_goal is not pending_goal:
            self._reports.report_end(
                execution.pending_goal, Outcome.REPLACED, "the same goal came again and goes on"
            )
            pending_goal.plan_stamp_ns = execution.command.stamp_ns
            elapsed = 1e3 * (now - pending_goal.received_at)
            plan = replace(execution.plan, plan_ms=elapsed, lead_ms=elapsed, continued=True)
            sentence = "the arm is on its way there already"
            self._reports.accept(pending_goal, Verdict.OK, sentence, plan)
            execution.pending_goal = pending_goal
        return True

    # --- Plans -----------------------------------------------------------------------------------

    def handle_plan_answer(self, request: PlanRequest, answer: Replan | Exception | None) -> None:
        """Handle the answer to a plan request, then begin to plan if a goal waits.

        An answer to a request that has been withdrawn or replaced is ignored, and no planning
        begins. If an event has made the plan void (`epoch` has changed), or if the plan in force
        has changed, the goal is planned for again. Otherwise the answer decides:

        - A plan: it is sent.
        - None: the arm is at the goal already, and the goal ends.
        - `DeadlineError`: the goal is planned for again with a longer commit horizon (time until a
          new plan takes over). It is refused after `MAX_LATE_PLANS` tries at the longest horizon.
        - Another `MhsbError`: if the arm executes a plan to this very goal, that plan goes on. If
          the target was extrapolated from a moving goal, the goal's own place is planned for.
          Otherwise the goal is refused.
        - Any other exception: the goal is refused with `INTERNAL`.

        After a plan, the time of planning is added to `horizon_estimator`. After a `DeadlineError`,
        `LATE_PLAN_FACTOR` times this time is added.

        Args:
            request: Request that was answered.
            answer: The plan, the error that planning raised, or None.
        """
        queue, pending_goal = self._queue, request.pending_goal
        if request is not queue.request:
            return
        queue.request = None
        now = self._clock.steady_time()
        took, lost_pumps = now - request.requested_at, self.settings.lost_pumps_clause
        if not queue.is_valid(request, self._now_ns()):
            self._plan_again(pending_goal)
        elif isinstance(answer, DeadlineError):
            self.horizon_estimator.add_first_motion(LATE_PLAN_FACTOR * took)
            self._handle_late_plan(request, Verdict.NOT_FOUND, f"{answer}{lost_pumps}")
        elif isinstance(answer, MhsbError) and self._is_being_executed(pending_goal):
            self._accept_plan_end()
        elif isinstance(answer, MhsbError) and request.target is not pending_goal.goal:
            pending_goal.needs_exact_place = True
            self._plan_again(pending_goal)
        elif isinstance(answer, MhsbError):
            code = find_verdict_code(answer)
            why = lost_pumps if code is Verdict.INFEASIBLE else ""
            self._reports.end(pending_goal, code, f"{answer}{why}")
        elif isinstance(answer, Exception):
            kind = type(answer).__name__
            self._reports.end(pending_goal, Verdict.INTERNAL, f"planning failed with {kind}")
        elif answer is None:
            self._reports.report_at_goal(pending_goal)
        else:
            self.horizon_estimator.add_first_motion(took - answer.improvement_time)
            self._send_plan(request, answer, now)
        self._start_planning()

    def _send_plan(self, request: PlanRequest, replan: Replan, steady_time: float) -> None:
        """Send a plan, and accept its goal if the goal has no verdict yet.

        A plan that starts from rest first gets the present time as its stamp. If the previous
        command still moves at this time, the goal is planned for again instead. The change is the
        time at which the plan leaves the previous command. If it has passed, the plan counts as too
        late and is not sent. If the plan is sent, `attempts`, `plan_stamp_ns` and `lead_ms` of the
        goal are updated.

        Args:
            request: Request of the plan.
            replan: The plan.
            steady_time: Present time by the steady clock [s].
        """
        now_ns, pending_goal = self._now_ns(), request.pending_goal
        if replan.starts_from_rest:
            stamped = self._hand_over.stamp_from_rest(replan, pending_goal, self.settings, now_ns)
            if stamped is None:
                self._plan_again(pending_goal)
                return
            replan = stamped
        if now_ns >= replan.change_ns:
            late = (now_ns - replan.change_ns) / SECOND_NS
            sentence = f"the plan was ready {late:.3f} s after its change"
            self._handle_late_plan(request, Verdict.DEADLINE, sentence)
            return
        pending_goal.attempts += 1
        pending_goal.plan_stamp_ns = replan.command.stamp_ns
        elapsed = 1e3 * (steady_time - pending_goal.received_at)
        ahead = 1e3 * (replan.change_ns - now_ns) / SECOND_NS
        clock_rate = self.arm_state.clock_estimator.convert_duration(1.0)
        pending_goal.lead_ms = elapsed + ahead / clock_rate
        planned_at = min(steady_time, request.deadline.instant)
        self._send(
            UnconfirmedPlan(
                replan.command, replan.change_ns, planned_at, steady_time, replan, request
            )
        )
        if not pending_goal.has_verdict:
            plan = summarize_plan(replan, elapsed, pending_goal.lead_ms)
            sentence = compose_acceptance_sentence(replan, pending_goal.goal)
            self._reports.accept(pending_goal, Verdict.OK, sentence, plan)

    def _send(self, sent: UnconfirmedPlan) -> None:
        """Send a command.

        Some arms do not report which plan they execute. For these, the command is handled as
        confirmed at once.

        Args:
            sent: The command with its request.
        """
        if self._hand_over.send(sent):
            self._handle_confirmation(sent)

    def _handle_late_plan(
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
        pending_goal, now = request.pending_goal, self._clock.steady_time()
        if not self._hand_over.lengthen_horizon(pending_goal, self.settings):
            if pending_goal.has_verdict:
                code = Verdict.DEADLINE
            spent = now - pending_goal.received_at
            tries = f"{MAX_LATE_PLANS} tries at the longest lead, {spent:.1f} s in all"
            self._reports.end(pending_goal, code, f"{sentence}, in {tries}")
        elif replan is not None:
            self._send_plan(request, replan, now)
        else:
            self._plan_again(pending_goal)

    def _plan_again(self, pending_goal: PendingGoal) -> None:
        """Let a goal wait for a new plan, or end it as superseded if a newer goal waits.

        A goal for which the arm executes a plan is not superseded. It ends when the arm takes a
        plan for another goal. If the goal has ended already, nothing happens.

        Args:
            pending_goal: The goal.
        """
        if pending_goal.has_ended:
            return
        if self._queue.waiting is None:
            self._queue.put_back(pending_goal)
        elif not self._is_being_executed(pending_goal):
            self._reports.supersede(pending_goal)

    # --- Messages of the arm ---------------------------------------------------------------------

    def handle_reference(self, state: MotionState, stamp_ns: int) -> None:
        """Store the reference that the servo follows, and begin to plan if a goal waits.

        The order of the stamps may show that several publishers send references. A warning is
        logged when this begins or ends. As long as several publishers are possible, a reference
        with an earlier stamp is ignored. If the clock was set back, `handle_clock_jump` is called
        first. If no joint state has come yet, the reference also serves to detect rest.

        Args:
            state: Position, velocity and acceleration of all joints.
            stamp_ns: Stamp by the arm's clock [ns].
        """
        now = self._clock.steady_time()
        order = self._stamp_order.add_stamp(stamp_ns, now)
        conflict = self._stamp_order.publisher_conflict
        if conflict != self.arm_state.publisher_conflict:
            self.arm_state.publisher_conflict = conflict
            self._outbox.warn(conflict or "the arm's topics have one publisher again")
        if order is Order.MIXED:
            return
        if order is Order.BACK:
            self.handle_clock_jump("the arm's clock went back")
        self.arm_state.add_reference(state, stamp_ns, now)
        self._start_planning()

    def handle_joint_state(self, state: MotionState, stamp_ns: int) -> None:
        """Store the measured state of the joints, and use it to detect rest.

        Args:
            state: Measured position and velocity of all joints; its acceleration is 0.
            stamp_ns: Stamp by the arm's clock [ns].
        """
        self.arm_state.add_measurement(state, stamp_ns, self._clock.steady_time())

    def handle_modes(self, modes: ModeArray) -> None:
        """Store the mode that each actuator has in force, uint8[n]."""
        self.arm_state.modes = modes

    def handle_plan_in_force(self, stamp_ns: int) -> None:
        """Store which plan the arm has in force, and handle the consequences.

        If it is a sent command of this planner that was not confirmed before, it is confirmed. Then
        the execution is judged, a stop under way takes its next step, and planning begins if a goal
        waits.

        Args:
            stamp_ns: Stamp of the plan [ns]; `NO_PLAN` while the arm holds its position.
        """
        self.arm_state.plan_in_force_ns = stamp_ns
        sent = self._hand_over.find_new_confirmation(stamp_ns)
        if sent is not None:
            self._handle_confirmation(sent)
        self._judge_execution()
        self._continue_stop()
        self._start_planning()

    def handle_plan_refusal(self, stamp_ns: int, reason: HandOverReason, sentence: str) -> None:
        """Handle the arm's report that it has not taken a plan.

        Only a report on the unconfirmed command (sent, without an answer) has an effect. The goal
        of this command is then planned for again or ended, and planning begins if a goal waits.

        Args:
            stamp_ns: Stamp of the plan [ns].
            reason: Reason code.
            sentence: The reason in words.
        """
        sent = self._hand_over.unconfirmed
        if sent is not None and sent.command.stamp_ns == stamp_ns:
            self._handle_refused_command(sent, reason, sentence)
            self._start_planning()

    def handle_arm_fault(self, sentence: str) -> None:
        """Store the fault that the arm reports, and end all goals if it is a new fault.

        Goals without a verdict are refused with `FAULT`, and accepted goals are aborted. An
        unconfirmed plan (sent, without an answer) becomes void: if the arm takes it after all, the
        arm is stopped. If a stop is under way, its next step is taken (brake, or call ~/stop).

        If the arm reports that the fault is cleared, only this is stored. If it reports the same
        fault again, nothing happens.

        Args:
            sentence: The fault in words; empty if the arm has none.
        """
        if sentence == self.arm_state.fault:
            return
        self.arm_state.fault = sentence
        if not sentence:
            return
        for pending_goal in self._list_goals_in_progress():
            self._reports.end(pending_goal, Verdict.FAULT, sentence)
        self._queue.clear()
        self._hand_over.revoke()
        self.execution = None
        self._continue_stop()

    def handle_arm_machine(self, difference: str | None) -> None:
        """Store how the arm's machine file differs from the planner's.

        A difference is logged when it appears or changes.

        Args:
            difference: The difference in one sentence; empty if the files are equal. None if the
                arm does not report its machine. The files then count as equal, and a warning is
                logged if nothing was known before.
        """
        if difference is None and not self.arm_state.is_machine_known:
            self._outbox.warn(
                "the arm does not report its machine: whether it is this one is unknown"
            )
        if difference and difference != self.arm_state.machine_difference:
            self._outbox.warn(difference)
        self.arm_state.machine_difference, self.arm_state.is_machine_known = difference or "", True

    def handle_plan_delay(self, delay_ns: int) -> None:
        """Store the time by which the arm executes plans later than stamped.

        Args:
            delay_ns: Delay, caused by the reference governor [ns].
        """
        self.arm_state.plan_delay_ns = delay_ns

    def handle_arm_stop(
        self, stop_ns: int, age: float = 0.0, received_at: float | None = None
    ) -> None:
        """Handle the arm's report of its last stop, and end the goals that came before it.

        A stop is ignored if it was reported before, or if this planner has called for it. Otherwise
        goals that were sent up to a certain time end as stopped (`StopSequence.find_void_time`). If
        the arm executes a plan for such a goal, the arm is stopped again.

        Args:
            stop_ns: Time of the stop by the arm's clock [ns]; 0 means never, and nothing happens.
            age: Time from the stop to the report, by the arm's clock [s].
            received_at: Time of receipt of the report by the steady clock [s]; None means now.
        """
        void_until = self._stop.find_void_time(stop_ns, age, received_at)
        if void_until is None:
            return
        self._queue.void_goals(void_until, ARM_STOPPED)
        for pending_goal in self._list_goals_before_confirmation():
            if pending_goal.sent_at <= void_until:
                self._reports.end(pending_goal, Verdict.STOPPED, ARM_STOPPED)
        execution = self.execution
        if execution is not None and execution.pending_goal.sent_at <= void_until:
            if self.arm_state.executes_own(self._now_ns()):  # it took the plan after the stop
                self._stop.begin(ARM_STOPPED)
            else:
                self.execution = None
                self._reports.end(execution.pending_goal, Verdict.STOPPED, ARM_STOPPED)
        for pending_goal in self._queue.goals:
            if pending_goal.has_ended:
                self._queue.withdraw(pending_goal)
        if any(pending_goal.has_ended for pending_goal in self._hand_over.goals):
            self._hand_over.revoke()
        self._continue_stop()

    def handle_clock_jump(self, sentence: str) -> None:
        """Drop the arm's data after a clock jump, and plan for unfinished goals again.

        The goal that is being executed ends as aborted. A goal that is being planned for, or has an
        unconfirmed plan (sent, without an answer), is planned for again.

        Args:
            sentence: What has happened to the clock. It is logged and reported.
        """
        self._outbox.warn(f"{sentence}: what was known of the arm is forgotten")
        self._queue.epoch += 1
        self.arm_state.forget()
        if self.execution is not None:
            self._reports.report_end(self.execution.pending_goal, Outcome.ABORTED, sentence)
            self.execution = None
        for pending_goal in self._hand_over.forget():
            self._plan_again(pending_goal)

    def _handle_confirmation(self, sent: UnconfirmedPlan) -> None:
        """Handle the arm's confirmation that it follows a command.

        The confirmation may also come after the command was given up.

        For a braking command, the stop is finished if it is known when the arm will rest. If zones
        have changed since the command was made, the remaining motion is checked for obstacles.

        For a plan, the execution of its goal begins, and further plans for this goal are withdrawn.
        Another goal that was being executed ends as replaced. If the plan was revoked before this
        confirmation, the arm is stopped. If settings have changed since the plan's request and an
        obstacle lies ahead, the arm is stopped. The goal is then planned for again.

        Args:
            sent: The command that the arm has confirmed.
        """
        self._hand_over.confirm(sent)
        if sent.request is None or sent.replan is None:  # a braking command
            self._finish_stop(self._stop.confirm_braking(sent))
            if sent.braking_machine is not self.settings.machine:
                self._stop_for_obstacle_ahead()
            return
        request, pending_goal = sent.request, sent.request.pending_goal
        self._queue.withdraw(pending_goal)
        if self.execution is not None and not self._is_being_executed(pending_goal):
            self._reports.report_end(
                self.execution.pending_goal, Outcome.REPLACED, "a later plan took over"
            )
        self.execution = None
        if not pending_goal.has_ended:
            plan = summarize_plan(sent.replan, 0.0, pending_goal.lead_ms)
            self.execution = Execution(
                pending_goal, sent.command, request.target, plan, request.settings, sent.change_ns
            )
        if sent.is_void:
            self._stop.begin(STOP_ASKED)
            self._continue_stop()
        elif request.settings is not pending_goal.get_settings(self.settings):
            self._stop_for_obstacle_ahead(goal_after_stop=pending_goal)

    def _handle_refused_command(
        self, sent: UnconfirmedPlan, reason: HandOverReason, sentence: str
    ) -> None:
        """Handle that the arm has not taken a command and goes on with the previous command.

        After a braking command or a void plan (withdrawn after it was sent), the stop takes its
        next step. After any other plan the first of these cases decides:

        1. Its goal has ended: nothing happens.
        2. The reason is in `FINAL_REFUSALS`: the goal ends.
        3. A newer goal waits: the goal ends as superseded. If the arm executes an earlier plan for
           it, this plan goes on.
        4. The plan starts from rest, the arm is still at its start, and no event has made the plan
           void: it gets a new stamp and is sent again.
        5. Otherwise a new plan for the goal is made, with a longer commit horizon (time until the
           plan takes over).

        Cases 4 and 5 count as a late plan; after too many of them the goal ends.

        Args:
            sent: The command that was sent.
            reason: Reason code; `LATE` also if the arm gave no answer in time.
            sentence: The reason in words.
        """
        self._hand_over.give_up(sent, reason)
        request, replan = sent.request, sent.replan
        if request is None or replan is None or sent.is_void:
            self._continue_stop()
            return
        pending_goal = request.pending_goal
        if pending_goal.has_ended:
            return
        if reason in FINAL_REFUSALS:
            self._reports.end(pending_goal, FINAL_REFUSALS[reason], sentence)
        elif self._queue.waiting is not None:
            self._plan_again(pending_goal)
        else:
            elsewhere = reason in (HandOverReason.JUMP, HandOverReason.RESET)
            valid = self._queue.is_valid(request, self._now_ns())
            anew = replan.starts_from_rest and valid and not elsewhere
            self._handle_late_plan(request, Verdict.DEADLINE, sentence, replan if anew else None)

    # --- Stopping --------------------------------------------------------------------------------

    def stop(self, done: Callable[[bool, str], None]) -> None:
        """Bring the arm to rest, whatever has set it in motion, and end all goals.

        If a stop is under way already, it goes on, and `done` is called at its end, too. Waiting
        goals, and the goal for which a plan is being made, are ended at once as stopped. So are
        goals that were sent before this call, but come or are read later. An unconfirmed plan
        (sent, without an answer) becomes void: if the arm takes it, the arm is stopped. Its goal
        and the goal of the plan in force end when the arm has stopped.

        Args:
            done: Called once with success and sentence. Success means that the arm is measured at
                rest or has confirmed a braking command. Otherwise the sentence says why it may
                still move.
        """
        before_now = math.nextafter(self._clock.steady_time(), -math.inf)
        self._queue.void_goals(before_now, STOP_ASKED)
        for pending_goal in self._queue.goals:
            self._reports.end(pending_goal, Verdict.STOPPED, STOP_ASKED)
        self._queue.clear()
        self._accept_plan_end()
        self._stop.join(done, self._hand_over.revoke())
        self._continue_stop()

    def cancel(self, pending_goal: PendingGoal) -> None:
        """Cancel a goal: stop the arm, unless a newer goal has come.

        The goal's `is_cancelled` is set. The arm is not stopped while a newer goal is in progress.
        If the newer goal ends before this one, for example by a refusal, the arm is stopped then.

        Args:
            pending_goal: The goal.
        """
        pending_goal.is_cancelled = True
        self._stop_for_cancelled_goal()

    def _stop_for_cancelled_goal(self) -> None:
        """Stop the arm if the newest goal in progress was cancelled.

        A goal is in progress while it waits, is being planned for, is executed, or has a plan that
        the arm has not answered yet. Nothing happens while a stop is under way.

        A stop ends all goals as stopped. Goals that wait or are being planned for end at once, the
        others when the arm has stopped.
        """
        newest = next(iter(self._list_goals_in_progress()), None)
        if newest is not None and newest.is_cancelled and not self._stop.is_under_way:
            self.stop(lambda success, sentence: None)

    def change_settings(self, settings: Settings) -> None:
        """Replace the settings for all goals.

        A plan that is being made is made again. If zones have changed and an obstacle lies ahead on
        the motion in force, the arm is stopped.

        Args:
            settings: The new settings.
        """
        zones_change = settings.machine.zones != self.settings.machine.zones
        self._queue.settings = settings
        self._queue.epoch += 1
        if zones_change:
            self._stop_for_obstacle_ahead()

    def _stop_for_obstacle_ahead(self, goal_after_stop: PendingGoal | None = None) -> None:
        """Begin a stop if an obstacle lies ahead on the motion in force.

        Args:
            goal_after_stop: Goal to plan for after the arm has stopped; None for no goal. It is
                ignored if a stop is under way already.
        """
        if self._stop.begin_for_obstacle(self.settings.machine, goal_after_stop):
            self._continue_stop()
            self._stop.report_waiting()

    def _continue_stop(self) -> None:
        """Take the next step of the stop under way, and finish the stop if it has a result.

        A step is a braking command, which is sent, or a call of the arm's own ~/stop. Without a
        stop, nothing happens.
        """
        braking = self._stop.take_step(self.settings)
        if braking is not None:
            self._send(braking)
        self._finish_stop(self._stop.find_result())

    def _finish_stop(self, result: tuple[bool, str] | None) -> None:
        """Finish the stop under way, and let its `goal_after_stop` wait for planning.

        If the stop has succeeded, the execution of the plan in force ends. If it has failed, the
        execution goes on.

        Args:
            result: Success and sentence. None means that the stop is not over: nothing happens.
        """
        if result is None:
            return
        execution = None
        if result[0]:
            execution, self.execution = self.execution, None
        goal_after_stop = self._stop.finish(result, execution, self.settings.machine, self._reports)
        if goal_after_stop is not None:
            self._plan_again(goal_after_stop)

    # --- Execution -------------------------------------------------------------------------------

    def _list_goals_before_confirmation(self) -> list[PendingGoal]:
        """Return the goals without a confirmed plan, newest first.

        Returns:
            Goals that wait, are being planned for, or have a plan that was sent and not answered
            yet.
        """
        return self._queue.goals + self._hand_over.goals

    def _list_goals_in_progress(self) -> list[PendingGoal]:
        """Return the goals in progress, newest first.

        A goal is in progress while it waits, is being planned for, has a plan that the arm has not
        answered yet, or is executed.
        """
        executed = [] if self.execution is None else [self.execution.pending_goal]
        return self._list_goals_before_confirmation() + executed

    def _is_being_executed(self, pending_goal: PendingGoal) -> bool:
        """Return whether the arm executes a plan for this very goal, not for one at its place."""
        return self.execution is not None and self.execution.pending_goal is pending_goal

    def _accept_plan_end(self) -> None:
        """Set the target of the plan in force to the goal's own place.

        The plan for a moving goal ends a little beyond the goal's place. Because of this call, no
        further plan to the exact place is made. If no plan is executed, nothing happens.
        """
        if self.execution is not None:
            self.execution.target = self.execution.pending_goal.goal

    def _plan_to_stopped_goal(self) -> None:
        """Plan once more for a goal that moved and now stands still.

        The plan in force ends a little beyond the place of such a goal. The goal becomes the
        waiting goal again, with `needs_exact_place` set. Nothing happens in these cases:

        - No plan is being executed.
        - The plan in force ends at the goal's exact place already.
        - The goal still moves.
        - A goal waits, a plan is being made, or a plan was sent without an answer yet.
        - The arm is being stopped.
        """
        execution, now = self.execution, self._clock.steady_time()
        if execution is None or self._stop.is_under_way or self._list_goals_before_confirmation():
            return
        pending_goal = execution.pending_goal
        at_exact_place = execution.target.is_at_same_position(pending_goal.goal)
        if not at_exact_place and not self._queue.stream.is_moving(now):
            pending_goal.needs_exact_place = True
            self._plan_again(pending_goal)

    def _judge_execution(self) -> None:
        """End and report the execution of the plan in force if the arm's reports say it is over.

        Nothing happens in these cases:

        - A stop is under way.
        - A further plan for the same goal is waited for, is being made, or was sent without an
          answer yet.
        - The arm has been silent for more than `REFERENCE_TIMEOUT`: it may be frozen, or its
          messages may be late. After `LONGEST_WAIT` the last reports decide.
        - The tip has reached the end of the plan, but the goal has moved on and still moves.
        """
        execution, now = self.execution, self._clock.steady_time()
        if execution is None or self._stop.is_under_way:
            return
        pending_goal = execution.pending_goal
        silence = self.arm_state.clock_estimator.time_since_last_stamp(now)
        is_planned_again = pending_goal in self._list_goals_before_confirmation()
        if REFERENCE_TIMEOUT < silence < LONGEST_WAIT or is_planned_again:
            return
        ending = execution.judge(self.settings.machine, self.arm_state, self._now_ns())
        if ending is None:
            return
        is_beyond = not execution.target.is_at_same_position(pending_goal.goal)
        if ending.outcome is Outcome.REACHED and is_beyond and self._queue.stream.is_moving(now):
            return
        self.execution = None
        self._reports.report_end(pending_goal, *ending)

    def _now_ns(self) -> int:
        """Return the time of plans: the arm's clock minus the arm's delay behind its plans [ns]."""
        return self.arm_state.get_plan_time_ns(self._clock.steady_time(), self._clock.ros_ns())
