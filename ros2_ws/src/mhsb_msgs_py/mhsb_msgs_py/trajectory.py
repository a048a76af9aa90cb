"""Codec: `Trajectory` as trajectory_msgs/JointTrajectory.

All arrays are full, points stand at most 20 ms apart, the last one has zero velocity. The
message passes the checks of ros2_control's joint_trajectory_controller, and the curve is the
quintic interpolation between its points on both sides.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence

import numpy as np
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mhsb_model.trajectory import Trajectory
from mhsb_model.types import FloatArray, IntArray
from mhsb_msgs_py import checks, stamps
from mhsb_msgs_py.errors import MessageError

LONGEST_GAP_NS = 20_000_000
SMALLEST_END_VELOCITY = 1e-9
"""Below this the end counts as standing still [rad/s]."""


def encode(trajectory: Trajectory, joint_names: Sequence[str]) -> JointTrajectory:
    """Message of a trajectory of n joints, n names."""
    return JointTrajectory(
        header=Header(stamp=stamps.to_time(trajectory.stamp_ns)),
        joint_names=list(joint_names),
        points=[
            JointTrajectoryPoint(
                positions=array("d", position),
                velocities=array("d", velocity),
                accelerations=array("d", acceleration),
                time_from_start=stamps.to_duration(int(offset)),
            )
            for offset, position, velocity, acceleration in zip(
                trajectory.offset_ns,
                trajectory.position,
                trajectory.velocity,
                trajectory.acceleration,
                strict=True,
            )
        ],
    )


def decode(message: JointTrajectory, joint_names: Sequence[str]) -> Trajectory:
    """The trajectory of a message, joints in the order of `joint_names`.

    Raises MessageError where names, sizes, times, numbers or the end velocity are not right.
    """
    order = checks.joint_order("joint_names", message.joint_names, joint_names)
    times = [stamps.from_duration(point.time_from_start) for point in message.points]
    offset = checks.point_times("the trajectory", times, apart_ns=LONGEST_GAP_NS)
    for index, point in enumerate(message.points):
        checks.empty(f"effort of point {index}", point.effort)
    velocity = _rows(message, "velocities", order)
    _check_standstill(velocity[-1], joint_names)
    return Trajectory(
        stamps.from_time(message.header.stamp),
        offset,
        _rows(message, "positions", order),
        velocity,
        _rows(message, "accelerations", order),
    )


def _rows(message: JointTrajectory, field: str, order: IntArray) -> FloatArray:
    """One array of all points, float64[points, joints]."""
    rows = [getattr(point, field) for point in message.points]
    return checks.table(rows, order, lambda index: f"{field} of point {index}")


def _check_standstill(velocity: FloatArray, joint_names: Sequence[str]) -> None:
    fastest = int(np.argmax(np.abs(velocity)))
    if abs(velocity[fastest]) > SMALLEST_END_VELOCITY:
        raise MessageError(
            f"{joint_names[fastest]} ends with {velocity[fastest]:g} rad/s; "
            "the last point must have zero velocity"
        )
