"""Codec: `Trajectory` as trajectory_msgs/JointTrajectory.

All arrays are full, points stand at most 20 ms apart, the last one has zero velocity. The
message passes the checks of ros2_control's joint_trajectory_controller, and the curve is the
quintic interpolation between its points on both sides. `to_bytes` and bytes given to `decode` are
the message as it goes over the wire, which is many times faster for long ones.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence

import numpy as np
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mhsb_model.trajectory import LONGEST_NS, POINT_SPACING_NS, Trajectory
from mhsb_model.types import FloatArray
from mhsb_msgs_py import checks, point_arrays, stamps
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.point_arrays import PointArrays

MOST_POINTS = 40_000
"""Greatest number of points that an arm takes."""

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


def to_bytes(trajectory: Trajectory, joint_names: Sequence[str]) -> bytes:
    """`encode`, and what rclpy would then make of it for the wire, at once."""
    return point_arrays.to_bytes(
        PointArrays(
            trajectory.stamp_ns,
            joint_names,
            trajectory.offset_ns,
            trajectory.position,
            trajectory.velocity,
            trajectory.acceleration,
            np.zeros((len(trajectory.offset_ns), 0)),
        )
    )


def decode(message: JointTrajectory | bytes, joint_names: Sequence[str]) -> Trajectory:
    """The trajectory of a message or of its bytes, joints in the order of `joint_names`.

    Raises MessageError where length, names, sizes, times, numbers or the end velocity are not
    right.
    """
    given = point_arrays.point_arrays(message, "the trajectory", MOST_POINTS)
    order = checks.joint_order("joint_names", given.joint_names, joint_names)
    offset = checks.point_times("the trajectory", given.time_ns, apart_ns=POINT_SPACING_NS)
    if offset[-1] > LONGEST_NS:
        raise MessageError(
            f"the trajectory takes {offset[-1] / 1e9:g} s; give at most {LONGEST_NS / 1e9:g} s"
        )
    checks.empty_rows("effort", given.effort)
    position = checks.point_table("positions", given.positions, order)
    velocity = checks.point_table("velocities", given.velocities, order)
    acceleration = checks.point_table("accelerations", given.accelerations, order)
    _check_standstill(velocity[-1], joint_names)
    return Trajectory(given.stamp_ns, offset, position, velocity, acceleration)


def _check_standstill(velocity: FloatArray, joint_names: Sequence[str]) -> None:
    fastest = int(np.argmax(np.abs(velocity)))
    if abs(velocity[fastest]) > SMALLEST_END_VELOCITY:
        raise MessageError(
            f"{joint_names[fastest]} ends with {velocity[fastest]:g} rad/s; "
            "the last point must have zero velocity"
        )
