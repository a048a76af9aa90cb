"""Codec: `Reference` as trajectory_msgs/JointTrajectory with one point."""

from __future__ import annotations

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
    """The state that the servo follows at the absolute time `stamp_ns`."""

    stamp_ns: int
    state: MotionState


def encode(reference: Reference, joint_names: Sequence[str]) -> JointTrajectory:
    """Message of a reference of n joints, n names."""
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
    """The reference of a message, joints in the order of `joint_names`.

    Raises MessageError where names, sizes, the point's time or numbers are not right.
    """
    order = checks.joint_order("joint_names", message.joint_names, joint_names)
    if len(message.points) != 1:
        raise MessageError(f"the reference has {len(message.points)} points; give exactly one")
    point = message.points[0]
    offset_ns = stamps.from_duration(point.time_from_start)
    if offset_ns != 0:
        raise MessageError(
            f"the reference is {offset_ns / 1e9:g} s after its stamp; give it at its stamp"
        )
    state = MotionState(
        checks.values("positions", point.positions, order),
        checks.values("velocities", point.velocities, order),
        checks.values("accelerations", point.accelerations, order),
    )
    return Reference(stamps.from_time(message.header.stamp), state)
