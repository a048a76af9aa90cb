"""Codec of `GoalVerdict` and `ExecutionReport` as statuses of diagnostic_msgs/DiagnosticArray."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Header

from mhsb_model.goal import Goal
from mhsb_model.verdict import (
    ExecutionReport,
    GoalVerdict,
    Outcome,
    PlanSummary,
    Report,
    Verdict,
)
from mhsb_msgs_py import stamps
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.names import PLANNER_NODE
from mhsb_msgs_py.status_values import StatusValues, make_status

GOAL_STATUS = "goal"
"""Name of the status of a verdict."""

EXECUTION_STATUS = "execution"
"""Name of the status of an execution report."""


def encode(report: Report, stamp_ns: int) -> DiagnosticArray:
    """Encode one verdict or execution report.

    Args:
        report: The report.
        stamp_ns: Stamp of the message [ns].
    """
    encoded = (
        _encode_verdict(report)
        if isinstance(report, GoalVerdict)
        else _encode_execution_report(report)
    )
    return DiagnosticArray(header=Header(stamp=stamps.to_time(stamp_ns)), status=[encoded])


def decode(message: DiagnosticArray) -> list[Report]:
    """Decode all verdicts and execution reports of a message, in their order.

    Args:
        message: The message.

    Returns:
        The reports.

    Raises:
        MessageError: A status or code is unknown, or a value is missing or cannot be read.
    """
    return [_decode_status(each) for each in message.status]


def _encode_verdict(verdict: GoalVerdict) -> DiagnosticStatus:
    """Return the status of a verdict.

    Args:
        verdict: The verdict.

    Returns:
        Status with the verdict's sentence as message. Its level is OK if the goal was accepted,
        WARN if it was superseded, otherwise ERROR. Its values are the code, and stamp [s, as text]
        and position [m] of the goal. If there is a plan, its stamp, energies, duration, switches
        and other numbers follow.
    """
    values = {
        "code": verdict.code.value,
        "goal_stamp": stamps.to_text(verdict.goal_stamp_ns),
        "goal_x": repr(float(verdict.goal.x)),
        "goal_z": repr(float(verdict.goal.z)),
    }
    if verdict.goal.y is not None:
        values["goal_y"] = repr(float(verdict.goal.y))
    if verdict.plan is not None:
        plan = verdict.plan
        values |= {
            "plan_stamp": stamps.to_text(plan.plan_stamp_ns),
            "energy_j": repr(float(plan.energy_j)),
            "energy_series_j": repr(float(plan.energy_series_j)),
            "duration_s": repr(float(plan.duration_s)),
            "switches": str(int(plan.switches)),
            "plan_ms": repr(float(plan.plan_ms)),
            "lower_bound_j": repr(float(plan.lower_bound_j)),
            "lead_ms": repr(float(plan.lead_ms)),
            "speed_excess": repr(float(plan.speed_excess)),
            "cavitation_s": repr(float(plan.cavitation_s)),
        }
        if plan.continued:
            values["continued"] = "true"
    return make_status(GOAL_STATUS, verdict.code.level, verdict.sentence, PLANNER_NODE, values)


def _encode_execution_report(report: ExecutionReport) -> DiagnosticStatus:
    """Return the status of an execution report.

    Args:
        report: The execution report.

    Returns:
        Status with the report's sentence as message and the level of its outcome. Its values are
        code, stamps of goal and plan [s, as text], number of sent plans (`attempts`), `lead_ms`,
        and the reason if there is one.
    """
    values = {
        "code": report.outcome.value,
        "goal_stamp": stamps.to_text(report.goal_stamp_ns),
        "plan_stamp": stamps.to_text(report.plan_stamp_ns),
        "attempts": str(int(report.attempts)),
        "lead_ms": repr(float(report.lead_ms)),
    }
    if report.reason is not None:
        values["reason"] = report.reason.value
    return make_status(
        EXECUTION_STATUS, report.outcome.level, report.sentence, PLANNER_NODE, values
    )


def _decode_status(message: DiagnosticStatus) -> Report:
    """Decode one status to a verdict or an execution report; its name says which it is.

    Args:
        message: The status.

    Returns:
        The report. A verdict has a summary of the plan only if it accepts the goal.

    Raises:
        MessageError: The status or code is unknown, or a value is missing or cannot be read.
    """
    values = StatusValues(message)
    if message.name == GOAL_STATUS:
        code = values.choice("code", Verdict)
        goal = Goal(
            values.time("goal_stamp"),
            values.number("goal_x"),
            values.number("goal_z"),
            values.number("goal_y") if values.has("goal_y") else None,
        )
        plan = _decode_plan_summary(values) if code.accepted else None
        return GoalVerdict(code, message.message, goal, plan)
    if message.name == EXECUTION_STATUS:
        return ExecutionReport(
            values.choice("code", Outcome),
            message.message,
            values.time("goal_stamp"),
            values.time("plan_stamp"),
            values.count("attempts"),
            values.number("lead_ms"),
            values.choice("reason", Verdict) if values.has("reason") else None,
        )
    raise MessageError(
        f"the status '{message.name}' is unknown; it must be {GOAL_STATUS} or {EXECUTION_STATUS}"
    )


def _decode_plan_summary(values: StatusValues) -> PlanSummary:
    """Return the summary of a plan from the status of a verdict that accepts its goal.

    Args:
        values: Values of the status.

    Returns:
        Summary with stamp [ns], energies and lower bound [J], duration [s] and other numbers of the
        plan.

    Raises:
        MessageError: A value is missing or cannot be read.
    """
    return PlanSummary(
        values.time("plan_stamp"),
        values.number("energy_j"),
        values.number("energy_series_j"),
        values.number("duration_s"),
        values.count("switches"),
        values.number("plan_ms"),
        values.number("lower_bound_j"),
        values.number("lead_ms"),
        values.has("continued"),
        values.number("speed_excess"),
        values.number("cavitation_s"),
    )
