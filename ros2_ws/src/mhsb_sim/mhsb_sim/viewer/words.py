"""Verdicts, and how executions end, in words for a person."""

from __future__ import annotations

from mhsb_model.goal import place
from mhsb_model.verdict import ExecutionReport, GoalVerdict


def words_of(report: GoalVerdict | ExecutionReport) -> str:
    """A verdict with what the plan costs, or how an execution ended."""
    if isinstance(report, ExecutionReport):
        return f"{report.outcome.value}: {report.sentence}"
    words = f"{report.code.value} {place(report.goal.position, '.3f')}: {report.sentence}"
    plan = report.plan
    if plan is None or plan.plan_stamp_ns == 0:
        return words
    return (
        f"{words}; {plan.energy_j:.0f} J, {plan.switches} mode switches, "
        f"planned in {plan.plan_ms:.0f} ms"
    )
