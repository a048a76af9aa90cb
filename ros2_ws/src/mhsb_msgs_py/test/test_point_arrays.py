"""Messages read from their bytes at once, against rclpy reading them."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mhsb_msgs_py import point_arrays as codec
from mhsb_msgs_py.errors import MessageError

any_float = st.floats(width=64)


@st.composite
def messages(draw: st.DrawFn) -> JointTrajectory:
    """Names and points of any kind, mostly with arrays alike, as a sender gone wrong has them."""
    message = JointTrajectory(joint_names=draw(st.lists(st.text("ab_1", max_size=9), max_size=4)))
    message.header.stamp.sec = draw(st.integers(-(2**31), 2**31 - 1))
    message.header.frame_id = draw(st.text("xyz", max_size=9))
    usual = draw(st.lists(st.integers(0, 4), min_size=4, max_size=4))
    for _ in range(draw(st.integers(0, 5))):
        sizes = draw(st.one_of(*[st.just(usual)] * 9, st.permutations(usual)))
        point = JointTrajectoryPoint()
        for field, size in zip(codec.POINT_FIELDS, sizes, strict=True):
            setattr(point, field, draw(st.lists(any_float, min_size=size, max_size=size)))
        point.time_from_start.sec = draw(st.integers(-(2**31), 2**31 - 1))
        point.time_from_start.nanosec = draw(st.integers(0, 999_999_999))
        message.points.append(point)
    return message


@given(messages())
def test_bytes_say_what_their_message_says(message):
    expected = codec.read_point_arrays(message, "it", 5)
    found = codec.read_point_arrays(serialize_message(message), "it", 5)
    assert found.stamp_ns == expected.stamp_ns
    assert list(found.joint_names) == expected.joint_names
    np.testing.assert_array_equal(found.time_ns, expected.time_ns)
    for field in codec.POINT_FIELDS:
        rows = [list(row) for row in getattr(found, field)]
        np.testing.assert_equal(rows, [list(row) for row in getattr(expected, field)])


def three_points() -> JointTrajectory:
    points = [JointTrajectoryPoint(positions=[1.0, 2.0]) for _ in range(3)]
    return JointTrajectory(joint_names=["a", "b"], points=points)


@given(st.binary(max_size=200))
@example(b"")
@example(codec.CDR_ENCAPSULATION)
@example(codec.CDR_ENCAPSULATION + b"\xff" * 60)
def test_bytes_that_are_no_message_are_refused_or_read(raw):
    with contextlib.suppress(MessageError):
        codec.read_point_arrays(raw, "it", 1000)


def test_a_message_without_points_is_read_whatever_follows_it():
    raw = bytes(serialize_message(JointTrajectory(joint_names=["a"])))
    for rest in (b"", b"\x01" + bytes(60), b"\xff" * 9):
        assert len(codec.read_point_arrays(raw + rest, "it", 3).time_ns) == 0


@given(st.integers(0, 150))
def test_of_a_message_cut_short_nothing_is_read_from_beyond_its_end(length):
    whole = codec.to_bytes(codec.read_point_arrays(three_points(), "it", 3))
    with contextlib.suppress(MessageError):
        found = codec.read_point_arrays(whole[: min(length, len(whole) - 1)], "it", 3)
        assert all(list(row) in ([1.0, 2.0], []) for row in found.positions)


def test_a_message_with_too_many_points_is_refused_by_their_number_alone():
    sent = serialize_message(three_points())
    for message in (three_points(), sent, sent[:60]):
        with pytest.raises(MessageError, match=r"^it has 3 points; give at most 2$"):
            codec.read_point_arrays(message, "it", 2)


def test_the_stamp_of_an_unusable_message_is_known_where_it_has_one():
    message = three_points()
    message.header.stamp.sec = 7
    message.points[1].effort = [1.0]
    assert codec.read_stamp(serialize_message(message)) == 7_000_000_000
    message.header.stamp.nanosec = 1_000_000_000
    assert codec.read_stamp(serialize_message(message)) == 0
    assert codec.read_stamp(b"nothing") == 0


def test_a_message_in_the_other_byte_order_is_no_message_here():
    with pytest.raises(MessageError, match="24 bytes came that are no JointTrajectory"):
        codec.read_point_arrays(bytes(24), "it", 5)
