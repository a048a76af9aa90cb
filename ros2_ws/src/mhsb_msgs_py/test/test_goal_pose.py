"""Codec of goal poses: the arm's plane, the plane laid flat, and what is refused."""

from __future__ import annotations

import math

import pytest
from geometry_msgs.msg import PoseStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from mhsb_model.verdict import Verdict
from mhsb_msgs_py import goal_pose as codec
from mhsb_msgs_py.errors import GoalError

coordinate = st.floats(-10, 10)


def pose(frame: str = "base_link", x: float = 0.5, y: float = 0.0, z: float = -0.25) -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = frame
    message.header.stamp.sec = 3
    message.pose.position.x, message.pose.position.y, message.pose.position.z = x, y, z
    return message


@given(st.integers(0, 10**18), coordinate, coordinate, st.sampled_from(["", "left/"]))
def test_a_goal_comes_back_from_the_wire_to_the_last_bit(stamp, x, z, prefix):
    goal = codec.Goal(stamp, x, z)
    sent = serialize_message(codec.encode(goal, prefix))
    assert codec.decode(deserialize_message(sent, PoseStamped), prefix) == goal


def test_the_base_frame_uses_x_and_z():
    assert codec.decode(pose()) == codec.Goal(3_000_000_000, 0.5, -0.25)


def test_the_flat_work_plane_uses_x_and_y():
    goal = codec.decode(pose("work_plane", 0.5, -0.25, 0.0))
    assert goal == codec.Goal(3_000_000_000, 0.5, -0.25)


def test_a_quaternion_of_zeros_is_ignored():
    message = pose()
    message.pose.orientation.w = 0.0
    assert codec.decode(message).x == 0.5


def test_a_millimetre_beside_the_plane_is_tolerated():
    assert codec.decode(pose(y=0.001)).z == -0.25


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("part", "field"),
    [("position", axis) for axis in "xyz"] + [("orientation", axis) for axis in "xyzw"],
)
def test_a_number_that_is_not_finite_is_refused_wherever_it_stands(part, field, number):
    message = pose()
    setattr(getattr(message.pose, part), field, number)
    with pytest.raises(GoalError) as refusal:
        codec.decode(message)
    assert refusal.value.code is Verdict.NOT_FINITE
    assert str(refusal.value).endswith("; give finite numbers")
    assert f"{number:g}" in str(refusal.value)


@pytest.mark.parametrize("frame", ["", "map", "/base_link", "left/base_link"])
def test_another_frame_is_refused_by_name_with_those_that_are_known(frame):
    with pytest.raises(GoalError) as refusal:
        codec.decode(pose(frame))
    assert refusal.value.code is Verdict.FRAME
    assert str(refusal.value) == f"the goal's frame is '{frame}'; give base_link or work_plane"


def test_with_a_prefix_only_prefixed_frames_are_known():
    assert codec.decode(pose("left/base_link"), "left/").x == 0.5
    with pytest.raises(GoalError, match="give left/base_link or left/work_plane"):
        codec.decode(pose("base_link"), "left/")


@pytest.mark.parametrize(
    "message", [pose(y=0.25), pose("work_plane", 0.5, -0.25, 0.25)], ids=["base_link", "work_plane"]
)
def test_a_goal_beside_the_plane_is_refused(message):
    with pytest.raises(GoalError) as refusal:
        codec.decode(message)
    assert refusal.value.code is Verdict.OUT_OF_WORKSPACE
    assert str(refusal.value) == (
        "the goal lies 0.25 m beside the arm's plane, where at most 1 mm is allowed; give 0"
    )


def test_a_refusal_carries_the_goal_so_that_the_verdict_can_name_it():
    with pytest.raises(GoalError) as refusal:
        codec.decode(pose("map"))
    assert refusal.value.goal == codec.Goal(3_000_000_000, 0.5, -0.25)


def turned(x: float, height: float) -> tuple[float, float, float]:
    """A work plane turned by 90°, its origin 0.1 m from the slew's axis."""
    return (0.0, 0.1 + x, height)


@given(st.integers(0, 10**18), coordinate, coordinate, coordinate)
def test_a_goal_of_an_arm_that_slews_comes_back_from_the_wire_to_the_last_bit(stamp, x, y, z):
    goal = codec.Goal(stamp, x, z, y)
    sent = serialize_message(codec.encode(goal))
    assert codec.decode(deserialize_message(sent, PoseStamped), "", turned) == goal


def test_the_work_plane_of_an_arm_that_slews_turns_with_it():
    goal = codec.decode(pose("work_plane", 0.5, -0.25, 0.0), "", turned)
    assert goal.position == pytest.approx((0.0, 0.6, -0.25))
    with pytest.raises(GoalError, match=r"0\.3 m beside the arm's plane"):
        codec.decode(pose("work_plane", 0.5, -0.25, 0.3), "", turned)


def test_where_nobody_knows_the_work_plane_the_goal_is_refused_as_it_was_sent():
    def unknown(x: float, height: float) -> tuple[float, ...]:
        raise GoalError(Verdict.NO_STATE, "nothing is known of the arm")

    with pytest.raises(GoalError, match="nothing is known") as refusal:
        codec.decode(pose("work_plane", 0.5, -0.25, 0.0), "", unknown)
    assert refusal.value.goal == codec.Goal(3_000_000_000, 0.5, 0.0, -0.25)
