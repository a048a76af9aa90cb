"""The simulator's reports survive the trip through a message."""

import math

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from mhsb_model.arm_reports import HandOverReason, HandOverReport, SimulatorReport
from mhsb_msgs_py import sim_status
from mhsb_msgs_py.errors import MessageError

APPLIED = HandOverReport("applied", "it continues the reference", 5_000_000_007, 1.5e-9, 0.0)
RUNNING = SimulatorReport("running", False, 12_000_000_000, 0.999, 123.25, 4.5)
REFUSED = HandOverReport("refused", "it came late", 7, 1e-3, 2e-3, HandOverReason.LATE)
WARNING = SimulatorReport("joint_1 is 0.1 rad off", False, 1, 1.0, 1.0, 2.0, warning=True)
SLOWED = SimulatorReport(
    "late", False, 12, 1.0, 1.0, 2.0, warning=True, plan_delay=0.125, interventions=3
)
WITHOUT = SimulatorReport("a pump stands still", False, 1, 1.0, 1.0, 2.0, lost_servo_pumps=(1, 4))
STOPPED = SimulatorReport("running", False, 12, 1.0, 1.0, 2.0, last_stop_ns=11)
FAILING = SimulatorReport("running", False, 1, 1.0, 1.0, 2.0, faults=3, last_fault="a fault in it")
FAULTY = SimulatorReport("the simulation diverged", True, 1, 0.0, 1.0, 2.0)


@pytest.mark.parametrize(
    "report", [APPLIED, REFUSED, RUNNING, WARNING, SLOWED, WITHOUT, STOPPED, FAILING, FAULTY]
)
def test_a_report_is_read_as_it_was_written(report):
    assert sim_status.decode(sim_status.encode(report, 7)) == [report]


def test_a_refusal_has_no_jump_and_is_a_warning():
    message = sim_status.encode(HandOverReport("refused", "late", 1, math.nan, math.nan), 7)
    assert message.status[0].level == DiagnosticStatus.WARN
    assert math.isnan(sim_status.decode(message)[0].position_jump)


def test_levels_tell_faults_and_warnings_apart():
    levels = [sim_status.encode(report, 7).status[0].level for report in (RUNNING, WARNING, FAULTY)]
    assert levels == [DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR]


def test_a_hand_over_of_an_earlier_version_has_no_reason():
    message = sim_status.encode(REFUSED, 7)
    message.status[0].values = [v for v in message.status[0].values if v.key != "reason"]
    assert sim_status.decode(message)[0].reason == ""


def test_an_unknown_reason_is_named_with_the_known_ones():
    message = sim_status.encode(REFUSED, 7)
    message.status[0].values[1].value = "mood"
    with pytest.raises(MessageError, match=r"is 'mood'; it must be one of '', 'late', 'jump'"):
        sim_status.decode(message)


def test_statuses_of_others_are_passed_over():
    message = sim_status.encode(RUNNING, 7)
    message.status.append(DiagnosticStatus(name="battery"))
    assert sim_status.decode(message) == [RUNNING]


def test_a_missing_value_is_named():
    message = sim_status.encode(RUNNING, 7)
    message.status[0].values.pop()
    with pytest.raises(MessageError, match=r"the value energy_sp_j of .* is missing"):
        sim_status.decode(message)


@pytest.mark.parametrize(
    ("key", "text", "words"),
    [
        ("plan_delay_s", "nan", "is 'nan'; it must be finite"),
        ("plan_delay_s", "inf", "is 'inf'; it must be finite"),
        ("interventions", "nan", "is 'nan'; it must be a whole number"),
        ("lost_servo_pumps", "1 x", "is '1 x'; it must be whole numbers"),
    ],
)
def test_what_a_planner_cannot_reckon_with_is_refused_by_name(key, text, words):
    message = sim_status.encode(SLOWED, 7)
    next(each for each in message.status[0].values if each.key == key).value = text
    with pytest.raises(MessageError, match=f"the value {key} of .* {words}"):
        sim_status.decode(message)


def test_of_two_simulators_the_one_in_the_namespace_asked_for_counts():
    message = sim_status.encode(RUNNING, 7, "/left")
    assert message.status[0].hardware_id == "/left/mhsb_sim"
    assert sim_status.decode(message, "/left") == [RUNNING]
    assert sim_status.decode(message, "/") == []
    assert sim_status.decode(message) == [RUNNING]
