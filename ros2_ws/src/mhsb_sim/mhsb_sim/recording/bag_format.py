"""What a rosbag2 folder consists of: file names, message types, metadata (version 9)."""

from __future__ import annotations

import functools
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from mhsb_model.errors import MhsbError

METADATA_FILE = "metadata.yaml"
METADATA_VERSION = 9
SERIALIZATION = "cdr"
SCHEMA_ENCODING = "ros2msg"
PROFILE = "ros2"
FOREVER = {"sec": 9223372036, "nsec": 854775807}  # how ROS writes a time that is not limited


class BagError(MhsbError):
    """A recording cannot be written, read or repaired."""


@dataclass(frozen=True)
class BagTopic:
    """A recorded topic: its absolute name, ROS type as `std_msgs/msg/String`, QoS as YAML."""

    name: str
    type_name: str
    qos: str


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


def data_file(folder: Path) -> Path:
    """The one MCAP file of a recording."""
    return folder / f"{folder.resolve().name}_0.mcap"


@functools.cache
def _typestore() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


def definition(type_name: str) -> str:
    """Full text of a message type, with the types that it contains."""
    return _typestore().generate_msgdef(type_name, ros_version=2)[0]


def type_hash(type_name: str) -> str:
    """Hash by which ROS 2 tells versions of a message type apart (REP 2011): `RIHS01_...`."""
    return _typestore().hash_rihs01(type_name)


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


def metadata_text(file_name: str, contents: BagContents) -> str:
    """The text that stands in the MCAP file; `metadata.yaml` has it under one more key."""
    return _yaml(_metadata(file_name, contents))


def write_metadata(folder: Path, contents: BagContents) -> None:
    """Write `metadata.yaml`, whole or not at all."""
    text = _yaml({"rosbag2_bagfile_information": _metadata(data_file(folder).name, contents)})
    half = folder / f"{METADATA_FILE}.part"
    half.write_text(text, encoding="utf-8")
    os.replace(half, folder / METADATA_FILE)


def _metadata(file_name: str, contents: BagContents) -> dict[str, Any]:
    start = {"nanoseconds_since_epoch": contents.start_ns}
    duration = {"nanoseconds": contents.end_ns - contents.start_ns}
    return {
        "version": METADATA_VERSION,
        "storage_identifier": "mcap",
        "duration": duration,
        "starting_time": start,
        "message_count": contents.message_count,
        "topics_with_message_count": _topics(contents.counts),
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [
            {
                "path": file_name,
                "starting_time": start,
                "duration": duration,
                "message_count": contents.message_count,
            }
        ],
        "custom_data": None,
        "ros_distro": "jazzy",
    }


def _topics(counts: Sequence[tuple[BagTopic, int]]) -> list[dict[str, Any]]:
    return [
        {
            "topic_metadata": {
                "name": topic.name,
                "type": topic.type_name,
                "serialization_format": SERIALIZATION,
                "offered_qos_profiles": yaml.safe_load(topic.qos) or [],
                "type_description_hash": type_hash(topic.type_name),
            },
            "message_count": count,
        }
        for topic, count in counts
    ]


class _PlainDumper(yaml.SafeDumper):
    """YAML without anchors, which not every reader of bags understands."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _yaml(data: Any) -> str:
    return yaml.dump(data, Dumper=_PlainDumper, sort_keys=False, default_flow_style=False)
