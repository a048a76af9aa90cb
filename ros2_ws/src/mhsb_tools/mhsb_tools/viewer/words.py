"""Verdicts and execution reports as text for the user."""

from __future__ import annotations

from mhsb_model.goal import format_position
from mhsb_model.verdict import ExecutionReport, GoalVerdict


def describe_report(report: GoalVerdict | ExecutionReport) -> str:
    """Return a verdict or an execution report as one line of text.

    Args:
        report: The verdict or execution report.

    Returns:
        For a verdict: its code, goal [m] and sentence. If a new plan was made, also the plan's
        energy [J], number of mode switches and planning time [ms]. For an execution report: its
        outcome and sentence.
    """
    if isinstance(report, ExecutionReport):
        return f"{report.outcome.value}: {report.sentence}"
    words = f"{report.code.value} {format_position(report.goal.position, '.3f')}: {report.sentence}"
    plan = report.plan
    if plan is None or plan.plan_stamp_ns == 0:
        return words
    return (
        f"{words}; {plan.energy_j:.0f} J, {plan.switches} mode switches, "
        f"planned in {plan.plan_ms:.0f} ms"
    )
