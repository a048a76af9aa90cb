"""What is told of goals: one verdict each, and of accepted ones how they ended, once."""

from __future__ import annotations

from mhsb_model.verdict import Outcome, PlanSummary, Report, Verdict
from mhsb_planner.online.goal_in_hand import GoalInHand
from mhsb_planner.online.ports import Clock, Outbox

NEWER_GOAL = "a newer goal came before this one was planned"
NEWER_GOAL_SENT = "a newer goal came before the arm had taken the plan"


class GoalReports:
    """Tells the outbox; nothing is told of a goal that is over."""

    def __init__(self, clock: Clock, outbox: Outbox) -> None:
        self._clock = clock
        self._out = outbox

    def accept(
        self, in_hand: GoalInHand, code: Verdict, sentence: str, plan: PlanSummary
    ) -> None:
        """Give a goal the verdict that it is accepted."""
        in_hand.answered = True
        self._report(in_hand, in_hand.accepted(code, sentence, plan))

    def at_goal(self, in_hand: GoalInHand) -> None:
        """The arm is there, and nothing has to be done."""
        elapsed = 1e3 * (self._clock.wall() - in_hand.received)
        sentence = f"the tip is at {in_hand.goal.place} already"
        if in_hand.answered:
            self.end(in_hand, Outcome.REACHED, sentence)
            return
        nothing = PlanSummary(0, 0.0, 0.0, 0.0, 0, elapsed, 0.0)
        self.accept(in_hand, Verdict.AT_GOAL, sentence, nothing)
        in_hand.over = True

    def refuse(self, in_hand: GoalInHand, code: Verdict, sentence: str) -> None:
        """By its verdict, or where it has been accepted, by aborting its execution."""
        if in_hand.answered:
            self.end(in_hand, Outcome.ABORTED, sentence, code)
        elif not in_hand.over:
            in_hand.over = True
            self._report(in_hand, in_hand.refused(code, sentence))

    def pass_over(self, in_hand: GoalInHand) -> None:
        """A newer goal has come before the arm took a plan for this one."""
        if in_hand.answered:
            self.end(in_hand, Outcome.REPLACED, NEWER_GOAL_SENT)
        else:
            self.refuse(in_hand, Verdict.SUPERSEDED, NEWER_GOAL)

    def stop(self, in_hand: GoalInHand, sentence: str) -> None:
        """Somebody has stopped the arm."""
        if in_hand.answered:
            self.end(in_hand, Outcome.STOPPED, sentence)
        else:
            self.refuse(in_hand, Verdict.STOPPED, sentence)

    def end(
        self,
        in_hand: GoalInHand,
        outcome: Outcome,
        sentence: str,
        reason: Verdict | None = None,
    ) -> None:
        """Report how the execution of an accepted goal ended."""
        if not in_hand.over:
            in_hand.over = True
            self._report(in_hand, in_hand.ended(outcome, sentence, reason))

    def _report(self, in_hand: GoalInHand, report: Report) -> None:
        self._out.report(report)
        in_hand.told(report)
