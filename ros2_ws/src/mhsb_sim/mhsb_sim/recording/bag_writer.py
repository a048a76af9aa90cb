"""Writing a recording: a rosbag2 folder with one MCAP file, of which a crash loses little.

Messages go into small chunks, and full chunks are flushed a few times a second, so that a
process that is killed loses the last chunk alone. What is then left has no index and no
metadata; `bag_repair` makes both.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from types import TracebackType
from typing import Self

from mcap.writer import CompressionType, Writer

from mhsb_sim.recording import bag_format
from mhsb_sim.recording.bag_format import BagContents, BagError, BagTopic

CHUNK_SIZE = 32 * 1024
"""Bytes; about a quarter of a second of the suite's topics."""


class BagWriter:
    """A recording in the making; use it as a context manager, which completes it at the end.

    Raises BagError where the folder holds something already or cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.path = bag_format.data_file(folder)
        self._topics: list[BagTopic] = []
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self._start_ns: int | None = None
        self._end_ns = 0
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise BagError(f"{folder} is not empty; remove it or name another folder")
            self._file = self.path.open("xb")
            self._writer = Writer(
                self._file, chunk_size=CHUNK_SIZE, compression=CompressionType.NONE
            )
            self._writer.start(profile=bag_format.PROFILE, library="mhsb")
        except OSError as error:
            raise self._cannot_write(error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None and issubclass(kind, BagError):
            with contextlib.suppress(OSError):  # what cannot be written cannot be completed either
                self._file.close()
        else:
            self.close()

    @property
    def message_count(self) -> int:
        """Messages written so far, on all topics."""
        return sum(self._counts.values())

    def add_topic(self, topic: BagTopic) -> None:
        """Announce a topic; each once, before its first message."""
        if topic.type_name not in self._schemas:
            self._schemas[topic.type_name] = self._writer.register_schema(
                topic.type_name,
                bag_format.SCHEMA_ENCODING,
                bag_format.definition(topic.type_name).encode(),
            )
        self._channels[topic.name] = self._writer.register_channel(
            topic.name,
            bag_format.SERIALIZATION,
            self._schemas[topic.type_name],
            {
                "offered_qos_profiles": topic.qos,
                "topic_type_hash": bag_format.type_hash(topic.type_name),
            },
        )
        self._topics.append(topic)
        self._counts[topic.name] = 0

    def write(self, topic_name: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        """Add a serialized message: when it was received and when it was sent, ns since epoch."""
        try:
            self._writer.add_message(
                self._channels[topic_name],
                log_time=log_ns,
                data=data,
                publish_time=publish_ns,
                sequence=self._counts[topic_name],
            )
        except OSError as error:
            raise self._cannot_write(error) from error
        self._counts[topic_name] += 1
        self._start_ns = log_ns if self._start_ns is None else min(self._start_ns, log_ns)
        self._end_ns = max(self._end_ns, log_ns)

    def flush(self) -> None:
        """Hand full chunks to the operating system, where a kill of this process spares them."""
        try:
            self._file.flush()
        except OSError as error:
            raise self._cannot_write(error) from error

    def close(self) -> None:
        """Complete the recording: index, summary, metadata."""
        if self._file.closed:
            return
        counts = tuple((topic, self._counts[topic.name]) for topic in self._topics)
        files = {self.path.name: BagContents(self._start_ns or 0, self._end_ns, counts)}
        try:
            self._writer.add_metadata(
                "rosbag2",
                {"serialized_metadata": bag_format.metadata_text(files)},
            )
            self._writer.finish()
            self._file.close()
            bag_format.write_metadata(self.folder, files)
        except OSError as error:
            raise self._cannot_write(error) from error

    def _cannot_write(self, error: OSError) -> BagError:
        return BagError(f"cannot write the recording {self.folder}: {error.strerror}")
