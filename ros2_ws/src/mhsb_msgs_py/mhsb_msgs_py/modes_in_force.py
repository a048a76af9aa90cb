"""Codec of the modes in force, uint8[actuators], as std_msgs/UInt8MultiArray."""

from array import array

import numpy as np
from std_msgs.msg import MultiArrayDimension, MultiArrayLayout, UInt8MultiArray

from mhsb_model.modes import Mode
from mhsb_model.types import ModeArray
from mhsb_msgs_py.errors import MessageError


def encode(modes: ModeArray) -> UInt8MultiArray:
    """Encode the modes of n actuators.

    Args:
        modes: Mode of each actuator, shape (n,): 0 (N, main pump alone), 1 (DB, own servo pump) or
            2 (SB, shared rail).

    Returns:
        The message.
    """
    count = len(modes)
    layout = MultiArrayLayout(dim=[MultiArrayDimension(label="actuator", size=count, stride=count)])
    return UInt8MultiArray(layout=layout, data=array("B", modes.astype(np.uint8).tolist()))


def decode(message: UInt8MultiArray, actuator_count: int) -> ModeArray:
    """Decode the modes of n actuators.

    Args:
        message: The message; its layout is not read.
        actuator_count: Expected number of actuators.

    Returns:
        Mode of each actuator, uint8[n]: 0 (N, main pump alone), 1 (DB, own servo pump) or 2 (SB,
        shared rail).

    Raises:
        MessageError: The number of modes is not `actuator_count`, or a mode is not 0, 1 or 2.
    """
    modes = np.asarray(message.data, dtype=np.uint8)
    if len(modes) != actuator_count:
        raise MessageError(
            f"modes has {len(modes)} values; give one for each of {actuator_count} actuators"
        )
    wrong = ~np.isin(modes, list(Mode))
    if np.any(wrong):
        raise MessageError(
            f"the mode of actuator {int(np.argmax(wrong)) + 1} is {modes[wrong][0]}; "
            "give 0 (N), 1 (DB) or 2 (SB)"
        )
    return modes
