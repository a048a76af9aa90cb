"""Warnings of planners that an error ended after their first motion."""

from types import SimpleNamespace

import pytest

from mhsb_planner.online.goal_reports import GoalReports
from mhsb_planner.plan_log import PlanLog, ProposalOutcome


def log_with(outcome, reason):
    """The log of a plan whose planner ended so."""
    log = PlanLog()
    log.add("own", ProposalOutcome.TAKEN, motion_cost=1.0)
    log.add("own", outcome, reason=reason)
    return log


@pytest.mark.usefixtures("planner_may_fail")
def test_the_log_of_the_node_has_each_error_of_a_planner_once_in_a_row():
    warnings = []
    reports = GoalReports(SimpleNamespace(warn=warnings.append))
    for outcome, reason in (
        (ProposalOutcome.FAILED, "division by zero"),
        (ProposalOutcome.FAILED, "division by zero"),
        (ProposalOutcome.NO_PATH, "no further path"),
        (ProposalOutcome.FAILED, "overflow"),
        (ProposalOutcome.FAILED, "division by zero"),
    ):
        reports.warn_of_failed_planner(log_with(outcome, reason))
    begin = "planner own failed after its first motion: "
    assert warnings == [f"{begin}division by zero", f"{begin}overflow", f"{begin}division by zero"]
