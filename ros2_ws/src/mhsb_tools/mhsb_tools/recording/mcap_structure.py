"""Finding records in an MCAP file, also behind damage.

Bytes count as records if they are a chunk whose stated lengths agree with each other, or several
records of right structure in succession. In a file that has chunks, schemas, channels and messages
are not accepted outside chunks. Otherwise the search could continue inside a damaged chunk.
"""

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from mcap.opcode import Opcode

from mhsb_tools.recording.data_file import DataFile
from mhsb_tools.recording.mcap_chunk import parse_chunk_fields
from mhsb_tools.recording.mcap_records import (
    FIRST_PRIVATE_OPCODE,
    MAX_CHUNK_SIZE,
    MAX_DEFINITION_SIZE,
    MESSAGE_HEAD,
    RECORD_HEADER,
    StructureError,
    parse_record,
)

CHUNK_HEAD_SIZE = 64
"""Bytes of a chunk's content that contain all fields before its packed content."""

SEARCH_WINDOW_SIZE = 1024 * 1024
"""Bytes that are searched at once for the next record."""

RECORDS_IN_SUCCESSION = 3
"""Records of right structure that must follow each other behind damage.

With fewer of them, random bytes could be taken for records.
"""

PLACE_OF_A_CHUNK = re.compile(
    rb"\x06(?=[\s\S]{5}\0\0\0[\s\S]{28}(?:\0{4}|\x03\0\0\0lz4|\x04\0\0\0zstd))"
)
"""Pattern of a chunk's first bytes: opcode, a length below 1 TiB, and the name of a known
compression.
"""

PLACE_OF_A_RECORD = re.compile(rb"[\x01-\x0f](?=[\s\S]{4}\0{4})")
"""Pattern of a record's first bytes: known opcode, and a length below 4 GiB."""

LONGEST_PLACE = 64
"""Bytes by which search windows overlap; neither pattern looks at more."""

IN_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
"""Opcodes of the records that chunks contain."""


class RecordFrame(NamedTuple):
    """Position of a record whose structure has been checked.

    Attributes:
        at: Offset of the record in the file.
        opcode: Its opcode.
        length: Length of its content [bytes].
        content: Head of a chunk or message in bytes. None for attachments, message indexes and
            records of applications. All others are parsed: records of classes of `mcap.records`.
    """

    at: int
    opcode: int
    length: int
    content: Any = None

    @property
    def begin(self) -> int:
        """Offset of the record's content in the file."""
        return self.at + RECORD_HEADER.size

    @property
    def end(self) -> int:
        """Offset of the next record in the file."""
        return self.at + RECORD_HEADER.size + self.length


class McapStructure:
    """Finder of records in a file."""

    def __init__(self, file: DataFile) -> None:
        """Keep the file; nothing is read yet.

        Args:
            file: The MCAP file.
        """
        self._file = file
        self._has_chunks: bool | None = None

    def read_frame(self, at: int) -> RecordFrame:
        """Read the record at an offset and check its structure.

        The check covers opcode and length. Most small records are also parsed completely. Of a
        chunk, only the fields before its packed content are checked. Checksums are not verified.

        Args:
            at: Offset of the record in the file.

        Returns:
            Position of the record, with the part of its content that the check has read.

        Raises:
            StructureError: There is no record of right structure at the offset.
        """
        head = self._file.read(at, RECORD_HEADER.size)
        if len(head) < RECORD_HEADER.size:
            raise StructureError("the file ends in the middle of a record")
        opcode, length = RECORD_HEADER.unpack(head)
        if opcode == 0 or Opcode.DATA_END < opcode < FIRST_PRIVATE_OPCODE:
            raise StructureError(f"there is no record of kind {opcode}")
        if length > self._file.size - at - RECORD_HEADER.size:
            raise StructureError(f"a record of {length} bytes reaches beyond the end of the file")
        return RecordFrame(
            at, opcode, length, self._check_content(opcode, at + RECORD_HEADER.size, length)
        )

    def can_continue_at(self, at: int) -> bool:
        """Return whether an offset can be the end of a chunk, judged by what follows.

        Args:
            at: Offset directly after a chunk, or after the message indexes that follow it.

        Returns:
            True at the end of the file, or if a record of right structure begins there. Schemas,
            channels and messages do not count, because they are inside chunks. Records of
            applications do not count either.
        """
        if at == self._file.size:
            return True
        try:
            opcode = self.read_frame(at).opcode
        except StructureError:
            return False
        return opcode not in IN_CHUNKS and opcode < FIRST_PRIVATE_OPCODE

    def check_succession(self, at: int, chunks_only: bool = False) -> None:
        """Check that a chunk, or several records one after the other, begin at an offset.

        RECORDS_IN_SUCCESSION records of right structure are required. Fewer are enough in three
        cases: one of them is a chunk, one is the footer, or the file ends after the last one.

        Args:
            at: Offset of the first record.
            chunks_only: True refuses schemas, channels and messages outside chunks. After the
                record that ends the data section they are accepted, because the summary repeats
                schemas and channels.

        Raises:
            StructureError: There are no such records.
        """
        for _ in range(RECORDS_IN_SUCCESSION):
            found = self.read_frame(at)
            if found.opcode == Opcode.CHUNK:
                return
            if chunks_only and found.opcode in IN_CHUNKS:
                raise StructureError("a record of a chunk stands outside of it")
            at = found.end
            if at == self._file.size or found.opcode == Opcode.FOOTER:
                return
            chunks_only &= found.opcode != Opcode.DATA_END  # the summary has such records, too

    def find_next_records(self, at: int) -> int:
        """Search the file for the next offset at which records begin.

        If the file has chunks, offsets of schemas, channels and messages are not accepted, because
        these may be inside a damaged chunk. The first call searches the whole file for a chunk;
        later calls use its answer.

        Args:
            at: Offset at which the search begins.

        Returns:
            The first offset at or after `at` at which records begin; the file's size if there is
            none.
        """
        if self._has_chunks is None:
            self._has_chunks = next(self._places(PLACE_OF_A_CHUNK, 0, False), None) is not None
        places = self._places(PLACE_OF_A_RECORD, at, self._has_chunks)
        return next(places, self._file.size)

    def find_chunks_between(self, at: int, end: int) -> Iterator[RecordFrame]:
        """Yield the records that look like chunks and begin between two offsets.

        Only their structure is checked. They may be random bytes that happen to have it.

        Args:
            at: Smallest offset at which a chunk may begin.
            end: Offset before which it must begin.

        Yields:
            The records in the order of the file; they may overlap.

        Raises:
            BagError: The file cannot be read, or more of it was read than its limit allows.
        """
        for place in self._places(PLACE_OF_A_CHUNK, at, False, end):
            found = self.read_frame(place)
            if found.opcode == Opcode.CHUNK:
                yield found

    def _places(
        self, pattern: re.Pattern[bytes], at: int, chunks_only: bool, end: int | None = None
    ) -> Iterator[int]:
        """Yield the offsets at which bytes match a pattern and records begin.

        A match counts only if `check_succession` finds records there. Holes of sparse files are
        skipped.

        Args:
            pattern: Pattern of the first bytes of a record.
            at: Offset at which the search begins.
            chunks_only: True refuses schemas, channels and messages outside chunks.
            end: Offset before which a record must begin; None for the end of the file.

        Yields:
            Offsets in increasing order.
        """
        end = self._file.size if end is None else end
        while (at := self._file.next_data(at)) < end:
            window = self._file.read(at, min(SEARCH_WINDOW_SIZE, end - at) + LONGEST_PLACE)
            for match in pattern.finditer(window):
                place = at + match.start()
                if match.start() >= SEARCH_WINDOW_SIZE or place >= end:
                    break
                try:
                    self.check_succession(place, chunks_only)
                except StructureError:
                    continue
                yield place
            at += SEARCH_WINDOW_SIZE

    def _check_content(self, opcode: int, begin: int, length: int) -> Any:
        """Check the content of a record and return the part of it that is of use.

        Args:
            opcode: Opcode of the record.
            begin: Offset of the content in the file.
            length: Length of the content [bytes]; it must end within the file.

        Returns:
            The first bytes of a chunk or a message. None for an attachment, a message index or a
            record of an application. The parsed record in all other cases.

        Raises:
            StructureError: The content has a wrong structure, or is longer than the limit for its
                kind.
        """
        if opcode >= FIRST_PRIVATE_OPCODE:
            return None
        if opcode == Opcode.CHUNK:
            head = self._file.read(begin, min(CHUNK_HEAD_SIZE, length))
            _, at, size = parse_chunk_fields(head)
            if at + size != length:
                raise StructureError("the lengths in the head of a chunk contradict each other")
            return head
        if opcode == Opcode.MESSAGE_INDEX:
            size = int.from_bytes(self._file.read(begin, 6)[2:], "little")
            if size + 6 != length or size % 16 or length > MAX_CHUNK_SIZE:
                raise StructureError("an index has a wrong length")
            return None
        if opcode in (Opcode.MESSAGE, Opcode.ATTACHMENT):
            if not MESSAGE_HEAD.size <= length <= MAX_CHUNK_SIZE:
                raise StructureError(
                    f"a message or attachment has {length} bytes; at most {MAX_CHUNK_SIZE} are read"
                )
            return self._file.read(begin, MESSAGE_HEAD.size) if opcode == Opcode.MESSAGE else None
        if length > MAX_DEFINITION_SIZE:
            raise StructureError(f"a record has {length} bytes; {MAX_DEFINITION_SIZE} are read")
        return parse_record(opcode, self._file.read(begin, length))
