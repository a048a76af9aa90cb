"""From what planning gives back, a plan or an error, to what is told of a goal."""

from __future__ import annotations

from mhsb_model.errors import MhsbError, OutOfWorkspaceError
from mhsb_model.goal import Goal, place
from mhsb_model.verdict import Verdict
from mhsb_planner.errors import (
    DeadlineError,
    ExpansionLimitError,
    InfeasibleGoalError,
    NoPathError,
    RequestError,
    StartError,
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
    (StartError, Verdict.INFEASIBLE),
    (DeadlineError, Verdict.DEADLINE),
    (ExpansionLimitError, Verdict.DEADLINE),
    (TableError, Verdict.TABLE),
    (NoStateError, Verdict.NO_STATE),
    (MovingError, Verdict.MOVING),
    (RequestError, Verdict.OPTIONS),
)

TOLD_EXCESS = 0.005
"""A greater excess over V_max is part of the sentence."""


def code_of(error: MhsbError) -> Verdict:
    """The code under which an error is reported."""
    return next((code for kind, code in CODES if isinstance(error, kind)), Verdict.INTERNAL)


def announcement(replan: Replan, goal: Goal) -> str:
    """What is told of an accepted goal."""
    plan = replan.plan
    end = plan.path.tip[-1].tolist() if plan.path.steps > 0 else goal.position
    sentence = f"the tip goes to {place(end)} in {plan.duration:.1f} s"
    if plan.path.statistics.out_of_time:
        sentence += ", the best found within its lead"
    excess = plan.motion.speed_excess
    if excess >= TOLD_EXCESS:
        sentence += f", pistons up to {100 * excess:.2g} % faster than V_max"
    return "; ".join([sentence, *plan.warnings])
