"""Codec of `Trajectory` as trajectory_msgs/JointTrajectory.

Each point has positions, velocities and accelerations of all joints. Points are at most 20 ms
apart, and the last one has zero velocity. The message passes the checks of ros2_control's
joint_trajectory_controller. Sender and receiver join the points by the same quintic interpolation.
`to_bytes` writes the serialized message directly, and `decode` reads it directly if it gets bytes.
For long messages this is many times faster than rclpy.
"""

from collections.abc import Sequence

import numpy as np
from trajectory_msgs.msg import JointTrajectory

from mhsb_model.trajectory import MAX_DURATION_NS, MAX_POINT_SPACING_NS, Trajectory
from mhsb_model.types import FloatArray
from mhsb_msgs_py import checks, point_arrays
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.point_arrays import PointArrays

MOST_POINTS = 40_000
"""Largest number of points that an arm accepts."""

MAX_END_VELOCITY = 1e-9
"""Largest joint speed of the last point that counts as standing still [rad/s]."""


def to_bytes(trajectory: Trajectory, joint_names: Sequence[str]) -> bytes:
    """Encode a trajectory as the serialized bytes of its message.

    The result equals what rclpy makes of the message, and takes less time.

    Args:
        trajectory: The trajectory of n joints.
        joint_names: Names of the n joints.

    Returns:
        Serialized message.
    """
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
    """Decode a message, or its bytes, to a trajectory.

    Args:
        message: The message, with its joints in any order.
        joint_names: Names of the joints in the order of the result.

    Returns:
        The trajectory.

    Raises:
        MessageError: One of these holds. The bytes are no such message. The nanoseconds of a time
            make a second or more. A name is missing, unknown or given twice. There is no
            point, or there are more than MOST_POINTS. The times do not start at 0, do not increase,
            are more than 20 ms apart or exceed MAX_DURATION_NS. A point lacks a finite position,
            velocity or acceleration for a joint, or has efforts. A joint still moves at the last
            point.
    """
    given = point_arrays.read_point_arrays(message, "the trajectory", MOST_POINTS)
    order = checks.find_joint_order("joint_names", given.joint_names, joint_names)
    offset = checks.check_point_times(
        "the trajectory", given.time_ns, max_spacing_ns=MAX_POINT_SPACING_NS
    )
    if offset[-1] > MAX_DURATION_NS:
        raise MessageError(
            f"the trajectory takes {offset[-1] / 1e9:g} s; give at most {MAX_DURATION_NS / 1e9:g} s"
        )
    checks.check_empty_rows("effort", given.effort)
    position = checks.check_point_table("positions", given.positions, order)
    velocity = checks.check_point_table("velocities", given.velocities, order)
    acceleration = checks.check_point_table("accelerations", given.accelerations, order)
    _check_standstill(velocity[-1], joint_names)
    return Trajectory(given.stamp_ns, offset, position, velocity, acceleration)


def _check_standstill(velocity: FloatArray, joint_names: Sequence[str]) -> None:
    """Raise MessageError if a joint still moves at the last point.

    A joint moves if its speed exceeds MAX_END_VELOCITY.

    Args:
        velocity: Joint velocities of the last point, float64[n], [rad/s or m/s].
        joint_names: Names of the joints.
    """
    fastest = int(np.argmax(np.abs(velocity)))
    if abs(velocity[fastest]) > MAX_END_VELOCITY:
        raise MessageError(
            f"{joint_names[fastest]} ends with {velocity[fastest]:g} rad/s or m/s; "
            "the last point must have zero velocity"
        )
