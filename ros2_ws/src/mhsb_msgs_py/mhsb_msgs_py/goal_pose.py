"""Codec of `Goal` as geometry_msgs/PoseStamped.

A goal can be given in two frames. In `base_link` it is (x, z), and y must be 0. `work_plane` is the
arm's plane as its x-y plane, for viewers that know only x and y. In this frame the goal is (x, y),
and z must be 0. Arms that slew go to any (x, y, z) in `base_link`. For them, `work_plane` is the
plane in which the arm is when the goal comes. The orientation has no meaning, and a quaternion of
zeros is accepted. An orientation with NaN is refused, since it shows a faulty sender. The stamp
identifies the goal.
"""

import math
from collections.abc import Callable

from geometry_msgs.msg import Point, Pose, PoseStamped
from std_msgs.msg import Header

from mhsb_model.goal import Goal, format_distance
from mhsb_model.types import Position
from mhsb_model.verdict import Verdict
from mhsb_msgs_py import stamps
from mhsb_msgs_py.errors import GoalError
from mhsb_msgs_py.names import BASE_FRAME, WORK_PLANE_FRAME

OFF_PLANE_TOLERANCE = 1e-3
"""Largest distance of a goal from the arm's plane [m]."""

ToBase = Callable[[float, float], Position]
"""Function for arms that slew: converts (x, y) [m] in the present `work_plane` to `base_link`."""


def encode(goal: Goal, frame_prefix: str = "") -> PoseStamped:
    """Encode a goal as a pose in `base_link`.

    Args:
        goal: The goal.
        frame_prefix: Text before the name of the frame.

    Returns:
        The pose, with position and stamp of the goal; it has no rotation. Its y is 0 for arms that
        do not slew.
    """
    header = Header(stamp=stamps.to_time(goal.stamp_ns), frame_id=frame_prefix + BASE_FRAME)
    position = Point(x=goal.x, y=goal.y or 0.0, z=goal.z)
    return PoseStamped(header=header, pose=Pose(position=position))


def decode(message: PoseStamped, frame_prefix: str = "", to_base: ToBase | None = None) -> Goal:
    """Decode a pose to a goal; whether the arm can go there is not checked.

    Args:
        message: The pose, in `base_link` or in `work_plane` (the arm's plane as the x-y plane: x
            forward, y up).
        frame_prefix: Text before the names of frames.
        to_base: Function for arms that slew, which converts (x, y) in `work_plane` to (x, y, z) in
            `base_link` [m]. None for arms that do not slew.

    Returns:
        The goal in `base_link`.

    Raises:
        GoalError: The goal cannot be used. Its code is `NOT_FINITE` for NaN or infinity in position
            or orientation, and `FRAME` for an unknown frame. It is `OUT_OF_WORKSPACE` for a goal
            more than OFF_PLANE_TOLERANCE beside the arm's plane. A GoalError of `to_base` keeps its
            code.
        MessageError: The nanoseconds of the stamp are 10⁹ or more.
    """
    position, orientation = message.pose.position, message.pose.orientation
    flat = message.header.frame_id == frame_prefix + WORK_PLANE_FRAME
    stamp_ns = stamps.from_time(message.header.stamp)
    goal = _goal_as_sent(position, flat, stamp_ns, slews=to_base is not None)

    numbers = (position.x, position.y, position.z)
    turns = (orientation.x, orientation.y, orientation.z, orientation.w)
    frames = [frame_prefix + BASE_FRAME, frame_prefix + WORK_PLANE_FRAME]
    if not all(math.isfinite(number) for number in numbers + turns):
        raise GoalError(
            Verdict.NOT_FINITE,
            f"the goal's position is {_format_numbers(numbers)} and its orientation "
            f"{_format_numbers(turns)}; give finite numbers",
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
            f"the goal lies {format_distance(beside)} beside the arm's plane, where at most "
            f"{format_distance(OFF_PLANE_TOLERANCE)} is allowed; give 0",
            goal,
        )
    if to_base is None or not flat:
        return goal
    try:
        return goal.moved_to(to_base(position.x, position.y))
    except GoalError as error:
        raise GoalError(error.code, str(error), goal) from None


def _goal_as_sent(position: Point, flat: bool, stamp_ns: int, slews: bool) -> Goal:
    """Return the goal that the numbers of a message give, without a conversion by the slew angle.

    Verdicts on poses that cannot be used refer to this goal.

    Args:
        position: Position of the pose [m].
        flat: Whether the frame is `work_plane` (the arm's plane as its x-y plane).
        stamp_ns: Stamp of the message [ns].
        slews: Whether the arm slews.

    Returns:
        The goal. If the arm slews, it has the x, y and z of the message in any frame. Otherwise it
        has x and z; in `work_plane` its z is the y of the message.
    """
    if slews:
        return Goal(stamp_ns, position.x, position.z, position.y)
    return Goal(stamp_ns, position.x, position.y if flat else position.z)


def _format_numbers(numbers: tuple[float, ...]) -> str:
    """Return numbers as text in parentheses, separated by commas."""
    return "(" + ", ".join(f"{number:g}" for number in numbers) + ")"
