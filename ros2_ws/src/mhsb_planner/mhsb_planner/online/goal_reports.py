"""Reports on goals: one verdict for each, and one execution report for each accepted goal."""

from __future__ import annotations

from mhsb_model.verdict import (
    ExecutionReport,
    GoalVerdict,
    Outcome,
    PlanSummary,
    Report,
    Verdict,
)
from mhsb_planner.online.pending_goal import PendingGoal
from mhsb_planner.online.planner_io import Clock, PlannerIO

NEWER_GOAL = "a newer goal came before this one was planned"
"""Sentence on a goal that was superseded before it was planned."""

NEWER_GOAL_SENT = "a newer goal came before the arm had taken the plan"
"""Sentence on a goal that was superseded after a plan had been sent."""

OUTCOME_OF_VERDICT = {Verdict.SUPERSEDED: Outcome.REPLACED, Verdict.STOPPED: Outcome.STOPPED}
"""Outcome of the execution report by verdict code, for an accepted goal that ends early.

For codes that are not listed, the outcome is `ABORTED`."""


class GoalReports:
    """Sender of verdicts and execution reports. Goals that have ended get no further report."""

    def __init__(self, clock: Clock, outbox: PlannerIO) -> None:
        """Store the source of the present time, and the outbox that sends the reports."""
        self._clock = clock
        self._out = outbox

    def accept(
        self, pending_goal: PendingGoal, code: Verdict, sentence: str, plan: PlanSummary
    ) -> None:
        """Send the verdict that a goal is accepted, and set the goal's `has_verdict`.

        Args:
            pending_goal: The goal.
            code: `OK` or `AT_GOAL`.
            sentence: The verdict in words.
            plan: Stamp, energies [J], duration [s] and planning times [ms] of the goal's plan.
        """
        pending_goal.has_verdict = True
        self._report(pending_goal, GoalVerdict.of(pending_goal.goal, code, sentence, plan))

    def report_at_goal(self, pending_goal: PendingGoal) -> None:
        """End a goal because the tip is at the goal already.

        A goal without a verdict is accepted with `AT_GOAL` and a plan of 0 J and 0 s. A goal that
        was accepted before gets an execution report with the outcome `REACHED`.

        Args:
            pending_goal: The goal; it is marked as ended.
        """
        elapsed = 1e3 * (self._clock.steady_time() - pending_goal.received_at)
        sentence = f"the tip is at {pending_goal.goal.position_text} already"
        if pending_goal.has_verdict:
            self.report_end(pending_goal, Outcome.REACHED, sentence)
            return
        nothing = PlanSummary(0, 0.0, 0.0, 0.0, 0, elapsed, 0.0)
        self.accept(pending_goal, Verdict.AT_GOAL, sentence, nothing)
        pending_goal.has_ended = True

    def end(self, pending_goal: PendingGoal, code: Verdict, sentence: str) -> None:
        """End a goal: with a verdict, or with an execution report if the goal was accepted before.

        If the goal has ended already, nothing happens. An accepted goal ends with the outcome in
        `OUTCOME_OF_VERDICT`. If the code is not listed there, the outcome is `ABORTED` with the
        code as reason.

        Args:
            pending_goal: The goal; it is marked as ended.
            code: Code of the verdict.
            sentence: Reason why the goal ends.
        """
        if pending_goal.has_verdict:
            outcome = OUTCOME_OF_VERDICT.get(code, Outcome.ABORTED)
            reason = code if outcome is Outcome.ABORTED else None
            self.report_end(pending_goal, outcome, sentence, reason)
        elif not pending_goal.has_ended:
            pending_goal.has_ended = True
            self._report(pending_goal, GoalVerdict.of(pending_goal.goal, code, sentence))

    def supersede(self, pending_goal: PendingGoal) -> None:
        """End a goal as superseded, because a newer goal came before the arm took a plan for it.

        Args:
            pending_goal: The older goal. An accepted one gets an execution report (`REPLACED`).
        """
        sentence = NEWER_GOAL_SENT if pending_goal.has_verdict else NEWER_GOAL
        self.end(pending_goal, Verdict.SUPERSEDED, sentence)

    def report_end(
        self,
        pending_goal: PendingGoal,
        outcome: Outcome,
        sentence: str,
        reason: Verdict | None = None,
    ) -> None:
        """Send the execution report of an accepted goal, and mark the goal as ended.

        Nothing happens if the goal has ended already.

        Args:
            pending_goal: The goal.
            outcome: Code of how the execution has ended.
            sentence: The outcome in words.
            reason: Verdict code of the cause; None if the report states no cause.
        """
        if pending_goal.has_ended:
            return
        pending_goal.has_ended = True
        report = ExecutionReport(
            outcome,
            sentence,
            pending_goal.goal.stamp_ns,
            pending_goal.plan_stamp_ns,
            pending_goal.attempts,
            pending_goal.lead_ms,
            reason,
        )
        self._report(pending_goal, report)

    def _report(self, pending_goal: PendingGoal, report: Report) -> None:
        """Send a report to the outbox, then call the goal's own listener.

        The listener is called even if the outbox raises an error.

        Args:
            pending_goal: The goal whose `on_report` is called.
            report: Verdict or execution report.
        """
        try:
            self._out.report(report)
        finally:
            pending_goal.on_report(report)  # the action's client waits for it
