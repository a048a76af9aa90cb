"""Record of a goal from its receipt to its end: reports sent, plans tried, own settings."""

from collections.abc import Callable
from dataclasses import dataclass, field

from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.verdict import PlanSummary, Report
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.settings import Settings

Adjustment = Callable[[Settings], Settings]
"""Function that derives the settings for one goal from the settings for all goals."""


def keep_settings(settings: Settings) -> Settings:
    """Return the settings unchanged."""
    return settings


def ignore_report(report: Report) -> None:
    """Do nothing with a report; the default listener of a goal."""


@dataclass(eq=False)
class PendingGoal:
    """Record of a goal from its receipt until it has ended.

    Attributes:
        goal: Place to which the tip must go.
        received_at: Time of receipt by the steady clock [s].
        sent_at: Time at which the goal was sent, by the steady clock [s]; not after `received_at`.
        waiting_since: Time at which the goal began to wait for planning, or for planning again, by
            the steady clock [s].
        has_verdict: True if the goal was accepted by a verdict.
        attempts: Number of plans that were sent for the goal.
        plan_stamp_ns: Stamp of the last plan that was sent for the goal [ns]; 0 if there is none.
        lead_ms: Time from receipt of the goal until its last plan deviates from the previous plan
            [ms].
        horizon_factor: Factor on the commit horizon (time until a new plan takes over) [-]. It
            grows with each plan that comes too late.
        late_plans_at_longest_horizon: Number of plans that came too late even at the longest commit
            horizon.
        needs_exact_place: True if the plan must lead to the goal's own place even if the goal
            moves.
        has_ended: True if the last report on the goal was sent.
        is_cancelled: True if the goal has been cancelled.
        adjust_settings: Function that derives the goal's settings from the settings for all goals.
        on_report: Called with each report on this goal.
    """

    goal: Goal
    received_at: float
    sent_at: float
    waiting_since: float
    has_verdict: bool = False
    attempts: int = 0
    plan_stamp_ns: int = 0
    lead_ms: float = 0.0
    horizon_factor: float = 1.0
    late_plans_at_longest_horizon: int = 0
    needs_exact_place: bool = False
    has_ended: bool = False
    is_cancelled: bool = False
    adjust_settings: Adjustment = keep_settings
    on_report: Callable[[Report], None] = ignore_report
    _settings: tuple[Settings, Settings] | None = field(default=None, repr=False)

    def get_settings(self, common_settings: Settings) -> Settings:
        """Return the settings of plans for this goal.

        `adjust_settings` derives them from the settings for all goals. The result is cached: it
        stays the same object as long as `common_settings` is the same object. If new settings for
        all goals do not fit the goal's own options, the goal keeps its previous settings.

        Args:
            common_settings: Settings for all goals.

        Returns:
            Settings for this goal.

        Raises:
            MhsbError: At the first call, the goal's options do not fit `common_settings`.
        """
        before, own = self._settings or (None, None)
        if own is None or before is not common_settings:
            try:
                own = self.adjust_settings(common_settings)
            except MhsbError:
                if own is None:
                    raise
            self._settings = common_settings, own
        return own


def summarize_plan(replan: Replan, plan_ms: float, lead_ms: float) -> PlanSummary:
    """Summarize a plan for the verdict of its goal.

    Args:
        replan: The plan.
        plan_ms: Time from receipt of the goal to the plan's publication [ms].
        lead_ms: Time from receipt of the goal until the plan deviates from the previous plan [ms].

    Returns:
        Summary with stamp [ns], energy in both energy readings [J], lower bound on the energy [J],
        duration [s], number of mode switches, excess of piston speed over V_max as a share of
        V_max, total time with cavitation [s], and the two given times.
    """
    plan = replan.plan
    return PlanSummary(
        plan_stamp_ns=replan.command.stamp_ns,
        energy_j=plan.energy.paper,
        energy_series_j=plan.energy.series,
        duration_s=plan.duration,
        switches=plan.motion.schedule.switch_count,
        plan_ms=plan_ms,
        lower_bound_j=plan.lower_bound,
        lead_ms=lead_ms,
        speed_excess=plan.motion.speed_excess,
        cavitation_s=sum(each.duration for each in plan.cavitations),
    )
