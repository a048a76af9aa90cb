"""Codec of the modes in force."""

from __future__ import annotations

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import UInt8MultiArray

from mhsb_msgs_py import modes_in_force as codec
from mhsb_msgs_py.errors import MessageError


def test_modes_come_back_from_the_wire_and_are_the_message_data():
    message = codec.encode(np.array([2, 0, 1], dtype=np.uint8))
    assert list(message.data) == [2, 0, 1]
    back = deserialize_message(serialize_message(message), UInt8MultiArray)
    assert codec.decode(back, 3).tolist() == [2, 0, 1]


def test_a_message_published_by_hand_without_a_layout_is_read():
    assert codec.decode(UInt8MultiArray(data=[1, 1]), 2).tolist() == [1, 1]


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ([0, 0], "modes has 2 values; give one for each of 3 actuators"),
        ([0, 7, 0], "the mode of actuator 2 is 7; give 0 (N), 1 (DB) or 2 (SB)"),
    ],
)
def test_each_fault_is_told_in_one_sentence(data, sentence):
    with pytest.raises(MessageError) as refusal:
        codec.decode(UInt8MultiArray(data=data), 3)
    assert str(refusal.value) == sentence
