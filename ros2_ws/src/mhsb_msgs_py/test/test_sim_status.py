"""The simulator's reports survive the trip through a message."""

import math

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from mhsb_msgs_py import sim_status
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.sim_status import HandOverReport, SimulatorReport

APPLIED = HandOverReport("applied", "it continues the reference", 5_000_000_007, 1.5e-9, 0.0)
RUNNING = SimulatorReport("running", False, 12_000_000_000, 0.999, 123.25, 4.5)
FAULTY = SimulatorReport("the simulation diverged", True, 1, 0.0, 1.0, 2.0)


@pytest.mark.parametrize("report", [APPLIED, RUNNING, FAULTY])
def test_a_report_is_read_as_it_was_written(report):
    assert sim_status.decode(sim_status.encode(report, 7)) == [report]


def test_a_refusal_has_no_jump_and_is_a_warning():
    message = sim_status.encode(HandOverReport("refused", "late", 1, math.nan, math.nan), 7)
    assert message.status[0].level == DiagnosticStatus.WARN
    assert math.isnan(sim_status.decode(message)[0].position_jump)


def test_statuses_of_others_are_passed_over():
    message = sim_status.encode(RUNNING, 7)
    message.status.append(DiagnosticStatus(name="battery"))
    assert sim_status.decode(message) == [RUNNING]


def test_a_missing_value_is_named():
    message = sim_status.encode(RUNNING, 7)
    message.status[0].values.pop()
    with pytest.raises(MessageError, match=r"the value energy_sp_j of .* is missing"):
        sim_status.decode(message)
