"""Codec of trajectories, against messages written by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rclpy.serialization import deserialize_message, serialize_message
from tests.support.messages import encode_trajectory
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mhsb_model.trajectory import Trajectory
from mhsb_msgs_py import trajectory as codec
from mhsb_msgs_py.errors import MessageError

NAMES = ("joint_1", "joint_2", "joint_3")
finite = st.floats(-1e6, 1e6)


@st.composite
def trajectories(draw: st.DrawFn) -> Trajectory:
    count = draw(st.integers(1, 12))
    gaps = draw(st.lists(st.integers(1, 20_000_000), min_size=count - 1, max_size=count - 1))
    position, velocity, acceleration = (
        draw(arrays(np.float64, (count, 3), elements=finite)) for _ in range(3)
    )
    velocity[-1] = 0.0
    stamp = draw(st.integers(0, 2**31 * 10**9 - 1))
    return Trajectory(stamp, np.cumsum([0, *gaps]), position, velocity, acceleration)


@given(trajectories())
def test_a_trajectory_comes_back_from_the_wire_to_the_last_bit(trajectory):
    sent = serialize_message(encode_trajectory(trajectory, NAMES))
    for message in (deserialize_message(sent, JointTrajectory), sent):
        back = codec.decode(message, NAMES)
        assert back.stamp_ns == trajectory.stamp_ns
        for name in ("offset_ns", "position", "velocity", "acceleration"):
            np.testing.assert_array_equal(getattr(back, name), getattr(trajectory, name))


@given(trajectories())
def test_its_bytes_are_those_of_its_message(trajectory):
    sent = codec.to_bytes(trajectory, NAMES)
    assert deserialize_message(sent, JointTrajectory) == encode_trajectory(trajectory, NAMES)


@pytest.mark.parametrize(
    ("points", "spacing_ns", "sentence"),
    [
        (codec.MOST_POINTS + 1, 1_000_000, "the trajectory has 40001 points; give at most 40000"),
        (30_002, 20_000_000, "the trajectory takes 600.02 s; give at most 600 s"),
    ],
)
def test_what_is_too_long_is_refused_with_its_length(points, spacing_ns, sentence):
    still = np.zeros((points, 3))
    long = Trajectory(0, spacing_ns * np.arange(points), still, still, still)
    with pytest.raises(MessageError) as refusal:
        codec.decode(codec.to_bytes(long, NAMES), NAMES)
    assert str(refusal.value) == sentence


def two_points() -> JointTrajectory:
    """A trajectory by hand: joint_1 from 0 to 0.1 rad, the others still."""
    message = JointTrajectory(joint_names=list(NAMES))
    message.header.stamp.sec = 12
    message.header.stamp.nanosec = 345
    for position, milliseconds in ((0.0, 0), (0.1, 20)):
        point = JointTrajectoryPoint(
            positions=[position, 0.2, 0.3], velocities=[0.0] * 3, accelerations=[0.0, 0.0, 1.0]
        )
        point.time_from_start.nanosec = milliseconds * 1_000_000
        message.points.append(point)
    return message


def test_the_fields_of_the_message_are_where_ros2_control_looks_for_them():
    trajectory = codec.decode(two_points(), NAMES)
    assert trajectory.stamp_ns == 12_000_000_345
    assert trajectory.offset_ns.tolist() == [0, 20_000_000]
    assert trajectory.position.tolist() == [[0.0, 0.2, 0.3], [0.1, 0.2, 0.3]]
    assert encode_trajectory(trajectory, NAMES) == two_points()


def test_joints_may_come_in_another_order():
    message = two_points()
    message.joint_names = ["joint_3", "joint_1", "joint_2"]
    assert codec.decode(message, NAMES).position[0].tolist() == [0.2, 0.3, 0.0]


def set_last(field: str, values: list[float]):
    return lambda message: setattr(message.points[1], field, values)


def set_time(point: int, seconds: int, nanoseconds: int):
    def change(message: JointTrajectory) -> None:
        message.points[point].time_from_start.sec = seconds
        message.points[point].time_from_start.nanosec = nanoseconds

    return change


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            lambda m: setattr(m, "joint_names", ["joint_1", "joint_2", "wrist"]),
            "joint_names: wrist unknown; give each of joint_1, joint_2, joint_3 once, in any order",
        ),
        (
            lambda m: setattr(m, "joint_names", ["joint_1", "joint_2"]),
            "joint_names: joint_3 missing; give each of joint_1, joint_2, joint_3 once, "
            "in any order",
        ),
        (
            lambda m: setattr(m, "joint_names", ["joint_1", "joint_1", "joint_2", "joint_3"]),
            "joint_names: joint_1 given twice; give each of joint_1, joint_2, joint_3 once, "
            "in any order",
        ),
        (lambda m: m.points.clear(), "the trajectory has no points; give at least one"),
        (
            set_last("positions", [0.1]),
            "positions of point 1 has 1 values; give one for each of 3 names",
        ),
        (
            set_last("velocities", []),
            "velocities of point 1 has 0 values; give one for each of 3 names",
        ),
        (
            set_last("accelerations", [0.0] * 4),
            "accelerations of point 1 has 4 values; give one for each of 3 names",
        ),
        (
            set_last("positions", [0.1, float("nan"), 0.3]),
            "positions of point 1 has nan for name 2; give finite numbers",
        ),
        (
            set_last("accelerations", [float("inf"), 0.0, 0.0]),
            "accelerations of point 1 has inf for name 1; give finite numbers",
        ),
        (set_last("effort", [1.0]), "effort of point 1 has 1 values; leave it empty"),
        (
            set_last("velocities", [0.0, -0.25, 0.0]),
            "joint_2 ends with -0.25 rad/s or m/s; the last point must have zero velocity",
        ),
        (
            set_time(1, 0, 0),
            "the trajectory point 1 at 0 s does not come after point 0 at 0 s; times must increase",
        ),
        (
            set_time(1, 0, 25_000_000),
            "the trajectory point 1 comes 25 ms after the one before; "
            "give points at most 20 ms apart",
        ),
        (
            set_time(0, 0, 1_000_000),
            "the trajectory starts 0.001 s after its stamp; the first point must be at 0",
        ),
        (
            set_time(1, 0, 1_000_000_000),
            "a time has 1000000000 ns beside its seconds; it must be below 1000000000",
        ),
    ],
)
def test_each_fault_is_told_in_one_sentence(change, sentence):
    message = two_points()
    change(message)
    for sent in (message, serialize_message(message)):
        with pytest.raises(MessageError) as refusal:
            codec.decode(sent, NAMES)
        assert str(refusal.value) == sentence
