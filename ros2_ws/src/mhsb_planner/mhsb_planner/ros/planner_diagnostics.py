"""What the planner says of itself on /diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from mhsb_model.verdict import Level
from mhsb_msgs_py import stamps
from mhsb_msgs_py.names import PLANNER_NODE
from mhsb_planner.online.arm_view import NO_PLAN, ArmView
from mhsb_planner.online.goal_lifecycle import GoalLifecycle


def message(
    now_ns: int, wall: float, lifecycle: GoalLifecycle, verdicts: int
) -> DiagnosticArray:
    """One status: whether the planner knows the arm's state, and what it has done so far."""
    view = lifecycle.view
    known = view.knows_state(wall)
    status = DiagnosticStatus(
        level=bytes([Level.OK if known else Level.WARN]),
        name=f"{PLANNER_NODE}: planner",
        message="ready" if known else "nobody says where the arm is",
        hardware_id=PLANNER_NODE,
        values=[
            KeyValue(key="verdicts_given", value=str(verdicts)),
            KeyValue(key="plan_in_force", value=_plan_in_force(view)),
            KeyValue(key="lead_s", value=f"{lifecycle.lead.lead:.4f}"),
        ],
    )
    return DiagnosticArray(header=Header(stamp=stamps.to_time(now_ns)), status=[status])


def _plan_in_force(view: ArmView) -> str:
    if view.in_force_ns is None:
        return "unknown"
    if view.in_force_ns == NO_PLAN:
        return "none, the arm holds"
    own = view.own is not None and view.own.stamp_ns == view.in_force_ns
    whose = "this planner's" if own else "somebody else's"
    return f"{stamps.to_text(view.in_force_ns)}, {whose}"
