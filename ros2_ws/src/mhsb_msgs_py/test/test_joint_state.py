"""Codec of joint states."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from mhsb_msgs_py import joint_state as codec
from mhsb_msgs_py.errors import MessageError

NAMES = ("joint_1", "joint_2")
numbers = arrays(np.float64, 2, elements=st.floats(allow_nan=False, allow_infinity=False))


@given(st.integers(0, 10**18), numbers, numbers, st.none() | numbers)
def test_a_sample_comes_back_from_the_wire_to_the_last_bit(stamp, position, velocity, effort):
    sample = codec.JointSample(stamp, position, velocity, effort)
    sent = serialize_message(codec.encode(sample, NAMES))
    back = codec.decode(deserialize_message(sent, JointState), NAMES)
    assert back.stamp_ns == stamp
    np.testing.assert_array_equal(back.position, position)
    np.testing.assert_array_equal(back.velocity, velocity)
    if effort is None:
        assert back.effort is None
    else:
        np.testing.assert_array_equal(back.effort, effort)


def message() -> JointState:
    return JointState(name=["joint_2", "joint_1"], position=[2.0, 1.0], velocity=[0.2, 0.1])


def test_joints_may_come_in_another_order():
    sample = codec.decode(message(), NAMES)
    assert sample.position.tolist() == [1.0, 2.0]
    assert sample.velocity.tolist() == [0.1, 0.2]


@pytest.mark.parametrize(
    ("field", "value", "sentence"),
    [
        (
            "name",
            ["joint_1"],
            "joint states: joint_2 missing; give each of joint_1, joint_2 once, in any order",
        ),
        (
            "name",
            ["joint_1", "joint_2", "gripper"],
            "joint states: gripper unknown; give each of joint_1, joint_2 once, in any order",
        ),
        (
            "name",
            ["joint_1", "joint_2", "joint_2"],
            "joint states: joint_2 given twice; give each of joint_1, joint_2 once, in any order",
        ),
        ("position", [1.0], "position has 1 values; give one for each of 2 names"),
        ("velocity", [], "velocity has 0 values; give one for each of 2 names"),
        ("effort", [1.0], "effort has 1 values; give one for each of 2 names"),
        ("position", [1.0, float("nan")], "position has nan for name 1; give finite numbers"),
        ("velocity", [float("-inf"), 0.0], "velocity has -inf for name 2; give finite numbers"),
    ],
)
def test_each_fault_is_told_in_one_sentence(field, value, sentence):
    wrong = message()
    setattr(wrong, field, value)
    with pytest.raises(MessageError) as refusal:
        codec.decode(wrong, NAMES)
    assert str(refusal.value) == sentence


def test_a_sample_cannot_be_changed():
    sample = codec.decode(message(), NAMES)
    with pytest.raises(ValueError, match="read-only"):
        sample.position[0] = 5.0
