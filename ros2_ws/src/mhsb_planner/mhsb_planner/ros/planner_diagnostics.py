"""What the planner says of itself on /diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_msgs.msg import Header

from mhsb_model.verdict import Level
from mhsb_msgs_py import stamps
from mhsb_msgs_py.duplicates import duplicate_problem
from mhsb_msgs_py.names import PLANNER_NODE
from mhsb_planner.online.arm_view import NO_PLAN, ArmView
from mhsb_planner.online.goal_lifecycle import GoalLifecycle
from mhsb_planner.ros.outbox import RosOutbox

PLANNER_STATUS = f"{PLANNER_NODE}: planner"


def message(
    node: Node, wall: float, lifecycle: GoalLifecycle, outbox: RosOutbox, payload: float
) -> DiagnosticArray:
    """One status: whether the planner knows the arm's state, and what it has done so far.

    wall: by the steady clock [s]; payload: that plans are made for
    [kg]. What is there twice is also written to the log.
    """
    doubles = duplicate_problem(node, outbox.own)
    if doubles:
        node.get_logger().warning(doubles, throttle_duration_sec=10.0)
    view = lifecycle.view
    known = view.knows_state(wall)
    status = DiagnosticStatus(
        level=bytes([Level.OK if known and not doubles else Level.WARN]),
        name=PLANNER_STATUS,
        message=doubles or ("ready" if known else "nobody says where the arm is"),
        hardware_id=PLANNER_NODE,
        values=[
            KeyValue(key="verdicts_given", value=str(outbox.verdicts)),
            KeyValue(key="plan_in_force", value=_plan_in_force(view)),
            KeyValue(key="lead_s", value=f"{lifecycle.lead.lead:.4f}"),
            KeyValue(key="payload_kg", value=f"{payload:.3f}"),
        ],
    )
    header = Header(stamp=node.get_clock().now().to_msg())
    return DiagnosticArray(header=header, status=[status])


def _plan_in_force(view: ArmView) -> str:
    if view.in_force_ns is None:
        return "unknown"
    if view.in_force_ns == NO_PLAN:
        return "none, the arm holds"
    own = view.own is not None and view.own.stamp_ns == view.in_force_ns
    whose = "this planner's" if own else "somebody else's"
    return f"{stamps.to_text(view.in_force_ns)}, {whose}"
