"""Codec of `JointSample` as sensor_msgs/JointState."""

from array import array
from collections.abc import Sequence
from dataclasses import dataclass

from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from mhsb_model.types import FloatArray, frozen
from mhsb_msgs_py import checks, stamps


@dataclass(frozen=True)
class JointSample:
    """Measured state of n joints at one time; joints that slide have m instead of rad.

    Attributes:
        stamp_ns: Absolute time [ns].
        position: Joint positions, float64[n], [rad].
        velocity: Joint velocities, float64[n], [rad/s].
        effort: Joint torques, float64[n], [N m]; None if they are not measured.
    """

    stamp_ns: int
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray | None = None

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("position", "velocity", "effort"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen(given))


def encode(sample: JointSample, joint_names: Sequence[str]) -> JointState:
    """Encode a sample of n joints.

    Args:
        sample: The sample.
        joint_names: Names of the n joints, in the order of the sample's arrays.
    """
    return JointState(
        header=Header(stamp=stamps.to_time(sample.stamp_ns)),
        name=list(joint_names),
        position=array("d", sample.position),
        velocity=array("d", sample.velocity),
        effort=array("d", () if sample.effort is None else sample.effort),
    )


def decode(message: JointState, joint_names: Sequence[str]) -> JointSample:
    """Decode a message to a sample.

    Args:
        message: The message, with its joints in any order; effort may be empty.
        joint_names: Names of the joints in the order of the result.

    Returns:
        The sample; its `effort` is None if the message has none.

    Raises:
        MessageError: One of these holds. A name is missing, unknown or given twice. A joint lacks a
            finite value. The stamp is before 1970, or so late that later times would not fit into a
            message (`stamps.from_clock`). Its nanoseconds make a second or more.
    """
    order = checks.find_joint_order("joint states", message.name, joint_names)
    return JointSample(
        stamps.from_clock(message.header.stamp),
        checks.check_values("position", message.position, order),
        checks.check_values("velocity", message.velocity, order),
        checks.check_values("effort", message.effort, order) if len(message.effort) else None,
    )
