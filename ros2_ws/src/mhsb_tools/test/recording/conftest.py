"""Recordings to be damaged: small, of every kind that is read, and what is in them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rclpy.serialization import serialize_message

from mhsb_msgs_py import joint_state, modes_in_force, names, topics
from mhsb_tools.recording import bag_format
from mhsb_tools.recording.bag_format import BagContents, BagTopic
from mhsb_tools.recording.bag_writer import BagWriter

JOINTS = names.joint_names(2)
START = 1_700_000_000_000_000_000  # ns
PERIOD = 10_000_000  # ns
FOREIGN_TYPE, FOREIGN_TEXT = "com3_msgs/msg/JointCmd", b"string[] joint_name\nfloat64[] position\n"


@dataclass(frozen=True)
class Original:
    """A sound recording.

    folder   where it is
    written  messages of each data file by the file's name: topic, time of recording [ns], content
    chunks   of each data file: bytes of the chunk's record, and the messages in it
    ends     of each data file: everything from the end of its data on, its summary
    """

    folder: Path
    written: dict[str, list[tuple[str, int, bytes]]]
    chunks: dict[str, list[tuple[bytes, list[tuple[str, int, bytes]]]]]
    ends: dict[str, bytes]


def messages_of(content: bytes | Path) -> list[tuple[str, int, bytes]]:
    """All messages that the mcap library reads from a file: topic, time of recording, content."""
    with open(content, "rb") as file:
        reader = make_reader(file)
        found = reader.iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in found]


def original(folder: Path) -> Original:
    """What the mcap library says of a sound recording."""
    written, chunks, ends = {}, {}, {}
    for path in sorted(folder.glob("*.mcap")):
        content, name = path.read_bytes(), path.name
        written[name] = messages_of(path)
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
        footer = int.from_bytes(content[-28:-20], "little")
        ends[name] = content[footer - 13 :]  # with the record that ends the data
        chunks[name] = []
        for index in summary.chunk_indexes:
            begin = index.chunk_start_offset
            inside = [
                each
                for each in written[name]
                if index.message_start_time <= each[1] <= index.message_end_time
            ]
            chunks[name].append((content[begin : begin + index.chunk_length], inside))
    return Original(folder, written, chunks, ends)


def state(number: int) -> bytes:
    """Serialized joint states of two joints, different for each number."""
    values = np.array([number, -number]) * 1e-3
    sample = joint_state.JointSample(number * PERIOD, values, values)
    return serialize_message(joint_state.encode(sample, JOINTS))


MODE = serialize_message(modes_in_force.encode(np.array([2, 0])))


def write_own(folder: Path, count: int = 1200, namespace: str = "", start: int = START) -> None:
    """A recording by the suite's own writer."""
    with BagWriter(folder) as bag:
        for topic in (topics.JOINT_STATES, topics.MODES, topics.ESTIMATES):
            qos = bag_format.format_qos(topic.qos)
            bag.add_topic(BagTopic(f"{namespace}/{topic.name}", topic.type_name, qos))
        for number in range(count):
            time_ns = start + number * PERIOD
            bag.write(f"{namespace}/joint_states", state(number), time_ns, time_ns)
            if number % 10 == 0:
                bag.write(f"{namespace}/modes", MODE + bytes([number % 256]), time_ns + 1, time_ns)


def write_other(
    folder: Path,
    parts: int = 1,
    count: int = 600,
    compression: CompressionType = CompressionType.NONE,
    foreign: bool = False,
    **options: object,
) -> None:
    """A recording as other programs write it, in several files possibly."""
    folder.mkdir(parents=True)
    files, topic = {}, topics.JOINT_STATES
    for part in range(parts):
        path = folder / f"{folder.name}_{part}.mcap"
        first, last = part * count // parts, (part + 1) * count // parts
        times = [START + number * PERIOD for number in range(first, last)]
        counts = {"/joint_states": len(times), "/zx200/front_cmd": len(times[::5]) * foreign}
        with path.open("wb") as stream:
            writer = Writer(stream, chunk_size=8192, compression=compression, **options)
            writer.start(profile="ros2", library="other")
            text = bag_format.get_type_definition(topic.type_name).encode()
            schemas = [writer.register_schema(topic.type_name, "ros2msg", text)]
            channels = [writer.register_channel("/joint_states", "cdr", schemas[0], {"key": "x"})]
            if foreign:
                schemas.append(writer.register_schema(FOREIGN_TYPE, "ros2msg", FOREIGN_TEXT))
                channels.append(writer.register_channel("/zx200/front_cmd", "cdr", schemas[1], {}))
            for number, time_ns in enumerate(times):
                data = state((time_ns - START) // PERIOD)
                writer.add_message(channels[0], time_ns, data, time_ns, number)
                if foreign and number % 5 == 0:
                    data = b"\x00\x01\x00\x00" + number.to_bytes(8, "little")
                    writer.add_message(channels[1], time_ns + 1, data, time_ns, number)
            writer.finish()
        kinds = {"/joint_states": topic.type_name, "/zx200/front_cmd": FOREIGN_TYPE}
        known = {name: bag_format.compute_type_hash(kind) for name, kind in kinds.items()}
        files[path.name] = BagContents(
            times[0],
            times[-1] + foreign,
            tuple(
                (BagTopic(name, kinds[name], "", "cdr", known[name]), number)
                for name, number in counts.items()
                if number
            ),
        )
    bag_format.write_metadata(folder, files)


KINDS: dict[str, Callable[[Path], None]] = {
    "own": write_own,
    "other": write_other,
    "split": lambda folder: write_other(folder, 3),
    "lz4": lambda folder: write_other(folder, compression=CompressionType.LZ4),
    "zstd": lambda folder: write_other(folder, compression=CompressionType.ZSTD),
    "foreign": lambda folder: write_other(folder, foreign=True),
    "without checksums": lambda folder: write_other(folder, enable_crcs=False),
    "with data checksum": lambda folder: write_other(folder, enable_data_crcs=True),
    "without index": lambda folder: write_other(
        folder, index_types=IndexType.NONE, use_summary_offsets=False
    ),
}
"""Functions that write a recording of a kind into a folder."""


@pytest.fixture(scope="session")
def originals(tmp_path_factory) -> dict[str, Original]:
    """A sound recording of each kind."""
    folder = tmp_path_factory.mktemp("originals")
    found = {}
    for kind, write in KINDS.items():
        write(folder / kind / "bag")
        found[kind] = original(folder / kind / "bag")
    # Other topics under the same ids, an hour or three later.
    write_own(folder / "second" / "bag", 300, "/second", START + 10**13)
    found["second"] = original(folder / "second" / "bag")
    return found


@pytest.fixture
def copy_of(originals, tmp_path) -> Callable[[str], Path]:
    """Function (kind) that copies the sound recording of a kind into a folder to be damaged."""

    def copy(kind: str) -> Path:
        shutil.copytree(originals[kind].folder, tmp_path / "bag", dirs_exist_ok=True)
        return tmp_path / "bag"

    return copy
