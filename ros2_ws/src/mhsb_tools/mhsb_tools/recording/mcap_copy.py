"""Writing the readable messages of a damaged MCAP file into a new one.

The library `mcap` writes chunks, indexes and summary. Definitions are copied with their own text,
so unknown types are kept as well.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Set
from dataclasses import replace
from typing import IO

from mcap.records import Attachment, Channel, Header, Metadata, Schema
from mcap.writer import CompressionType, Writer

from mhsb_tools.recording.bag_format import SCHEMA_ENCODING, BagError
from mhsb_tools.recording.bag_writer import CHUNK_SIZE
from mhsb_tools.recording.mcap_chunk import Chunk, RawMessage
from mhsb_tools.recording.mcap_survey import Definitions

MAX_ID = 2**16 - 1
"""Largest id of a schema or channel."""

UNKNOWN_SCHEMA = Schema(0, b"", SCHEMA_ENCODING, "unknown_msgs/msg/Unknown")
"""Schema of the ROS type that stands for types whose definition is lost."""

COMPRESSION_TYPES = {
    "": CompressionType.NONE,
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
}
"""Compression of the library, by its name in a chunk."""


class McapCopy:
    """Writer of a new MCAP file from the parts of a damaged one; `finish` completes it.

    Schemas and channels get new ids. One old id may mean different things in different parts of a
    damaged file, and then has several new ids.

    Attributes:
        counts: Number of messages written, by channel id in the new file.
        definitions: Schemas and channels of the new file.
    """

    def __init__(
        self,
        stream: IO[bytes],
        definitions: Definitions,
        header: Header,
        compression: str = "",
        listed: Set[tuple[int, int, int]] = frozenset(),
    ) -> None:
        """Begin the new file with a header, and add all known schemas and channels.

        Args:
            stream: Binary stream that receives the new file.
            definitions: Schemas and channels of the damaged file. Each of its messages must have a
                channel in it. A channel whose schema is missing gets UNKNOWN_SCHEMA.
            header: Header of the new file.
            compression: Compression of the new file's chunks: `zstd`, `lz4`, or empty for none.
            listed: Keys of the chunks that are known to use these definitions. A key is the first
                log time [ns], the last log time [ns] and the unpacked size [bytes] of a chunk.
        """
        self.counts: Counter[int] = Counter()
        self.definitions = Definitions()
        self._writer = Writer(
            stream, chunk_size=CHUNK_SIZE, compression=COMPRESSION_TYPES[compression]
        )
        self._writer.start(header.profile, header.library)
        self._ids: dict[str, int] = {}
        self._own = definitions
        self._own_channel_ids = self._add_all(definitions)
        self._other_channel_ids: dict[int, int] | None = None
        self._listed = listed
        self._own_end: int | None = None
        self._other_end = 0

    def add_chunk(self, chunk: Chunk) -> None:
        """Write the messages of a chunk.

        A damaged file may have parts of another recording, and the same ids may have other meanings
        there. A chunk belongs to such a part if it has a schema or channel that contradicts the
        known definition of the same id. Its messages then get channels of their own. Later chunks
        that belong to the same part get the same channels, also if they have no definitions.

        Args:
            chunk: A verified chunk.

        Raises:
            BagError: All schema or channel ids are in use.
        """
        if self._has_contradicting_ids(chunk):
            others = [definition for _, definition in chunk.definitions]
            self._other_channel_ids = self._add_all([*self._own, *others])
        elif self._other_channel_ids is None or not self._belongs_to_other_recording(chunk):
            self._own_end = chunk.key[1]
            self.add_messages(chunk.messages(), self._own_channel_ids)
            return
        self._other_end = chunk.key[1]
        self.add_messages(chunk.messages(), self._other_channel_ids)

    def add_messages(
        self, messages: Iterable[RawMessage], channel_ids: dict[int, int] | None = None
    ) -> None:
        """Write messages in their order.

        Args:
            messages: Messages of the damaged file.
            channel_ids: Id in the new file of each channel, by its id in the damaged file; None
                takes those of the known definitions.
        """
        channel_ids = channel_ids or self._own_channel_ids
        for message in messages:
            channel_id = channel_ids[message.channel_id]
            self.counts[channel_id] += 1
            self._writer.add_message(
                channel_id, message.log_ns, message.data, message.publish_ns, message.sequence
            )

    def add_attachment(self, attachment: Attachment) -> None:
        """Write an attachment."""
        self._writer.add_attachment(
            attachment.create_time,
            attachment.log_time,
            attachment.name,
            attachment.media_type,
            attachment.data,
        )

    def add_metadata(self, metadata: Metadata) -> None:
        """Write a metadata record."""
        self._writer.add_metadata(metadata.name, metadata.metadata)

    def finish(self) -> None:
        """Write the last chunk, the summary with all indexes, and the footer.

        The stream stays open. Nothing may be added afterwards.
        """
        self._writer.finish()

    def _has_contradicting_ids(self, chunk: Chunk) -> bool:
        """Return whether a chunk has another definition of an id than the known one.

        Definitions are schemas and channels.

        Args:
            chunk: A verified chunk. If it has no schemas and channels, the result is False.
        """
        known = self._own
        return any(each != known.table(each).get(each.id, each) for _, each in chunk.definitions)

    def _belongs_to_other_recording(self, chunk: Chunk) -> bool:
        """Return whether a chunk belongs to the recording of the last contradicting chunk.

        A contradicting chunk has schemas or channels that differ from those of the main recording.
        It comes from another recording. For any other chunk the first rule that fits decides:

        1. It has schemas or channels, or its key is listed: it belongs to the main recording.
        2. No chunk of the main recording has come yet: it belongs to the other recording if there
           are listed keys, else to the main recording.
        3. It belongs to the recording whose last chunk ended closest in time to its first log time.

        Args:
            chunk: A chunk that contradicts nothing. A contradicting chunk must have come before.

        Returns:
            True if it belongs to the other recording.
        """
        if chunk.definitions or chunk.key in self._listed:
            return False
        begin = chunk.key[0]
        if self._own_end is None:
            return bool(self._listed)
        return abs(begin - self._other_end) < abs(begin - self._own_end)

    def _add_all(self, definitions: Iterable[Schema | Channel]) -> dict[int, int]:
        """Add schemas and channels to the new file, and return the new ids of the channels.

        Args:
            definitions: Schemas and channels with the ids of the damaged file, each channel after
                its schema. If an id has several definitions, the last definition counts. A channel
                whose schema is missing gets UNKNOWN_SCHEMA.

        Returns:
            Id in the new file of each channel, by its id in the damaged file.

        Raises:
            BagError: All ids are in use.
        """
        schema_ids = {0: 0}  # 0 stands for no schema
        channel_ids: dict[int, int] = {}
        for each in definitions:
            if isinstance(each, Schema):
                schema_ids[each.id] = self._add(each)
                continue
            if each.schema_id not in schema_ids:
                schema_ids[each.schema_id] = self._add(UNKNOWN_SCHEMA)
            channel_ids[each.id] = self._add(replace(each, schema_id=schema_ids[each.schema_id]))
        return channel_ids

    def _add(self, definition: Schema | Channel) -> int:
        """Return the id of a schema or channel in the new file.

        If the new file has no definition that is equal except for its id, it is written there.

        Args:
            definition: Schema, or channel with the schema id of the new file.

        Returns:
            The id.

        Raises:
            BagError: All ids are in use.
        """
        key = repr(replace(definition, id=0))
        if key not in self._ids:
            table = self.definitions.table(definition)
            if len(table) == MAX_ID:
                raise BagError(f"more than {MAX_ID} definitions cannot be repaired")
            if isinstance(definition, Schema):
                number = self._writer.register_schema(
                    definition.name, definition.encoding, definition.data
                )
            else:
                number = self._writer.register_channel(
                    definition.topic,
                    definition.message_encoding,
                    definition.schema_id,
                    definition.metadata,
                )
            self._ids[key], table[number] = number, replace(definition, id=number)
        return self._ids[key]
