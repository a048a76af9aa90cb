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
    return JointTrajectory(
        header=Header(stamp=stamps.to_time(trajectory.stamp_ns)),
        joint_names=list(joint_names),
        points=[
            JointTrajectoryPoint(
                positions=array("d", position),
                velocities=array("d", velocity),
                accelerations=array("d", acceleration),
                time_from_start=Duration(nanoseconds=int(offset)).to_msg(),
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


def encode_schedule(schedule: ModeSchedule, actuator_names: Sequence[str]) -> JointTrajectory:
    """Encode a mode schedule of n actuators.

    Args:
        schedule: The schedule.
        actuator_names: Names of the n actuators.
    """
    return JointTrajectory(
        header=Header(stamp=stamps.to_time(schedule.stamp_ns)),
        joint_names=list(actuator_names),
        points=[
            JointTrajectoryPoint(
                positions=array("d", modes),
                time_from_start=Duration(nanoseconds=int(offset)).to_msg(),
            )
            for offset, modes in zip(schedule.offset_ns, schedule.modes, strict=True)
        ],
    )
