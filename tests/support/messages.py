"""Messages of trajectories and mode schedules, made by the classes of ROS."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

from rclpy.duration import Duration
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_msgs_py import stamps


def encode_trajectory(trajectory: Trajectory, joint_names: Sequence[str]) -> JointTrajectory:
    """Encode a trajectory of n joints.

    Args:
        trajectory: The trajectory.
        joint_names: Names of the n joints.
    """
    points = [
        JointTrajectoryPoint(
            positions=array("d", position),
            velocities=array("d", velocity),
            accelerations=array("d", acceleration),
        )
        for position, velocity, acceleration in zip(*trajectory.points, strict=True)
    ]
    return _encode(trajectory, joint_names, points)


def encode_schedule(schedule: ModeSchedule, actuator_names: Sequence[str]) -> JointTrajectory:
    """Encode a mode schedule of n actuators.

    Args:
        schedule: The schedule.
        actuator_names: Names of the n actuators.
    """
    points = [JointTrajectoryPoint(positions=array("d", modes)) for modes in schedule.modes]
    return _encode(schedule, actuator_names, points)


def _encode(
    timed: Trajectory | ModeSchedule, names: Sequence[str], points: list[JointTrajectoryPoint]
) -> JointTrajectory:
    """Make the message of points, with stamp and offsets of a trajectory or schedule."""
    for point, offset_ns in zip(points, timed.offset_ns, strict=True):
        point.time_from_start = Duration(nanoseconds=int(offset_ns)).to_msg()
    header = Header(stamp=stamps.to_time(timed.stamp_ns))
    return JointTrajectory(header=header, joint_names=list(names), points=points)
