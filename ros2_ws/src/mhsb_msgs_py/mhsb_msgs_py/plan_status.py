"""Codec: `GoalVerdict` and `ExecutionReport` as statuses of diagnostic_msgs/DiagnosticArray."""

from __future__ import annotations

from typing import TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Header

from mhsb_model.verdict import ExecutionReport, GoalVerdict, Outcome, PlanSummary, Verdict
from mhsb_msgs_py import stamps
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.names import PLANNER_NODE
from mhsb_msgs_py.status_values import StatusValues, status

GOAL_STATUS = "goal"
EXECUTION_STATUS = "execution"


Report = GoalVerdict | ExecutionReport
Code = TypeVar("Code", Verdict, Outcome)


def encode(report: Report, stamp_ns: int) -> DiagnosticArray:
    """Message with one verdict or execution report, sent at `stamp_ns`."""
    encoded = _goal(report) if isinstance(report, GoalVerdict) else _execution(report)
    return DiagnosticArray(header=Header(stamp=stamps.to_time(stamp_ns)), status=[encoded])


def decode(message: DiagnosticArray) -> list[Report]:
    """All verdicts and execution reports of a message, in their order.

    Raises MessageError for an unknown status or code, and for missing or unreadable values.
    """
    return [_decode_status(each) for each in message.status]


def _goal(verdict: GoalVerdict) -> DiagnosticStatus:
    values = {
        "code": verdict.code.value,
        "goal_stamp": stamps.to_text(verdict.goal_stamp_ns),
        "goal_x": repr(float(verdict.goal_x)),
        "goal_z": repr(float(verdict.goal_z)),
    }
    if verdict.goal_y is not None:
        values["goal_y"] = repr(float(verdict.goal_y))
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
    return status(
        GOAL_STATUS, verdict.code.level, verdict.sentence, PLANNER_NODE, values
    )


def _execution(report: ExecutionReport) -> DiagnosticStatus:
    values = {
        "code": report.outcome.value,
        "goal_stamp": stamps.to_text(report.goal_stamp_ns),
        "plan_stamp": stamps.to_text(report.plan_stamp_ns),
        "attempts": str(int(report.attempts)),
        "lead_ms": repr(float(report.lead_ms)),
    }
    if report.reason is not None:
        values["reason"] = report.reason.value
    return status(
        EXECUTION_STATUS, report.outcome.level, report.sentence, PLANNER_NODE, values
    )


def _decode_status(message: DiagnosticStatus) -> Report:
    values = StatusValues(message)
    if message.name == GOAL_STATUS:
        code = _code(Verdict, values.text("code"))
        return GoalVerdict(
            code,
            message.message,
            values.time("goal_stamp"),
            values.number("goal_x"),
            values.number("goal_z"),
            _plan(values) if code.accepted else None,
            values.number("goal_y") if values.has("goal_y") else None,
        )
    if message.name == EXECUTION_STATUS:
        return ExecutionReport(
            _code(Outcome, values.text("code")),
            message.message,
            values.time("goal_stamp"),
            values.time("plan_stamp"),
            values.count("attempts"),
            values.number("lead_ms"),
            _code(Verdict, values.text("reason")) if values.has("reason") else None,
        )
    raise MessageError(
        f"the status '{message.name}' is unknown; it must be {GOAL_STATUS} or {EXECUTION_STATUS}"
    )


def _plan(values: StatusValues) -> PlanSummary:
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


def _code(codes: type[Code], text: str) -> Code:
    try:
        return codes(text)
    except ValueError:
        known = ", ".join(code.value for code in codes)
        raise MessageError(f"the code '{text}' is unknown; it must be one of {known}") from None
