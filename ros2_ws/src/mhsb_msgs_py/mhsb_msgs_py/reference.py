"""Codec of `Reference` as trajectory_msgs/JointTrajectory with one point."""

from array import array
from collections.abc import Sequence
from dataclasses import dataclass

from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mhsb_model.trajectory import MotionState
from mhsb_msgs_py import checks, stamps
from mhsb_msgs_py.errors import MessageError


@dataclass(frozen=True)
class Reference:
    """State that the servo follows.

    Attributes:
        stamp_ns: Absolute time of the state [ns].
        state: Position, velocity and acceleration of all joints.
    """

    stamp_ns: int
    state: MotionState


def encode(reference: Reference, joint_names: Sequence[str]) -> JointTrajectory:
    """Encode a reference of n joints.

    Args:
        reference: The reference.
        joint_names: Names of the n joints.

    Returns:
        Message with one point at time 0.
    """
    point = JointTrajectoryPoint(
        positions=array("d", reference.state.position),
        velocities=array("d", reference.state.velocity),
        accelerations=array("d", reference.state.acceleration),
    )
    return JointTrajectory(
        header=Header(stamp=stamps.to_time(reference.stamp_ns)),
        joint_names=list(joint_names),
        points=[point],
    )


def decode(message: JointTrajectory, joint_names: Sequence[str]) -> Reference:
    """Decode a message to a reference.

    Args:
        message: The message, with its joints in any order.
        joint_names: Names of the joints in the order of the result.

    Returns:
        The reference.

    Raises:
        MessageError: One of these holds. A name is missing, unknown or given twice. The number of
            points is not 1, or the point is not at time 0. A joint lacks a finite position,
            velocity or acceleration. The stamp is before 1970, or so late
            that later times would not fit into a message. The nanoseconds of a
            time make a second or more.
    """
    order = checks.find_joint_order("joint_names", message.joint_names, joint_names)
    if len(message.points) != 1:
        raise MessageError(f"the reference has {len(message.points)} points; give exactly one")
    point = message.points[0]
    offset_ns = stamps.from_time(point.time_from_start)
    if offset_ns != 0:
        raise MessageError(
            f"the reference is {offset_ns / 1e9:g} s after its stamp; give it at its stamp"
        )
    state = MotionState(
        checks.check_values("positions", point.positions, order),
        checks.check_values("velocities", point.velocities, order),
        checks.check_values("accelerations", point.accelerations, order),
    )
    return Reference(stamps.from_clock(message.header.stamp), state)
