"""Walk through an MCAP file: its pieces in order, and the damage between them.

Bytes that cannot be a record are damage, and the walk continues where records begin again. The head
of a chunk states its lengths, its checksum and its compression. If the head is damaged, the chunk
is still found if one of the stated lengths leads to bytes with the right checksum.
"""

import zlib
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Schema, Statistics

from mhsb_tools.recording.data_file import COST_OF_A_MESSAGE, DataFile
from mhsb_tools.recording.mcap_chunk import (
    Chunk,
    ChunkHeader,
    open_chunk,
    parse_chunk_fields,
)
from mhsb_tools.recording.mcap_records import (
    CHUNK_TIMES,
    COMPRESSED_MAGICS,
    FILE_MAGIC,
    FIRST_PRIVATE_OPCODE,
    MAX_CHUNK_SIZE,
    MESSAGE_HEAD,
    RECORD_HEADER,
    StructureError,
    parse_record,
)
from mhsb_tools.recording.mcap_structure import (
    CHUNK_HEAD_SIZE,
    SEARCH_WINDOW_SIZE,
    McapStructure,
    RecordFrame,
)

MAX_CHUNK_KEYS = 100_000
"""Number of chunk keys kept in memory; a recording of that many chunks has 3 GB."""

INDEX_HEAD_SIZE = 6
"""Bytes before the entries of a message index; each entry is 16 bytes, log time [ns] and offset."""


@dataclass(frozen=True)
class Damage:
    """A part of a file that cannot be used.

    Attributes:
        begin: Offset of the first byte of the part.
        end: Offset after the last byte of the part.
        reason: What is wrong, without a period.
        messages: Number of messages lost in the part, from the message indexes of a damaged chunk.
            0 if no messages are lost; None if the number is unknown.
        times: First and last log time of the lost messages [ns]; None if unknown.
    """

    begin: int
    end: int
    reason: str
    messages: int | None = None
    times: tuple[int, int] | None = None


@dataclass
class Summary:
    """Summary at the end of a file, which lists the contents; the walk collects it by records.

    Attributes:
        begin: Offset of the first byte that the summary's checksum covers. The record that ends the
            data section comes right before this byte; if it is damaged or missing, None.
        statistics: Message counts; None if missing or damaged.
        chunk_keys: Key of each listed chunk: first and last log time [ns], unpacked size [bytes].
            There are at most MAX_CHUNK_KEYS.
        definitions: Schemas and channels that the summary repeats, at most MAX_CHUNK_KEYS.
        verified: True if the summary has a checksum, and the checksum is right.
    """

    begin: int | None = None
    statistics: Statistics | None = None
    chunk_keys: list[tuple[int, int, int]] = field(default_factory=list)
    definitions: list[Schema | Channel] = field(default_factory=list)
    verified: bool = False

    @property
    def begun(self) -> bool:
        """True if any part of a summary has been found."""
        return self.begin is not None or self.statistics is not None or bool(self.chunk_keys)


Piece = Chunk | RecordFrame | Schema | Channel | Summary | Damage
"""Item that a walk yields: a chunk, a record, a definition outside chunks, a summary, or damage."""

Walking = Generator[Piece, None, int]
"""Generator that yields pieces and returns the offset at which the walk continues."""


class McapWalk:
    """One walk through a file; `iterate_pieces` yields what it finds in the order of the file.

    Pieces are verified chunks, schemas and channels outside chunks, summaries, and damage.
    RecordFrames stand for the header, messages outside chunks, attachments and metadata records.
    """

    def __init__(self, file: DataFile) -> None:
        """Prepare the walk; nothing is read yet.

        Args:
            file: The MCAP file.
        """
        self._file = file
        self._structure = McapStructure(file)
        self._parts = Summary()
        self._channels: set[int] = set()
        self._unverified_offset: int | None = None
        """Offset of the last record if no checksum has verified its length, else None."""

    def iterate_pieces(self) -> Iterator[Piece]:
        """Yield everything that the file contains; call it only once.

        A piece is a verified chunk, a record, a schema or channel outside chunks, a summary, or
        damage. If the file does not end with a footer, the last piece is damage of zero bytes.

        Yields:
            Pieces in the order of the file.

        Raises:
            BagError: The file cannot be read, or its budget for reading or unpacking is used up. No
                usable recording needs more than these budgets.
        """
        at = yield from self._begin()
        while at < self._file.size:
            try:
                found = self._structure.read_frame(at)
                if found.opcode == Opcode.CHUNK:
                    at = yield from self._yield_chunk(found)
                elif found.opcode == Opcode.MESSAGE_INDEX:
                    at = yield from self._lost_indexes(found)
                elif found.opcode == Opcode.FOOTER:
                    at = yield from self._footer(found)
                    if at == self._file.size:
                        return
                else:
                    yield from self._yield_other_record(found)
                    at, self._unverified_offset = found.end, found.at
            except StructureError as error:
                at = yield from self._skip_damage(at, str(error))
        lost = 0 if self._parts.begun else None
        yield from self._summary(self._file.size, None)
        yield Damage(self._file.size, self._file.size, "its end is missing", lost)

    def _begin(self) -> Walking:
        """Check the magic bytes at the beginning of the file, and yield damage if they are wrong.

        If records follow directly after wrong magic bytes, only the magic bytes are damaged.
        Otherwise the damage reaches to the next records in the file.

        Yields:
            At most one piece of damage.

        Returns:
            Offset of the first record.
        """
        if self._file.read(0, len(FILE_MAGIC)) == FILE_MAGIC:
            return len(FILE_MAGIC)
        at = len(FILE_MAGIC)
        lost: int | None = 0
        try:
            self._structure.check_succession(at)
        except StructureError:
            at, lost = self._structure.find_next_records(0), None
        yield Damage(0, at, "it does not begin as an MCAP file", lost)
        return at

    def _skip_damage(self, at: int, reason: str) -> Walking:
        """Yield the damage at an offset, and find where the file continues.

        No usable record begins at the offset. There are two cases:

        - A chunk begins at the offset, and only its head is damaged. The head is yielded as damage,
          and then the chunk is yielded.
        - In any other case, the next records are searched. All bytes from `at` to them are damage.

        The record before `at` may have a wrong length that no checksum has verified. The search
        then begins inside that record. The next records may begin before `at`; the damage is then
        empty.

        Args:
            at: Offset of the damage.
            reason: What is wrong, without a period.

        Yields:
            Damage, and possibly a chunk. The damage states 0 lost messages if only the head of a
            chunk is damaged, or if a summary has begun before. Otherwise the number is None, which
            means unknown.

        Returns:
            Offset at which the walk continues. After a chunk, it is the offset after the chunk's
            message indexes.

        Raises:
            BagError: The budget for reading or unpacking is used up.
        """
        found = self._chunk_of_damaged_head(at)
        if found is not None:
            chunk, end = found
            yield Damage(at, at + RECORD_HEADER.size, "the head of a chunk is damaged", 0)
            yield chunk
            return self._indexes(end)[1]
        # If a record's length is wrong, the fault shows only where the next record should be.
        begin, self._unverified_offset = (
            at if self._unverified_offset is None else self._unverified_offset,
            None,
        )
        end = self._structure.find_next_records(begin + 1)
        yield Damage(min(at, end), end, reason, 0 if self._parts.begun else None)
        return end

    # --- Chunks ----------------------------------------------------------------------------------

    def _yield_chunk(self, found: RecordFrame) -> Walking:
        """Yield the chunk of a record, or damage if the chunk is damaged.

        Message indexes follow each chunk. Complete indexes of a damaged chunk give the number of
        lost messages. Otherwise the number is None, which means unknown. Message indexes
        that do not fit an undamaged chunk are yielded as damage with 0 lost messages.

        A damaged index may state a wrong length, so that it seems to contain the next chunk. If a
        chunk with the right checksum begins within the indexes, the damage ends at that chunk.

        Args:
            found: A chunk record.

        Yields:
            The chunk or damage, and possibly damage of the message indexes.

        Returns:
            Offset after the message indexes that follow the chunk.

        Raises:
            StructureError: The chunk is damaged, and probably its stated length is wrong as well.
            BagError: The budget for reading or unpacking is used up.
        """
        count, end, times = self._indexes(found.end)
        try:
            chunk = self._open(found)
        except StructureError as error:
            if self._has_untrusted_length(found):
                raise
            complete = count > 0 and end < self._file.size and self._structure.can_continue_at(end)
            at = self._find_verified_chunk(found.end, end)
            if at is not None:
                end, complete = at, False
            yield Damage(found.at, end, str(error), count if complete else None, times)
            return end
        self._file.count_unpacked(COST_OF_A_MESSAGE * len(chunk.channel_ids))
        self._channels.update(chunk.counts())
        yield chunk
        if not self._indexes_agree(chunk, found.end, end):
            at = self._find_verified_chunk(found.end, end)
            end = end if at is None else at
            yield Damage(found.end, end, "the index of a chunk is damaged", 0)
        return end

    def _open(self, found: RecordFrame) -> Chunk:
        """Read, unpack and verify the chunk of a record.

        Args:
            found: A chunk record.

        Returns:
            The chunk.

        Raises:
            StructureError: The chunk is damaged or larger than MAX_CHUNK_SIZE.
            BagError: The budget for reading or unpacking is used up.
        """
        head, begin, size = parse_chunk_fields(found.content)
        if size > MAX_CHUNK_SIZE:
            raise StructureError(f"a chunk has {size} bytes, above the bound of {MAX_CHUNK_SIZE}")
        self._file.count_unpacked(min(head.unpacked_size, MAX_CHUNK_SIZE))
        return open_chunk(head, self._file.read(found.begin + begin, size))

    def _has_untrusted_length(self, found: RecordFrame) -> bool:
        """Return whether the stated length of a damaged chunk is probably wrong.

        Args:
            found: Record of the damaged chunk.

        Returns:
            True in each of three cases. No record that can follow a chunk begins at its stated end.
            Or another length gives a chunk with the right checksum. Or another chunk with the right
            checksum begins inside it.

        Raises:
            BagError: The budget for reading or unpacking is used up.
        """
        if not self._structure.can_continue_at(found.end):
            return True
        if self._chunk_of_damaged_head(found.at) is not None:
            return True
        return self._find_verified_chunk(found.at + 1, found.end) is not None

    def _find_verified_chunk(self, at: int, end: int) -> int | None:
        """Find a chunk with the right checksum that begins between two offsets.

        Args:
            at: Smallest offset at which it may begin.
            end: Offset before which it must begin.

        Returns:
            The smallest offset of such a chunk; None if there is none. A chunk without a checksum
            is not found.

        Raises:
            BagError: The budget for reading or unpacking is used up.
        """
        for inner in self._structure.find_chunks_between(at, end):
            try:
                if self._open(inner).header.checksum != 0:
                    return inner.at
            except StructureError:
                continue
        return None

    def _chunk_of_damaged_head(self, at: int) -> tuple[Chunk, int] | None:
        """Find the chunk that begins at an offset, even if one field of its head is damaged.

        All known compressions are tried, each with three packed sizes: the stated packed size, the
        size by the record's length, and the stated unpacked size. A combination counts only if the
        content begins as its compression requires, and a record that can follow a chunk comes next.
        The first that gives content with the stated checksum is taken. A chunk without a checksum
        is never found.

        Args:
            at: Offset at which the chunk record would begin.

        Returns:
            The chunk and the offset at which its record ends; None if there is none.

        Raises:
            BagError: The budget for unpacking is used up.
        """
        head = self._file.read(at, RECORD_HEADER.size + CHUNK_HEAD_SIZE)
        if len(head) < RECORD_HEADER.size + CHUNK_TIMES.size + 12:
            return None
        (_, length), content = RECORD_HEADER.unpack_from(head), head[RECORD_HEADER.size :]
        _, _, unpacked, checksum = CHUNK_TIMES.unpack_from(content)
        for compression, magic in COMPRESSED_MAGICS.items():
            fields = CHUNK_TIMES.size + 4 + len(compression) + 8
            stated = int.from_bytes(content[fields - 8 : fields], "little")
            begin = at + RECORD_HEADER.size + fields
            header = ChunkHeader(unpacked, checksum, compression)
            for size in dict.fromkeys((stated, length - fields, unpacked)):
                if not 0 < size <= min(MAX_CHUNK_SIZE, self._file.size - begin):
                    continue
                if checksum == 0 or not self._structure.can_continue_at(begin + size):
                    continue
                packed = self._file.read(begin, size)
                if not packed.startswith(magic):
                    continue
                self._file.count_unpacked(size if not compression else MAX_CHUNK_SIZE)
                try:
                    return open_chunk(header, packed, any_size=True), begin + size
                except StructureError:
                    continue
        return None

    # --- Indexes ---------------------------------------------------------------------------------

    def _indexes(self, at: int) -> tuple[int, int, tuple[int, int] | None]:
        """Read all message indexes that follow each other from an offset on.

        A message index lists log time and place of the messages of one channel in the chunk before
        it. A damaged frame ends the reading without an error. `_unverified_offset` becomes the
        offset of the last index; None without an index.

        Args:
            at: Offset of the first message index.

        Returns:
            Number of messages in all these indexes, offset after the last one, and first and last
            log time of the messages [ns]. The times are None if no messages are listed. Without an
            index at `at`, the number is 0 and the offset is `at`.
        """
        count, times, self._unverified_offset = 0, None, None
        while at < self._file.size:
            try:
                found = self._structure.read_frame(at)
            except StructureError:
                break
            if found.opcode != Opcode.MESSAGE_INDEX:
                break
            if len(rows := self._index_rows(found)):
                count += len(rows)
                first, last = int(rows[:, 0].min()), int(rows[:, 0].max())
                times = (min(times[0], first), max(times[1], last)) if times else (first, last)
            at, self._unverified_offset = found.end, found.at
        return count, at, times

    def _index_rows(self, found: RecordFrame) -> np.ndarray:
        """Return the entries of a message index.

        Args:
            found: Record of the message index.

        Returns:
            A row for each message, shape (messages, 2), uint64. Column 0 is its log time [ns],
            column 1 the offset of its record in the unpacked chunk.
        """
        content = self._file.read(found.begin, found.length)
        return np.frombuffer(content, "<u8", offset=INDEX_HEAD_SIZE).reshape(-1, 2)

    def _indexes_agree(self, chunk: Chunk, at: int, end: int) -> bool:
        """Return whether the message indexes after a chunk list exactly the chunk's messages.

        Log time and offset of each message are compared. The order of the entries in an index does
        not matter.

        Args:
            chunk: The chunk.
            at: Offset of the first message index.
            end: Offset after the last one.

        Returns:
            True if they agree, or if there are no message indexes.
        """
        if at == end:
            return True
        missing = chunk.counts()
        while at < end:
            found = self._structure.read_frame(at)
            rows, at = self._index_rows(found), found.end
            if len(rows) == 0:
                continue
            channel_id = int.from_bytes(self._file.read(found.begin, 2), "little")
            if missing.pop(channel_id, None) != len(rows):
                return False
            if np.any(rows[1:, 1] < rows[:-1, 1]):
                rows = rows[np.argsort(rows[:, 1], kind="stable")]
            wanted = chunk.channel_ids == channel_id
            if not np.array_equal(rows[:, 0], chunk.log_ns[wanted]):
                return False
            if not np.array_equal(rows[:, 1], chunk.offsets[wanted]):
                return False
        return not missing

    def _lost_indexes(self, found: RecordFrame) -> Walking:
        """Yield damage for message indexes that do not follow a chunk.

        Args:
            found: Record of the first message index. Only its offset `at` is read.

        Yields:
            One piece of damage. All messages in the lists of the indexes are counted as lost. The
            damage may also end earlier, at an intact chunk between the indexes. The number of lost
            messages is then None, which means unknown.

        Returns:
            Offset after the damage.

        Raises:
            BagError: The budget for reading or unpacking is used up.
        """
        count, end, times = self._indexes(found.at)
        at = self._find_verified_chunk(found.at, end)
        lost, end = (count, end) if at is None else (None, at)
        yield Damage(found.at, end, "a chunk is missing before its index", lost, times)
        return end

    # --- Other records ---------------------------------------------------------------------------

    def _yield_other_record(self, found: RecordFrame) -> Iterator[Piece]:
        """Evaluate a record that is no chunk, message index or footer, and yield its piece.

        Records of the summary are collected; the summary is yielded later as one piece. Records
        that the suite does not use yield nothing. Two kinds of records may in fact be chunks with a
        damaged opcode: records of applications, and messages on an unknown channel. Both kinds are
        accepted only after further checks.

        Args:
            found: The record.

        Yields:
            The schema or channel, or the record of a header, message, attachment or metadata. The
            record that ends the data section yields a summary if parts of one came before. It also
            yields damage if the checksum of the data is wrong.

        Raises:
            StructureError: The record is damaged.
            BagError: The budget for reading or unpacking is used up.
        """
        is_private = found.opcode >= FIRST_PRIVATE_OPCODE
        is_nameless = (
            found.opcode == Opcode.MESSAGE
            and MESSAGE_HEAD.unpack(found.content)[0] not in self._channels
        )
        if is_private or is_nameless:
            if self._chunk_of_damaged_head(found.at) is not None:
                raise StructureError("the kind of a record is damaged")
            if found.end != self._file.size:
                self._structure.read_frame(found.end)  # raises if no record follows
            if is_nameless and self._channels:
                raise StructureError("a message outside of chunks is on no topic of the file")
        match found.opcode:
            case Opcode.SCHEMA | Opcode.CHANNEL:
                if found.opcode == Opcode.CHANNEL:
                    self._channels.add(found.content.id)
                if self._parts.begun and len(self._parts.definitions) < MAX_CHUNK_KEYS:
                    self._parts.definitions.append(found.content)
                yield found.content
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
                self._parts.statistics = found.content
            case Opcode.CHUNK_INDEX:
                if len(self._parts.chunk_keys) < MAX_CHUNK_KEYS:
                    index = found.content
                    times = index.message_start_time, index.message_end_time
                    self._parts.chunk_keys.append((*times, index.uncompressed_size))

    def _check_attachment(self, found: RecordFrame) -> None:
        """Check the lengths of the fields in an attachment, and its checksum if it has one.

        Args:
            found: Record of the attachment.

        Raises:
            StructureError: A length or the checksum is wrong.
        """
        content = self._file.read(found.begin, found.length)
        parse_record(Opcode.ATTACHMENT, content)
        if int.from_bytes(content[-4:], "little") not in (0, zlib.crc32(content[:-4])):
            raise StructureError("the checksum of an attachment is wrong")

    def _check_data(self, found: RecordFrame) -> Iterator[Piece]:
        """Yield damage if the checksum of the data section is wrong.

        Args:
            found: Record that ends the data section. It states the checksum of all bytes of the
                file before this record. These bytes are read again and compared with the checksum.
                If it is 0, there is no checksum, and nothing is checked.

        Yields:
            At most one piece of damage. It covers only the record `found` and has 0 lost messages.
        """
        stated = found.content.data_section_crc
        if stated and stated != self._checksum(0, found.at):
            yield Damage(found.at, found.end, "the checksum of all data is wrong", 0)

    def _checksum(self, begin: int, end: int) -> int:
        """Return the CRC-32 of a part of the file.

        Args:
            begin: Offset of its first byte.
            end: Offset after its last byte.

        Returns:
            The checksum.
        """
        checksum = 0
        for at in range(begin, end, SEARCH_WINDOW_SIZE):
            checksum = zlib.crc32(self._file.read(at, min(SEARCH_WINDOW_SIZE, end - at)), checksum)
        return checksum

    def _footer(self, found: RecordFrame) -> Walking:
        """Yield the summary, and damage if the file does not end properly after its footer.

        Args:
            found: Record of the footer.

        Yields:
            Up to four pieces in this order. The first is damage if the summary's checksum is wrong,
            the second the summary, if there is one. The others are damage if the magic bytes after
            the footer are wrong, and damage if further bytes follow.

        Returns:
            Offset at which the walk continues: the end of the file, or the next records after the
            footer.
        """
        yield from self._summary(found.end - 4, found.content.summary_crc)
        end = found.end + len(FILE_MAGIC)
        if self._file.read(found.end, len(FILE_MAGIC)) != FILE_MAGIC:
            end = min(end, self._file.size)
            yield Damage(found.end, end, "it does not end as an MCAP file", 0)
        if end < self._file.size:
            at = self._structure.find_next_records(end)
            yield Damage(end, at, "something stands behind its end")
            return at
        return end

    def _summary(self, end: int, stated: int | None) -> Iterator[Piece]:
        """Yield the summary whose parts were collected, and begin to collect a new one.

        If no part was collected, nothing is yielded.

        Args:
            end: Offset of the first byte after the part that the checksum covers.
            stated: Checksum in the footer; None or 0 if there is none.

        Yields:
            Damage if the checksum is wrong, and then the summary in any case. The summary counts as
            verified if its checksum is right. The checksum covers the bytes after the record that
            ends the data section. If that record was not found, the checksum is not examined.
        """
        parts, self._parts = self._parts, Summary()
        if not parts.begun:
            return
        if stated and parts.begin is not None:
            parts.verified = self._checksum(parts.begin, end) == stated
            if not parts.verified:
                yield Damage(parts.begin, end, "the checksum of the summary is wrong", 0)
        yield parts
