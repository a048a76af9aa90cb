"""Reports on goals: one verdict for each goal, and one execution report for each accepted goal.

A verdict has a code and a sentence, which follow from the plan or from the error of planning.
"""

from mhsb_model.errors import MhsbError, OutOfWorkspaceError
from mhsb_model.goal import Goal, format_position
from mhsb_model.verdict import (
    ExecutionReport,
    GoalVerdict,
    Outcome,
    PlanSummary,
    Report,
    Verdict,
)
from mhsb_planner.errors import (
    DeadlineError,
    InfeasibleGoalError,
    NoPathError,
    RequestError,
    StartError,
    TableError,
    ZoneError,
)
from mhsb_planner.motion.s3_trajectory import FitError
from mhsb_planner.online.pending_goal import PendingGoal
from mhsb_planner.online.planner_io import PlannerIO
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.start_state import MovingError, NoStateError, OtherMachineError
from mhsb_planner.plan_log import PlanLog, ProposalOutcome

ERROR_VERDICTS: tuple[tuple[type[MhsbError], Verdict], ...] = (
    (OutOfWorkspaceError, Verdict.OUT_OF_WORKSPACE),
    (ZoneError, Verdict.ZONE),
    (InfeasibleGoalError, Verdict.INFEASIBLE),
    (NoPathError, Verdict.INFEASIBLE),
    (FitError, Verdict.INFEASIBLE),
    (StartError, Verdict.INFEASIBLE),
    (DeadlineError, Verdict.DEADLINE),
    (TableError, Verdict.TABLE),
    (NoStateError, Verdict.NO_STATE),
    (MovingError, Verdict.MOVING),
    (OtherMachineError, Verdict.MACHINE),
    (RequestError, Verdict.OPTIONS),
)
"""Types of errors, and the verdict code of each. The first matching type counts."""

MIN_REPORTED_EXCESS = 0.005
"""Least excess of a piston's speed over V_max that a verdict states, as a share of V_max [-]."""

NEWER_GOAL = "a newer goal came before this one was planned"
"""Sentence on a goal that was superseded before it was planned."""

NEWER_GOAL_SENT = "a newer goal came before the arm had taken the plan"
"""Sentence on a goal that was superseded after a plan had been sent."""

OUTCOME_OF_VERDICT = {
    Verdict.AT_GOAL: Outcome.REACHED,
    Verdict.SUPERSEDED: Outcome.REPLACED,
    Verdict.STOPPED: Outcome.STOPPED,
}
"""Outcome of the execution report by verdict code, for an accepted goal that ends early.

For codes that are not listed, the outcome is `ABORTED`."""


def find_verdict_code(error: MhsbError) -> Verdict:
    """Return the verdict code of an error; `INTERNAL` if its type is not in `ERROR_VERDICTS`."""
    return next(
        (code for kind, code in ERROR_VERDICTS if isinstance(error, kind)), Verdict.INTERNAL
    )


def compose_acceptance_sentence(replan: Replan, goal: Goal) -> str:
    """Compose the sentence of the verdict on an accepted goal.

    The sentence states the end of the tip's path and the duration, and whether the search ran out
    of time. It states an excess of piston speed over V_max of at least `MIN_REPORTED_EXCESS`. The
    plan's warnings follow.

    Args:
        replan: The plan.
        goal: The goal. Its place is stated if the plan's path has no steps.

    Returns:
        The sentence, without a full stop.
    """
    plan = replan.plan
    end = plan.path.tip[-1].tolist() if plan.path.steps > 0 else goal.position
    sentence = f"the tip goes to {format_position(end)} in {plan.duration:.1f} s"
    if plan.path.statistics.out_of_time:
        sentence += ", the best found within the commit horizon"
    excess = plan.motion.speed_excess
    if excess >= MIN_REPORTED_EXCESS:
        sentence += f", pistons up to {100 * excess:.2g} % faster than V_max"
    return "; ".join([sentence, *plan.warnings])


def compose_at_goal_verdict(goal: Goal, plan_ms: float) -> GoalVerdict:
    """Compose the verdict on a goal that needs no motion, with a plan of 0 J and 0 s.

    Args:
        goal: The goal.
        plan_ms: Time from receipt of the goal to the verdict [ms].

    Returns:
        Verdict with the code `AT_GOAL`.
    """
    sentence = f"the tip is at {goal.position_text} already"
    nothing = PlanSummary(0, 0.0, 0.0, 0.0, 0, plan_ms, 0.0)
    return GoalVerdict(Verdict.AT_GOAL, sentence, goal, nothing)


class GoalReports:
    """Sender of verdicts, execution reports, and warnings about planners that failed.

    Goals that have ended get no further report.
    """

    def __init__(self, outbox: PlannerIO) -> None:
        """Store the outbox that sends the reports."""
        self._outbox = outbox
        self._last_failure = ""

    def warn_of_failed_planner(self, log: PlanLog) -> None:
        """Warn of an error that ended a planner after its first motion.

        The warning is not repeated if it equals the previous warning.

        Args:
            log: Log of a plan.
        """
        for entry in log.entries:
            sentence = f"planner {entry.proposer} failed after its first motion: {entry.reason}"
            if entry.outcome == ProposalOutcome.FAILED and sentence != self._last_failure:
                self._last_failure = sentence
                self._outbox.warn(sentence)

    def accept(self, pending_goal: PendingGoal, sentence: str, plan: PlanSummary) -> None:
        """Send the verdict that a goal is accepted, and set the goal's `has_verdict`.

        Args:
            pending_goal: The goal.
            sentence: The verdict in words.
            plan: Stamp, energies [J], duration [s] and planning times [ms] of the goal's plan.
        """
        pending_goal.has_verdict = True
        self._report(pending_goal, GoalVerdict(Verdict.OK, sentence, pending_goal.goal, plan))

    def report_at_goal(self, pending_goal: PendingGoal) -> None:
        """End a goal because the tip is at the goal already.

        A goal without a verdict is accepted with `AT_GOAL` and a plan of 0 J and 0 s. A goal that
        was accepted before gets an execution report with the outcome `REACHED`.

        Args:
            pending_goal: The goal; it is marked as ended.
        """
        elapsed = 1e3 * (self._outbox.steady_time() - pending_goal.received_at)
        self.end(pending_goal, compose_at_goal_verdict(pending_goal.goal, elapsed))

    def end(self, pending_goal: PendingGoal, verdict: GoalVerdict) -> None:
        """End a goal: with a verdict, or with an execution report if the goal was accepted before.

        If the goal has ended already, nothing happens. An accepted goal ends with the outcome in
        `OUTCOME_OF_VERDICT`. If the code is not listed there, the outcome is `ABORTED` with the
        code as reason.

        Args:
            pending_goal: The goal; it is marked as ended.
            verdict: The verdict. An execution report repeats its sentence.
        """
        if pending_goal.has_verdict:
            outcome = OUTCOME_OF_VERDICT.get(verdict.code, Outcome.ABORTED)
            reason = verdict.code if outcome is Outcome.ABORTED else None
            self.report_end(pending_goal, outcome, verdict.sentence, reason)
        elif not pending_goal.has_ended:
            pending_goal.has_ended = True
            self._report(pending_goal, verdict)

    def supersede(self, pending_goal: PendingGoal) -> None:
        """End a goal as superseded, because a newer goal came before the arm took a plan for it.

        Args:
            pending_goal: The older goal. If it was accepted, it gets an execution report
                (`REPLACED`).
        """
        sentence = NEWER_GOAL_SENT if pending_goal.has_verdict else NEWER_GOAL
        self.end(pending_goal, GoalVerdict(Verdict.SUPERSEDED, sentence, pending_goal.goal))

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
            outcome: Outcome of the execution.
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
            self._outbox.report(report)
        finally:
            pending_goal.on_report(report)  # the action's client waits for it
