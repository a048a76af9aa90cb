"""A walk through an MCAP file: its pieces one after the other, and what is damaged between them.

What cannot be a record is damage, and the walk goes on where records begin again. A chunk whose
own head is damaged is still found where the walk expects it, if one of its lengths leads to bytes
for which its checksum holds.
"""

from __future__ import annotations

import zlib
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field

import numpy as np

from mhsb_sim.recording import mcap_records as records
from mhsb_sim.recording.data_file import COST_OF_A_MESSAGE, DataFile
from mhsb_sim.recording.mcap_chunk import (
    Chunk,
    ChunkHeader,
    open_chunk,
    parse_chunk_fields,
)
from mhsb_sim.recording.mcap_records import (
    BEGINNINGS,
    CHUNK_TIMES,
    COMPRESSIONS,
    FIRST_PRIVATE_OPCODE,
    HEAD,
    MAGIC,
    MAX_CHUNK_SIZE,
    MESSAGE_HEAD,
    Channel,
    Opcode,
    Schema,
    Statistics,
    StructureError,
)
from mhsb_sim.recording.mcap_structure import CHUNK_HEAD_SIZE, WINDOW, McapStructure, Record

MAX_CHUNK_KEYS = 100_000
"""Chunk indexes that are kept in memory; a file of so many chunks of the suite has 3 GB."""

INDEX_HEAD_SIZE = 6
"""Bytes before the entries of a message index, which are 16 bytes each: time [ns], offset."""


@dataclass(frozen=True)
class Damage:
    """A part of a file that cannot be used.

    begin, end   its bytes
    reason       what is wrong, without a period
    messages     lost with it, from the index of its chunk; 0 beside messages; None if nobody knows
    times        first and last time of recording of these messages [ns]
    """

    begin: int
    end: int
    reason: str
    messages: int | None = None
    times: tuple[int, int] | None = None


@dataclass(frozen=True)
class Summary:
    """What the end of a file says of it.

    statistics  None where they are missing or damaged
    chunk_keys  of its chunk indexes: first and last time [ns], unpacked size
    definitions schemas and channels in it
    verified    its checksum is there and holds
    """

    statistics: Statistics | None
    chunk_keys: tuple[tuple[int, int, int], ...]
    definitions: tuple[Schema | Channel, ...]
    verified: bool


@dataclass
class _SummaryParts:
    """Collects a summary; `begin` is where its checksum begins, None if that is damaged."""

    begin: int | None = None
    statistics: Statistics | None = None
    chunk_keys: list[tuple[int, int, int]] = field(default_factory=list)
    definitions: list[Schema | Channel] = field(default_factory=list)

    @property
    def begun(self) -> bool:
        """Whether anything of a summary has been found."""
        return self.begin is not None or self.statistics is not None or bool(self.chunk_keys)


Piece = Chunk | Record | Schema | Channel | Summary | Damage
Walking = Generator[Piece, None, int]
"""Yields pieces and returns where the walk goes on."""


class McapWalk:
    """Goes through a file once; `pieces` yields what it finds in the order of the file.

    Records are the header, messages outside of chunks, attachments and metadata.
    """

    def __init__(self, file: DataFile) -> None:
        self._file = file
        self._structure = McapStructure(file)
        self._parts = _SummaryParts()
        self._channels: set[int] = set()
        self._unsure: int | None = None
        """Where the last record begins whose length no checksum has verified."""

    def pieces(self) -> Iterator[Piece]:
        """Yield everything that the file holds; raises BagError where it cannot be read."""
        at = yield from self._begin()
        while at < self._file.size:
            try:
                found = self._structure.record_at(at)
                if found.opcode == Opcode.CHUNK:
                    at = yield from self._chunk(found)
                elif found.opcode == Opcode.MESSAGE_INDEX:
                    at = yield from self._lost_indexes(found)
                elif found.opcode == Opcode.FOOTER:
                    at = yield from self._footer(found)
                    if at == self._file.size:
                        return
                else:
                    yield from self._other(found)
                    at, self._unsure = found.end, found.at
            except StructureError as error:
                at = yield from self._past_damage(at, str(error))
        lost = 0 if self._parts.begun else None
        yield from self._summary(self._file.size, None)
        yield Damage(self._file.size, self._file.size, "its end is missing", lost)

    def _begin(self) -> Walking:
        """Yield damage if the file does not begin as one; returns where the records begin."""
        if self._file.read(0, len(MAGIC)) == MAGIC:
            return len(MAGIC)
        at = len(MAGIC)
        lost: int | None = 0
        try:
            self._structure.check_succession(at)
        except StructureError:
            at, lost = self._structure.find(0), None
        yield Damage(0, at, "it does not begin as an MCAP file", lost)
        return at

    def _past_damage(self, at: int, reason: str) -> Walking:
        """Yield a chunk of which the head alone is damaged, or damage up to the next record."""
        found = self._chunk_of_damaged_head(at)
        if found is not None:
            chunk, end = found
            yield Damage(at, at + HEAD.size, "the head of a chunk is damaged", 0)
            yield chunk
            return self._indexes(end)[1]
        # Where a record's length is wrong, the damage shows at the next one.
        begin, self._unsure = at if self._unsure is None else self._unsure, None
        end = self._structure.find(begin + 1)
        yield Damage(min(at, end), end, reason, 0 if self._parts.begun else None)
        return end

    # --- Chunks ----------------------------------------------------------------------------------

    def _chunk(self, found: Record) -> Walking:
        """Yield a chunk, or the damage in its place; returns where the walk goes on."""
        count, end, times = self._indexes(found.end)
        try:
            chunk = self._open(found)
        except StructureError as error:
            if self._is_misleading(found):
                raise
            complete = count > 0 and end < self._file.size and self._structure.goes_on(end)
            yield Damage(found.at, end, str(error), count if complete else None, times)
            return end
        self._file.count_unpacked(COST_OF_A_MESSAGE * len(chunk.channels))
        self._channels.update(chunk.counts())
        yield chunk
        if not self._indexes_agree(chunk, found.end, end):
            yield Damage(found.end, end, "the index of a chunk is damaged", 0)
        return end

    def _open(self, found: Record) -> Chunk:
        """Return the chunk of a record; raises StructureError if it is damaged or too large."""
        head, begin, size = parse_chunk_fields(found.content)
        if size > MAX_CHUNK_SIZE:
            raise StructureError(f"a chunk has {size} bytes, above the bound of {MAX_CHUNK_SIZE}")
        self._file.count_unpacked(min(head.unpacked_size, MAX_CHUNK_SIZE))
        return open_chunk(head, self._file.read(found.begin + begin, size))

    def _is_misleading(self, found: Record) -> bool:
        """Return whether the length of a damaged chunk must not be followed.

        It must not if no record follows, if another length leads to a chunk whose checksum holds,
        or if such a chunk stands inside.
        """
        if not self._structure.goes_on(found.end):
            return True
        if self._chunk_of_damaged_head(found.at) is not None:
            return True
        for inner in self._structure.chunks_between(found.at + 1, found.end):
            try:
                if self._open(inner).header.checksum != 0:
                    return True
            except StructureError:
                continue
        return False

    def _chunk_of_damaged_head(self, at: int) -> tuple[Chunk, int] | None:
        """Find a chunk at a place by its checksum, though a field of its head is wrong.

        Returns:
            The chunk and where its record ends; None if there is none.
        """
        head = self._file.read(at, HEAD.size + CHUNK_HEAD_SIZE)
        if len(head) < HEAD.size + CHUNK_TIMES.size + 12:
            return None
        (_, length), content = HEAD.unpack_from(head), head[HEAD.size :]
        _, _, unpacked, checksum = CHUNK_TIMES.unpack_from(content)
        for compression in COMPRESSIONS:
            fields = CHUNK_TIMES.size + 4 + len(compression) + 8
            stated = int.from_bytes(content[fields - 8 : fields], "little")
            begin = at + HEAD.size + fields
            header = ChunkHeader(unpacked, checksum, compression)
            for size in dict.fromkeys((stated, length - fields, unpacked)):
                if not 0 < size <= min(MAX_CHUNK_SIZE, self._file.size - begin):
                    continue
                if checksum == 0 or not self._structure.goes_on(begin + size):
                    continue
                packed = self._file.read(begin, size)
                if not packed.startswith(BEGINNINGS[compression]):
                    continue
                self._file.count_unpacked(size if not compression else MAX_CHUNK_SIZE)
                try:
                    return open_chunk(header, packed, any_size=True), begin + size
                except StructureError:
                    continue
        return None

    # --- Indexes ---------------------------------------------------------------------------------

    def _indexes(self, at: int) -> tuple[int, int, tuple[int, int] | None]:
        """Go through the message indexes from a place on.

        Returns:
            How many messages they count, where they end, and the first and last time in them [ns].
        """
        count, times, self._unsure = 0, None, None
        while at < self._file.size:
            try:
                found = self._structure.record_at(at)
            except StructureError:
                break
            if found.opcode != Opcode.MESSAGE_INDEX:
                break
            if len(rows := self._index_rows(found)):
                count += len(rows)
                first, last = int(rows[:, 0].min()), int(rows[:, 0].max())
                times = (min(times[0], first), max(times[1], last)) if times else (first, last)
            at, self._unsure = found.end, found.at
        return count, at, times

    def _index_rows(self, found: Record) -> np.ndarray:
        """Return the entries of a message index: rows of time [ns] and offset, uint64."""
        content = self._file.read(found.begin, found.length)
        return np.frombuffer(content, "<u8", offset=INDEX_HEAD_SIZE).reshape(-1, 2)

    def _indexes_agree(self, chunk: Chunk, at: int, end: int) -> bool:
        """Return whether the indexes behind a chunk hold its messages; none at all may be there."""
        if at == end:
            return True
        missing = chunk.counts()
        while at < end:
            found = self._structure.record_at(at)
            rows, at = self._index_rows(found), found.end
            if len(rows) == 0:
                continue
            channel_id = int.from_bytes(self._file.read(found.begin, 2), "little")
            if missing.pop(channel_id, None) != len(rows):
                return False
            if np.any(rows[1:, 1] < rows[:-1, 1]):
                rows = rows[np.argsort(rows[:, 1], kind="stable")]
            wanted = chunk.channels == channel_id
            if not np.array_equal(rows[:, 0], chunk.log_ns[wanted]):
                return False
            if not np.array_equal(rows[:, 1], chunk.offsets[wanted]):
                return False
        return not missing

    def _lost_indexes(self, found: Record) -> Walking:
        """Yield the damage that indexes are which stand behind no chunk."""
        count, end, times = self._indexes(found.at)
        yield Damage(found.at, end, "a chunk is missing before its index", count, times)
        return end

    # --- Other records ---------------------------------------------------------------------------

    def _other(self, found: Record) -> Iterator[Piece]:
        """Yield what a record says that is no chunk, index of one, or footer."""
        is_private = found.opcode >= FIRST_PRIVATE_OPCODE
        is_nameless = found.opcode == Opcode.MESSAGE and not self._is_known(found)
        if is_private or is_nameless:
            if self._chunk_of_damaged_head(found.at) is not None:
                raise StructureError("the kind of a record is damaged")
            self._check_next(found.end)
            if is_nameless and self._channels:
                raise StructureError("a message outside of chunks is on no topic of the file")
        match found.opcode:
            case Opcode.SCHEMA | Opcode.CHANNEL:
                definition = self._definition(found)
                if self._parts.begun and len(self._parts.definitions) < MAX_CHUNK_KEYS:
                    self._parts.definitions.append(definition)
                yield definition
            case Opcode.HEADER | Opcode.METADATA | Opcode.MESSAGE:
                yield found
            case Opcode.ATTACHMENT:
                self._check_attachment(found)
                yield found
            case Opcode.DATA_END:
                yield from self._summary(found.at, None)
                self._parts.begin = found.end
                yield from self._check_data(found)
            case Opcode.STATISTICS:
                self._parts.statistics = records.parse_statistics(found.content)
            case Opcode.CHUNK_INDEX:
                if len(self._parts.chunk_keys) < MAX_CHUNK_KEYS:
                    self._parts.chunk_keys.append(records.parse_chunk_key(found.content))

    def _check_next(self, at: int) -> None:
        """Raise StructureError unless a record is at a place, or the end of the file."""
        if at != self._file.size:
            self._structure.record_at(at)

    def _definition(self, found: Record) -> Schema | Channel:
        """Return a schema or channel outside of chunks, and note that its channel is known."""
        definition = records.parse_definition(found.opcode, found.content)
        if isinstance(definition, Channel):
            self._channels.add(definition.id)
        return definition

    def _is_known(self, found: Record) -> bool:
        """Return whether a message outside of chunks belongs to a channel that is known."""
        channel_id, *_ = MESSAGE_HEAD.unpack(found.content)
        return channel_id in self._channels

    def _check_attachment(self, found: Record) -> None:
        """Raise StructureError if the lengths in an attachment, or its checksum, are wrong."""
        content = self._file.read(found.begin, found.length)
        fields = records.Fields(content)
        fields.take(16)
        fields.text()
        fields.text()
        fields.take(fields.number(8))
        if fields.number(4) not in (0, zlib.crc32(content[:-4])):
            raise StructureError("the checksum of an attachment is wrong")
        fields.end()

    def _check_data(self, found: Record) -> Iterator[Piece]:
        """Yield damage if the checksum of all data before a record is there and wrong."""
        stated = int.from_bytes(found.content, "little")
        if stated and stated != self._checksum(0, found.at):
            yield Damage(found.at, found.end, "the checksum of all data is wrong", 0)

    def _checksum(self, begin: int, end: int) -> int:
        """Return the checksum of a part of the file."""
        checksum = 0
        for at in range(begin, end, WINDOW):
            checksum = zlib.crc32(self._file.read(at, min(WINDOW, end - at)), checksum)
        return checksum

    def _footer(self, found: Record) -> Walking:
        """Yield the summary and what is wrong with the end; returns where the walk goes on."""
        stated = int.from_bytes(found.content[16:20], "little")
        yield from self._summary(found.end - 4, stated)
        end = found.end + len(MAGIC)
        if self._file.read(found.end, len(MAGIC)) != MAGIC:
            end = min(end, self._file.size)
            yield Damage(found.end, end, "it does not end as an MCAP file", 0)
        if end < self._file.size:
            at = self._structure.find(end)
            yield Damage(end, at, "something stands behind its end")
            return at
        return end

    def _summary(self, end: int, stated: int | None) -> Iterator[Piece]:
        """Yield the summary that was collected up to a place, whose checksum is `stated`."""
        parts, self._parts = self._parts, _SummaryParts()
        if not parts.begun:
            return
        verified = False
        if stated and parts.begin is not None:
            verified = self._checksum(parts.begin, end) == stated
            if not verified:
                yield Damage(parts.begin, end, "the checksum of the summary is wrong", 0)
        yield Summary(
            parts.statistics, tuple(parts.chunk_keys), tuple(parts.definitions), verified
        )
