"""The recorder as a process on a real graph, its files read by an independent library."""

from __future__ import annotations

import os
import re
import signal
import time
from pathlib import Path

import pytest
import rclpy
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from mhsb_msgs_py import topics


@pytest.fixture
def node(ros_context):
    node = rclpy.create_node("suite", context=ros_context)
    yield node
    node.destroy_node()


def publish_numbers(node, recorder, count: int) -> None:
    """Publish joint states numbered by their position, at most 1 kHz, once the recorder hears."""
    topic = topics.JOINT_STATES
    publisher = node.create_publisher(topic.message, topic.name, topic.qos)
    status = topics.PLAN_STATUS
    node.create_publisher(status.message, status.name, status.qos)
    recorder.wait_for("ready")  # a match that this side sees may be news to the other one
    for number in range(count):
        publisher.publish(topic.message(name=["joint_1"], position=[float(number)]))
        time.sleep(0.001)
        if number % topic.qos.depth == 0:  # beyond its depth the publisher itself drops the oldest
            assert publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=10))
    assert publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=10))
    time.sleep(0.3)  # what has arrived is not yet written


def recorded(folder: Path, topic: str) -> list:
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(folder) as reader:
        connections = [each for each in reader.connections if each.topic == topic]
        return [
            store.deserialize_cdr(data, connection.msgtype)
            for connection, _, data in reader.messages(connections=connections)
        ]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_completes_the_recording_and_nothing_is_lost(node, start, tmp_path, number):
    recorder = start("mhsb_tools", "mhsb", "record", "--output", tmp_path / "bag")
    publish_numbers(node, recorder, 500)
    assert recorder.stop(number) == 0
    assert recorder.output.endswith(f"recorded 500 messages in {tmp_path / 'bag'}\n")
    positions = [message.position[0] for message in recorded(tmp_path / "bag", "/joint_states")]
    assert positions == list(range(500))


def test_what_was_latched_before_the_recorder_came_is_recorded(node, start, tmp_path):
    topic = topics.PLAN_IN_FORCE
    node.create_publisher(topic.message, topic.name, topic.qos).publish(topic.message(sec=42))
    recorder = start("mhsb_tools", "mhsb", "record", "--output", tmp_path / "bag", "--duration", 4)
    assert recorder.wait() == 0
    [message] = recorded(tmp_path / "bag", "/plan_in_force")
    assert message.sec == 42


def test_the_recorder_says_when_it_hears_both_nodes(node, start, tmp_path):
    recorder = start("mhsb_tools", "mhsb", "record", "--output", tmp_path / "bag")
    recorder.wait_for("recording into")
    for topic in (topics.JOINT_STATES, topics.PLAN_STATUS):
        assert "ready" not in recorder.output
        node.create_publisher(topic.message, topic.name, topic.qos)
    recorder.wait_for("ready: simulator and planner are heard")
    assert recorder.stop() == 0


def test_a_recorder_in_a_namespace_records_that_namespace(node, start, tmp_path):
    recorder = start(
        "mhsb_tools",
        "mhsb",
        "record",
        "--output",
        tmp_path / "bag",
        "--ros-args",
        "-r",
        "__ns:=/left",
    )
    recorder.wait_for("recording into")
    topic = topics.JOINT_STATES
    publisher = node.create_publisher(topic.message, f"/left/{topic.name}", topic.qos)
    status = topics.PLAN_STATUS
    node.create_publisher(status.message, f"/left/{status.name}", status.qos)
    recorder.wait_for("ready")
    publisher.publish(topic.message(name=["joint_1"]))
    assert publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=10))
    time.sleep(0.3)
    assert recorder.stop() == 0
    assert len(recorded(tmp_path / "bag", "/left/joint_states")) == 1


def test_a_killed_recorder_leaves_a_recording_that_repair_completes(
    node, start, eventually, tmp_path
):
    recorder = start("mhsb_tools", "mhsb", "record", "--output", tmp_path / "bag")
    publish_numbers(node, recorder, 3000)
    file = tmp_path / "bag" / "bag_0.mcap"
    eventually(lambda: file.stat().st_size > 250_000)
    assert recorder.stop(signal.SIGKILL) == -signal.SIGKILL

    repairer = start("mhsb_tools", "mhsb", "record", "--repair", tmp_path / "bag")
    assert repairer.wait() == 0
    positions = [message.position[0] for message in recorded(tmp_path / "bag", "/joint_states")]
    assert re.fullmatch(
        rf"kept {len(positions)} messages in {re.escape(str(tmp_path / 'bag'))}; lost at least 0 "
        r"messages, \d+ bytes; the damaged recording is kept as bag_0.mcap.torn\n",
        repairer.output,
    )
    assert positions == list(range(len(positions)))
    assert len(positions) > 2000


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (
            ["--output", "{bag}"],
            1,
            "mhsb record: {bag} is not empty; remove it or name another folder",
        ),
        (
            ["--repair", "{bag}"],
            1,
            "mhsb record: {bag} holds no file bag_0.mcap; name the folder of a recording",
        ),
        ([], 2, "mhsb record: give either --output DIR or --repair DIR; see mhsb record --help"),
        (
            ["--output", "{bag}", "--duration", "-2"],
            2,
            "mhsb record: --duration must be from 0.001 to 1e+09 (is -2.0)",
        ),
    ],
)
def test_what_cannot_be_done_is_told_in_one_sentence(start, tmp_path, arguments, code, sentence):
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "notes.txt").write_text("precious")
    recorder = start("mhsb_tools", "mhsb", "record", *[word.format(bag=bag) for word in arguments])
    assert recorder.wait() == code
    assert recorder.output == sentence.format(bag=bag) + "\n"
    assert os.listdir(bag) == ["notes.txt"]
