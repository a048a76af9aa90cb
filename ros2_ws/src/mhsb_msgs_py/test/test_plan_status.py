"""Codec of verdicts and execution reports."""

from __future__ import annotations

import math

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from mhsb_model.goal import Goal
from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import plan_status as codec
from mhsb_msgs_py.errors import MessageError

number = st.floats(allow_nan=False)
stamp = st.integers(0, 10**18)
plans = st.builds(
    codec.PlanSummary,
    stamp,
    number,
    number,
    number,
    st.integers(0, 99),
    number,
    number,
    number,
    st.booleans(),
    number,
    number,
)
sentences = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=40)


def over_the_wire(message: DiagnosticArray) -> DiagnosticArray:
    return deserialize_message(serialize_message(message), DiagnosticArray)


@given(st.sampled_from(Verdict), sentences, stamp, number, number, st.none() | number, plans)
def test_a_verdict_comes_back_from_the_wire_unchanged(code, sentence, goal, x, z, y, plan):
    verdict = codec.GoalVerdict(
        code, sentence, Goal(goal, x, z, y), plan if code.accepted else None
    )
    assert codec.decode(over_the_wire(codec.encode(verdict, 5))) == [verdict]


@given(
    st.builds(
        codec.ExecutionReport,
        st.sampled_from(Outcome),
        sentences,
        stamp,
        stamp,
        st.integers(0, 9),
        number,
        st.none() | st.sampled_from(Verdict),
    )
)
def test_an_execution_report_comes_back_from_the_wire_unchanged(report):
    assert codec.decode(over_the_wire(codec.encode(report, 5))) == [report]


def test_an_accepted_goal_reads_as_the_contract_says():
    costs = 593.5, 470.25, 8.0, 3, 21.5, 300.0, 45.5
    plan = codec.PlanSummary(12_000_000_005, *costs, cavitation_s=0.25)
    verdict = codec.GoalVerdict(Verdict.OK, "planned", Goal(7_000_000_000, 0.55, -0.6), plan)
    message = codec.encode(verdict, 1_500_000_000)
    assert message.header.stamp.nanosec == 500_000_000
    [status] = message.status
    assert (status.name, status.level, status.message) == ("goal", DiagnosticStatus.OK, "planned")
    assert {item.key: item.value for item in status.values} == {
        "code": "OK",
        "goal_stamp": "7.000000000",
        "goal_x": "0.55",
        "goal_z": "-0.6",
        "plan_stamp": "12.000000005",
        "energy_j": "593.5",
        "energy_series_j": "470.25",
        "duration_s": "8.0",
        "switches": "3",
        "plan_ms": "21.5",
        "lower_bound_j": "300.0",
        "lead_ms": "45.5",
        "speed_excess": "0.0",
        "cavitation_s": "0.25",
    }


@pytest.mark.parametrize(
    ("code", "level"),
    [
        (Verdict.SUPERSEDED, DiagnosticStatus.WARN),
        (Verdict.FRAME, DiagnosticStatus.ERROR),
        (Verdict.INTERNAL, DiagnosticStatus.ERROR),
    ],
)
def test_a_goal_that_is_not_accepted_has_its_level_and_no_plan(code, level):
    [status] = codec.encode(codec.GoalVerdict(code, "no", Goal(0, math.nan, 0.0)), 0).status
    assert status.level == level
    assert [item.key for item in status.values] == ["code", "goal_stamp", "goal_x", "goal_z"]


def test_the_ending_of_an_execution_reads_as_the_contract_says():
    report = codec.ExecutionReport(
        Outcome.ABORTED, "the arm took none of its plans", 1, 2, 3, 1500.0, Verdict.DEADLINE
    )
    [status] = codec.encode(report, 0).status
    assert (status.name, status.level) == ("execution", DiagnosticStatus.ERROR)
    assert {item.key: item.value for item in status.values} == {
        "code": "aborted",
        "goal_stamp": "0.000000001",
        "plan_stamp": "0.000000002",
        "attempts": "3",
        "lead_ms": "1500.0",
        "reason": "DEADLINE",
    }


@pytest.mark.parametrize("code", [Verdict.OK, Verdict.AT_GOAL])
def test_an_accepted_goal_without_a_plan_cannot_be_made(code):
    with pytest.raises(ValueError, match="do not go together"):
        codec.GoalVerdict(code, "planned", Goal(0, 0.5, 0.5))


def refused() -> DiagnosticStatus:
    verdict = codec.GoalVerdict(Verdict.ZONE, "in a zone", Goal(0, 0.5, 0.5))
    return codec.encode(verdict, 0).status[0]


def set_value(index: int, value: str):
    return lambda status: setattr(status.values[index], "value", value)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            lambda s: setattr(s, "name", "battery"),
            "the status 'battery' is unknown; it must be goal or execution",
        ),
        (
            set_value(0, "FINE"),
            "the value code of 'goal' is 'FINE'; it must be one of 'OK', 'AT_GOAL', 'SUPERSEDED', "
            "'NO_STATE', 'MOVING', 'NOT_FINITE', 'FRAME', 'OUT_OF_WORKSPACE', 'INFEASIBLE', "
            "'OPTIONS', 'ZONE', 'NOT_FOUND', 'DEADLINE', 'STOPPED', 'MACHINE', 'FAULT', 'TABLE', "
            "'INTERNAL'",
        ),
        (set_value(0, "OK"), "the value plan_stamp of 'goal' is missing"),
        (
            set_value(1, "12"),
            "the time '12' cannot be read; give seconds with nine decimals, as 12.000000005",
        ),
        (set_value(2, "half"), "the value goal_x of 'goal' is 'half'; it must be a number"),
        (lambda s: s.values.pop(), "the value goal_z of 'goal' is missing"),
        (
            lambda s: s.values.append(KeyValue(key="code", value="OK")),
            "the value code of 'goal' is there twice",
        ),
    ],
)
def test_each_fault_is_told_in_one_sentence(change, sentence):
    status = refused()
    change(status)
    with pytest.raises(MessageError) as refusal:
        codec.decode(DiagnosticArray(status=[status]))
    assert str(refusal.value) == sentence
