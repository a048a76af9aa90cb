"""From what planning gives back, a plan or an error, to what the verdict on a goal says."""

from __future__ import annotations

from mhsb_model.errors import MhsbError, OutOfWorkspaceError
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import PlanSummary, Verdict
from mhsb_planner.errors import (
    DeadlineError,
    ExpansionLimitError,
    InfeasibleGoalError,
    NoPathError,
    TableError,
    ZoneError,
)
from mhsb_planner.motion.s3_trajectory import FitError
from mhsb_planner.online.departure import MovingError, NoStateError
from mhsb_planner.online.replanning import Replan

CODES: tuple[tuple[type[MhsbError], Verdict], ...] = (
    (OutOfWorkspaceError, Verdict.OUT_OF_WORKSPACE),
    (ZoneError, Verdict.ZONE),
    (InfeasibleGoalError, Verdict.INFEASIBLE),
    (NoPathError, Verdict.INFEASIBLE),
    (FitError, Verdict.INFEASIBLE),
    (DeadlineError, Verdict.DEADLINE),
    (ExpansionLimitError, Verdict.DEADLINE),
    (TableError, Verdict.TABLE),
    (NoStateError, Verdict.NO_STATE),
    (MovingError, Verdict.MOVING),
)


def code_of(error: MhsbError) -> Verdict:
    """The code under which an error is reported."""
    return next((code for kind, code in CODES if isinstance(error, kind)), Verdict.INTERNAL)


def summary_of(replan: Replan, plan_ms: float) -> PlanSummary:
    """What the verdict says of a plan; `plan_ms` is from goal received to plan published."""
    plan = replan.plan
    return PlanSummary(
        plan_stamp_ns=replan.command.stamp_ns,
        energy_j=plan.energy.paper,
        energy_series_j=plan.energy.series,
        duration_s=plan.motion.trajectory.duration_ns / SECOND_NS,
        switches=plan.motion.schedule.switches,
        plan_ms=plan_ms,
        lower_bound_j=plan.lower_bound,
    )
