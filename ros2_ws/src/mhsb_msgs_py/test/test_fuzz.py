"""Whatever comes: each codec gives a domain object or one sentence, never anything else.

A few hundred messages of each kind every time, 100,000 with `scripts/test --slow`.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from tests.support import spoiling
from tests.support.messages import encode_schedule, encode_trajectory

from mhsb_model.arm_reports import HandOverOutcome, HandOverReport, SimulatorReport
from mhsb_model.goal import Goal
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import MotionState, Trajectory
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Outcome, PlanSummary, Verdict
from mhsb_msgs_py import (
    actuator_states,
    goal_pose,
    joint_state,
    mode_schedule,
    modes_in_force,
    names,
    plan_status,
    point_arrays,
    reference,
    sim_status,
    stamps,
    trajectory,
)
from mhsb_msgs_py.actuator_states import SAMPLE_FIELDS, ActuatorSample
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.joint_state import JointSample
from mhsb_msgs_py.reference import Reference

JOINTS, ACTUATORS = names.joint_names(3), names.actuator_names(3)
STAMP_NS = 1_700_000_000_123_456_789
SEEDS = st.integers(0, 2**64 - 1)
FEW, MANY = 200, 4500


class Codec(NamedTuple):
    """A good message, what reads its like, and whether that reads the message's bytes as well."""

    message: Any
    decode: Callable[[Any], Any]
    reads_bytes: bool = False


def rows(count: int) -> np.ndarray:
    return np.linspace(0.1, 0.3, 3 * count).reshape(count, 3)


def codecs() -> dict[str, Codec]:
    """Every codec, with a message that it accepts."""
    still = np.zeros((1, 3))
    path = Trajectory(
        STAMP_NS, np.arange(8) * 15_000_000, rows(8), np.vstack([rows(7), still]), rows(8)
    )
    schedule = ModeSchedule(STAMP_NS, [0, 40_000_000, 90_000_000], [[0, 1, 2], [0, 0, 1], [0] * 3])
    plan = PlanSummary(STAMP_NS, 100.0, 90.0, 4.0, 2, 40.0, 50.0, 60.0, True)
    accepted = GoalVerdict(Verdict.OK, "the tip goes", Goal(STAMP_NS, 0.5, 0.1), plan)
    ended = ExecutionReport(Outcome.ABORTED, "too late", STAMP_NS, STAMP_NS, 3, 900.0)
    state = MotionState(*rows(3))
    refused = HandOverReport(HandOverOutcome.REFUSED, "it came too late", STAMP_NS)
    running = SimulatorReport("running", False, STAMP_NS, 1.0, 5.0, 6.0)
    sample = ActuatorSample(STAMP_NS, **dict.fromkeys(SAMPLE_FIELDS, np.arange(3.0)))
    return {
        "goal_pose": Codec(goal_pose.encode(Goal(STAMP_NS, 0.5, 0.1)), goal_pose.decode),
        "joint_trajectory": Codec(
            encode_trajectory(path, JOINTS),
            lambda message: trajectory.decode(message, JOINTS),
            reads_bytes=True,
        ),
        "mode_commands": Codec(
            encode_schedule(schedule, ACTUATORS),
            lambda message: mode_schedule.decode(message, ACTUATORS),
            reads_bytes=True,
        ),
        "reference": Codec(
            reference.encode(Reference(STAMP_NS, state), JOINTS),
            lambda message: reference.decode(message, JOINTS),
        ),
        "joint_states": Codec(
            joint_state.encode(JointSample(STAMP_NS, *rows(3)), JOINTS),
            lambda message: joint_state.decode(message, JOINTS),
        ),
        "actuator_states": Codec(
            actuator_states.encode(sample, ACTUATORS),
            lambda message: actuator_states.decode(message, ACTUATORS),
        ),
        "modes": Codec(
            modes_in_force.encode(np.array([0, 1, 2], dtype=np.uint8)),
            lambda message: modes_in_force.decode(message, 3),
        ),
        "plan_in_force": Codec(stamps.to_time(STAMP_NS), stamps.from_time),
        "verdict": Codec(plan_status.encode(accepted, STAMP_NS), plan_status.decode),
        "execution": Codec(plan_status.encode(ended, STAMP_NS), plan_status.decode),
        "hand_over": Codec(sim_status.encode(refused, STAMP_NS), sim_status.decode),
        "simulator": Codec(sim_status.encode(running, STAMP_NS), sim_status.decode),
    }


def read(codec: Codec, message: Any) -> bool:
    """Read a message; nothing but `MessageError` may come of it, with one sentence."""
    sentence = ""
    try:
        codec.decode(message)
    except MessageError as error:
        sentence = str(error)
        assert_a_sentence(sentence)
    return not sentence


def assert_a_sentence(text: str) -> None:
    assert 10 <= len(text) < 500
    assert text.isprintable()


def read_spoilt(codec: Codec, seed: int) -> None:
    """A spoilt message; where its bytes are read, too, they must be worth as much."""
    source = random.Random(seed)
    message = spoiling.damage_message(codec.message, source, source.choice((1, 1, 1, 2, 5)))
    readable = read(codec, message)
    if codec.reads_bytes:
        assert read(codec, serialize_message(message)) == readable


def read_torn(codec: Codec, seed: int) -> None:
    """Torn bytes, as the middleware lets them through, or as a node reads them itself."""
    kind = type(codec.message)
    data = spoiling.damage_bytes(serialize_message(codec.message), random.Random(seed))
    if codec.reads_bytes:
        read(codec, data)
        read(Codec(data, point_arrays.read_stamp), data)
    try:
        message = deserialize_message(data, kind)
    except Exception:  # whatever the middleware says of bytes that it cannot read
        return
    read(codec, message)


@pytest.mark.parametrize("name", codecs())
def test_a_good_message_is_read(name):
    codec = codecs()[name]
    assert read(codec, codec.message)


def test_very_many_names_are_refused_at_once():
    codec = codecs()["joint_states"]
    codec.message.name = [f"joint_{number % 50_000}" for number in range(100_000)]
    assert not read(codec, codec.message)


@pytest.mark.parametrize("name", codecs())
@settings(max_examples=FEW, derandomize=False)
@given(seed=SEEDS)
def test_spoilt_messages_are_read_or_refused_with_a_sentence(name, seed):
    read_spoilt(CODECS[name], seed)


@pytest.mark.parametrize("name", codecs())
@settings(max_examples=FEW, derandomize=False)
@given(seed=SEEDS)
def test_torn_bytes_are_read_or_refused(name, seed):
    read_torn(CODECS[name], seed)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", codecs())
@settings(max_examples=MANY, derandomize=False)
@given(seed=SEEDS)
def test_many_spoilt_messages_are_read_or_refused_with_a_sentence(name, seed):
    read_spoilt(CODECS[name], seed)
    read_torn(CODECS[name], seed)


CODECS = codecs()
