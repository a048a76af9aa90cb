"""Status of the planner node on /diagnostics."""

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from std_msgs.msg import Header

from mhsb_model.machine import Machine
from mhsb_model.verdict import Level
from mhsb_msgs_py import stamps
from mhsb_msgs_py.endpoints import describe_duplicates
from mhsb_msgs_py.faults import Faults
from mhsb_msgs_py.names import PLANNER_NODE
from mhsb_msgs_py.status_values import make_status
from mhsb_planner.online.arm_state import NO_PLAN, ArmState
from mhsb_planner.online.goal_lifecycle import GoalLifecycle
from mhsb_planner.ros.outbox import RosOutbox

PLANNER_STATUS = f"{PLANNER_NODE}: planner"
"""Name of the planner node's status."""


def compose_diagnostics(
    node: Node,
    steady_time: float,
    lifecycle: GoalLifecycle,
    outbox: RosOutbox,
    payload: float,
    machine: Machine,
    faults: Faults,
) -> DiagnosticArray:
    """Compose the status of the planner node for /diagnostics.

    The status has these values: number of verdicts, plan in force, and estimated commit horizon
    [s]. The commit horizon is the time until a new plan takes over. Further values are the payload
    [kg], name and hash of the machine, and the faults of callbacks. Another node is a duplicate if
    it has the name of this node, or publishes on the same topics. Duplicates are also logged, at
    most every 10 s.

    Args:
        node: Planner node.
        steady_time: Present time by the steady clock [s].
        lifecycle: State machine of the node's goals.
        outbox: Outbox of the node.
        payload: Payload with which plans are made [kg].
        machine: Machine that the node was started with.
        faults: Faults of the node's callbacks.

    Returns:
        Message with one status. Its level is WARN in three cases: no state of the arm was received
        recently, there is a duplicate, or a callback has failed recently.
    """
    doubles = describe_duplicates(node, outbox.exclusive_publishers)
    if doubles:
        node.get_logger().warning(doubles, throttle_duration_sec=10.0)
    view = lifecycle.arm_state
    known = view.get_fresh_state(steady_time) is not None
    warnings = "; ".join(filter(None, (doubles, faults.get_recent_fault())))
    status = make_status(
        PLANNER_STATUS,
        Level.OK if known and not warnings else Level.WARN,
        warnings or ("ready" if known else "no state of the arm is received"),
        PLANNER_NODE,
        {
            "verdicts_given": str(outbox.verdict_count),
            "plan_in_force": _describe_plan_in_force(view),
            "lead_s": f"{lifecycle.hand_over.horizon_estimator.horizon:.4f}",
            "payload_kg": f"{payload:.3f}",
            "machine": machine.name,
            "machine_hash": machine.planning_hash,
            "faults": str(faults.count),
            "last_fault": faults.last,
        },
    )
    header = Header(stamp=node.get_clock().now().to_msg())
    return DiagnosticArray(header=header, status=[status])


def _describe_plan_in_force(arm_state: ArmState) -> str:
    """Describe the stamp and the origin of the plan in force as text.

    Args:
        arm_state: Arm state.

    Returns:
        "unknown" if the arm has not reported which plan it executes; "none, the arm holds" if the
        arm reports that it executes no plan. Otherwise the stamp, and whether this planner made the
        plan.
    """
    if arm_state.plan_in_force_ns is None:
        return "unknown"
    if arm_state.plan_in_force_ns == NO_PLAN:
        return "none, the arm holds"
    own = (
        arm_state.own_command is not None
        and arm_state.own_command.stamp_ns == arm_state.plan_in_force_ns
    )
    whose = "this planner's" if own else "somebody else's"
    return f"{stamps.to_text(arm_state.plan_in_force_ns)}, {whose}"
