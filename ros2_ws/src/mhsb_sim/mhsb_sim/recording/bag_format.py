"""What a rosbag2 folder consists of: file names, message types, metadata (version 9)."""

from __future__ import annotations

import contextlib
import functools
import os
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from mhsb_model.errors import MhsbError
from mhsb_sim.recording import bounded_yaml

METADATA_FILE = "metadata.yaml"
METADATA_KEY = "rosbag2_bagfile_information"
METADATA_VERSION = 9
STORAGE = "mcap"
SERIALIZATION = "cdr"
SCHEMA_ENCODING = "ros2msg"
PROFILE = "ros2"
LONGEST_QOS = 64 * 1024
"""Characters of a topic's QoS that are read; each publisher takes 400."""

FOREVER = {"sec": 9223372036, "nsec": 854775807}  # how ROS writes a time that is not limited


class BagError(MhsbError):
    """A recording cannot be written, read or repaired."""


@dataclass(frozen=True)
class BagTopic:
    """A recorded topic: its absolute name, ROS type as `std_msgs/msg/String`, QoS as YAML.

    encoding   of its messages
    type_hash  of its type; None for that of the type of this name
    """

    name: str
    type_name: str
    qos: str
    encoding: str = SERIALIZATION
    type_hash: str | None = None


@dataclass(frozen=True)
class BagContents:
    """What a finished recording holds: times in ns since the epoch, messages for each topic."""

    start_ns: int
    end_ns: int
    counts: tuple[tuple[BagTopic, int], ...]

    @property
    def message_count(self) -> int:
        """Messages on all topics."""
        return sum(count for _, count in self.counts)


def merged(parts: Sequence[BagContents]) -> BagContents:
    """Return what several files hold together; topics in the order in which they come."""
    counts: Counter[BagTopic] = Counter()
    for part in parts:
        for topic, count in part.counts:
            counts[topic] += count
    filled = [part for part in parts if part.message_count] or [BagContents(0, 0, ())]
    start_ns, end_ns = min(each.start_ns for each in filled), max(each.end_ns for each in filled)
    return BagContents(start_ns, end_ns, tuple(counts.items()))


def data_file(folder: Path) -> Path:
    """The one MCAP file of a recording."""
    return folder / f"{folder.resolve().name}_0.mcap"


@functools.cache
def typestore() -> Typestore:
    """Return the definitions of all message types of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


def definition(type_name: str) -> str:
    """Full text of a message type, with the types that it contains."""
    return typestore().generate_msgdef(type_name, ros_version=2)[0]


def type_hash(type_name: str) -> str:
    """Hash by which ROS 2 tells versions of a message type apart (REP 2011): `RIHS01_...`."""
    return typestore().hash_rihs01(type_name)


def known_definition(type_name: str) -> str:
    """Return the text of a type of ROS's own; an empty text for one that is not known here."""
    return definition(type_name) if type_name in typestore().fielddefs else ""


def known_type_hash(type_name: str) -> str:
    """Return the hash of a type of ROS's own; an empty text for one that is not known here."""
    return type_hash(type_name) if type_name in typestore().fielddefs else ""


def qos_text(profile: QoSProfile) -> str:
    """YAML of the QoS profile that a topic was offered with."""
    reliable = profile.reliability is ReliabilityPolicy.RELIABLE
    latched = profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    return _yaml(
        [
            {
                "history": "keep_last",
                "depth": profile.depth,
                "reliability": "reliable" if reliable else "best_effort",
                "durability": "transient_local" if latched else "volatile",
                "deadline": FOREVER,
                "lifespan": FOREVER,
                "liveliness": "automatic",
                "liveliness_lease_duration": FOREVER,
                "avoid_ros_namespace_conventions": False,
            }
        ]
    )


def metadata_text(files: Mapping[str, BagContents]) -> str:
    """Return the text that stands in an MCAP file; `metadata.yaml` has it under one more key.

    files: What each data file holds, by its name, in time order.
    """
    return _yaml(_metadata(files))


def write_metadata(folder: Path, files: Mapping[str, BagContents]) -> None:
    """Write `metadata.yaml` of these data files, whole or not at all."""
    text = _yaml({METADATA_KEY: _metadata(files)})
    descriptor, half = tempfile.mkstemp(".part", f".{METADATA_FILE}.", folder)
    try:
        with open(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fchmod(file.fileno(), 0o666 & ~_umask())
            os.fsync(file.fileno())
        os.replace(half, folder / METADATA_FILE)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(half)
        raise


def _umask() -> int:
    """Return the permissions that new files of this process do not get."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _metadata(files: Mapping[str, BagContents]) -> dict[str, Any]:
    whole = merged(list(files.values()))
    return {
        "version": METADATA_VERSION,
        "storage_identifier": STORAGE,
        **_extent(whole),
        "topics_with_message_count": _topics(whole.counts),
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": list(files),
        "files": [{"path": name, **_extent(contents)} for name, contents in files.items()],
        "custom_data": None,
        "ros_distro": "jazzy",
    }


def _extent(contents: BagContents) -> dict[str, Any]:
    """Return the times and the number of messages of a recording or of one file."""
    return {
        "duration": {"nanoseconds": contents.end_ns - contents.start_ns},
        "starting_time": {"nanoseconds_since_epoch": contents.start_ns},
        "message_count": contents.message_count,
    }


def _topics(counts: Sequence[tuple[BagTopic, int]]) -> list[dict[str, Any]]:
    return [
        {
            "topic_metadata": {
                "name": topic.name,
                "type": topic.type_name,
                "serialization_format": topic.encoding,
                "offered_qos_profiles": _qos_profiles(topic.qos),
                "type_description_hash": (
                    type_hash(topic.type_name) if topic.type_hash is None else topic.type_hash
                ),
            },
            "message_count": count,
        }
        for topic, count in counts
    ]


def _qos_profiles(text: str) -> list[Any]:
    """Return the profiles in a text that may come from a stranger; none if it holds none."""
    try:
        profiles = bounded_yaml.parse(text[:LONGEST_QOS], values=True)
    except bounded_yaml.YamlError:
        return []
    return profiles if isinstance(profiles, list) else []


class _PlainDumper(yaml.SafeDumper):
    """YAML without anchors, which not every reader of bags understands."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _yaml(data: Any) -> str:
    return yaml.dump(data, Dumper=_PlainDumper, sort_keys=False, default_flow_style=False)
