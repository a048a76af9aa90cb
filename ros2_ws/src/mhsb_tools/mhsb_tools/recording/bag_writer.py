"""Writing a recording: a rosbag2 folder with one MCAP file. Little of the file is lost in a crash.

Messages go into small chunks. The recorder flushes full chunks a few times a second, so a process
that is killed loses only the last chunk. What is left then has no index and no metadata;
`bag_repair` makes both.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from mcap.writer import CompressionType, Writer

from mhsb_tools.recording import bag_format
from mhsb_tools.recording.bag_format import CHUNK_SIZE, BagContents, BagError, BagTopic


class BagWriter(contextlib.AbstractContextManager["BagWriter"]):
    """Writer of a new recording; use it as a context manager.

    Leaving the `with` block completes the recording. After a BagError the file is closed without
    index and metadata. After any other exception it is completed.

    Attributes:
        folder: Folder of the recording.
        path: Its MCAP file.
    """

    def __init__(self, folder: Path) -> None:
        """Create the folder if it does not exist, and begin its MCAP file.

        Args:
            folder: Folder of the recording. If it exists, it must be empty.

        Raises:
            BagError: The folder is not empty or cannot be written.
        """
        self.folder = folder
        self.path = bag_format.get_data_file_path(folder)
        self._topics: list[BagTopic] = []
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self._start_ns: int | None = None
        self._end_ns = 0
        with self._failures_explained():
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise BagError(f"{folder} is not empty; remove it or name another folder")
            self._file = self.path.open("xb")
            self._writer = Writer(
                self._file, chunk_size=CHUNK_SIZE, compression=CompressionType.NONE
            )
            self._writer.start(profile=bag_format.MCAP_PROFILE, library="mhsb")

    def __exit__(self, kind: type[BaseException] | None, *other: object) -> None:
        """Complete the recording; after a BagError, only close the file.

        Args:
            kind: Class of the exception that ended the block; None without one.
            *other: The exception and its traceback; unused.
        """
        if kind is not None and issubclass(kind, BagError):
            with contextlib.suppress(OSError):  # a file that cannot be written cannot be completed
                self._file.close()
        else:
            self.close()

    @property
    def message_count(self) -> int:
        """Number of messages written so far, on all topics."""
        return sum(self._counts.values())

    def add_topic(self, topic: BagTopic) -> None:
        """Write the definition of a topic (MCAP schema and channel).

        Call this once for each topic, before its first message.

        Args:
            topic: The topic. Its type must be one of the types that this package knows for ROS 2
                Jazzy. Its `encoding` and `type_hash` are ignored: messages are always CDR, and the
                type hash is computed from the type.
        """
        if topic.type_name not in self._schemas:
            self._schemas[topic.type_name] = self._writer.register_schema(
                topic.type_name,
                bag_format.SCHEMA_ENCODING,
                bag_format.get_type_definition(topic.type_name).encode(),
            )
        self._channels[topic.name] = self._writer.register_channel(
            topic.name,
            bag_format.SERIALIZATION_FORMAT,
            self._schemas[topic.type_name],
            {
                "offered_qos_profiles": topic.qos,
                "topic_type_hash": bag_format.compute_type_hash(topic.type_name),
            },
        )
        self._topics.append(topic)
        self._counts[topic.name] = 0

    def write(self, topic_name: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        """Add one serialized message to the recording.

        Args:
            topic_name: Name of a topic that was added before.
            data: Message serialized as CDR.
            log_ns: Time at which it was received [ns since the epoch].
            publish_ns: Time at which it was published [ns since the epoch].

        Raises:
            BagError: The file cannot be written.
        """
        with self._failures_explained():
            self._writer.add_message(
                self._channels[topic_name],
                log_time=log_ns,
                data=data,
                publish_time=publish_ns,
                sequence=self._counts[topic_name],
            )
        self._counts[topic_name] += 1
        self._start_ns = log_ns if self._start_ns is None else min(self._start_ns, log_ns)
        self._end_ns = max(self._end_ns, log_ns)

    def flush(self) -> None:
        """Hand complete chunks to the operating system.

        They are then kept if this process is killed.

        Raises:
            BagError: The file cannot be written.
        """
        with self._failures_explained():
            self._file.flush()

    def close(self) -> None:
        """Complete the recording and close its file.

        The MCAP file gets its index and summary, and `metadata.yaml` is written. Nothing is done if
        the file is closed already.

        Raises:
            BagError: The file or the metadata cannot be written.
        """
        if self._file.closed:
            return
        counts = tuple((topic, self._counts[topic.name]) for topic in self._topics)
        files = {self.path.name: BagContents(self._start_ns or 0, self._end_ns, counts)}
        with self._failures_explained():
            self._writer.add_metadata(
                "rosbag2",
                {"serialized_metadata": bag_format.format_metadata(files)},
            )
            self._writer.finish()
            self._file.close()
            bag_format.write_metadata(self.folder, files)

    @contextlib.contextmanager
    def _failures_explained(self) -> Iterator[None]:
        """Context manager that raises BagError, which names the folder, in place of OSError."""
        try:
            yield
        except OSError as error:
            raise BagError(f"cannot write the recording {self.folder}: {error.strerror}") from error
