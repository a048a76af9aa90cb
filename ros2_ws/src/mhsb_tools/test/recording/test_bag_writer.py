"""Recordings are read back by an independent library, also what a kill has left of them."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys

import pytest
from mcap.reader import make_reader
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState

from mhsb_msgs_py import qos
from mhsb_tools.recording import bag_format
from mhsb_tools.recording.bag_format import BagError, BagTopic
from mhsb_tools.recording.bag_repair import repair_recording
from mhsb_tools.recording.bag_writer import BagWriter

STATES = BagTopic("/joint_states", "sensor_msgs/msg/JointState", bag_format.format_qos(qos.DEFAULT))
MODES = BagTopic("/modes", "std_msgs/msg/UInt8MultiArray", bag_format.format_qos(qos.LATCHED))
START = 1_700_000_000_000_000_000


def joint_state(number: int) -> bytes:
    message = JointState(name=["joint_1"], position=[float(number)], velocity=[0.0], effort=[0.0])
    return serialize_message(message)


def write_states(bag: BagWriter, count: int) -> None:
    bag.add_topic(STATES)
    bag.add_topic(MODES)
    for number in range(count):
        bag.write(STATES.name, joint_state(number), START + number * 10_000_000, START)


def positions(folder) -> list[float]:
    """What rosbags reads from a recording."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(folder) as reader:
        return [
            float(store.deserialize_cdr(data, connection.msgtype).position[0])
            for connection, _, data in reader.messages()
        ]


def test_an_independent_reader_finds_every_message(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        write_states(bag, 2000)
    assert positions(tmp_path / "bag") == [float(number) for number in range(2000)]


def test_an_independent_reader_understands_the_metadata(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        write_states(bag, 300)
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 300
        assert reader.start_time == START
        assert reader.duration == 2_990_000_000 + 1  # rosbags counts the last nanosecond in
        assert reader.ros_distro == "jazzy"
        by_topic = {each.topic: each for each in reader.connections}
        assert by_topic["/joint_states"].msgcount == 300
        assert by_topic["/joint_states"].digest == bag_format.compute_type_hash(STATES.type_name)
        assert by_topic["/modes"].msgcount == 0
        assert by_topic["/modes"].ext.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"


def test_the_file_itself_is_indexed_and_says_that_it_is_of_ros(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        write_states(bag, 2000)
    with bag.path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
        assert summary is not None
        assert summary.statistics.message_count == 2000
        assert len(summary.chunk_indexes) > 3
        [channel] = [each for each in summary.channels.values() if each.topic == "/joint_states"]
        assert channel.metadata["topic_type_hash"] == bag_format.compute_type_hash(STATES.type_name)


def test_a_folder_that_holds_something_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("precious")
    with pytest.raises(BagError) as refusal:
        BagWriter(tmp_path)
    assert str(refusal.value) == f"{tmp_path} is not empty; remove it or name another folder"
    assert (tmp_path / "notes.txt").read_text() == "precious"


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match=r"cannot write the recording .*: Not a directory"):
        BagWriter(tmp_path / "file" / "bag")


def test_a_full_disk_is_told_and_what_was_written_can_be_repaired(tmp_path):
    """A limit on file size stands for the full disk; it fails the same calls."""
    script = f"""
import sys
sys.path.insert(0, {os.path.dirname(__file__)!r})
from pathlib import Path
from test_bag_writer import BagError, BagWriter, write_states
try:
    with BagWriter(Path({str(tmp_path / "bag")!r})) as bag:
        write_states(bag, 10_000)
except BagError as error:
    print(error)
"""
    limit = 300_000
    child = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert child.stdout == f"cannot write the recording {tmp_path / 'bag'}: File too large\n"
    assert child.stderr == ""
    kept = repair_recording(tmp_path / "bag").kept
    assert kept > 1000
    assert positions(tmp_path / "bag") == [float(number) for number in range(kept)]


def test_a_kill_loses_the_last_chunk_alone(tmp_path):
    script = f"""
import os, signal, sys
sys.path.insert(0, {os.path.dirname(__file__)!r})
from pathlib import Path
from test_bag_writer import BagWriter, write_states
bag = BagWriter(Path({str(tmp_path / "bag")!r}))
write_states(bag, 5000)
bag.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""
    child = subprocess.run([sys.executable, "-c", script], check=False)
    assert child.returncode == -signal.SIGKILL
    kept = repair_recording(tmp_path / "bag").kept
    per_chunk = 32 * 1024 // len(joint_state(0))
    assert 5000 - per_chunk <= kept < 5000
    assert positions(tmp_path / "bag") == [float(number) for number in range(kept)]
