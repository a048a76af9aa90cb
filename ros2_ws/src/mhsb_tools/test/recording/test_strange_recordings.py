"""Recordings of strangers: one sentence, within bounds of memory and time, whatever is in them."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import lz4.frame
import pytest
import yaml
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Schema
from mcap.writer import CompressionType, Writer
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from mhsb_msgs_py import topics
from mhsb_msgs_py.stamps import LATEST_PRESENT
from mhsb_tools.recording import bag_format
from mhsb_tools.recording.bag_format import BagContents, BagError, BagTopic
from mhsb_tools.recording.bag_reader import read_recording
from mhsb_tools.recording.bag_repair import repair_recording
from mhsb_tools.recording.mcap_records import (
    MAX_CHUNK_SIZE,
    RECORD_HEADER,
    parse_definition,
)
from mhsb_tools.recording.recording import check_order

MAGIC = b"\x89MCAP0\r\n"
START = 1_700_000_000_000_000_000  # ns
MEBIBYTE = 1024 * 1024
MEMORY = 64 * MEBIBYTE
"""Beside two of the largest chunk [bytes]."""


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(words: str) -> bytes:
    return struct.pack("<I", len(words)) + words.encode()


def chunk(packed: bytes, compression: str, size: int, checksum: int = 0) -> bytes:
    """A chunk's record of which the size unpacked, and the rest, is as stated."""
    head = struct.pack("<QQQI", START, START, size, checksum) + text(compression)
    return record(6, head + struct.pack("<Q", len(packed)) + packed)


def definitions(topic: str = "/joint_states", kind: str = "sensor_msgs/msg/JointState") -> bytes:
    schema = struct.pack("<H", 1) + text(kind) + text("ros2msg") + text("")
    channel = struct.pack("<HH", 1, 1) + text(topic) + text("cdr") + struct.pack("<I", 0)
    return record(3, schema) + record(4, channel)


def message(data: bytes, channel_id: int = 1) -> bytes:
    return record(5, struct.pack("<HIQQ", channel_id, 0, START, START) + data)


STATE = serialize_message(JointState(name=["joint_1", "joint_2"], position=[0.0] * 2,
                                     velocity=[0.0] * 2))  # fmt: skip


def folder_of(path: Path, *records: bytes) -> Path:
    """A recording of these records, without its end and metadata."""
    path.mkdir()
    header = record(1, text("ros2") + text("stranger"))
    (path / "bag_0.mcap").write_bytes(MAGIC + header + b"".join(records))
    return path


def recording_of(path: Path, *messages: tuple[str, str, bytes]) -> Path:
    """A complete recording of messages: topic, type, content."""
    path.mkdir()
    counts: dict[BagTopic, int] = {}
    with (path / "bag_0.mcap").open("wb") as stream:
        writer, channels = Writer(stream, compression=CompressionType.NONE), {}
        writer.start("ros2", "stranger")
        for number, (topic, kind, data) in enumerate(messages):
            if (topic, kind) not in channels:
                schema = writer.register_schema(kind, "ros2msg", b"")
                channels[topic, kind] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic, kind], START + number, data, START, number)
            named = BagTopic(topic, kind, "", type_hash="")
            counts[named] = counts.get(named, 0) + 1
        writer.finish()
    contents = BagContents(START, START + len(messages) - 1, tuple(counts.items()))
    bag_format.write_metadata(path, {"bag_0.mcap": contents})
    return path


def sentence_of(function, *arguments) -> str:
    """The one sentence with which something is refused."""
    with pytest.raises(BagError) as refusal:
        function(*arguments)
    words = str(refusal.value)
    assert "\n" not in words
    assert len(words) < 600
    return words


# --- Messages ------------------------------------------------------------------------------------

LONG_ARRAY = b"\x00\x01\x00\x00" + bytes(8) + struct.pack("<I", 1) + bytes(4) + b"\xff" * 4
NO_POINTS = b"\x00\x01\x00\x00" + bytes(8) + struct.pack("<IIIII", 1, 0, 0, 0, 1) + bytes(60)
"""A trajectory without points with more bytes behind it, found by coverage-guided fuzzing."""

GARBAGE = [
    b"",
    b"\x00",
    b"\x00\x01\x00\x00",
    b"\x03\x04\x7f" * 70,
    b"\xff" * 200,
    LONG_ARRAY,
    NO_POINTS,
]


@pytest.mark.parametrize("topic", topics.SUITE_TOPICS, ids=lambda each: each.name)
def test_garbage_on_a_topic_is_left_out_and_told(tmp_path, topic):
    name = topic.name if topic.name.startswith("/") else f"/{topic.name}"
    good = ("/joint_states", "sensor_msgs/msg/JointState", STATE)
    recording_of(tmp_path / "bag", good, *((name, topic.type_name, each) for each in GARBAGE))
    recording = read_recording(tmp_path / "bag")
    assert len(recording.joint_states.time_ns) == 1
    assert len(recording.unreadable) <= len(GARBAGE)
    assert all("\n" not in each and len(each) < 600 for each in recording.unreadable)


def test_a_recording_of_garbage_alone_is_refused(tmp_path):
    kind = "sensor_msgs/msg/JointState"
    recording_of(tmp_path / "bag", *(("/joint_states", kind, each) for each in GARBAGE))
    assert "no messages on /joint_states that can be read: 0 bytes" in sentence_of(
        read_recording, tmp_path / "bag"
    )


def values(number: float, name: str = "joint_1") -> bytes:
    """Serialized joint states of one joint."""
    return serialize_message(JointState(name=[name], position=[number], velocity=[0.0]))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (values(float("nan")), "position has nan for name 1; give finite numbers"),
        (values(1e300), "a number is beyond 1e+15; no measurement is"),
        (values(0.0, "elbow"), "joint states: elbow unknown"),
        (serialize_message(JointState()), "they are of 0 joints; at most 64 are read"),
        (serialize_message(JointState(name=["a"] * 65)), "they are of 65 joints"),
    ],
    ids=["nan", "beyond_1e15", "unknown_name", "no_joint", "65_joints"],  # padding bytes differ
)
def test_joint_states_that_are_no_measurement_are_refused_in_one_sentence(tmp_path, data, words):
    recording_of(tmp_path / "bag", ("/joint_states", "sensor_msgs/msg/JointState", data))
    assert words in sentence_of(read_recording, tmp_path / "bag")


def test_times_that_run_backwards_are_refused_in_one_sentence(tmp_path):
    """Also where the recording's own times do not, and decades later."""
    messages = [JointState(name=["joint_1"], position=[0.0], velocity=[0.0]) for _ in range(3)]
    for message_, second in zip(messages, (5, LATEST_PRESENT, 0), strict=True):
        message_.header.stamp.sec = second
    kind = "sensor_msgs/msg/JointState"
    data = [("/joint_states", kind, serialize_message(each)) for each in messages]
    recording = read_recording(recording_of(tmp_path / "bag", *data))
    assert "time runs backwards" in sentence_of(check_order, recording)


def test_a_topic_of_another_type_is_told_by_both_names(tmp_path):
    other = ("/modes", "std_msgs/msg/String", serialize_message(String(data="words")))
    good = ("/joint_states", "sensor_msgs/msg/JointState", STATE)
    recording_of(tmp_path / "bag", good, other)
    assert read_recording(tmp_path / "bag").unreadable == (
        "modes: was recorded as std_msgs/msg/String; it must be std_msgs/msg/UInt8MultiArray",
    )
    recording_of(tmp_path / "other", ("/joint_states", *other[1:]))
    assert "was recorded as std_msgs/msg/String" in sentence_of(read_recording, tmp_path / "other")


def test_sentences_about_unreadable_messages_are_bounded(tmp_path):
    good = ("/joint_states", "sensor_msgs/msg/JointState", STATE)
    bad = ("/modes", "std_msgs/msg/UInt8MultiArray", b"\xff" * 9)
    recording_of(tmp_path / "bag", good, *[bad] * 3000)
    unreadable = read_recording(tmp_path / "bag").unreadable
    assert len(unreadable) == 1001
    assert unreadable[-1] == "and 2000 more"


# --- Chunks and records --------------------------------------------------------------------------

ZEROS = zstandard.compress(bytes(64 * MEBIBYTE))
BOMBS = {
    "a chunk of 0.8 GB": chunk(zstandard.compress(bytes(800 * MEBIBYTE)), "zstd", 800 * MEBIBYTE),
    "one that states less": chunk(ZEROS, "zstd", 100),
    "one that states more": chunk(zstandard.compress(bytes(100)), "zstd", 60 * MEBIBYTE),
    "an lz4 bomb": chunk(lz4.frame.compress(bytes(200 * MEBIBYTE)), "lz4", 200 * MEBIBYTE),
    "an lz4 bomb that states less": chunk(lz4.frame.compress(bytes(200 * MEBIBYTE)), "lz4", 9),
    "an unknown compression": chunk(bytes(100), "brotli", 100),
    "a large window": chunk(b"\x28\xb5\x2f\xfd\x00\xa8" + bytes(50), "zstd", 100),
    "a record of 2^63 bytes": struct.pack("<BQ", 6, 2**63) + bytes(100),
    "a message of 2^40 bytes": struct.pack("<BQ", 5, 2**40) + bytes(100),
    "a schema of 4 GB": record(3, struct.pack("<HI", 1, 2**32 - 1) + bytes(100)),
    "a list of 4 GB": record(4, struct.pack("<HH", 1, 1) + text("/a") + text("b") + b"\xff" * 4),
    "an index of 4 GB": record(7, struct.pack("<HI", 1, 2**32 - 16) + bytes(100)),
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_in_one_sentence_and_what_is_good_beside_it_kept(tmp_path, name):
    good = definitions() + message(STATE)
    good = chunk(good, "", len(good), zlib.crc32(good))
    alone = folder_of(tmp_path / "alone", BOMBS[name])
    assert "nothing can be read" in sentence_of(repair_recording, alone)
    beside = folder_of(tmp_path / "beside", BOMBS[name], good, BOMBS[name])
    assert repair_recording(beside).kept == 1
    recording = read_recording(beside)
    assert len(recording.joint_states.time_ns) == 1


def test_a_chunk_above_the_bound_is_refused_by_its_size_before_it_is_unpacked(tmp_path):
    size = MAX_CHUNK_SIZE + 1
    folder = folder_of(tmp_path / "bag", chunk(zstandard.compress(bytes(size)), "zstd", size))
    assert f"a chunk states {size} bytes unpacked, above the bound of {MAX_CHUNK_SIZE}" in (
        sentence_of(repair_recording, folder)
    )


MEASURED = """
import json, sys
from pathlib import Path
from mhsb_tools.recording.bag_format import BagError
from mhsb_tools.recording.bag_reader import read_recording
from mhsb_tools.recording.bag_repair import repair_recording

def peak():
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))

print(peak())
for folder in sys.argv[1:]:
    try:
        repair_recording(Path(folder))
        read_recording(Path(folder))
    except BagError as error:
        assert "\\n" not in str(error)
    print(peak())
"""


@pytest.mark.parametrize(
    "size", [8 * MEBIBYTE, pytest.param(63 * MEBIBYTE, marks=pytest.mark.slow)]
)
def test_memory_stays_below_the_bound(tmp_path, size):
    """Bombs of every kind, then chunks full of tiny messages or of a single one."""
    small = definitions("/other") + message(b"") * (size // len(message(b"")))
    large = definitions("/other") + message(bytes(size))
    folders = [folder_of(tmp_path / str(n), each) for n, each in enumerate(BOMBS.values())]
    for name, content in (("small", small), ("large", large)):
        packed = zstandard.compress(content)
        whole = chunk(packed, "zstd", len(content), zlib.crc32(content))
        folders.append(folder_of(tmp_path / name, whole))
        folders.append(folder_of(tmp_path / f"{name} plain", content))
    child = subprocess.run(
        [sys.executable, "-c", MEASURED, *map(str, folders)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert child.stderr == ""
    idle, *peaks = map(int, child.stdout.split())
    used = [(peak - idle) // MEBIBYTE for peak in peaks]
    assert len(peaks) == len(folders)
    assert max(used[: len(BOMBS)]) < 16, used
    assert max(peaks) - idle < MEMORY + 2 * size, used
    assert all((each / "bag_0.mcap.torn").exists() for each in folders[len(BOMBS) :])


# --- Files ---------------------------------------------------------------------------------------


def pipe(path: Path) -> None:
    os.mkfifo(path)


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def loop(path: Path) -> None:
    path.symlink_to(path)


def hanging_link(path: Path) -> None:
    path.symlink_to(path.with_name("nowhere"))


def folder(path: Path) -> None:
    path.mkdir()


@pytest.mark.parametrize("make", [pipe, device, loop, hanging_link, folder])
@pytest.mark.parametrize("name", ["bag_0.mcap", "metadata.yaml"])
def test_what_is_no_regular_file_is_refused_at_once(tmp_path, make, name):
    bag = recording_of(tmp_path / "bag", ("/joint_states", "sensor_msgs/msg/JointState", STATE))
    (bag / name).unlink()
    make(bag / name)
    for function in (read_recording, repair_recording):
        assert f"{name} cannot be read: " in sentence_of(function, bag)


def test_a_hole_of_a_terabyte_takes_no_time(tmp_path):
    bag = folder_of(tmp_path / "bag", definitions(), message(STATE))
    os.truncate(bag / "bag_0.mcap", 2**40)
    (bag / "metadata.yaml").write_text(metadata())
    assert "is damaged" in sentence_of(read_recording, bag)
    assert repair_recording(bag).kept == 1


# --- Metadata ------------------------------------------------------------------------------------


def metadata(**changes: object) -> str:
    content = {
        "version": 9,
        "storage_identifier": "mcap",
        "message_count": 1,
        "compression_mode": "",
        "relative_file_paths": ["bag_0.mcap"],
        "files": [],
    }
    return yaml.safe_dump({"rosbag2_bagfile_information": content | changes})


DAMAGED_METADATA = {
    "nested lists": "[" * 200_000,
    "nested sections": "".join(f"{' ' * n}a:\n" for n in range(1000)),
    "aliases": "a: &a [1, 1]\nb: &b [*a, *a]\nc: [*b, *b]\n",
    "itself": "&a [*a]",
    "no YAML": "a: [b\n",
    "no text": "\xff\xfe",
    "nothing": "",
    "a number": "1",
    "a list": "- 1",
    "a long number": metadata(message_count="9" * 60_000),
    "a negative number": metadata(message_count=-1),
    "no files": metadata(relative_file_paths=[]),
    "files of another kind": metadata(relative_file_paths=[{"a": 1}]),
    "files elsewhere": metadata(relative_file_paths=["../../../etc/passwd"]),
    "one file twice": metadata(relative_file_paths=["bag_0.mcap"] * 2),
    "a missing file": metadata(relative_file_paths=["bag_0.mcap", "bag_7.mcap"]),
    "a tag": "!!python/object/apply:os.system ['true']",
    "large": "# " + "a" * 2 * MEBIBYTE,
}


@pytest.mark.parametrize("name", DAMAGED_METADATA)
def test_damaged_metadata_are_refused_in_one_sentence_and_written_anew(tmp_path, name):
    bag = recording_of(tmp_path / "bag", ("/joint_states", "sensor_msgs/msg/JointState", STATE))
    (bag / "metadata.yaml").write_text(DAMAGED_METADATA[name], encoding="latin-1")
    content = (bag / "bag_0.mcap").read_bytes()
    assert "record --repair" in sentence_of(read_recording, bag)
    assert repair_recording(bag).kept == 1
    assert (bag / "bag_0.mcap").read_bytes() == content
    assert (bag / "metadata.yaml.torn").read_text("latin-1") == DAMAGED_METADATA[name]
    assert len(read_recording(bag).joint_states.time_ns) == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"storage_identifier": "sqlite3"}, "is stored as 'sqlite3', which is not read; convert"),
        ({"compression_mode": "MESSAGE"}, "is compressed by rosbag2"),
    ],
)
def test_kinds_of_recordings_that_are_not_read_are_named_and_left_alone(tmp_path, change, words):
    bag = recording_of(tmp_path / "bag", ("/joint_states", "sensor_msgs/msg/JointState", STATE))
    (bag / "metadata.yaml").write_text(metadata(**change))
    for function in (read_recording, repair_recording):
        assert words in sentence_of(function, bag)


@pytest.mark.parametrize(
    "qos", ["[" * 5000, "&a [*a]", "!!python/name:os.system", "a: b", "\0", "- 0x" + "f" * 60_000]
)
def test_strange_quality_of_service_does_not_stop_a_repair(tmp_path, qos):
    bag = tmp_path / "bag"
    bag.mkdir()
    with (bag / "bag_0.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
        channel = writer.register_channel(
            "/joint_states", "cdr", schema, {"offered_qos_profiles": qos}
        )
        writer.add_message(channel, START, STATE, START)
        writer.finish()
    assert repair_recording(bag).kept == 1
    whole = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    [topic] = whole["topics_with_message_count"]
    assert topic["topic_metadata"]["offered_qos_profiles"] == []
    assert repair_recording(bag).is_complete


@pytest.mark.parametrize(
    ("type_name", "begin"), [("sensor_msgs/msg/JointState", b"std_msgs/Header"), ("a/msg/B", b"")]
)
def test_a_message_definition_that_is_no_text_is_replaced_by_that_of_its_type(type_name, begin):
    """A file without checksums does not show that its bytes have changed."""
    damaged = Schema(7, b"string\xa4] name", "ros2msg", type_name)
    damaged.write(builder := RecordBuilder())
    content = bytes(builder.end())[RECORD_HEADER.size :]
    found = parse_definition(Opcode.SCHEMA, content)
    assert (found.id, found.name, found.encoding) == (7, type_name, "ros2msg")
    assert found.data[: len(begin)] == begin
    assert bool(found.data) is bool(begin)
