"""Codec: `Goal` as geometry_msgs/PoseStamped.

In `base_link` the goal is (x, z) and y must be 0; in `work_plane`, the same plane laid flat for
viewers that know only x and y, it is (x, y) and z must be 0. Arms that slew go to any (x, y, z) in
`base_link`, and `work_plane` is the plane in which the arm is when the goal comes. The orientation
has no meaning, and a quaternion of zeros is as good as any, but NaN in it shows a sender gone
wrong. The stamp is an opaque id of the goal.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from geometry_msgs.msg import Point, Pose, PoseStamped
from std_msgs.msg import Header

from mhsb_model.goal import Goal
from mhsb_model.types import Position
from mhsb_model.verdict import Verdict
from mhsb_msgs_py import stamps
from mhsb_msgs_py.errors import GoalError
from mhsb_msgs_py.names import BASE_FRAME, WORK_PLANE_FRAME, frame_name

OFF_PLANE_TOLERANCE = 1e-3
"""How far a goal may lie beside the arm's plane [m]."""

ToBase = Callable[[float, float], Position]
"""Of arms that slew: from (x, y) [m] in `work_plane`, as it stands, to (x, y, z) in `base_link`."""


def encode(goal: Goal, frame_prefix: str = "") -> PoseStamped:
    """Message of a goal in the base frame."""
    header = Header(
        stamp=stamps.to_time(goal.stamp_ns), frame_id=frame_name(BASE_FRAME, frame_prefix)
    )
    position = Point(x=goal.x, y=goal.y or 0.0, z=goal.z)
    return PoseStamped(header=header, pose=Pose(position=position))


def decode(message: PoseStamped, frame_prefix: str = "", to_base: ToBase | None = None) -> Goal:
    """The goal of a message; whether the arm can go there is for the planner to say.

    to_base  None for arms that do not slew

    Raises GoalError: NOT_FINITE for NaN or infinity anywhere, FRAME for an unknown frame,
    OUT_OF_WORKSPACE for a goal beside the arm's plane, and what `to_base` raises; MessageError for
    an impossible stamp.
    """
    position, orientation = message.pose.position, message.pose.orientation
    flat = message.header.frame_id == frame_name(WORK_PLANE_FRAME, frame_prefix)
    stamp_ns = stamps.from_time(message.header.stamp)
    goal = _as_sent(position, flat, stamp_ns, slews=to_base is not None)

    numbers = (position.x, position.y, position.z)
    turns = (orientation.x, orientation.y, orientation.z, orientation.w)
    frames = [frame_name(BASE_FRAME, frame_prefix), frame_name(WORK_PLANE_FRAME, frame_prefix)]
    if not all(math.isfinite(number) for number in numbers + turns):
        raise GoalError(
            Verdict.NOT_FINITE,
            f"the goal's position is {_text(numbers)} and its orientation {_text(turns)}; "
            "give finite numbers",
            goal,
        )
    if message.header.frame_id not in frames:
        raise GoalError(
            Verdict.FRAME,
            f"the goal's frame is '{message.header.frame_id}'; give {' or '.join(frames)}",
            goal,
        )
    beside = position.z if flat else 0.0 if to_base else position.y
    if abs(beside) > OFF_PLANE_TOLERANCE:
        raise GoalError(
            Verdict.OUT_OF_WORKSPACE,
            f"the goal lies {beside:g} m beside the arm's plane, where at most "
            f"{OFF_PLANE_TOLERANCE:g} m is allowed; give 0",
            goal,
        )
    if to_base is None or not flat:
        return goal
    try:
        return goal.moved_to(to_base(position.x, position.y))
    except GoalError as error:
        raise GoalError(error.code, str(error), goal) from None


def _as_sent(position: Point, flat: bool, stamp_ns: int, slews: bool) -> Goal:
    """By the message's numbers alone."""
    if slews:
        return Goal(stamp_ns, position.x, position.z, position.y)
    return Goal(stamp_ns, position.x, position.y if flat else position.z)


def _text(numbers: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{number:g}" for number in numbers) + ")"
