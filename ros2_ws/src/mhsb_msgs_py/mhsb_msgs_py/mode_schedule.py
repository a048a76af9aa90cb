"""Codec of `ModeSchedule` as trajectory_msgs/JointTrajectory, for the topic mode_commands.

Positions are exactly 0, 1 or 2 for N, DB, SB. Each point holds until the next one.
"""

from collections.abc import Sequence

import numpy as np
from trajectory_msgs.msg import JointTrajectory

from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_msgs_py import checks, point_arrays
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.point_arrays import PointArrays

MOST_POINTS = 10_000
"""Largest number of points that an arm accepts."""


def to_bytes(schedule: ModeSchedule, actuator_names: Sequence[str]) -> bytes:
    """Encode a schedule as the serialized bytes of its message.

    The result equals what rclpy makes of the message, and takes less time.

    Args:
        schedule: The schedule of n actuators.
        actuator_names: Names of the n actuators.

    Returns:
        Serialized message.
    """
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
    """Decode a message, or its bytes, to a schedule.

    Args:
        message: The message, with its actuators in any order.
        actuator_names: Names of the actuators in the order of the result.

    Returns:
        The schedule; its `last_switch_ns` is None.

    Raises:
        MessageError: One of these holds. The bytes are no such message. The nanoseconds of a time
            make a second or more. There is no point, or there are more than MOST_POINTS. A
            name is missing, unknown or given twice. The times do not start at 0 or do not increase.
            A point lacks a position for an actuator. A position is not 0, 1 or 2. A point has
            velocities, accelerations or efforts.
    """
    given = point_arrays.read_point_arrays(message, "the mode schedule", MOST_POINTS)
    order = checks.find_joint_order("joint_names", given.joint_names, actuator_names)
    offset = checks.check_point_times("the mode schedule", given.time_ns)
    checks.check_empty_rows("velocities", given.velocities)
    checks.check_empty_rows("accelerations", given.accelerations)
    checks.check_empty_rows("effort", given.effort)
    modes = checks.check_point_table("positions", given.positions, order)
    wrong = np.argwhere(~np.isin(modes, list(Mode)))
    if len(wrong) > 0:
        index, actuator = wrong[0]
        raise MessageError(
            f"the mode of {actuator_names[actuator]} at point {index} is "
            f"{modes[index, actuator]:g}; give 0 (N), 1 (DB) or 2 (SB)"
        )
    return ModeSchedule(given.stamp_ns, offset, modes.astype(np.uint8))
