"""A goal from its arrival to its end, and what has been done for it so far."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.verdict import (
    ExecutionReport,
    GoalVerdict,
    Outcome,
    PlanSummary,
    Report,
    Verdict,
)
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.settings import Settings

Adjustment = Callable[[Settings], Settings]
"""What a goal changes of the settings that hold for all."""


def as_they_are(settings: Settings) -> Settings:
    """Change nothing."""
    return settings


def nobody(report: Report) -> None:
    """Tell nobody."""


@dataclass
class GoalInHand:
    """A goal that has not ended yet.

    received       when it came, by the steady clock [s]
    waiting_since  since when it waits to be planned, or to be planned again [s]
    answered       whether it has got its verdict
    attempts       plans that were sent for it
    plan_stamp_ns  of the last one
    lead_ms        from its arrival to where that one leaves the command before
    stretch        factor of the lead, for plans that came too late before
    too_long       how often even the longest lead was too short
    exact          whether it is to be planned for where it is, also if it moves
    over           whether it has ended
    unwanted       whether it has been cancelled
    adjusted       settings for it alone, from those of all
    told           who is told of it alone
    """

    goal: Goal
    received: float
    waiting_since: float
    answered: bool = False
    attempts: int = 0
    plan_stamp_ns: int = 0
    lead_ms: float = 0.0
    stretch: float = 1.0
    too_long: int = 0
    exact: bool = False
    over: bool = False
    unwanted: bool = False
    adjusted: Adjustment = as_they_are
    told: Callable[[Report], None] = nobody
    _settings: tuple[Settings, Settings] | None = field(default=None, repr=False)

    def settings(self, of_all: Settings) -> Settings:
        """With which it is planned: the same object as long as those of all are.

        Raises what `adjusted` raises the first time; settings of all that do not go with the
        goal's own are not taken over later.
        """
        before, own = self._settings or (None, None)
        if own is None or before is not of_all:
            try:
                own = self.adjusted(of_all)
            except MhsbError:
                if own is None:
                    raise
            self._settings = of_all, own
        return own

    def refused(self, code: Verdict, sentence: str) -> GoalVerdict:
        """Its verdict, where it is not accepted."""
        return GoalVerdict.of(self.goal, code, sentence)

    def accepted(self, code: Verdict, sentence: str, plan: PlanSummary) -> GoalVerdict:
        """Its verdict, where it is."""
        return GoalVerdict.of(self.goal, code, sentence, plan)

    def ended(
        self, outcome: Outcome, sentence: str, reason: Verdict | None = None
    ) -> ExecutionReport:
        """The report that closes it after it has been accepted."""
        return ExecutionReport(
            outcome,
            sentence,
            self.goal.stamp_ns,
            self.plan_stamp_ns,
            self.attempts,
            self.lead_ms,
            reason,
        )


def summary_of(replan: Replan, plan_ms: float, lead_ms: float) -> PlanSummary:
    """What the verdict says of a plan; both times count from the goal's arrival."""
    plan = replan.plan
    return PlanSummary(
        plan_stamp_ns=replan.command.stamp_ns,
        energy_j=plan.energy.paper,
        energy_series_j=plan.energy.series,
        duration_s=plan.duration,
        switches=plan.motion.schedule.switches,
        plan_ms=plan_ms,
        lower_bound_j=plan.lower_bound,
        lead_ms=lead_ms,
        speed_excess=plan.motion.speed_excess,
        cavitation_s=sum(each.duration for each in plan.cavitations),
    )
