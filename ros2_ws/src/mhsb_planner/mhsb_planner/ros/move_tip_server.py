"""Action MoveTip: goals with feedback and cancellation.

The goal lifecycle handles goals of the action in the same way as goals of the topic `goal_pose`.
This module passes goals of the action to the lifecycle, and the lifecycle's reports to the clients.
A goal with `plan_only` is planned for but not executed. The interface package mhsb_interfaces must
be compiled. If it is missing, the planner node logs this and serves only the topics.
"""

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionServer, CancelResponse
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import JointTrajectory

from mhsb_model.circuit.dead_time import compute_dead_time
from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.verdict import GoalVerdict, Outcome, PlanSummary, Report, Verdict
from mhsb_msgs_py import names, qos, stamps
from mhsb_msgs_py.errors import GoalError
from mhsb_msgs_py.guarded_executor import get_faults
from mhsb_planner import deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.online.commit_horizon import LATE_PLAN_FACTOR
from mhsb_planner.online.goal_lifecycle import GoalLifecycle
from mhsb_planner.online.goal_reports import (
    compose_acceptance_sentence,
    compose_at_goal_verdict,
    find_verdict_code,
)
from mhsb_planner.online.pending_goal import Adjustment, PendingGoal, summarize_plan
from mhsb_planner.online.plan_request import PlanRequest
from mhsb_planner.online.progress import Progress
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.settings import Settings
from mhsb_planner.ros import goal_options
from mhsb_planner.ros.outbox import RosOutbox

FEEDBACK_PERIOD = 0.1
"""Time between two rounds of feedback [s]."""

FEEDBACK_AT_ONCE = 20
"""Largest number of goals that get feedback in one round.

If there are more goals, the others get feedback in later rounds.
"""

RESULT_KEPT = 60
"""Time for which results are kept, for clients that request them late [s]."""

MOST_GOALS = 1000
"""Largest number of goals without a result; further goals are refused.

The queues of the middleware have more room."""

MOST_STRETCHED = 20.0
"""Largest factor on the commit horizon for plans that will not be executed [-]."""


class _Server(ActionServer):
    """Action server that runs the coroutine of a goal only when its result is known.

    rclpy's own server starts the coroutine at once, and resumes it whenever the node wakes, even if
    nothing has changed. Here `ServerGoalHandle.execute` calls `notify_execute` without a callback,
    which has no effect.
    """

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Schedule a callback that writes the result of a goal; without a callback, do nothing.

        Args:
            goal_handle: rclpy's handle of the goal.
            execute_callback: Function that writes the result; None if the result is not known yet.
        """
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)


@dataclass(eq=False)
class _ActionGoal:
    """Goal of the action.

    Attributes:
        handle: rclpy's handle of the goal.
        on_finished: Function that is called once with this object when the goal has ended.
        success: True if the goal was reached or, with `plan_only`, planned for. False if it ended
            in another way; None before its end.
        pending_goal: The lifecycle's record of the goal; None if the goal will not be executed.
        progress: Elapsed share, time left and energy of the motion.
        result: Fields of the action's result that are known so far.
    """

    handle: Any
    on_finished: Callable[["_ActionGoal"], None]
    success: bool | None = None
    pending_goal: PendingGoal | None = None
    progress: Progress = field(default_factory=Progress)
    result: dict[str, Any] = field(default_factory=dict)

    def take_report(self, report: Report) -> None:
        """Write a report on this goal into its result, and end the goal if the report is the last.

        Every report except the verdict `OK` is the last. The goal ends with success after the
        verdict `AT_GOAL` or the outcome `REACHED`.

        Args:
            report: Verdict or execution report.
        """
        if isinstance(report, GoalVerdict):
            self.result |= {"verdict": str(report.code), "message": report.sentence}
            if report.plan is not None:
                self.result |= _collect_plan_fields(report.plan)
            if report.code is not Verdict.OK:
                self.end(report.code is Verdict.AT_GOAL)
        else:
            self.result |= {
                "outcome": str(report.outcome),
                "message": report.sentence,
                "plan_stamp": stamps.to_time(report.plan_stamp_ns),
                "lead_ms": report.lead_ms,
            }
            self.end(report.outcome is Outcome.REACHED)

    def refuse(self, code: Verdict, sentence: str) -> None:
        """End the goal without success, with a verdict in its result.

        Args:
            code: Code of the verdict.
            sentence: The verdict in words.
        """
        self.result |= {"verdict": str(code), "message": sentence}
        self.end(False)

    def end(self, success: bool) -> None:
        """End the goal and call `on_finished`, unless the goal has ended before.

        Args:
            success: True if the goal was reached or, with `plan_only`, planned for.
        """
        if self.success is None:
            self.success = success
            self.on_finished(self)


class MoveTipServer:
    """Server of the action ~/move_tip."""

    def __init__(
        self,
        action: Any,
        node: Any,
        machine: Machine,
        decode_goal: Callable[[PoseStamped], Goal],
        lifecycle: GoalLifecycle,
        outbox: RosOutbox,
        make_settings: Callable[[Sequence[Parameter]], Settings],
    ) -> None:
        """Start to serve the action.

        Args:
            action: Compiled action type MoveTip.
            node: Planner node. Its attribute `faults` records exceptions in callbacks.
            machine: Machine of the node.
            decode_goal: Function that returns the goal of a pose message. It raises GoalError or
                MessageError.
            lifecycle: State machine of the goals that will be executed.
            outbox: Outbox with the planning worker. It plans for goals that will not be executed,
                and encodes their plans as messages.
            make_settings: Function that returns the settings of plans from the node's parameters.
                Its argument is a list of one goal's own parameters, which replace the node's
                parameters.

        Raises:
            Exception: The compiled interface does not fit rclpy's libraries; the type is rclpy's.
        """
        self._action = action
        self._node = node
        self._machine = machine
        self._decode_goal = decode_goal
        self._lifecycle = lifecycle
        self._outbox = outbox
        self._make_settings = make_settings
        self._faults = get_faults(node)
        self._jobs: list[_ActionGoal] = []
        self._trial_request: tuple[PlanRequest, _ActionGoal] | None = None
        self._trial_queue: deque[tuple[_ActionGoal, Goal, Adjustment]] = deque()
        self._feedback_sent_at = 0.0
        self._turn = 0
        self._server = _Server(
            node,
            action,
            names.MOVE_TIP_ACTION,
            self._write_result,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            goal_service_qos_profile=qos.SERVICE,
            result_service_qos_profile=qos.SERVICE,
            cancel_service_qos_profile=qos.SERVICE,
            result_timeout=RESULT_KEPT,
        )

    def close(self) -> None:
        """Destroy the action server. The node calls this at its end."""
        self._server.destroy()

    # --- A goal's life ---------------------------------------------------------------------------

    def _on_accepted(self, handle: Any) -> None:
        """Begin a goal that rclpy has accepted.

        If `MOST_GOALS` goals have no result yet, the new goal ends at once. Its verdict has the
        code `DEADLINE` and a sentence that asks the client to send the goal again later. If
        `_begin` raises an exception, the exception is recorded as a fault, and the goal ends with
        `INTERNAL`.

        Args:
            handle: rclpy's handle of the goal.
        """
        job = _ActionGoal(handle, self._finish)
        handle.execute()
        if len(self._jobs) >= MOST_GOALS:
            job.refuse(
                Verdict.DEADLINE,
                f"{MOST_GOALS} goals of the action have no result yet, the most that are taken; "
                "send this one again when some have ended",
            )
            return
        self._jobs.append(job)
        try:
            self._begin(job)
        except Exception as error:
            job.refuse(Verdict.INTERNAL, self._faults.record_fault("a goal of the action", error))

    def _begin(self, job: _ActionGoal) -> None:
        """Decode a goal and its options, and begin to plan for it.

        A goal that will be executed is passed to the goal lifecycle (state machine of goals). A
        goal with `plan_only` is queued; plans for such goals are made one after the other. A goal
        is refused if its pose or its options cannot be used. The stamp 0 is replaced by the system
        time.

        Args:
            job: The goal. Its `pending_goal` is written if it will be executed.
        """
        request = job.handle.request
        try:
            goal = self._decode_goal(request.pose)
            changes = goal_options.decode(self._node, self._machine, request.options)
        except GoalError as error:
            job.refuse(error.code, str(error))
        except MhsbError as error:
            job.refuse(find_verdict_code(error), str(error))
        else:
            goal = replace(goal, stamp_ns=goal.stamp_ns or time.time_ns())
            adjusted = self._make_adjustment(changes)
            if request.plan_only:
                self._trial_queue.append((job, goal, adjusted))
                self._start_next_trial_plan()
            else:
                job.pending_goal = self._lifecycle.add_goal(
                    goal, adjust_settings=adjusted, on_report=job.take_report
                )

    def _make_adjustment(self, changes: Sequence[Parameter]) -> Adjustment:
        """Create the function that derives a goal's settings from the settings for all goals.

        Args:
            changes: The goal's own parameters; may be empty.

        Returns:
            The function. If the goal has no parameters of its own, it returns its argument.
            Otherwise it ignores its argument, and makes settings from the node's present
            parameters, replaced by the goal's own parameters.
        """
        return lambda settings: self._make_settings(changes) if changes else settings

    def _finish(self, job: _ActionGoal) -> None:
        """Schedule the result of a goal that has ended, and remove the goal from the list.

        rclpy later runs `_write_result` as the goal's execute callback, and sends the returned
        message to the client.

        Args:
            job: The goal, with its result.
        """
        if job in self._jobs:
            self._jobs.remove(job)
        self._server.notify_execute(job.handle, partial(self._write_result, job))

    def _write_result(self, job: _ActionGoal, handle: Any) -> Any:
        """Set the final state of a goal in rclpy, and return its result.

        The state is succeeded if `job.success` is True. Otherwise it is canceled if the client has
        requested this, and aborted if not. If the fields in `job.result` do not fit the message, a
        fault is recorded and `job.success` becomes False. The result then only has the sentence of
        the fault.

        Args:
            job: The goal, which has ended.
            handle: rclpy's handle of the goal.

        Returns:
            Result message of the action.
        """
        try:
            result = self._action.Result(**job.result)
        except Exception as error:
            sentence = self._faults.record_fault("a result of the action", error)
            job.success, result = False, self._action.Result(message=sentence)
        if job.success:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return result

    def _on_cancel(self, handle: Any) -> CancelResponse:
        """Cancel a goal of the action.

        If the goal is being executed or will be, the arm is stopped, unless a newer goal has come.
        If the goal is only planned for, it ends with `STOPPED`, and its plan is dropped.

        Args:
            handle: rclpy's handle of the goal.

        Returns:
            `REJECT` if the goal has ended already, otherwise `ACCEPT`.
        """
        job = next((job for job in self._jobs if job.handle is handle), None)
        if job is None:
            return CancelResponse.REJECT
        if job.pending_goal is None:
            job.refuse(Verdict.STOPPED, "planning was cancelled")
        else:
            self._lifecycle.cancel(job.pending_goal)
        return CancelResponse.ACCEPT

    # --- Plans without execution -----------------------------------------------------------------

    def _start_next_trial_plan(self) -> None:
        """Begin to plan for the next queued goal that will not be executed.

        Only one such trial plan is made at a time, so a goal that will be executed waits for at
        most one trial plan. Queued goals that have ended are skipped. Nothing happens if a trial
        plan is being made, or if no goal is queued.
        """
        while self._trial_request is None and self._trial_queue:
            job, goal, adjusted = self._trial_queue.popleft()
            if job.success is None:
                self._request_trial_plan(job, goal, adjusted)

    def _request_trial_plan(
        self, job: _ActionGoal, goal: Goal, adjust_settings: Adjustment, horizon_factor: float = 1.0
    ) -> None:
        """Request a plan that will not be executed, or refuse the goal if this is impossible.

        Args:
            job: Goal of the action.
            goal: Place to which the tip would go.
            adjust_settings: Function that derives the goal's settings from the settings for all
                goals.
            horizon_factor: Factor on the commit horizon (time until a new plan would take over)
                [-].
        """
        try:
            request = self._lifecycle.planning.build_trial_request(
                goal, adjust_settings, horizon_factor
            )
        except MhsbError as error:
            job.refuse(find_verdict_code(error), str(error))
        else:
            self._trial_request = request, job
            self._outbox.start_planning(request)

    def handle_plan_answer(self, request: PlanRequest, answer: Replan | Exception | None) -> bool:
        """Handle an answer of the planning worker if this server has requested the plan.

        The answer ends the goal, or the goal is planned for again. After that, planning begins for
        the next goal whose request has `plan_only`. An exception in this method is recorded as a
        fault, and the goal is refused with `INTERNAL`.

        Args:
            request: Request that was answered.
            answer: The plan, the error that planning raised, or None if the arm is at the goal
                already.

        Returns:
            True if this server has requested the plan. If False, nothing was done.
        """
        if self._trial_request is None or self._trial_request[0] is not request:
            return False
        job, self._trial_request = self._trial_request[1], None
        try:
            if job.success is None:
                self._handle_trial_answer(job, request, answer)
        except Exception as error:
            job.refuse(Verdict.INTERNAL, self._faults.record_fault("a plan of the action", error))
        self._start_next_trial_plan()
        return True

    def _handle_trial_answer(
        self, job: _ActionGoal, request: PlanRequest, answer: Replan | Exception | None
    ) -> None:
        """End a goal that asks only for a plan, or plan again if the deadline was missed.

        A plan ends the goal with success. Its energies, duration, times and both of its messages
        are written into the result. After a missed deadline the goal is planned for again. The
        commit horizon (time until the plan would take over) is then longer by `LATE_PLAN_FACTOR`.
        The goal is refused with `NOT_FOUND` if the horizon has reached `lead_max` plus the
        machine's dead time, or `MOST_STRETCHED` times the first horizon.

        Args:
            job: The goal.
            request: Request that was answered.
            answer: The plan, the error that planning raised, or None if the arm is at the goal
                already.
        """
        in_hand, settings = request.pending_goal, request.settings
        longest = settings.lead_max + compute_dead_time(settings.machine)
        elapsed = 1e3 * (deadline.now() - in_hand.received_at)
        again = request.commit_horizon < longest and in_hand.horizon_factor < MOST_STRETCHED
        if isinstance(answer, DeadlineError) and again:
            self._request_trial_plan(
                job,
                in_hand.goal,
                in_hand.adjust_settings,
                LATE_PLAN_FACTOR * in_hand.horizon_factor,
            )
        elif isinstance(answer, MhsbError):
            code = (
                Verdict.NOT_FOUND
                if isinstance(answer, DeadlineError)
                else find_verdict_code(answer)
            )
            job.refuse(code, str(answer))
        elif isinstance(answer, Exception):
            job.refuse(Verdict.INTERNAL, f"planning failed with {type(answer).__name__}")
        elif answer is None:
            job.take_report(compose_at_goal_verdict(in_hand.goal, elapsed))
        else:
            halves = self._outbox.encode_command(answer.command)
            job.result |= _collect_plan_fields(
                summarize_plan(answer, elapsed, elapsed + 1e3 * request.commit_horizon)
            )
            job.result |= {
                "verdict": str(Verdict.OK),
                "message": compose_acceptance_sentence(answer, in_hand.goal),
                "joint_trajectory": deserialize_message(halves[0], JointTrajectory),
                "mode_commands": deserialize_message(halves[1], JointTrajectory),
            }
            job.end(True)

    # --- Feedback --------------------------------------------------------------------------------

    def tick(self) -> None:
        """Publish feedback for goals without a result, at most every `FEEDBACK_PERIOD`.

        Feedback has the state (`planning`, `moving` or `stopping`), the elapsed share of the
        motion, the time left [s], the arm's modes, and the energy so far [J]. Share, time and
        energy are updated only for the goal whose plan is in force. If there are many goals, only
        some of them get feedback in one call.
        """
        now = deadline.now()
        if not self._jobs or now - self._feedback_sent_at < FEEDBACK_PERIOD:
            return
        self._feedback_sent_at = now
        life, view = self._lifecycle, self._lifecycle.arm_state
        for job in self._choose_goals_for_feedback():
            execution, state = life.state.execution, "planning"
            if execution is not None and execution.pending_goal is job.pending_goal:
                job.progress.update(execution, life.state.now_ns)
                state = "stopping" if life.is_stopping else "moving"
            job.handle.publish_feedback(
                self._action.Feedback(
                    state=state,
                    progress=job.progress.time_share,
                    time_left_s=job.progress.time_left,
                    modes=[] if view.modes is None else view.modes.tolist(),
                    energy_j=job.progress.energy_j,
                    energy_series_j=job.progress.energy_series_j,
                )
            )

    def _choose_goals_for_feedback(self) -> list[_ActionGoal]:
        """Choose the goals that get feedback in this round.

        If there are at most `FEEDBACK_AT_ONCE` goals, all get feedback. Otherwise the goal that is
        being executed gets feedback in every round, and the next `FEEDBACK_AT_ONCE` of the other
        goals in turn.

        Returns:
            Goals to send feedback for.
        """
        jobs = self._jobs
        if len(jobs) <= FEEDBACK_AT_ONCE:
            return list(jobs)
        execution = self._lifecycle.state.execution
        executed = None if execution is None else execution.pending_goal
        under_way = [
            job for job in jobs if job.pending_goal is not None and job.pending_goal is executed
        ]
        self._turn = (self._turn + FEEDBACK_AT_ONCE) % len(jobs)
        in_turn = (jobs[self._turn :] + jobs[: self._turn])[:FEEDBACK_AT_ONCE]
        return under_way + [job for job in in_turn if job not in under_way]


def _collect_plan_fields(plan: PlanSummary) -> dict[str, Any]:
    """Return the fields of the action's result that describe a plan.

    Args:
        plan: Summary of the plan.

    Returns:
        Values by field name of the result message.
    """
    return {
        "plan_stamp": stamps.to_time(plan.plan_stamp_ns),
        "energy_j": plan.energy_j,
        "energy_series_j": plan.energy_series_j,
        "lower_bound_j": plan.lower_bound_j,
        "duration_s": plan.duration_s,
        "switches": plan.switches,
        "plan_ms": plan.plan_ms,
        "lead_ms": plan.lead_ms,
    }
