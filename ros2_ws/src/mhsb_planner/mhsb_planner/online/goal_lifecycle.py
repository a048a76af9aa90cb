"""Lifecycle of goals, from waiting over planning and execution to the end; without ROS.

At most one goal waits (the newest), one is being planned for, one plan is unconfirmed, and one is
in force. A plan replaces the plan in force only when the arm has confirmed it. A clock jump or new
settings make a plan void that is still being made.

Every goal gets one verdict, and every accepted goal gets one execution report. A plan that comes
too late is made again with a longer commit horizon, unless a newer goal has come. A late plan from
rest is not made again; it gets a new stamp. The module `goal_states` has a table of the effect of
each event on a goal.

A command is a joint trajectory with its mode schedule. From its stamp on it repeats the previous
command. At its change, one commit horizon later, it deviates from the previous command. The time of
plans is the arm's clock minus the delay that speed scaling has caused.
"""

import math
from collections.abc import Callable

from mhsb_model.arm_reports import HandOverReason
from mhsb_model.goal import Goal
from mhsb_model.trajectory import MotionState
from mhsb_model.verdict import Outcome, Report, Verdict
from mhsb_planner.motion.s3_clearance import find_contact_ahead
from mhsb_planner.online.arm_clock import Order, StampOrder
from mhsb_planner.online.arm_state import ArmState
from mhsb_planner.online.arm_stops import ArmStops
from mhsb_planner.online.execution_monitor import ExecutionMonitor
from mhsb_planner.online.goal_planning import GoalPlanning
from mhsb_planner.online.goal_reports import GoalReports
from mhsb_planner.online.hand_over import HandOver
from mhsb_planner.online.lifecycle_state import LifecycleState
from mhsb_planner.online.pending_goal import (
    Adjustment,
    PendingGoal,
    ignore_report,
    keep_settings,
)
from mhsb_planner.online.plan_request import PlanRequest, UnconfirmedPlan
from mhsb_planner.online.planner_io import PlannerIO
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.settings import Settings
from mhsb_planner.online.stop_sequence import ARM_STOPPED, STOP_ASKED, Brake, StopSequence


class GoalLifecycle:
    """State machine of goals, from their arrival to their execution report.

    Goals and the arm's messages come in as events. Plan requests, commands and reports go out.
    Every public method handles one event and returns quickly. Messages of the arm that are only
    stored are written to `arm_state` directly. Four other classes do the work: `GoalPlanning` plans
    for goals, `HandOver` sends plans, `ExecutionMonitor` reports how their execution ends, and
    `StopSequence` stops the arm.

    Attributes:
        state: Data that all parts share: settings, arm state, outbox, and goals by their stage.
        arm_state: What the planner knows of the arm.
        planning: Planning of goals, which can also build requests for plans on trial.
        hand_over: Hand-over of plans, with the estimator of the commit horizon.
    """

    def __init__(self, settings: Settings, brake: Brake, outbox: PlannerIO) -> None:
        """Begin without a goal and without data of the arm.

        Args:
            settings: Settings for goals that come without settings.
            brake: Function that makes a braking command.
            outbox: Clocks, and interface that carries out decisions: make a plan, send a command,
                send a report.
        """
        self.arm_state = ArmState(settings.machine.joint_count)
        self.state = LifecycleState(settings, self.arm_state, outbox, GoalReports(outbox))
        self._brake = brake
        self._monitor = ExecutionMonitor(self.state)
        self.hand_over = HandOver(self.state, self._handle_confirmation)
        self._arm_stops = ArmStops(self.state)
        self.planning = GoalPlanning(self.state, self._monitor, self.hand_over, self._arm_stops)
        self._stop: StopSequence | None = None
        self._stamp_order = StampOrder(outbox.describe_publisher_conflict)

    @property
    def is_stopping(self) -> bool:
        """True while a stop is under way."""
        return self._stop is not None

    # --- Goals and plans -------------------------------------------------------------------------

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
            Record of the goal, even if the goal was refused.
        """
        now = self.state.now
        received_at = now if received_at is None else received_at
        sent_at = received_at if sent_at is None else sent_at
        pending_goal = PendingGoal(
            goal, received_at, sent_at, now, adjust_settings=adjust_settings, on_report=on_report
        )
        if self.state.admit(pending_goal):
            self._start_planning()
        return pending_goal

    def cancel(self, pending_goal: PendingGoal) -> None:
        """Cancel a goal: stop the arm, unless a newer goal has come.

        The goal's `is_cancelled` is set. The arm is not stopped while a newer goal is in progress.
        If the newer goal ends before this goal, for example by a refusal, the arm is stopped at
        that time.

        Args:
            pending_goal: The goal.
        """
        pending_goal.is_cancelled = True
        self._stop_for_cancelled_goal()

    def handle_plan_answer(self, request: PlanRequest, answer: Replan | Exception | None) -> None:
        """Handle the answer to a plan request, then begin to plan if a goal waits.

        An answer to a request that has been withdrawn or replaced is ignored, and no planning
        begins.

        Args:
            request: Request that was answered.
            answer: The plan, the error that planning raised, or None if the arm is at the goal.
        """
        if request is self.state.request:
            self.planning.handle_answer(request, answer)
            self._start_planning()

    def change_settings(self, settings: Settings) -> None:
        """Replace the settings for all goals.

        A plan that is being made is started again. If zones have changed and an obstacle lies ahead
        on the motion in force, the arm is stopped.

        Args:
            settings: The new settings.
        """
        zones_change = settings.machine.zones != self.state.settings.machine.zones
        self.state.settings = settings
        self.state.epoch += 1
        if zones_change:
            self._stop_for_obstacle_ahead()

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
        sent = self.state.unconfirmed
        if sent is not None and self.hand_over.is_overdue(sent):
            self._handle_refused_command(
                sent, HandOverReason.LATE, "the arm did not take the plan in time"
            )
        if self._stop is None:
            self._monitor.plan_to_stopped_goal()
            self._monitor.judge()
        self._stop_for_cancelled_goal()
        self._continue_stop()
        self._start_planning()

    def _start_planning(self) -> None:
        """Begin to plan for the waiting goal, if no stop is under way and nothing prevents it."""
        if self._stop is None:
            self.planning.start()

    # --- Messages of the arm ---------------------------------------------------------------------

    def handle_reference(self, state: MotionState, stamp_ns: int) -> None:
        """Store the reference that the servo follows, and begin to plan if a goal waits.

        The order of the stamps may show that several publishers send references. A warning is
        logged when this state begins or ends. As long as there may be several publishers,
        references with earlier stamps are ignored. If the clock was set back, `handle_clock_jump`
        is called first.

        Args:
            state: Position, velocity and acceleration of all joints.
            stamp_ns: Stamp by the arm's clock [ns].
        """
        now = self.state.now
        order = self._stamp_order.add_stamp(stamp_ns, now)
        conflict = self._stamp_order.publisher_conflict
        if conflict != self.arm_state.publisher_conflict:
            self.arm_state.publisher_conflict = conflict
            self.state.outbox.warn(conflict or "the arm's topics have one publisher again")
        if order is Order.MIXED:
            return
        if order is Order.BACK:
            self.handle_clock_jump("the arm's clock went back")
        self.arm_state.add_reference(state, stamp_ns, now)
        self._start_planning()

    def handle_clock_jump(self, sentence: str) -> None:
        """Drop the arm's data after a clock jump, and plan for unfinished goals again.

        The goal that is being executed ends as aborted. A goal that is being planned for, or has an
        unconfirmed plan (sent, without an answer), is planned for again.

        Args:
            sentence: What has happened to the clock. It is logged and reported.
        """
        state = self.state
        state.outbox.warn(f"{sentence}: what was known of the arm is forgotten")
        state.epoch += 1
        self.arm_state.forget()
        if state.execution is not None:
            self.state.reports.report_end(state.execution.pending_goal, Outcome.ABORTED, sentence)
            state.execution = None
        for pending_goal in self.hand_over.forget():
            self.state.put_back(pending_goal)

    def handle_plan_in_force(self, stamp_ns: int) -> None:
        """Store which plan the arm has in force, and handle the consequences.

        If the plan is a command of this planner that was not confirmed before, it now counts as
        confirmed. Then the execution is judged, a stop under way takes its next step, and planning
        begins if a goal waits.

        Args:
            stamp_ns: Stamp of the plan [ns]; `NO_PLAN` while the arm holds its position.
        """
        self.arm_state.plan_in_force_ns = stamp_ns
        sent = self.hand_over.find_new_confirmation(stamp_ns)
        if sent is not None:
            self._handle_confirmation(sent)
        if self._stop is None:
            self._monitor.judge()
        self._continue_stop()
        self._start_planning()

    def _handle_confirmation(self, sent: UnconfirmedPlan) -> None:
        """Handle the arm's confirmation that it follows a command.

        The confirmation may also come after the command was given up.

        For a braking command, the stop is finished if the time at which the arm will rest is known.
        If zones have changed since the command was made, the remaining motion is checked for
        obstacles.

        For a plan, the execution of its goal begins. If the plan was revoked before this
        confirmation, the arm is stopped. If settings have changed since the plan's request and an
        obstacle lies ahead, the arm is stopped. The goal is then planned for again.

        Args:
            sent: The command that the arm has confirmed.
        """
        request, replan = sent.request, sent.replan
        self.hand_over.confirm(sent)
        if request is None or replan is None:  # a braking command
            if self._stop is not None:
                self._finish_stop(self._stop.confirm_braking(sent))
            elif sent.obstacle_sentence:
                self.state.outbox.warn(sent.obstacle_sentence)
            if sent.braking_machine is not self.state.settings.machine:
                self._stop_for_obstacle_ahead()
            return
        self._monitor.begin(request, replan)
        if sent.is_void:
            self._begin_stop(STOP_ASKED)
            self._continue_stop()
        elif request.settings is not request.pending_goal.get_settings(self.state.settings):
            self._stop_for_obstacle_ahead(goal_after_stop=request.pending_goal)

    def handle_plan_refusal(self, stamp_ns: int, reason: HandOverReason, sentence: str) -> None:
        """Handle the arm's report that it refused or dropped a plan.

        Only a report on the unconfirmed command (sent, without an answer) has an effect. The goal
        of this command is then planned for again or ended, and planning begins if a goal waits. If
        a stop is under way, it takes its next step instead.

        Args:
            stamp_ns: Stamp of the plan [ns].
            reason: Reason code.
            sentence: The reason in words.
        """
        sent = self.state.unconfirmed
        if sent is not None and sent.command.stamp_ns == stamp_ns:
            self._handle_refused_command(sent, reason, sentence)
            self._start_planning()

    def _handle_refused_command(
        self, sent: UnconfirmedPlan, reason: HandOverReason, sentence: str
    ) -> None:
        """Handle that the arm refused or dropped a command and continues the previous command.

        The command is no longer unconfirmed. If it was late, its transport time becomes a sample of
        the commit horizon; if its stamp was refused, the clock's estimate is renewed. After a
        braking command or a void plan (withdrawn after it was sent), the stop takes its next step.
        After any other plan, its goal is planned for again or ended, or the plan is sent again.

        Args:
            sent: The command that was sent.
            reason: Reason code; it is `LATE` if the arm gave no answer in time.
            sentence: The reason in words.
        """
        self.hand_over.give_up(sent, reason)
        if sent.request is None or sent.replan is None or sent.is_void:
            self._continue_stop()
        else:
            self.planning.handle_refusal(sent.request, sent.replan, reason, sentence)

    def handle_arm_fault(self, sentence: str) -> None:
        """Store the fault that the arm reports, and end all goals if it is a new fault.

        Goals without a verdict are refused with `FAULT`, and accepted goals are aborted. An
        unconfirmed plan (sent, without an answer) becomes void: if the arm still begins to follow
        it, the arm is stopped. If a stop is under way, it takes its next step (a braking command or
        a call of ~/stop).

        An empty sentence is only stored: the fault is cleared. If the arm reports the same fault
        again, nothing happens.

        Args:
            sentence: The fault in words; empty if the arm has none.
        """
        if sentence == self.arm_state.fault:
            return
        self.arm_state.fault = sentence
        if not sentence:
            return
        for pending_goal in self.state.goals_in_progress:
            self.state.end(pending_goal, Verdict.FAULT, sentence)
        self.state.execution = None
        self._continue_stop()

    def handle_arm_stop(
        self, stop_ns: int, age: float = 0.0, received_at: float | None = None
    ) -> None:
        """Handle the arm's report of its last stop, and end the goals that came before it.

        A stop is ignored if it was reported before, or if this planner has called for it. Otherwise
        goals that were sent up to a certain time end as stopped, even if they arrive later
        (`ArmStops.find_void_time`). If the arm executes a plan for such a goal, the arm is stopped
        again.

        Args:
            stop_ns: Time of the stop by the arm's clock [ns]; 0 means never, and nothing happens.
            age: Time from the stop to the report, by the arm's clock [s].
            received_at: Time of receipt of the report by the steady clock [s]; None means now.
        """
        state, void_until = self.state, self._arm_stops.find_void_time(stop_ns, age, received_at)
        if void_until is None:
            return
        state.void_goals(void_until, ARM_STOPPED)
        for pending_goal in state.goals_before_confirmation:
            if pending_goal.sent_at <= void_until:
                state.end(pending_goal, Verdict.STOPPED, ARM_STOPPED)
        execution = state.execution
        if execution is not None and execution.pending_goal.sent_at <= void_until:
            if self.arm_state.executes_own(state.now_ns):
                self._begin_stop(ARM_STOPPED)  # the arm took the plan after the stop
            else:
                state.execution = None
                state.end(execution.pending_goal, Verdict.STOPPED, ARM_STOPPED)
        self._continue_stop()

    # --- Stopping --------------------------------------------------------------------------------

    def stop(self, done: Callable[[bool, str], None]) -> None:
        """Bring the arm to rest, even from a motion that others commanded, and end all goals.

        If a stop is under way already, it goes on, and `done` is called at its end, too. Waiting
        goals, and the goal for which a plan is being made, are ended at once as stopped. Goals that
        were sent before this call, but come or are read later, also end as stopped. An unconfirmed
        plan (sent, without an answer) becomes void: if the arm begins to follow it, the arm is
        stopped. The goals of this plan and of the plan in force end when the arm has stopped.

        Args:
            done: Called once with success and sentence. Success means that the arm is measured at
                rest or has confirmed a braking command. Without success, the sentence says why the
                arm may still move.
        """
        state = self.state
        state.void_goals(math.nextafter(state.now, -math.inf), STOP_ASKED)
        for pending_goal in state.queued_goals:
            state.end(pending_goal, Verdict.STOPPED, STOP_ASKED)
        state.accept_plan_end()
        self._begin_stop(STOP_ASKED).join(done, state.revoke())
        self._continue_stop()

    def _begin_stop(self, reason: str, goal_after_stop: PendingGoal | None = None) -> StopSequence:
        """Begin a stop, unless a stop is under way, and return the stop under way.

        If a stop is under way already, the arguments are ignored.

        Args:
            reason: Reason of the stop, as execution reports state it.
            goal_after_stop: Goal to plan for after the arm has stopped; None for no goal.
        """
        self._stop = self._stop or StopSequence(
            self.state, self.hand_over, self._arm_stops, self._brake, reason, goal_after_stop
        )
        return self._stop

    def _stop_for_cancelled_goal(self) -> None:
        """Stop the arm if the newest goal in progress was cancelled.

        Nothing happens while a stop is under way. The stop ends all goals as stopped: goals without
        a sent plan at once, the others when the arm has stopped.
        """
        newest = next(iter(self.state.goals_in_progress), None)
        if newest is not None and newest.is_cancelled and self._stop is None:
            self.stop(lambda success, sentence: None)

    def _stop_for_obstacle_ahead(self, goal_after_stop: PendingGoal | None = None) -> None:
        """Begin a stop if an obstacle lies ahead on the motion in force.

        If a stop is under way already, it continues, but brakes for the obstacle. The next step of
        the stop is taken at once. A wait for the arm's answer to the last plan is logged. Nothing
        happens if the arm executes no command of this planner.

        Args:
            goal_after_stop: Goal to plan for after the arm has stopped; None for no goal. It is
                ignored if a stop is under way already.
        """
        own, now_ns = self.arm_state.own_command, self.state.now_ns
        if own is None or not self.arm_state.executes_own(now_ns):
            return
        contact = find_contact_ahead(self.state.settings.machine, own.trajectory, now_ns)
        if contact is None:
            return
        stop = self._begin_stop("", goal_after_stop)
        stop.brake_for(contact.name)
        self._continue_stop()
        if self._stop is stop:
            stop.report_waiting()

    def _continue_stop(self) -> None:
        """Take the next step of the stop under way, and finish the stop if it has a result.

        A step is a braking command, which is sent, or a call of the arm's own ~/stop. Without a
        stop, nothing happens.
        """
        if self._stop is not None:
            self._stop.take_step()
        if self._stop is not None:
            self._finish_stop(self._stop.find_result())

    def _finish_stop(self, result: tuple[bool, str] | None) -> None:
        """Finish the stop under way, and let its `goal_after_stop` wait for planning.

        Args:
            result: Success and sentence. None means that the stop is not over: nothing happens.
        """
        stop = self._stop
        if result is None or stop is None:
            return
        self._stop = None
        stop.finish(result)
        if stop.goal_after_stop is not None:
            self.state.put_back(stop.goal_after_stop)
