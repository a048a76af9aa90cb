"""Verdict code and sentence of a goal, from its plan or from the error that planning raised."""

from __future__ import annotations

from mhsb_model.errors import MhsbError, OutOfWorkspaceError
from mhsb_model.goal import Goal, format_position
from mhsb_model.verdict import Verdict
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
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.start_state import MovingError, NoStateError, OtherMachineError

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
"""Types of errors with the verdict code of each. The first type that matches counts."""

MIN_REPORTED_EXCESS = 0.005
"""Least excess of a piston's speed over V_max that a verdict states, as a share of V_max [-]."""


def find_verdict_code(error: MhsbError) -> Verdict:
    """Return the verdict code of an error; `INTERNAL` if its type is not in `ERROR_VERDICTS`."""
    return next(
        (code for kind, code in ERROR_VERDICTS if isinstance(error, kind)), Verdict.INTERNAL
    )


def compose_acceptance_sentence(replan: Replan, goal: Goal) -> str:
    """Compose the sentence of the verdict on an accepted goal.

    It states the end of the tip's path and the duration. If the search ran out of time, it says so.
    An excess of piston speed over V_max is stated if it is at least `MIN_REPORTED_EXCESS`. The
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
        sentence += ", the best found within its lead"
    excess = plan.motion.speed_excess
    if excess >= MIN_REPORTED_EXCESS:
        sentence += f", pistons up to {100 * excess:.2g} % faster than V_max"
    return "; ".join([sentence, *plan.warnings])
