"""Codec: `ModeSchedule` as trajectory_msgs/JointTrajectory (topic mode_commands).

Positions are exactly 0, 1 or 2 for N, DB, SB; each point holds until the next one.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence

import numpy as np
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_msgs_py import checks, point_arrays, stamps
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.point_arrays import PointArrays

MOST_POINTS = 10_000
"""Greatest number of points that an arm takes."""


def encode(schedule: ModeSchedule, actuator_names: Sequence[str]) -> JointTrajectory:
    """Message of a schedule of n actuators, n names."""
    return JointTrajectory(
        header=Header(stamp=stamps.to_time(schedule.stamp_ns)),
        joint_names=list(actuator_names),
        points=[
            JointTrajectoryPoint(
                positions=array("d", modes), time_from_start=stamps.to_duration(int(offset))
            )
            for offset, modes in zip(schedule.offset_ns, schedule.modes, strict=True)
        ],
    )


def to_bytes(schedule: ModeSchedule, actuator_names: Sequence[str]) -> bytes:
    """`encode`, and what rclpy would then make of it for the wire, at once."""
    empty = np.zeros((len(schedule.offset_ns), 0))
    return point_arrays.to_bytes(
        PointArrays(
            schedule.stamp_ns,
            actuator_names,
            schedule.offset_ns,
            schedule.modes.astype(np.float64),
            *(empty,) * 3,
        )
    )


def decode(message: JointTrajectory | bytes, actuator_names: Sequence[str]) -> ModeSchedule:
    """The schedule of a message or of its bytes, actuators in the order of `actuator_names`.

    Raises MessageError where length, names, sizes, times or codes are not right.
    """
    given = point_arrays.point_arrays(message, "the mode schedule", MOST_POINTS)
    order = checks.joint_order("joint_names", given.joint_names, actuator_names)
    offset = checks.point_times("the mode schedule", given.time_ns)
    checks.empty_rows("velocities", given.velocities)
    checks.empty_rows("accelerations", given.accelerations)
    checks.empty_rows("effort", given.effort)
    modes = checks.point_table("positions", given.positions, order)
    wrong = np.argwhere(~np.isin(modes, list(Mode)))
    if len(wrong) > 0:
        index, actuator = wrong[0]
        raise MessageError(
            f"the mode of {actuator_names[actuator]} at point {index} is "
            f"{modes[index, actuator]:g}; give 0 (N), 1 (DB) or 2 (SB)"
        )
    return ModeSchedule(given.stamp_ns, offset, modes.astype(np.uint8))
