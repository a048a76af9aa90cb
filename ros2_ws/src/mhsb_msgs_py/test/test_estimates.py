"""Codec of what an arm has learnt of itself."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from mhsb_model.arm_reports import Estimate
from mhsb_msgs_py import estimates as codec
from mhsb_msgs_py.errors import MessageError

numbers = st.floats(allow_nan=False, allow_infinity=False)
LEARNT = [
    Estimate("payload", "", 11.5, 0.2, True),
    Estimate("friction", "actuator_1", 1.4, 0.5, False),
]


@given(numbers, st.floats(0.0, 1e9), st.booleans(), st.integers(0, 10**18))
def test_estimates_come_back_from_the_wire_to_the_last_bit(value, deviation, known, stamp):
    sent = [Estimate("leakage", "actuator_2", value, deviation, known), *LEARNT]
    wire = serialize_message(codec.encode(sent, stamp))
    assert codec.decode(deserialize_message(wire, JointState)) == sent


def test_each_number_has_a_name_that_plotting_tools_show():
    message = codec.encode(LEARNT, 0)
    by_name = dict(zip(message.name, message.position, strict=True))
    assert by_name["payload"] == 11.5
    assert by_name["actuator_1/friction/deviation"] == 0.5
    assert by_name["actuator_1/friction/known"] == 0.0


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda m: (m.name.pop(), m.position.pop()), "actuator_1/friction without"),
        (lambda m: m.name.append("payload"), "payload given twice"),
        (lambda m: m.position.pop(), "position has 5 values"),
        (lambda m: m.position.__setitem__(1, -1.0), "payload/deviation -1"),
        (lambda m: m.position.__setitem__(0, float("nan")), "position has nan"),
        (lambda m: m.velocity.append(0.0), "velocity has 1 values; leave it empty"),
    ],
)
def test_each_fault_is_told(change, sentence):
    wrong = codec.encode(LEARNT, 0)
    change(wrong)
    with pytest.raises(MessageError) as refusal:
        codec.decode(wrong)
    assert sentence in str(refusal.value)
