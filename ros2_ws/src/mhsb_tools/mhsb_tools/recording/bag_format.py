"""Contents of a rosbag2 folder: file names, message types, and metadata of version 9."""

import functools
import os
import struct
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from mhsb_model.errors import MhsbError
from mhsb_msgs_py.errors import MessageError
from mhsb_tools.recording import bounded_yaml

METADATA_FILE = "metadata.yaml"
"""Name of the metadata file of a rosbag2 folder."""
METADATA_KEY = "rosbag2_bagfile_information"
"""Key of `metadata.yaml` below which all metadata stand."""
METADATA_VERSION = 9
STORAGE_ID = "mcap"
SERIALIZATION_FORMAT = "cdr"
SCHEMA_ENCODING = "ros2msg"
MCAP_PROFILE = "ros2"
CHUNK_SIZE = 32 * 1024
"""Size after which a chunk is complete [bytes]; about a quarter of a second of the suite's topics.
"""

LONGEST_QOS = 64 * 1024
"""Characters of a topic's QoS text that are read; each publisher takes 400."""

PROFILE_KINDS: dict[str, Any] = {
    "history": (str, int),
    "depth": int,
    "reliability": (str, int),
    "durability": (str, int),
    "deadline": dict,
    "lifespan": dict,
    "liveliness": (str, int),
    "liveliness_lease_duration": dict,
    "avoid_ros_namespace_conventions": bool,
}
"""Types of a QoS profile's values by their keys."""

UNLIMITED_DURATION = {
    "sec": 9223372036,
    "nsec": 854775807,
}
"""Duration by which ROS denotes "unlimited"."""


class BagError(MhsbError):
    """A recording that cannot be written, read or repaired."""


@dataclass(frozen=True)
class BagTopic:
    """A recorded topic.

    Attributes:
        name: Absolute name of the topic.
        type_name: ROS type, such as `std_msgs/msg/String`.
        qos: QoS profiles of its publishers, as YAML.
        encoding: Encoding of its messages, such as `cdr`.
        type_hash: Hash of its type; None stands for the hash of the ROS type of this name.
    """

    name: str
    type_name: str
    qos: str
    encoding: str = SERIALIZATION_FORMAT
    type_hash: str | None = None


@dataclass(frozen=True)
class BagContents:
    """Contents of a data file or of a whole recording.

    Attributes:
        start_ns: First log time [ns since the epoch]; 0 without messages.
        end_ns: Last log time [ns since the epoch]; 0 without messages.
        counts: Each topic with its number of messages.
    """

    start_ns: int
    end_ns: int
    counts: tuple[tuple[BagTopic, int], ...]

    @property
    def message_count(self) -> int:
        """Number of messages on all topics."""
        return sum(count for _, count in self.counts)


def merge_contents(parts: Sequence[BagContents]) -> BagContents:
    """Combine the contents of several data files of one recording.

    Message counts of equal topics are added. Files without messages have no influence on the times.

    Args:
        parts: Contents of each file.

    Returns:
        First log time, last log time and message counts of all files together. Topics are in the
        order in which they first occur. Both times are 0 if there are no messages.
    """
    counts: Counter[BagTopic] = Counter()
    for part in parts:
        for topic, count in part.counts:
            counts[topic] += count
    filled = [part for part in parts if part.message_count] or [BagContents(0, 0, ())]
    start_ns, end_ns = min(each.start_ns for each in filled), max(each.end_ns for each in filled)
    return BagContents(start_ns, end_ns, tuple(counts.items()))


def get_data_file_path(folder: Path) -> Path:
    """Return the path of the only MCAP file in a recording of the suite.

    Args:
        folder: Folder of the recording; its name is part of the file's name.
    """
    return folder / f"{folder.resolve().name}_0.mcap"


@functools.cache
def get_typestore_jazzy() -> Typestore:
    """Return the definitions of all message types of ROS 2 Jazzy; loaded once and cached."""
    return get_typestore(Stores.ROS2_JAZZY)


def check_structure(type_name: str, data: bytes) -> None:
    """Check that bytes can be a CDR message of a ROS type, before the middleware decodes them.

    A middleware allocates an array by its stated length before it looks at how many bytes there
    are. `rosbags` compares every length with the bytes that are left. Values are not checked. Bytes
    after the end of the message are allowed.

    Args:
        type_name: ROS type, such as `std_msgs/msg/String`; it must be known to this package.
        data: Serialized message with its encapsulation header of 4 bytes.

    Raises:
        MessageError: The bytes are not such a message.
    """
    types = get_typestore_jazzy()
    definition = types.get_msgdef(type_name)
    try:
        read = {0: definition.deserialize_cdr_be, 1: definition.deserialize_cdr_le}
        read[int.from_bytes(data[:2])](data[4:], 0, definition.cls, types)
    except (KeyError, struct.error, ValueError, SerdeError):
        raise MessageError(f"{len(data)} bytes were recorded that are no {type_name}") from None


def get_type_definition(type_name: str) -> str:
    """Return the full text of a message type, with the types that it contains.

    Args:
        type_name: ROS type, such as `std_msgs/msg/String`.

    Returns:
        The text, or an empty text if the type is unknown here.
    """
    types = get_typestore_jazzy()
    return (
        types.generate_msgdef(type_name, ros_version=2)[0] if type_name in types.fielddefs else ""
    )


def compute_type_hash(type_name: str) -> str:
    """Return the hash by which ROS 2 distinguishes versions of a message type.

    The hash follows REP 2011 and has the form `RIHS01_...`.

    Args:
        type_name: ROS type, such as `std_msgs/msg/String`.

    Returns:
        The hash, or an empty text if the type is unknown here.
    """
    types = get_typestore_jazzy()
    return types.hash_rihs01(type_name) if type_name in types.fielddefs else ""


def format_qos(profile: QoSProfile) -> str:
    """Return a QoS profile as YAML in rosbag2's form.

    Depth, reliability and durability are taken from the profile. History is always `keep_last`, and
    deadline, lifespan and lease duration are unlimited.

    Args:
        profile: Profile that a publisher offers.

    Returns:
        YAML text of a list with this one profile.
    """
    reliable = profile.reliability is ReliabilityPolicy.RELIABLE
    latched = profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    return _yaml(
        [
            {
                "history": "keep_last",
                "depth": profile.depth,
                "reliability": "reliable" if reliable else "best_effort",
                "durability": "transient_local" if latched else "volatile",
                "deadline": dict(UNLIMITED_DURATION),
                "lifespan": dict(UNLIMITED_DURATION),
                "liveliness": "automatic",
                "liveliness_lease_duration": dict(UNLIMITED_DURATION),
                "avoid_ros_namespace_conventions": False,
            }
        ]
    )


def format_metadata(files: Mapping[str, BagContents]) -> str:
    """Return the metadata as text in the form that is repeated inside an MCAP file.

    The file `metadata.yaml` has the same content below one more key, METADATA_KEY.

    Args:
        files: Contents of each data file by its name, in time order.
    """
    return _yaml(_metadata(files))


def write_metadata(folder: Path, files: Mapping[str, BagContents]) -> None:
    """Write `metadata.yaml` of a recording; an existing file is replaced.

    The text is first written to a temporary folder inside `folder` and synchronized to disk. The
    file therefore has either its old or its complete new content at any time.

    Args:
        folder: Folder of the recording.
        files: Contents of each data file by its name, in time order.

    Raises:
        OSError: The file cannot be written; the old one is unchanged and the temporary folder
            deleted.
    """
    with tempfile.TemporaryDirectory(".part", ".", folder) as parts:
        part = Path(parts, METADATA_FILE)
        with part.open("w", encoding="utf-8") as file:
            file.write(_yaml({METADATA_KEY: _metadata(files)}))
            file.flush()
            os.fsync(file.fileno())
        part.replace(folder / METADATA_FILE)


def _metadata(files: Mapping[str, BagContents]) -> dict[str, Any]:
    """Return the metadata of a recording as nested dictionaries in rosbag2's form.

    Args:
        files: Contents of each data file by its name, in time order.
    """
    whole = merge_contents(list(files.values()))
    return {
        "version": METADATA_VERSION,
        "storage_identifier": STORAGE_ID,
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
    """Return duration, start time and message count of a recording or file in rosbag2's form."""
    return {
        "duration": {"nanoseconds": contents.end_ns - contents.start_ns},
        "starting_time": {"nanoseconds_since_epoch": contents.start_ns},
        "message_count": contents.message_count,
    }


def _topics(counts: Sequence[tuple[BagTopic, int]]) -> list[dict[str, Any]]:
    """Return the topics of a recording in the form of rosbag2's metadata.

    A topic without a stated type hash gets the hash of the ROS type of its name.

    Args:
        counts: Each topic with its number of messages.
    """
    return [
        {
            "topic_metadata": {
                "name": topic.name,
                "type": topic.type_name,
                "serialization_format": topic.encoding,
                "offered_qos_profiles": _qos_profiles(topic.qos),
                "type_description_hash": (
                    compute_type_hash(topic.type_name)
                    if topic.type_hash is None
                    else topic.type_hash
                ),
            },
            "message_count": count,
        }
        for topic, count in counts
    ]


def _qos_profiles(text: str) -> list[Any]:
    """Parse the QoS profiles of a topic from YAML of an untrusted source.

    Only the first LONGEST_QOS characters are parsed.

    Args:
        text: YAML text of a list of profiles.

    Returns:
        The profiles as dictionaries. Empty if the text is not YAML within the bounds, or if one
        profile lacks a key or has a value of a wrong type.
    """
    try:
        profiles = bounded_yaml.parse(text[:LONGEST_QOS], convert_values=True)
    except bounded_yaml.YamlError:
        return []
    whole = isinstance(profiles, list) and all(map(_is_profile, profiles))
    return profiles if whole else []


def _is_profile(profile: Any) -> bool:
    """Return whether a value is a complete QoS profile in rosbag2's form.

    Args:
        profile: Any value that was parsed from YAML.

    Returns:
        True if it is a dictionary with all keys of PROFILE_KINDS, each with a value of the type
        stated there. Durations must be dictionaries with integers `sec` and `nsec`. Further keys
        are allowed.
    """
    if not isinstance(profile, dict) or not profile.keys() >= PROFILE_KINDS.keys():
        return False
    times = [profile[name] for name, kind in PROFILE_KINDS.items() if kind is dict]
    return all(isinstance(profile[name], kind) for name, kind in PROFILE_KINDS.items()) and all(
        isinstance(each.get(part), int) for each in times for part in ("sec", "nsec")
    )


def _yaml(data: Any) -> str:
    """Return data as YAML text in block style, keys in their given order.

    Args:
        data: Nested dictionaries and lists. None of them may occur twice in `data`: YAML would
            refer to the first place by an anchor, which not every reader of bags understands.
    """
    return yaml.safe_dump(data, sort_keys=False, default_flow_style=False)
