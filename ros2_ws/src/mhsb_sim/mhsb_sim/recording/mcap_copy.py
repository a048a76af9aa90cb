"""Writes what is left of a damaged MCAP file: verified chunks as they are, index and summary anew.

All schemas and channels stand before the first chunk, as bytes of the damaged file, so that types
that nobody knows here are kept as well. Messages outside of chunks are put into chunks.
"""

from __future__ import annotations

import tempfile
import zlib
from collections import Counter
from collections.abc import Set
from dataclasses import dataclass, replace
from typing import IO

from mcap import records as mcap_records
from mcap.data_stream import RecordBuilder

from mhsb_sim.recording.bag_format import BagError
from mhsb_sim.recording.mcap_chunk import Chunk, ChunkHeader, message_index, take_apart
from mhsb_sim.recording.mcap_records import (
    CHUNK_TIMES,
    HEAD,
    MAGIC,
    Channel,
    Opcode,
    Schema,
)
from mhsb_sim.recording.mcap_survey import Definitions
from mhsb_sim.recording.mcap_walk import INDEX_HEAD_SIZE

CHUNK_SIZE = 32 * 1024
"""Bytes after which messages outside of chunks fill one."""

INDEX_IN_MEMORY = 4 * 1024 * 1024
"""Bytes of chunk indexes that are kept in memory; more go into a temporary file."""

MAX_ID = 2**16 - 1


class McapCopy:
    """An MCAP file in the making; `finish` completes it.

    counts: Messages written by channel, ids as they are in the new file.
    """

    def __init__(
        self,
        stream: IO[bytes],
        definitions: Definitions,
        header: bytes,
        listed: Set[tuple[int, int, int]] = frozenset(),
    ) -> None:
        """Begin a file.

        Args:
            stream: It is written to.
            definitions: All that are known.
            header: Content of the header record.
            listed: Keys of chunks that surely belong to these definitions.
        """
        self.counts: Counter[int] = Counter()
        self.definitions = definitions
        self._stream = stream
        self._at = 0
        self._checksum: int | None = None
        self._loose = bytearray()
        self._indexes = tempfile.SpooledTemporaryFile(INDEX_IN_MEMORY)  # noqa: SIM115
        self._others: list[bytes] = []
        self._chunk_count = 0
        self._times: list[tuple[int, int]] = []
        self._other_ids: _Ids | None = None
        self._listed = listed
        self._own_end: int | None = None
        self._other_end = 0
        self._write(MAGIC)
        self._record(Opcode.HEADER, header)
        self._write(_definition_bytes(definitions))

    def add_chunk(self, chunk: Chunk) -> None:
        """Write a chunk and its indexes; one whose ids mean something else here gets new ones."""
        self.flush()
        if self._contradicts(chunk):
            self._other_ids = self._new_ids(chunk)
            self._other_end = chunk.key[1]
            chunk = _with_ids(chunk, self._other_ids)
        elif self._other_ids is not None and self._continues(chunk):
            self._other_end = chunk.key[1]
            chunk = _with_ids(chunk, self._other_ids)
        else:
            self._own_end = chunk.key[1]
        if len(chunk.channels):
            self._write_chunk(chunk)

    def add_message(self, record: bytes) -> None:
        """Write a message that stood outside of chunks, given as its record."""
        if len(record) >= CHUNK_SIZE:
            self.flush()
            self._write_records(record)
            return
        self._loose += record
        if len(self._loose) >= CHUNK_SIZE:
            self.flush()

    def add_other(self, opcode: int, content: bytes) -> None:
        """Write an attachment or a metadata record, given as its content, and keep its index."""
        self.flush()
        at = self._at
        self._record(opcode, content)
        self._others.append(_index_of(opcode, content, at))

    def flush(self) -> None:
        """Write the messages that wait for a chunk to be filled."""
        if self._loose:
            unpacked, self._loose = bytes(self._loose), bytearray()
            self._write_records(unpacked)

    def finish(self) -> None:
        """Write the index and summary of everything."""
        self.flush()
        self._record(Opcode.DATA_END, bytes(4))
        begin, self._checksum = self._at, 0
        groups = [(Opcode.SCHEMA, begin)]
        self._write(_definition_bytes(Definitions(self.definitions.schemas)))
        groups.append((Opcode.CHANNEL, self._at))
        self._write(_definition_bytes(Definitions({}, self.definitions.channels)))
        groups.append((Opcode.STATISTICS, self._at))
        self._write(self._statistics())
        groups.append((Opcode.CHUNK_INDEX, self._at))
        self._indexes.seek(0)
        while part := self._indexes.read(INDEX_IN_MEMORY):
            self._write(part)
        self._indexes.close()
        for opcode in (Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX):
            groups.append((opcode, self._at))
            self._write(b"".join(each for each in self._others if each[0] == opcode))
        self._write_end(begin, groups)

    # --- Chunks ----------------------------------------------------------------------------------

    def _write_records(self, records: bytes) -> None:
        """Write a chunk of records, not compressed."""
        header = ChunkHeader(len(records), zlib.crc32(records), "")
        self._write_chunk(take_apart(header, records, records))

    def _write_chunk(self, chunk: Chunk) -> None:
        first, last, size = chunk.key
        name = chunk.header.compression.encode()
        fields = CHUNK_TIMES.pack(first, last, size, zlib.crc32(chunk.unpacked))
        fields += len(name).to_bytes(4, "little") + name + len(chunk.packed).to_bytes(8, "little")
        begin = self._at
        self._write(HEAD.pack(Opcode.CHUNK, len(fields) + len(chunk.packed)) + fields)
        self._write(chunk.packed)
        length, offsets = self._at - begin, {}
        for channel_id, count in chunk.counts().items():
            offsets[channel_id] = self._at
            content = message_index(chunk, channel_id).data.cast("B")
            self._write(HEAD.pack(Opcode.MESSAGE_INDEX, INDEX_HEAD_SIZE + len(content)))
            self._write(channel_id.to_bytes(2, "little") + len(content).to_bytes(4, "little"))
            self._write(content)
            self.counts[channel_id] += count
        self._indexes.write(
            _built(
                mcap_records.ChunkIndex(
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
        self._times = [_span([*self._times, (first, last)])]
        self._chunk_count += 1

    def _contradicts(self, chunk: Chunk) -> bool:
        """Return whether a definition in a chunk is another one than that of its id here."""
        tables = self.definitions
        return any(each != tables.table(each).get(each.id, each) for _, each in chunk.definitions)

    def _continues(self, chunk: Chunk) -> bool:
        """Return whether a chunk belongs to the last one that contradicted.

        It does if nothing says otherwise, and if it begins closer to the end of that one and its
        successors than to the end of all other chunks.
        """
        if chunk.definitions or chunk.key in self._listed:
            return False
        begin = chunk.key[0]
        if self._own_end is None:
            return bool(self._listed)
        return abs(begin - self._other_end) < abs(begin - self._own_end)

    def _new_ids(self, chunk: Chunk) -> _Ids:
        """Return under which ids the definitions of a chunk stand here; writes new ones."""
        ids = _Ids({}, {})
        for _, each in chunk.definitions:
            table = ids.schemas if isinstance(each, Schema) else ids.channels
            if each.id not in table:
                table[each.id] = self._new_id(each, ids.schemas)
        return ids

    def _new_id(self, definition: Schema | Channel, schema_ids: dict[int, int]) -> int:
        """Return the id under which a definition stands here; writes it if it is not there yet."""
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
        one = {number: table[number]}
        alone = Definitions(one) if isinstance(definition, Schema) else Definitions({}, one)
        self._write(_definition_bytes(alone))
        return number

    # --- Records ---------------------------------------------------------------------------------

    def _record(self, opcode: int, content: bytes) -> None:
        self._write(HEAD.pack(opcode, len(content)) + content)

    def _write(self, data: bytes | memoryview) -> None:
        self._stream.write(data)
        self._at += len(data)
        if self._checksum is not None:
            self._checksum = zlib.crc32(data, self._checksum)

    def _statistics(self) -> bytes:
        first, last = self._times[0] if self._times else (0, 0)
        kinds = Counter(each[0] for each in self._others)
        return _built(
            mcap_records.Statistics(
                attachment_count=kinds[Opcode.ATTACHMENT_INDEX],
                channel_count=len(self.definitions.channels),
                channel_message_counts=dict(self.counts),
                chunk_count=self._chunk_count,
                message_count=self.counts.total(),
                message_start_time=first,
                message_end_time=last,
                metadata_count=kinds[Opcode.METADATA_INDEX],
                schema_count=len(self.definitions.schemas),
            )
        )

    def _write_end(self, begin: int, groups: list[tuple[Opcode, int]]) -> None:
        """Write where the groups of the summary begin, the footer and the closing magic."""
        ends = [at for _, at in groups[1:]] + [self._at]
        offsets = self._at
        for (opcode, at), end in zip(groups, ends, strict=True):
            if end > at:
                self._write(_built(mcap_records.SummaryOffset(opcode, at, end - at)))
        self._write(HEAD.pack(Opcode.FOOTER, 20))
        self._write(begin.to_bytes(8, "little") + offsets.to_bytes(8, "little"))
        assert self._checksum is not None
        self._write(self._checksum.to_bytes(4, "little") + MAGIC)


def _definition_bytes(definitions: Definitions) -> bytes:
    """Return the records of schemas and channels."""
    built = [
        _built(mcap_records.Schema(each.id, each.data, each.encoding, each.name))
        for each in definitions.schemas.values()
    ]
    built += [
        _built(
            mcap_records.Channel(
                id=each.id,
                topic=each.topic,
                message_encoding=each.encoding,
                metadata=dict(each.metadata),
                schema_id=each.schema_id,
            )
        )
        for each in definitions.channels.values()
    ]
    return b"".join(built)


def _index_of(opcode: int, content: bytes, at: int) -> bytes:
    """Return the index record of an attachment or metadata record that begins at a place."""
    length = HEAD.size + len(content)
    if opcode == Opcode.METADATA:
        size = int.from_bytes(content[:4], "little")
        name = content[4 : 4 + size].decode("utf-8")
        return _built(mcap_records.MetadataIndex(length=length, name=name, offset=at))
    end = 16
    texts = []
    for _ in range(2):
        size = int.from_bytes(content[end : end + 4], "little")
        texts.append(content[end + 4 : end + 4 + size].decode("utf-8"))
        end += 4 + size
    return _built(
        mcap_records.AttachmentIndex(
            offset=at,
            length=length,
            log_time=int.from_bytes(content[:8], "little"),
            create_time=int.from_bytes(content[8:16], "little"),
            data_size=int.from_bytes(content[end : end + 8], "little"),
            name=texts[0],
            media_type=texts[1],
        )
    )


def _built(record: mcap_records.McapRecord) -> bytes:
    """Return the bytes of a record."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


@dataclass(frozen=True)
class _Ids:
    """Ids under which schemas and channels of a chunk stand in the new file, by those in it."""

    schemas: dict[int, int]
    channels: dict[int, int]


def _with_ids(chunk: Chunk, ids: _Ids) -> Chunk:
    """Return a chunk with other ids, not compressed."""
    unpacked = bytearray(chunk.unpacked)

    def change(at: int, table: dict[int, int]) -> None:
        number = int.from_bytes(unpacked[at : at + 2], "little")
        unpacked[at : at + 2] = table.get(number, number).to_bytes(2, "little")

    for at, each in chunk.definitions:
        begin = at + HEAD.size
        change(begin, ids.schemas if isinstance(each, Schema) else ids.channels)
        if isinstance(each, Channel):
            change(begin + 2, ids.schemas)
    for offset in chunk.each_offset():
        change(offset + HEAD.size, ids.channels)
    content = bytes(unpacked)
    return take_apart(ChunkHeader(len(content), zlib.crc32(content), ""), content, content)


def _span(times: list[tuple[int, int]]) -> tuple[int, int]:
    return min(first for first, _ in times), max(last for _, last in times)


