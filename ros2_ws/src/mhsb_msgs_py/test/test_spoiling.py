"""Spoilt messages: other than the good one, still of its type, the same for the same seed."""

from __future__ import annotations

import copy
import random

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from tests.support import spoiling
from tests.support.messages import encode_trajectory

from mhsb_model.goal import Goal
from mhsb_model.trajectory import Trajectory
from mhsb_msgs_py import goal_pose, names


def path_message():
    rows = np.zeros((4, 3))
    path = Trajectory(7, 20_000_000 * np.arange(4), rows, rows, rows)
    return encode_trajectory(path, names.joint_names(3))


GOOD = {"goal": goal_pose.encode(Goal(7, 0.5, 0.1)), "path": path_message()}


@pytest.mark.parametrize("name", GOOD)
def test_a_spoilt_message_can_be_published_and_the_good_one_stays_good(name):
    good, before = GOOD[name], copy.deepcopy(GOOD[name])
    others = 0
    for seed in range(300):
        spoilt = spoiling.damage_message(good, random.Random(seed), times=2)
        data = serialize_message(spoilt)
        assert isinstance(deserialize_message(data, type(good)), type(good))
        others += data != serialize_message(good)
    assert good == before
    assert others > 200


def test_the_same_seed_spoils_in_the_same_way():
    one, other = (
        spoiling.damage_message(GOOD["path"], random.Random(5), times=4) for _ in range(2)
    )
    assert repr(one) == repr(other)
    data = serialize_message(GOOD["path"])
    assert spoiling.damage_bytes(data, random.Random(5)) == spoiling.damage_bytes(
        data, random.Random(5)
    )


def test_torn_bytes_differ_in_content_or_length():
    data = serialize_message(GOOD["goal"])
    torn = [spoiling.damage_bytes(data, random.Random(seed)) for seed in range(100)]
    assert sum(each != data for each in torn) > 95
    assert len({len(each) for each in torn}) > 10
