"""Writing the readable part of a damaged MCAP file into a new one.

Verified chunks are copied in their packed form. Message indexes and summary are computed anew. All
schemas and channels are written unchanged before the first chunk, so that types which ROS does not
know are kept as well. Messages outside chunks are put into new chunks.
"""

import tempfile
import zlib
from collections import Counter
from collections.abc import Iterable, Set
from dataclasses import replace
from operator import itemgetter
from typing import IO

from mcap import records
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from mhsb_tools.recording.bag_format import CHUNK_SIZE, BagError
from mhsb_tools.recording.mcap_chunk import Chunk, ChunkHeader, compute_message_index, find_records
from mhsb_tools.recording.mcap_records import (
    CHUNK_TIMES,
    FILE_MAGIC,
    RECORD_HEADER,
    parse_record,
    serialize_record,
)
from mhsb_tools.recording.mcap_survey import Definitions
from mhsb_tools.recording.mcap_walk import INDEX_HEAD_SIZE

INDEX_IN_MEMORY = 4 * 1024 * 1024
"""Total size up to which chunk indexes are kept in memory [bytes]. Beyond it, all of them are kept
in a temporary file.
"""

MAX_ID = 2**16 - 1
"""Largest id of a schema or channel."""


class McapCopy:
    """Writer of a new MCAP file from the usable parts of a damaged one.

    Call `finish` at the end. A damaged file may contain parts of another recording. There, the ids
    of schemas and channels may have other meanings. Such schemas and channels get new ids.

    Attributes:
        counts: Number of messages written, by channel id in the new file.
        definitions: Schemas and channels of the new file. Chunks of another recording may add more.
    """

    def __init__(
        self,
        stream: IO[bytes],
        definitions: Definitions,
        header: records.Header,
        listed: Set[tuple[int, int, int]] = frozenset(),
    ) -> None:
        """Write the beginning of the new file: magic bytes, header, schemas and channels.

        Args:
            stream: Binary stream that receives the new file.
            definitions: All known schemas and channels. Later calls may add more of them, in place.
            header: Header of the new file.
            listed: Keys of the chunks that are known to use these definitions. A key is the first
                log time [ns], the last log time [ns] and the unpacked size [bytes] of a chunk.
        """
        self.counts: Counter[int] = Counter()
        self.definitions = definitions
        self._stream = stream
        self._at = 0
        self._checksum: int | None = None
        self._loose = bytearray()
        # The file is open as long as this object writes.
        self._indexes = tempfile.SpooledTemporaryFile(INDEX_IN_MEMORY)  # noqa: SIM115
        self._others: list[bytes] = []
        self._chunk_count = 0
        self._other_channel_ids: dict[int, int] | None = None
        self._listed = listed
        self._own_end: int | None = None
        self._other_end = 0
        self._write(FILE_MAGIC)
        self._write(serialize_record(header))
        self._write_definitions(definitions)

    def add_chunk(self, chunk: Chunk) -> None:
        """Write a chunk with its message indexes; a chunk without messages is not written.

        A chunk is from another recording if one of its schemas or channels has an id that stands
        for something else in the new file. The messages of such a chunk get new channel ids
        and are written as new chunks. Later chunks of the same recording get the same new ids, even
        if they contain no schemas and channels.

        Args:
            chunk: A verified chunk.

        Raises:
            BagError: All schema or channel ids are in use.
        """
        self.flush()
        if self._has_contradicting_ids(chunk):
            self._other_channel_ids = self._choose_channel_ids(chunk)
            self._add_with_other_ids(chunk, self._other_channel_ids)
        elif self._other_channel_ids is not None and self._belongs_to_other_recording(chunk):
            self._add_with_other_ids(chunk, self._other_channel_ids)
        else:
            self._own_end = chunk.key[1]
            if len(chunk.channel_ids):
                self._write_chunk(chunk)

    def add_message(self, record: bytes) -> None:
        """Add a message that was outside chunks in the damaged file.

        Such messages are collected, and written as one chunk as soon as they have CHUNK_SIZE bytes.
        A message of that size or more is written at once, as a separate chunk.

        Args:
            record: The message record with opcode and length.
        """
        if len(record) >= CHUNK_SIZE:
            self.flush()
            self._write_records(record)
            return
        self._loose += record
        if len(self._loose) >= CHUNK_SIZE:
            self.flush()

    def add_attachment_or_metadata(self, record: bytes) -> None:
        """Write an attachment or metadata record, and keep its index for the summary.

        Args:
            record: The record with opcode and length, verified.
        """
        self.flush()
        self._others.append(_make_index_record(record, self._at))
        self._write(record)

    def flush(self) -> None:
        """Write the messages that `add_message` has collected as one chunk.

        If there are none, nothing is written.
        """
        if self._loose:
            unpacked, self._loose = bytes(self._loose), bytearray()
            self._write_records(unpacked)

    def finish(self, start_ns: int, end_ns: int) -> None:
        """Write the end of the new file: summary with all indexes, footer, and magic bytes.

        Records with summary offsets, which are optional in MCAP, are not written. The stream stays
        open. Nothing may be added afterwards.

        Args:
            start_ns: First log time of all messages [ns]; 0 without messages.
            end_ns: Last log time of all messages [ns]; 0 without messages.
        """
        self.flush()
        self._write(serialize_record(records.DataEnd(0)))
        begin, self._checksum = self._at, 0
        self._write_definitions(self.definitions)
        self._write(self._make_statistics(start_ns, end_ns))
        self._indexes.seek(0)
        while part := self._indexes.read(INDEX_IN_MEMORY):
            self._write(part)
        self._indexes.close()
        for index in sorted(self._others, key=itemgetter(0)):  # grouped by opcode
            self._write(index)
        self._write(RECORD_HEADER.pack(Opcode.FOOTER, 20) + begin.to_bytes(8, "little") + bytes(8))
        self._write(self._checksum.to_bytes(4, "little") + FILE_MAGIC)

    # --- Chunks ----------------------------------------------------------------------------------

    def _write_records(self, records: bytes) -> None:
        """Write message records as one uncompressed chunk with its message indexes.

        Args:
            records: Message records, one after the other.
        """
        header = ChunkHeader(len(records), zlib.crc32(records), "")
        self._write_chunk(find_records(header, records, records))

    def _write_chunk(self, chunk: Chunk) -> None:
        """Write a chunk record and the message indexes of its channels.

        Message counts and chunk indexes for the summary are updated. The checksum of the
        chunk is computed anew.

        Args:
            chunk: The chunk, with the ids of the new file.
        """
        first, last, size = chunk.key
        name = chunk.header.compression.encode()
        fields = CHUNK_TIMES.pack(first, last, size, zlib.crc32(chunk.unpacked))
        fields += len(name).to_bytes(4, "little") + name + len(chunk.packed).to_bytes(8, "little")
        begin = self._at
        self._write(RECORD_HEADER.pack(Opcode.CHUNK, len(fields) + len(chunk.packed)) + fields)
        self._write(chunk.packed)
        length, offsets = self._at - begin, {}
        for channel_id, count in chunk.counts().items():
            offsets[channel_id] = self._at
            content = compute_message_index(chunk, channel_id).data.cast("B")
            self._write(RECORD_HEADER.pack(Opcode.MESSAGE_INDEX, INDEX_HEAD_SIZE + len(content)))
            self._write(channel_id.to_bytes(2, "little") + len(content).to_bytes(4, "little"))
            self._write(content)
            self.counts[channel_id] += count
        self._indexes.write(
            serialize_record(
                records.ChunkIndex(
                    chunk_length=length,
                    chunk_start_offset=begin,
                    compression=chunk.header.compression,
                    compressed_size=len(chunk.packed),
                    message_end_time=last,
                    message_index_length=self._at - begin - length,
                    message_index_offsets=offsets,
                    message_start_time=first,
                    uncompressed_size=size,
                )
            )
        )
        self._chunk_count += 1

    def _has_contradicting_ids(self, chunk: Chunk) -> bool:
        """Return whether a chunk and the new file have different definitions for one id.

        Definitions are schemas and channels.

        Args:
            chunk: A verified chunk. If it has no schemas and channels, the result is False.
        """
        tables = self.definitions
        return any(each != tables.table(each).get(each.id, each) for _, each in chunk.definitions)

    def _belongs_to_other_recording(self, chunk: Chunk) -> bool:
        """Return whether a chunk belongs to another recording, although its ids do not show this.

        An earlier chunk had schemas or channels that contradict those of the main recording. That
        earlier chunk is from another recording, and this chunk may be from it as well. The first
        rule that applies decides:

        1. If the chunk has schemas or channels, or if its key is listed, it is from the main
           recording.
        2. If no chunk of the main recording was added before, the listed keys decide. If there are
           any, the chunk is from the other recording, else from the main recording.
        3. The chunk is from the recording whose last chunk ended closest in time to the first log
           time of this chunk.

        Args:
            chunk: A chunk whose schemas and channels, if any, contradict nothing.

        Returns:
            True if the chunk is from the other recording, so that its ids must be translated.
        """
        if chunk.definitions or chunk.key in self._listed:
            return False
        begin = chunk.key[0]
        if self._own_end is None:
            return bool(self._listed)
        return abs(begin - self._other_end) < abs(begin - self._own_end)

    def _choose_channel_ids(self, chunk: Chunk) -> dict[int, int]:
        """Choose ids in the new file for the schemas and channels of a contradicting chunk.

        Schemas and channels that the new file does not contain yet are written to it.

        Args:
            chunk: A chunk whose schemas or channels contradict those of the new file.

        Returns:
            Id in the new file of each channel, by its id in the chunk.

        Raises:
            BagError: All ids are in use.
        """
        schema_ids: dict[int, int] = {}
        channel_ids: dict[int, int] = {}
        for _, each in chunk.definitions:
            chosen = schema_ids if isinstance(each, Schema) else channel_ids
            if each.id not in chosen:
                chosen[each.id] = self._new_id(each, schema_ids)
        return channel_ids

    def _new_id(self, definition: Schema | Channel, schema_ids: dict[int, int]) -> int:
        """Choose the id of a schema or channel in the new file.

        If the new file has a definition that is equal except for its id, that id is used. Otherwise
        the definition is written to the new file under the lowest free id.

        Args:
            definition: Schema or channel with the ids of the damaged file.
            schema_ids: New id of each schema by its id in the damaged file. The schema id of a
                channel is replaced by the new id. If it has no entry, it stays.

        Returns:
            The id.

        Raises:
            BagError: All ids are in use.
        """
        if isinstance(definition, Channel):
            schema_id = schema_ids.get(definition.schema_id, definition.schema_id)
            definition = replace(definition, schema_id=schema_id)
        table = self.definitions.table(definition)
        for number, known in table.items():
            if replace(known, id=definition.id) == definition:
                return number
        number = next((each for each in range(1, MAX_ID + 1) if each not in table), 0)
        if number == 0:
            raise BagError(f"a recording with more than {MAX_ID} definitions cannot be repaired")
        table[number] = replace(definition, id=number)
        self._write_definitions([table[number]])
        return number

    def _add_with_other_ids(self, chunk: Chunk, channel_ids: dict[int, int]) -> None:
        """Add the messages of a chunk of another recording under other channel ids.

        The messages are collected and written later, as chunks of the copy's own size.

        Args:
            chunk: The chunk.
            channel_ids: New id of each channel by its id in the chunk; an id without an entry
                stays.
        """
        self._other_end, unpacked = chunk.key[1], chunk.unpacked
        for offset in chunk.each_offset():
            _, length = RECORD_HEADER.unpack_from(unpacked, offset)
            begin = offset + RECORD_HEADER.size
            own = int.from_bytes(unpacked[begin : begin + 2], "little")
            new = channel_ids.get(own, own).to_bytes(2, "little")
            rest = unpacked[begin + 2 : begin + length]
            self.add_message(unpacked[offset:begin] + new + rest)

    # --- Records ---------------------------------------------------------------------------------

    def _write_definitions(self, definitions: Iterable[Schema | Channel]) -> None:
        """Write schema and channel records."""
        for each in definitions:
            self._write(serialize_record(each))

    def _write(self, data: bytes | memoryview) -> None:
        """Write bytes to the new file and advance the file position.

        Within the summary, the bytes also enter the summary's checksum.

        Args:
            data: The bytes.
        """
        self._stream.write(data)
        self._at += len(data)
        if self._checksum is not None:
            self._checksum = zlib.crc32(data, self._checksum)

    def _make_statistics(self, start_ns: int, end_ns: int) -> bytes:
        """Return the statistics record of the new file, with opcode and length.

        Args:
            start_ns: First log time of all messages [ns]; 0 without messages.
            end_ns: Last log time of all messages [ns]; 0 without messages.
        """
        kinds = Counter(each[0] for each in self._others)
        return serialize_record(
            records.Statistics(
                attachment_count=kinds[Opcode.ATTACHMENT_INDEX],
                channel_count=len(self.definitions.channels),
                channel_message_counts=dict(self.counts),
                chunk_count=self._chunk_count,
                message_count=self.counts.total(),
                message_start_time=start_ns,
                message_end_time=end_ns,
                metadata_count=kinds[Opcode.METADATA_INDEX],
                schema_count=len(self.definitions.schemas),
            )
        )


def _make_index_record(record: bytes, at: int) -> bytes:
    """Create the index record that lists an attachment or metadata record in the summary.

    Args:
        record: The record with opcode and length, verified.
        at: Offset of the record in the file.

    Returns:
        The index record with opcode and length.
    """
    parsed = parse_record(record[0], memoryview(record)[RECORD_HEADER.size :])
    if isinstance(parsed, records.Metadata):
        return serialize_record(records.MetadataIndex(at, len(record), parsed.name))
    return serialize_record(
        records.AttachmentIndex(
            offset=at,
            length=len(record),
            log_time=parsed.log_time,
            create_time=parsed.create_time,
            data_size=len(parsed.data),
            name=parsed.name,
            media_type=parsed.media_type,
        )
    )
