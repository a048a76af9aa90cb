"""Records of an MCAP file, read strictly: every length is compared with what is there.

A record is one byte of opcode, eight bytes of length and its content (https://mcap.dev/spec). A
file may come from a stranger, so nothing is allocated by a length that a file states before that
length has been found to be within the file and below the bounds of this module.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from mcap.writer import MCAP0_MAGIC

MAGIC = MCAP0_MAGIC
HEAD = struct.Struct("<BQ")
MESSAGE_HEAD = struct.Struct("<HIQQ")
"""Channel, sequence, time of recording and time of sending [ns]."""

CHUNK_TIMES = struct.Struct("<QQQI")
"""First and last time of recording [ns], unpacked size [bytes], checksum of the unpacked bytes."""

MAX_CHUNK_SIZE = 64 * 1024 * 1024
"""Largest chunk that is unpacked [bytes]; ROS writes chunks of 0.8 MB, the suite of 32 KiB."""

MAX_DEFINITION_SIZE = 4 * 1024 * 1024
"""Largest record that is not a chunk, message or index [bytes]; definitions take kilobytes."""

BEGINNINGS = {"": b"", "lz4": b"\x04\x22\x4d\x18", "zstd": b"\x28\xb5\x2f\xfd"}
"""First bytes of a chunk's packed content by its compression."""

COMPRESSIONS = tuple(BEGINNINGS)


class StructureError(Exception):
    """Bytes are not the record that they claim to be; the text says why, without a period."""


class Opcode(IntEnum):
    """Kinds of records by their first byte."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    ATTACHMENT = 0x09
    ATTACHMENT_INDEX = 0x0A
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    SUMMARY_OFFSET = 0x0E
    DATA_END = 0x0F


FIRST_PRIVATE_OPCODE = 0x80
"""From here on opcodes belong to applications."""

LENGTHS = {Opcode.FOOTER: 20, Opcode.DATA_END: 4, Opcode.SUMMARY_OFFSET: 17}
"""Content of records that have one length alone [bytes]."""


@dataclass(frozen=True)
class Schema:
    """Definition of a message type, as it stands in a file."""

    id: int
    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True)
class Channel:
    """A recorded topic, as it stands in a file; metadata in the order of the file."""

    id: int
    schema_id: int
    topic: str
    encoding: str
    metadata: tuple[tuple[str, str], ...]

    def value(self, key: str) -> str:
        """Return the metadata of a key, or an empty text."""
        return dict(self.metadata).get(key, "")


@dataclass(frozen=True)
class Statistics:
    """What a file states about itself; counts are messages by channel."""

    message_count: int
    counts: tuple[tuple[int, int], ...]


class Fields:
    """Fields of one record's content in their order; raises StructureError beyond its end."""

    def __init__(self, content: bytes | memoryview, at: int = 0) -> None:
        self._content = content
        self.at = at

    def take(self, length: int) -> bytes:
        """Return the next bytes."""
        if length > len(self._content) - self.at:
            raise StructureError("a field is longer than its record")
        self.at += length
        return bytes(self._content[self.at - length : self.at])

    def number(self, size: int) -> int:
        """Return the next unsigned number of that many bytes."""
        return int.from_bytes(self.take(size), "little")

    def text(self) -> str:
        """Return the next text."""
        try:
            return self.take(self.number(4)).decode("utf-8")
        except UnicodeDecodeError:
            raise StructureError("a text is not in UTF-8") from None

    def table(self) -> tuple[tuple[str, str], ...]:
        """Return the next list of keys and values."""
        end = self.number(4) + self.at
        pairs = []
        while self.at < end:
            pairs.append((self.text(), self.text()))
        if self.at != end:
            raise StructureError("a list does not end where it should")
        return tuple(pairs)

    def end(self) -> None:
        """Raise StructureError if the record has more bytes than its fields take."""
        if self.at != len(self._content):
            raise StructureError("a record is longer than its fields")


def parse_schema(content: bytes | memoryview) -> Schema:
    """Return the schema in the content of its record; raises StructureError."""
    fields = Fields(content)
    schema = Schema(fields.number(2), fields.text(), fields.text(), fields.take(fields.number(4)))
    fields.end()
    if schema.id == 0:
        raise StructureError("a schema has the id 0")
    return schema


def parse_channel(content: bytes | memoryview) -> Channel:
    """Return the channel in the content of its record; raises StructureError."""
    fields = Fields(content)
    channel = Channel(
        fields.number(2), fields.number(2), fields.text(), fields.text(), fields.table()
    )
    fields.end()
    return channel


def parse_definition(opcode: int, content: bytes | memoryview) -> Schema | Channel:
    """Return the schema or channel in the content of a record; raises StructureError."""
    if len(content) > MAX_DEFINITION_SIZE:
        raise StructureError(f"a definition has {len(content)} bytes")
    return parse_schema(content) if opcode == Opcode.SCHEMA else parse_channel(content)


def parse_statistics(content: bytes) -> Statistics:
    """Return the statistics in the content of their record.

    Raises StructureError also if the counts of the channels do not add up to the whole.
    """
    fields = Fields(content)
    message_count = fields.number(8)
    fields.take(2 + 4 + 4 + 4 + 4 + 8 + 8)  # other counts and times, which are counted anew
    size = fields.number(4)
    counts = tuple((fields.number(2), fields.number(8)) for _ in range(size // 10))
    fields.end()
    if size % 10 or sum(count for _, count in counts) != message_count:
        raise StructureError("the statistics contradict themselves")
    return Statistics(message_count, counts)


def parse_chunk_key(content: bytes) -> tuple[int, int, int]:
    """Return what a chunk index says of its chunk: first and last time [ns], unpacked size."""
    fields = Fields(content)
    first, last = fields.number(8), fields.number(8)
    fields.take(8 + 8)
    fields.take(fields.number(4))
    fields.take(8)
    fields.text()
    fields.take(8)
    key = first, last, fields.number(8)
    fields.end()
    return key


def check_texts(content: bytes, numbers: int) -> None:
    """Raise StructureError unless content is two texts behind that many bytes of numbers."""
    fields = Fields(content)
    fields.take(numbers)
    fields.text()
    fields.text()
    fields.end()


def check_metadata(content: bytes) -> str:
    """Return the name of a metadata record; raises StructureError unless its content is one."""
    fields = Fields(content)
    name = fields.text()
    fields.table()
    fields.end()
    return name


def check_metadata_index(content: bytes) -> None:
    """Raise StructureError unless content is that of a metadata index."""
    fields = Fields(content)
    fields.take(8 + 8)
    fields.text()
    fields.end()
