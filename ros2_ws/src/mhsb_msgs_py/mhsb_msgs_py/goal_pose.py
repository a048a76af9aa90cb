"""Codec: `Goal` as geometry_msgs/PoseStamped.

In `base_link` the goal is (x, z) and y must be 0; in `work_plane`, the same plane laid flat for
viewers that know only x and y, it is (x, y) and z must be 0. The orientation has no meaning, and
a quaternion of zeros is as good as any, but NaN in it shows a sender gone wrong. The stamp is an
opaque id of the goal.
"""

from __future__ import annotations

import math

from geometry_msgs.msg import Point, Pose, PoseStamped
from std_msgs.msg import Header

from mhsb_model.goal import Goal
from mhsb_model.verdict import Verdict
from mhsb_msgs_py import stamps
from mhsb_msgs_py.errors import GoalError
from mhsb_msgs_py.names import BASE_FRAME, WORK_PLANE_FRAME, frame_name

OFF_PLANE_TOLERANCE = 1e-3
"""How far a goal may lie beside the arm's plane [m]."""


def encode(goal: Goal, frame_prefix: str = "") -> PoseStamped:
    """Message of a goal in the base frame."""
    header = Header(
        stamp=stamps.to_time(goal.stamp_ns), frame_id=frame_name(BASE_FRAME, frame_prefix)
    )
    return PoseStamped(header=header, pose=Pose(position=Point(x=goal.x, y=0.0, z=goal.z)))


def decode(message: PoseStamped, frame_prefix: str = "") -> Goal:
    """The goal of a message; whether the arm can go there is for the planner to say.

    Raises GoalError: NOT_FINITE for NaN or infinity anywhere, FRAME for an unknown frame,
    OUT_OF_WORKSPACE for a goal beside the arm's plane; MessageError for an impossible stamp.
    """
    position, orientation = message.pose.position, message.pose.orientation
    flat = message.header.frame_id == frame_name(WORK_PLANE_FRAME, frame_prefix)
    height, beside = (position.y, position.z) if flat else (position.z, position.y)
    goal = Goal(stamps.from_time(message.header.stamp), position.x, height)

    numbers = (position.x, position.y, position.z)
    turns = (orientation.x, orientation.y, orientation.z, orientation.w)
    frames = [frame_name(BASE_FRAME, frame_prefix), frame_name(WORK_PLANE_FRAME, frame_prefix)]
    if not all(math.isfinite(number) for number in numbers + turns):
        raise _refusal(
            goal,
            Verdict.NOT_FINITE,
            f"the goal's position is {_text(numbers)} and its orientation {_text(turns)}; "
            "give finite numbers",
        )
    if message.header.frame_id not in frames:
        raise _refusal(
            goal,
            Verdict.FRAME,
            f"the goal's frame is '{message.header.frame_id}'; give {' or '.join(frames)}",
        )
    if abs(beside) > OFF_PLANE_TOLERANCE:
        raise _refusal(
            goal,
            Verdict.OUT_OF_WORKSPACE,
            f"the goal lies {beside:g} m beside the arm's plane, where at most "
            f"{OFF_PLANE_TOLERANCE:g} m is allowed; give 0",
        )
    return goal


def _refusal(goal: Goal, code: Verdict, sentence: str) -> GoalError:
    return GoalError(code, sentence, goal.stamp_ns, goal.x, goal.z)


def _text(numbers: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{number:g}" for number in numbers) + ")"
