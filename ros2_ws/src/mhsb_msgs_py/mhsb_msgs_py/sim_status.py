"""Codec: what the simulator reports of plans and of itself, as statuses on /diagnostics.

A `HandOverReport` is sent once for every plan that the simulator applied, refused or dropped; a
`SimulatorReport` once a second.
"""

from __future__ import annotations

from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Header

from mhsb_model.verdict import Level
from mhsb_msgs_py import stamps
from mhsb_msgs_py.names import SIM_NODE
from mhsb_msgs_py.status_values import StatusValues, status

HAND_OVER_STATUS = f"{SIM_NODE}: hand_over"
SIMULATOR_STATUS = f"{SIM_NODE}: simulator"
APPLIED = "applied"


@dataclass(frozen=True)
class HandOverReport:
    """What became of a plan.

    outcome        `applied`, `refused` or `dropped`
    sentence       the same for a person, with the reason
    plan_stamp_ns  ns
    position_jump  of the reference at the instant of the swap, new minus old, rad; NaN if unknown
    velocity_jump  likewise, rad/s
    """

    outcome: str
    sentence: str
    plan_stamp_ns: int
    position_jump: float
    velocity_jump: float


@dataclass(frozen=True)
class SimulatorReport:
    """Where the simulator stands.

    sentence          one sentence, the fault if there is one
    faulty            whether it has stopped because of a fault
    sim_time_ns       simulated time, ns
    real_time_factor  simulated over real time since the report before
    main_pump_j       energy delivered by the main pump since the start, J
    servo_pumps_j     likewise by the servo pumps, J
    """

    sentence: str
    faulty: bool
    sim_time_ns: int
    real_time_factor: float
    main_pump_j: float
    servo_pumps_j: float


def encode(report: HandOverReport | SimulatorReport, stamp_ns: int) -> DiagnosticArray:
    """Message with one report, sent at `stamp_ns`."""
    encoded = _hand_over(report) if isinstance(report, HandOverReport) else _simulator(report)
    return DiagnosticArray(header=Header(stamp=stamps.to_time(stamp_ns)), status=[encoded])


def decode(message: DiagnosticArray) -> list[HandOverReport | SimulatorReport]:
    """The simulator's reports in a message of /diagnostics; those of others are passed over.

    Raises MessageError for missing or unreadable values.
    """
    reports: list[HandOverReport | SimulatorReport] = []
    for each in message.status:
        if each.name == HAND_OVER_STATUS:
            reports.append(_read_hand_over(each))
        elif each.name == SIMULATOR_STATUS:
            reports.append(_read_simulator(each))
    return reports


def _hand_over(report: HandOverReport) -> DiagnosticStatus:
    values = {
        "outcome": report.outcome,
        "plan_stamp": stamps.to_text(report.plan_stamp_ns),
        "position_jump_rad": repr(float(report.position_jump)),
        "velocity_jump_rad_s": repr(float(report.velocity_jump)),
    }
    level = Level.OK if report.outcome == APPLIED else Level.WARN
    return status(HAND_OVER_STATUS, level, report.sentence, SIM_NODE, values)


def _simulator(report: SimulatorReport) -> DiagnosticStatus:
    values = {
        "sim_time": stamps.to_text(report.sim_time_ns),
        "real_time_factor": repr(float(report.real_time_factor)),
        "energy_mp_j": repr(float(report.main_pump_j)),
        "energy_sp_j": repr(float(report.servo_pumps_j)),
    }
    level = Level.ERROR if report.faulty else Level.OK
    return status(SIMULATOR_STATUS, level, report.sentence, SIM_NODE, values)


def _read_hand_over(message: DiagnosticStatus) -> HandOverReport:
    values = StatusValues(message)
    return HandOverReport(
        values.text("outcome"),
        message.message,
        values.time("plan_stamp"),
        values.number("position_jump_rad"),
        values.number("velocity_jump_rad_s"),
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
    )
