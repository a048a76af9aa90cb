"""Codec of the reference that the servo follows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rclpy.serialization import deserialize_message, serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mhsb_model.trajectory import MotionState
from mhsb_msgs_py import reference as codec
from mhsb_msgs_py.errors import MessageError

NAMES = ("joint_1", "joint_2")
numbers = arrays(np.float64, 2, elements=st.floats(allow_nan=False, allow_infinity=False))


@given(st.integers(0, 10**18), numbers, numbers, numbers)
def test_a_reference_comes_back_from_the_wire_to_the_last_bit(stamp, q, qd, qdd):
    sent = serialize_message(codec.encode(codec.Reference(stamp, MotionState(q, qd, qdd)), NAMES))
    back = codec.decode(deserialize_message(sent, JointTrajectory), NAMES)
    assert back.stamp_ns == stamp
    np.testing.assert_array_equal(back.state.position, q)
    np.testing.assert_array_equal(back.state.velocity, qd)
    np.testing.assert_array_equal(back.state.acceleration, qdd)


def message() -> JointTrajectory:
    point = JointTrajectoryPoint(
        positions=[2.0, 1.0], velocities=[0.2, 0.1], accelerations=[0.0, 0.0]
    )
    return JointTrajectory(joint_names=["joint_2", "joint_1"], points=[point])


def test_joints_may_come_in_another_order():
    assert codec.decode(message(), NAMES).state.position.tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            lambda m: setattr(m, "joint_names", ["joint_2", "elbow"]),
            "joint_names: elbow unknown; give each of joint_1, joint_2 once, in any order",
        ),
        (lambda m: m.points.clear(), "the reference has 0 points; give exactly one"),
        (lambda m: m.points.append(m.points[0]), "the reference has 2 points; give exactly one"),
        (
            lambda m: setattr(m.points[0].time_from_start, "sec", 1),
            "the reference is 1 s after its stamp; give it at its stamp",
        ),
        (
            lambda m: setattr(m.points[0], "accelerations", []),
            "accelerations has 0 values; give one for each of 2 names",
        ),
        (
            lambda m: setattr(m.points[0], "velocities", [float("nan"), 0.0]),
            "velocities has nan for name 2; give finite numbers",
        ),
    ],
)
def test_each_fault_is_told_in_one_sentence(change, sentence):
    wrong = message()
    change(wrong)
    with pytest.raises(MessageError) as refusal:
        codec.decode(wrong, NAMES)
    assert str(refusal.value) == sentence
