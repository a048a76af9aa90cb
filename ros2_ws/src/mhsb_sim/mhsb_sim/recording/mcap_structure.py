"""Where records stand in an MCAP file, and where they go on behind damage.

What is taken for a record is a chunk whose head agrees with its length, or several records of
right structure in succession. In a file that has chunks, what may stand in a chunk is never taken
for a record outside of it: the walk must not go on inside of a damaged chunk.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

from mhsb_sim.recording import mcap_records as records
from mhsb_sim.recording.data_file import DataFile
from mhsb_sim.recording.mcap_chunk import parse_chunk_fields
from mhsb_sim.recording.mcap_records import (
    FIRST_PRIVATE_OPCODE,
    HEAD,
    LENGTHS,
    MAX_CHUNK_SIZE,
    MAX_DEFINITION_SIZE,
    MESSAGE_HEAD,
    Opcode,
    StructureError,
)

CHUNK_HEAD_SIZE = 64
"""Bytes of a chunk's content in which all fields before its packed bytes stand."""

WINDOW = 1024 * 1024
"""Bytes that are searched at once for the next record."""

RECORDS_IN_SUCCESSION = 3
"""By which bytes are taken for records, behind damage; fewer would take chance for order."""

PLACE_OF_A_CHUNK = re.compile(
    rb"\x06(?=[\s\S]{5}\0\0\0[\s\S]{28}(?:\0{4}|\x03\0\0\0lz4|\x04\0\0\0zstd))"
)
PLACE_OF_A_RECORD = re.compile(rb"[\x01-\x0f](?=[\s\S]{4}\0{4})")
LONGEST_PLACE = 64
"""Bytes by which windows overlap, more than either pattern looks at."""

IN_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)


class Record(NamedTuple):
    """A record whose structure holds.

    content  the first bytes of a chunk or message; nothing of attachments, indexes of messages and
             records of applications; all of others
    """

    at: int
    opcode: int
    length: int
    content: bytes = b""

    @property
    def begin(self) -> int:
        """Where the content begins."""
        return self.at + HEAD.size

    @property
    def end(self) -> int:
        """Where the next record begins."""
        return self.at + HEAD.size + self.length


class McapStructure:
    """Finds records in a file."""

    def __init__(self, file: DataFile) -> None:
        self._file = file
        self._has_chunks: bool | None = None

    def record_at(self, at: int) -> Record:
        """Return the record at a place; raises StructureError unless its structure holds."""
        head = self._file.read(at, HEAD.size)
        if len(head) < HEAD.size:
            raise StructureError("the file ends in the middle of a record")
        opcode, length = HEAD.unpack(head)
        if opcode == 0 or Opcode.DATA_END < opcode < FIRST_PRIVATE_OPCODE:
            raise StructureError(f"there is no record of kind {opcode}")
        if length > self._file.size - at - HEAD.size:
            raise StructureError(f"a record of {length} bytes reaches beyond the end of the file")
        if length != LENGTHS.get(opcode, length):
            raise StructureError("a record has a wrong length")
        return Record(at, opcode, length, self._content(opcode, at + HEAD.size, length))

    def goes_on(self, at: int) -> bool:
        """Return whether a record that follows a chunk is at a place, or the end of the file."""
        if at == self._file.size:
            return True
        try:
            opcode = self.record_at(at).opcode
        except StructureError:
            return False
        return opcode not in IN_CHUNKS and opcode < FIRST_PRIVATE_OPCODE

    def check_succession(self, at: int, chunks_only: bool = False) -> None:
        """Raise StructureError unless a chunk, or several records, begin at a place.

        chunks_only: refuse records that also stand in chunks.
        """
        for _ in range(RECORDS_IN_SUCCESSION):
            found = self.record_at(at)
            if found.opcode == Opcode.CHUNK:
                return
            if chunks_only and found.opcode in IN_CHUNKS:
                raise StructureError("a record of a chunk stands outside of it")
            at = found.end
            if at == self._file.size or found.opcode == Opcode.FOOTER:
                return
            chunks_only &= found.opcode != Opcode.DATA_END  # a summary has them, too

    def find(self, at: int) -> int:
        """Return the next place from `at` on where records begin, or the end of the file."""
        if self._has_chunks is None:
            self._has_chunks = next(self._places(PLACE_OF_A_CHUNK, 0, False), None) is not None
        places = self._places(PLACE_OF_A_RECORD, at, self._has_chunks)
        return next(places, self._file.size)

    def chunks_between(self, at: int, end: int) -> Iterator[Record]:
        """Yield what looks like chunks and begins and ends between two places."""
        for place in self._places(PLACE_OF_A_CHUNK, at, False, end):
            found = self.record_at(place)
            if found.opcode == Opcode.CHUNK and found.end <= end:
                yield found

    def _places(
        self, pattern: re.Pattern[bytes], at: int, chunks_only: bool, end: int | None = None
    ) -> Iterator[int]:
        """Yield where records begin by a pattern of their first bytes, from `at` on."""
        end = self._file.size if end is None else end
        while (at := self._file.next_data(at)) < end:
            window = self._file.read(at, min(WINDOW, end - at) + LONGEST_PLACE)
            for match in pattern.finditer(window):
                place = at + match.start()
                if match.start() >= WINDOW or place >= end:
                    break
                try:
                    self.check_succession(place, chunks_only)
                except StructureError:
                    continue
                yield place
            at += WINDOW

    def _content(self, opcode: int, begin: int, length: int) -> bytes:
        """Return what `Record` keeps of a content; raises StructureError unless it holds."""
        if opcode >= FIRST_PRIVATE_OPCODE:
            return b""
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
            return b""
        if opcode in (Opcode.MESSAGE, Opcode.ATTACHMENT):
            if not MESSAGE_HEAD.size <= length <= MAX_CHUNK_SIZE:
                raise StructureError(
                    f"a message or attachment has {length} bytes; at most {MAX_CHUNK_SIZE} are read"
                )
            return self._file.read(begin, MESSAGE_HEAD.size) if opcode == Opcode.MESSAGE else b""
        if length > MAX_DEFINITION_SIZE:
            raise StructureError(f"a record has {length} bytes; {MAX_DEFINITION_SIZE} are read")
        content = self._file.read(begin, length)
        if opcode in _CHECKS:
            _CHECKS[opcode](content)
        return content


_CHECKS: dict[int, Callable[[bytes], object]] = {
    Opcode.HEADER: lambda content: records.check_texts(content, 0),
    Opcode.SCHEMA: records.parse_schema,
    Opcode.CHANNEL: records.parse_channel,
    Opcode.CHUNK_INDEX: records.parse_chunk_key,
    Opcode.ATTACHMENT_INDEX: lambda content: records.check_texts(content, 40),
    Opcode.STATISTICS: records.parse_statistics,
    Opcode.METADATA: records.check_metadata,
    Opcode.METADATA_INDEX: records.check_metadata_index,
}
