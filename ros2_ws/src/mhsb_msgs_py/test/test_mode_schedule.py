"""Codec of mode schedules, against messages written by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rclpy.serialization import deserialize_message, serialize_message
from tests.support.messages import encode_schedule
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mhsb_model.mode_schedule import ModeSchedule
from mhsb_msgs_py import mode_schedule as codec
from mhsb_msgs_py.errors import MessageError

NAMES = ("actuator_1", "actuator_2", "actuator_3")


@given(
    st.integers(0, 2**31 * 10**9 - 1),
    st.lists(st.integers(1, 10**10), max_size=9),
    st.data(),
)
def test_a_schedule_comes_back_from_the_wire_unchanged(stamp, gaps, data):
    modes = data.draw(arrays(np.uint8, (len(gaps) + 1, 3), elements=st.integers(0, 2)))
    schedule = ModeSchedule(stamp, np.cumsum([0, *gaps]), modes)
    sent = serialize_message(encode_schedule(schedule, NAMES))
    for message in (deserialize_message(sent, JointTrajectory), sent):
        back = codec.decode(message, NAMES)
        assert back.stamp_ns == schedule.stamp_ns
        np.testing.assert_array_equal(back.offset_ns, schedule.offset_ns)
        np.testing.assert_array_equal(back.modes, schedule.modes)
    own = codec.to_bytes(schedule, NAMES)
    assert deserialize_message(own, JointTrajectory) == encode_schedule(schedule, NAMES)


def test_what_is_too_long_is_refused_with_its_length():
    rows = codec.MOST_POINTS + 1
    long = ModeSchedule(0, np.arange(rows), np.zeros((rows, 3), np.uint8))
    with pytest.raises(MessageError) as refusal:
        codec.decode(codec.to_bytes(long, NAMES), NAMES)
    assert str(refusal.value) == "the mode schedule has 10001 points; give at most 10000"


def boost_then_hold() -> JointTrajectory:
    """A schedule by hand: actuator_1 in SB and actuator_3 in DB for 1.5 s, then all in N."""
    message = JointTrajectory(joint_names=list(NAMES))
    message.header.stamp.sec = 7
    message.points = [
        JointTrajectoryPoint(positions=[2.0, 0.0, 1.0]),
        JointTrajectoryPoint(positions=[0.0, 0.0, 0.0]),
    ]
    message.points[1].time_from_start.sec = 1
    message.points[1].time_from_start.nanosec = 500_000_000
    return message


def test_positions_are_the_mode_codes():
    schedule = codec.decode(boost_then_hold(), NAMES)
    assert schedule.modes_at(7_000_000_000).tolist() == [2, 0, 1]
    assert schedule.modes_at(8_499_999_999).tolist() == [2, 0, 1]
    assert schedule.modes_at(8_500_000_000).tolist() == [0, 0, 0]
    assert encode_schedule(schedule, NAMES) == boost_then_hold()


def test_actuators_may_come_in_another_order():
    message = boost_then_hold()
    message.joint_names = ["actuator_2", "actuator_3", "actuator_1"]
    assert codec.decode(message, NAMES).modes[0].tolist() == [1, 2, 0]


def in_first(field: str, values: list[float]):
    return lambda message: setattr(message.points[0], field, values)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            lambda m: setattr(m, "joint_names", ["joint_1", "actuator_2", "actuator_3"]),
            "joint_names: joint_1 unknown; "
            "give each of actuator_1, actuator_2, actuator_3 once, in any order",
        ),
        (lambda m: m.points.clear(), "the mode schedule has no points; give at least one"),
        (
            in_first("positions", [2.0, 0.0]),
            "positions of point 0 has 2 values; give one for each of 3 names",
        ),
        (
            in_first("positions", [2.0, 0.5, 0.0]),
            "the mode of actuator_2 at point 0 is 0.5; give 0 (N), 1 (DB) or 2 (SB)",
        ),
        (
            in_first("positions", [2.0, 0.0, 3.0]),
            "the mode of actuator_3 at point 0 is 3; give 0 (N), 1 (DB) or 2 (SB)",
        ),
        (
            in_first("positions", [2.0, 0.0, float("nan")]),
            "positions of point 0 has nan for name 3; give finite numbers",
        ),
        (in_first("velocities", [0.0] * 3), "velocities of point 0 has 3 values; leave it empty"),
        (
            in_first("accelerations", [0.0] * 3),
            "accelerations of point 0 has 3 values; leave it empty",
        ),
        (
            lambda m: setattr(m.points[1].time_from_start, "sec", -1),
            "the mode schedule point 1 at -0.5 s does not come after point 0 at 0 s; "
            "times must increase",
        ),
        (
            lambda m: setattr(m.points[0].time_from_start, "sec", 1),
            "the mode schedule starts 1 s after its stamp; the first point must be at 0",
        ),
    ],
)
def test_each_fault_is_told_in_one_sentence(change, sentence):
    message = boost_then_hold()
    change(message)
    for sent in (message, serialize_message(message)):
        with pytest.raises(MessageError) as refusal:
            codec.decode(sent, NAMES)
        assert str(refusal.value) == sentence
