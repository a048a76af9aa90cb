"""Codec of the hydraulic state of the actuators."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from mhsb_msgs_py import actuator_states as codec
from mhsb_msgs_py.errors import MessageError

NAMES = ("actuator_1", "actuator_2")
COUNT = len(codec.SAMPLE_FIELDS)
tables = arrays(np.float64, (COUNT, 2), elements=st.floats(allow_nan=False, allow_infinity=False))


@given(st.integers(0, 10**18), tables)
def test_a_sample_comes_back_from_the_wire_to_the_last_bit(stamp, table):
    sent = serialize_message(codec.encode(codec.ActuatorSample(stamp, *table), NAMES))
    back = codec.decode(deserialize_message(sent, JointState), NAMES)
    assert back.stamp_ns == stamp
    for quantity, expected in zip(codec.SAMPLE_FIELDS, table, strict=True):
        np.testing.assert_array_equal(getattr(back, quantity), expected)


def message() -> JointState:
    return codec.encode(codec.ActuatorSample(0, *np.arange(2.0 * COUNT).reshape(COUNT, 2)), NAMES)


def test_each_quantity_stands_under_its_actuators_name():
    by_name = dict(zip(message().name, message().position, strict=True))
    assert by_name["actuator_1/cap_pressure"] == 0.0
    assert by_name["actuator_2/cap_pressure"] == 1.0
    assert by_name["actuator_2/rod_pressure"] == 3.0
    assert len(by_name) == 2 * COUNT


def test_entries_may_come_in_another_order():
    reversed_message = message()
    reversed_message.name = reversed_message.name[::-1]
    reversed_message.position = reversed_message.position[::-1]
    assert codec.decode(reversed_message, NAMES).rod_pressure.tolist() == [2.0, 3.0]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda m: m.name.append("actuator_3/cap_pressure"), "actuator_3/cap_pressure unknown"),
        (lambda m: m.name.pop(), "actuator_2/servo_pump_speed missing"),
        (lambda m: m.name.append(m.name[0]), "actuator_1/cap_pressure given twice"),
        (lambda m: m.position.pop(), f"position has {2 * COUNT - 1} values"),
        (lambda m: m.position.__setitem__(0, float("nan")), "position has nan for name 1"),
        (lambda m: m.velocity.append(0.0), "velocity has 1 values; leave it empty"),
        (lambda m: m.effort.append(0.0), "effort has 1 values; leave it empty"),
    ],
)
def test_each_fault_is_told(change, sentence):
    wrong = message()
    change(wrong)
    with pytest.raises(MessageError) as refusal:
        codec.decode(wrong, NAMES)
    assert sentence in str(refusal.value)
