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
from mhsb_msgs_py import checks, stamps
from mhsb_msgs_py.errors import MessageError


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


def decode(message: JointTrajectory, actuator_names: Sequence[str]) -> ModeSchedule:
    """The schedule of a message, actuators in the order of `actuator_names`.

    Raises MessageError where names, sizes, times or codes are not right.
    """
    order = checks.joint_order("joint_names", message.joint_names, actuator_names)
    times = [stamps.from_duration(point.time_from_start) for point in message.points]
    offset = checks.point_times("the mode schedule", times)
    for index, point in enumerate(message.points):
        for field in ("velocities", "accelerations", "effort"):
            checks.empty(f"{field} of point {index}", getattr(point, field))
    rows = [point.positions for point in message.points]
    modes = checks.table(rows, order, lambda index: f"positions of point {index}")
    wrong = np.argwhere(~np.isin(modes, list(Mode)))
    if len(wrong) > 0:
        index, actuator = wrong[0]
        raise MessageError(
            f"the mode of {actuator_names[actuator]} at point {index} is "
            f"{modes[index, actuator]:g}; give 0 (N), 1 (DB) or 2 (SB)"
        )
    return ModeSchedule(stamps.from_time(message.header.stamp), offset, modes.astype(np.uint8))
