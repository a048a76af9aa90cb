"""Codec: `JointSample` as sensor_msgs/JointState."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass

from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from mhsb_model.types import FloatArray, frozen
from mhsb_msgs_py import checks, stamps


@dataclass(frozen=True)
class JointSample:
    """What was measured at the joints at one time.

    stamp_ns  absolute time, ns
    position  float64[n], rad
    velocity  float64[n], rad/s
    effort    float64[n], N m, or None where nobody measures it
    """

    stamp_ns: int
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray | None = None

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "effort"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen(given))


def encode(sample: JointSample, joint_names: Sequence[str]) -> JointState:
    """Message of a sample of n joints, n names."""
    return JointState(
        header=Header(stamp=stamps.to_time(sample.stamp_ns)),
        name=list(joint_names),
        position=array("d", sample.position),
        velocity=array("d", sample.velocity),
        effort=array("d", () if sample.effort is None else sample.effort),
    )


def decode(message: JointState, joint_names: Sequence[str]) -> JointSample:
    """The sample of a message, joints in the order of `joint_names`; effort may be left out.

    Raises MessageError where names, sizes or numbers are not right.
    """
    order = checks.joint_order("joint states", message.name, joint_names)
    return JointSample(
        stamps.from_time(message.header.stamp),
        checks.values("position", message.position, order),
        checks.values("velocity", message.velocity, order),
        checks.values("effort", message.effort, order) if len(message.effort) else None,
    )
