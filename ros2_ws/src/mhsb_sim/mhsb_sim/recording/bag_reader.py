"""Reading a recording from a bag."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader, ReaderError

from mhsb_msgs_py.topics import Topic
from mhsb_sim.recording import bag_format
from mhsb_sim.recording.bag_format import BagError
from mhsb_sim.recording.recording import Recording, decoded


def read_recording(folder: Path, namespace: str = "", slews: bool = False) -> Recording:
    """Read the recording in `folder` of an arm that may slew, topics below `namespace`, `/left`.

    Raises BagError where the folder is not a complete recording, or has no joint states.
    """
    namespace = namespace.rstrip("/")
    if not folder.is_dir():
        raise BagError(f"{folder} is not a folder; name the folder of a recording")
    if not (folder / bag_format.METADATA_FILE).exists():
        raise BagError(
            f"{folder} has no {bag_format.METADATA_FILE}; if it is a recording that was cut off, "
            f"complete it by record --repair {folder}"
        )
    try:
        with Reader(folder) as reader:
            messages, what = partial(_raw, reader, namespace), f"the recording {folder}"
            return decoded(messages, what, namespace, slews)
    except (ReaderError, FileNotFoundError) as error:
        raise BagError(
            f"the recording {folder} cannot be read: {str(error).rstrip('.')}; if it was cut off, "
            f"complete it by record --repair {folder}"
        ) from error


def _raw(reader: Reader, namespace: str, topic: Topic) -> Iterator[tuple[int, bytes]]:
    """Messages of a topic below a namespace with their times of recording [ns]."""
    name = topic.name if topic.name.startswith("/") else f"{namespace}/{topic.name}"
    connections: list[Connection] = [each for each in reader.connections if each.topic == name]
    if connections:  # an empty list would select all topics
        for _, log_ns, data in reader.messages(connections=connections):
            yield log_ns, data
