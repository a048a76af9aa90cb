"""Codec: what the simulator reports of plans and of itself, as statuses on /diagnostics.

A `HandOverReport` is sent once for every plan that the simulator applied, refused or dropped; a
`SimulatorReport` once a second, at once where it turns faulty, warns, ceases to, or is asked to
stop, and ten times a second while the delay of plans changes.
"""

from __future__ import annotations

from enum import StrEnum
from typing import TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Header

from mhsb_model.arm_reports import (
    HandOverOutcome,
    HandOverReason,
    HandOverReport,
    SimulatorReport,
)
from mhsb_model.verdict import Level
from mhsb_msgs_py import stamps
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.names import SIM_NODE
from mhsb_msgs_py.status_values import StatusValues, status

__all__ = ["APPLIED", "HandOverReport", "SimulatorReport", "decode", "encode"]

HAND_OVER_STATUS = f"{SIM_NODE}: hand_over"
SIMULATOR_STATUS = f"{SIM_NODE}: simulator"
APPLIED = HandOverOutcome.APPLIED

Choice = TypeVar("Choice", bound=StrEnum)


def encode(
    report: HandOverReport | SimulatorReport, stamp_ns: int, namespace: str = "/"
) -> DiagnosticArray:
    """Message with one report, sent at `stamp_ns` by the simulator in a namespace."""
    encoded = _hand_over(report) if isinstance(report, HandOverReport) else _simulator(report)
    encoded.hardware_id = _source(namespace)
    return DiagnosticArray(header=Header(stamp=stamps.to_time(stamp_ns)), status=[encoded])


def decode(
    message: DiagnosticArray, namespace: str | None = None
) -> list[HandOverReport | SimulatorReport]:
    """The simulator's reports in a message of /diagnostics; those of others are passed over.

    namespace  of the simulator that counts, since all of them speak on that topic; None for any

    Raises MessageError for missing or unreadable values.
    """
    reports: list[HandOverReport | SimulatorReport] = []
    for each in message.status:
        if namespace is not None and each.hardware_id != _source(namespace):
            continue
        if each.name == HAND_OVER_STATUS:
            reports.append(_read_hand_over(each))
        elif each.name == SIMULATOR_STATUS:
            reports.append(_read_simulator(each))
    return reports


def _source(namespace: str) -> str:
    return f"{namespace.rstrip('/')}/{SIM_NODE}"


def _hand_over(report: HandOverReport) -> DiagnosticStatus:
    values = {
        "outcome": str(report.outcome),
        "reason": str(report.reason),
        "plan_stamp": stamps.to_text(report.plan_stamp_ns),
        "position_jump_rad": repr(float(report.position_jump)),
        "velocity_jump_rad_s": repr(float(report.velocity_jump)),
    }
    level = Level.OK if report.outcome == APPLIED else Level.WARN
    return status(HAND_OVER_STATUS, level, report.sentence, SIM_NODE, values)


def _simulator(report: SimulatorReport) -> DiagnosticStatus:
    values = {
        "sim_time": stamps.to_text(report.sim_time_ns),
        "last_stop": stamps.to_text(report.last_stop_ns),
        "plan_delay_s": repr(float(report.plan_delay)),
        "interventions": str(report.interventions),
        "lost_servo_pumps": " ".join(map(str, report.lost_servo_pumps)),
        "real_time_factor": repr(float(report.real_time_factor)),
        "energy_mp_j": repr(float(report.main_pump_j)),
        "energy_sp_j": repr(float(report.servo_pumps_j)),
    }
    level = Level.ERROR if report.faulty else Level.WARN if report.warning else Level.OK
    return status(SIMULATOR_STATUS, level, report.sentence, SIM_NODE, values)


def _read_hand_over(message: DiagnosticStatus) -> HandOverReport:
    values = StatusValues(message)
    return HandOverReport(
        _choice(values, "outcome", HandOverOutcome),
        message.message,
        values.time("plan_stamp"),
        values.number("position_jump_rad"),
        values.number("velocity_jump_rad_s"),
        # Recordings of earlier versions tell none.
        _choice(values, "reason", HandOverReason) if values.has("reason") else HandOverReason.NONE,
    )


def _read_simulator(message: DiagnosticStatus) -> SimulatorReport:
    values = StatusValues(message)
    return SimulatorReport(
        message.message,
        message.level == bytes([Level.ERROR]),
        values.time("sim_time"),
        values.number("real_time_factor"),
        values.number("energy_mp_j"),
        values.number("energy_sp_j"),
        message.level == bytes([Level.WARN]),
        values.time("last_stop") if values.has("last_stop") else 0,  # as above
        values.finite("plan_delay_s") if values.has("plan_delay_s") else 0.0,  # as above
        values.count("interventions") if values.has("interventions") else 0,  # as above
        values.counts("lost_servo_pumps") if values.has("lost_servo_pumps") else (),  # as above
    )


def _choice(values: StatusValues, key: str, choices: type[Choice]) -> Choice:
    text = values.text(key)
    try:
        return choices(text)
    except ValueError:
        raise MessageError(
            f"the value {key} of '{HAND_OVER_STATUS}' is '{text}'; it must be one of "
            + ", ".join(repr(str(choice)) for choice in choices)
        ) from None
