"""Codec of the simulator's reports on plans and on itself, as statuses on /diagnostics.

A `HandOverReport` is sent once for every plan that the simulator applied, refused or dropped. A
`SimulatorReport` is sent once a second, and ten times a second while the delay of plans changes. It
is also sent at once if a fault occurs, if a warning begins or ends, and if the arm is asked to
stop.
"""

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
from mhsb_msgs_py.names import SIM_NODE
from mhsb_msgs_py.status_values import StatusValues, make_status

HAND_OVER_STATUS = f"{SIM_NODE}: hand_over"
"""Name of the status on a plan."""

SIMULATOR_STATUS = f"{SIM_NODE}: simulator"
"""Name of the status on the simulator itself."""


def encode(
    report: HandOverReport | SimulatorReport, stamp_ns: int, namespace: str = "/"
) -> DiagnosticArray:
    """Encode one report of the simulator.

    Args:
        report: The report, on a plan or on the simulator itself.
        stamp_ns: Stamp of the message [ns].
        namespace: Namespace of the simulator that sends it.

    Returns:
        Message with one status. The status has the full name of the simulator's node as
        `hardware_id`.
    """
    encoded = (
        _encode_hand_over(report)
        if isinstance(report, HandOverReport)
        else _encode_simulator(report)
    )
    encoded.hardware_id = _get_node_name(namespace)
    return DiagnosticArray(header=Header(stamp=stamps.to_time(stamp_ns)), status=[encoded])


def decode(
    message: DiagnosticArray, namespace: str | None = None
) -> list[HandOverReport | SimulatorReport]:
    """Decode the simulator's reports in a message of /diagnostics; skip all other statuses.

    Args:
        message: The message. All nodes publish on this topic.
        namespace: Namespace of the simulator whose reports are decoded; None for any.

    Returns:
        The reports in their order.

    Raises:
        MessageError: A value is missing or cannot be read.
    """
    reports: list[HandOverReport | SimulatorReport] = []
    for each in message.status:
        if namespace is not None and each.hardware_id != _get_node_name(namespace):
            continue
        if each.name == HAND_OVER_STATUS:
            reports.append(_decode_hand_over(each))
        elif each.name == SIMULATOR_STATUS:
            reports.append(_decode_simulator(each))
    return reports


def _get_node_name(namespace: str) -> str:
    """Return the full name of the simulator's node in a namespace."""
    return f"{namespace.rstrip('/')}/{SIM_NODE}"


def _encode_hand_over(report: HandOverReport) -> DiagnosticStatus:
    """Return the status that encodes a hand-over report of a plan.

    Args:
        report: The report.

    Returns:
        Status with the report's sentence as message. Its level is OK if the plan was applied, else
        WARN. Its values are outcome, reason, stamp [s, as text] and jumps [rad and rad/s].
    """
    values = {
        "outcome": str(report.outcome),
        "reason": str(report.reason),
        "plan_stamp": stamps.to_text(report.plan_stamp_ns),
        "position_jump_rad": repr(float(report.position_jump)),
        "velocity_jump_rad_s": repr(float(report.velocity_jump)),
    }
    level = Level.OK if report.outcome == HandOverOutcome.APPLIED else Level.WARN
    return make_status(HAND_OVER_STATUS, level, report.sentence, SIM_NODE, values)


def _encode_simulator(report: SimulatorReport) -> DiagnosticStatus:
    """Return the status that encodes the simulator's report on itself.

    Args:
        report: The report.

    Returns:
        Status with the report's sentence as message. Its level is ERROR for a fault, WARN for a
        warning, else OK. Its values are all other fields of the report as text.
    """
    values = {
        "sim_time": stamps.to_text(report.sim_time_ns),
        "last_stop": stamps.to_text(report.last_stop_ns),
        "plan_delay_s": repr(float(report.plan_delay)),
        "interventions": str(report.interventions),
        "lost_servo_pumps": " ".join(map(str, report.lost_servo_pumps)),
        "machine": report.machine,
        "machine_hash": report.machine_hash,
        "faults": str(report.faults),
        "last_fault": report.last_fault,
        "real_time_factor": repr(float(report.real_time_factor)),
        "energy_mp_j": repr(float(report.main_pump_j)),
        "energy_sp_j": repr(float(report.servo_pumps_j)),
    }
    level = Level.ERROR if report.faulty else Level.WARN if report.warning else Level.OK
    return make_status(SIMULATOR_STATUS, level, report.sentence, SIM_NODE, values)


def _decode_hand_over(message: DiagnosticStatus) -> HandOverReport:
    """Return the report on a plan that a status contains.

    Args:
        message: The status.

    Returns:
        The report. Its reason is NONE if the status has none, as in recordings of earlier versions.

    Raises:
        MessageError: A value other than the reason is missing, or a value cannot be read.
    """
    values = StatusValues(message)
    return HandOverReport(
        values.choice("outcome", HandOverOutcome),
        message.message,
        values.time("plan_stamp"),
        values.number("position_jump_rad"),
        values.number("velocity_jump_rad_s"),
        # Recordings of earlier versions have none.
        values.choice("reason", HandOverReason) if values.has("reason") else HandOverReason.NONE,
    )


def _decode_simulator(message: DiagnosticStatus) -> SimulatorReport:
    """Return the report of the simulator on itself that a status contains.

    Args:
        message: The status. Recordings of earlier versions lack some values, which then get their
            defaults.

    Returns:
        The report.

    Raises:
        MessageError: A value that has no default is missing, or a value cannot be read.
    """
    values = StatusValues(message)
    return SimulatorReport(
        message.message,
        message.level == bytes([Level.ERROR]),
        values.time("sim_time"),
        values.number("real_time_factor"),
        values.number("energy_mp_j"),
        values.number("energy_sp_j"),
        message.level == bytes([Level.WARN]),
        values.time("last_stop") if values.has("last_stop") else 0,
        values.finite("plan_delay_s") if values.has("plan_delay_s") else 0.0,
        values.count("interventions") if values.has("interventions") else 0,
        values.counts("lost_servo_pumps") if values.has("lost_servo_pumps") else (),
        values.text("machine") if values.has("machine") else "",
        values.text("machine_hash") if values.has("machine_hash") else "",
        values.count("faults") if values.has("faults") else 0,
        values.text("last_fault") if values.has("last_fault") else "",
    )
