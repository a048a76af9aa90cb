"""Strict parsing of MCAP records: every stated length is compared with the bytes that exist.

A record consists of one byte of opcode, eight bytes of length, and its content
(https://mcap.dev/spec). A file may come from an untrusted source. Nothing is therefore allocated by
a stated length before that length is known to be within the file and below the bounds of this
module.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from mcap.writer import MCAP0_MAGIC

FILE_MAGIC = MCAP0_MAGIC
"""Bytes with which an MCAP file begins and ends."""

RECORD_HEADER = struct.Struct("<BQ")
"""Opcode and length of the content [bytes]."""

MESSAGE_HEAD = struct.Struct("<HIQQ")
"""First fields of a message: channel id, sequence number, log time and publish time [ns]."""

CHUNK_TIMES = struct.Struct("<QQQI")
"""First fields of a chunk: first and last log time [ns], unpacked size [bytes], checksum of the
unpacked bytes.
"""

MAX_CHUNK_SIZE = 64 * 1024 * 1024
"""Largest chunk that is unpacked [bytes]; ROS writes chunks of 0.8 MB, the suite of 32 KiB."""

MAX_DEFINITION_SIZE = 4 * 1024 * 1024
"""Largest record that is not a chunk, message, message index or attachment [bytes]; schemas and
channels take kilobytes.
"""

COMPRESSED_MAGICS = {"": b"", "lz4": b"\x04\x22\x4d\x18", "zstd": b"\x28\xb5\x2f\xfd"}
"""First bytes of a chunk's packed content, by the name of its compression."""

KNOWN_COMPRESSIONS = tuple(COMPRESSED_MAGICS)
"""Names of the compressions that can be unpacked; empty for none."""


class StructureError(Exception):
    """Bytes that are not the record that they claim to be; the message has no period."""


class Opcode(IntEnum):
    """Kinds of MCAP records by their first byte."""

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
"""First of the opcodes that are reserved for applications."""

FIXED_LENGTHS = {Opcode.FOOTER: 20, Opcode.DATA_END: 4, Opcode.SUMMARY_OFFSET: 17}
"""Content length of the records that always have the same length [bytes]."""


@dataclass(frozen=True)
class Schema:
    """Definition of a message type, as stored in an MCAP file.

    Attributes:
        id: Id by which channels refer to it; never 0.
        name: Name of the type.
        encoding: Encoding of `data`, such as `ros2msg`.
        data: Definition of the type.
    """

    id: int
    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True)
class Channel:
    """A recorded topic, as stored in an MCAP file.

    Attributes:
        id: Id by which messages refer to it.
        schema_id: Id of its schema; 0 for none.
        topic: Name of the topic.
        encoding: Encoding of its messages, such as `cdr`.
        metadata: Keys and values in the order of the file.
    """

    id: int
    schema_id: int
    topic: str
    encoding: str
    metadata: tuple[tuple[str, str], ...]

    def value(self, key: str) -> str:
        """Return the metadata value of a key, or an empty text if the key is missing."""
        return dict(self.metadata).get(key, "")


@dataclass(frozen=True)
class Statistics:
    """Message counts that a file states in its summary.

    Attributes:
        message_count: Number of messages in the file.
        counts: Channel id and number of messages of each channel.
    """

    message_count: int
    counts: tuple[tuple[int, int], ...]


class FieldReader:
    """Reader for the fields of one record's content, in their order.

    Each method moves the position past the field that it returns. It raises StructureError if the
    field reaches beyond the content.

    Attributes:
        at: Offset of the next field in the content.
    """

    def __init__(self, content: bytes | memoryview) -> None:
        """Begin to read the content of a record."""
        self._content = content
        self.at = 0

    def take(self, length: int) -> bytes:
        """Return the next bytes and move the read position past them.

        Args:
            length: Number of bytes.

        Returns:
            The bytes, as a copy.

        Raises:
            StructureError: The content has fewer bytes left.
        """
        if length > len(self._content) - self.at:
            raise StructureError("a field is longer than its record")
        self.at += length
        return bytes(self._content[self.at - length : self.at])

    def number(self, size: int) -> int:
        """Return the next unsigned number, stored in `size` bytes in little-endian order.

        Raises:
            StructureError: The content has fewer bytes left.
        """
        return int.from_bytes(self.take(size), "little")

    def text(self) -> str:
        """Return the next text and move the read position past it.

        Returns:
            The text. In the content, it follows its length, a number of 4 bytes.

        Raises:
            StructureError: The text is not UTF-8, or the content ends before the text does.
        """
        try:
            return self.take(self.number(4)).decode("utf-8")
        except UnicodeDecodeError:
            raise StructureError("a text is not in UTF-8") from None

    def table(self) -> tuple[tuple[str, str], ...]:
        """Return the next table of texts and move the read position past it.

        Returns:
            Pairs of key and value in the order of the file; a key may occur several times.

        Raises:
            StructureError: The entries do not end exactly where the length of the table says, or a
                text cannot be read.
        """
        end = self.number(4) + self.at
        pairs = []
        while self.at < end:
            pairs.append((self.text(), self.text()))
        if self.at != end:
            raise StructureError("a list does not end where it should")
        return tuple(pairs)

    def end(self) -> None:
        """Raise StructureError if bytes follow the last field."""
        if self.at != len(self._content):
            raise StructureError("a record is longer than its fields")


def parse_schema(content: bytes | memoryview) -> Schema:
    """Parse the content of a schema record.

    Args:
        content: Content of the record, without opcode and length.

    Returns:
        The schema.

    Raises:
        StructureError: The content is not that of a schema, or its id is 0.
    """
    fields = FieldReader(content)
    schema = Schema(fields.number(2), fields.text(), fields.text(), fields.take(fields.number(4)))
    fields.end()
    if schema.id == 0:
        raise StructureError("a schema has the id 0")
    return schema


def parse_channel(content: bytes | memoryview) -> Channel:
    """Parse the content of a channel record.

    Args:
        content: Content of the record, without opcode and length.

    Returns:
        The channel.

    Raises:
        StructureError: The content is not that of a channel.
    """
    fields = FieldReader(content)
    channel = Channel(
        fields.number(2), fields.number(2), fields.text(), fields.text(), fields.table()
    )
    fields.end()
    return channel


def parse_definition(opcode: int, content: bytes | memoryview) -> Schema | Channel:
    """Parse the content of a schema or channel record.

    Args:
        opcode: Opcode of the record: SCHEMA or CHANNEL. Every opcode other than SCHEMA is taken as
            CHANNEL.
        content: Content of the record, without opcode and length.

    Returns:
        The schema or channel.

    Raises:
        StructureError: The content is not that of a schema or channel, or has more than
            MAX_DEFINITION_SIZE bytes.
    """
    if len(content) > MAX_DEFINITION_SIZE:
        raise StructureError(f"a definition has {len(content)} bytes")
    return parse_schema(content) if opcode == Opcode.SCHEMA else parse_channel(content)


def parse_statistics(content: bytes) -> Statistics:
    """Parse the content of a statistics record.

    Only the message counts are returned. Other counts and times in the record are skipped.

    Args:
        content: Content of the record, without opcode and length.

    Returns:
        Number of messages in all and for each channel.

    Raises:
        StructureError: The content is not that of a statistics record, or the counts of the
            channels do not add up to the number in all.
    """
    fields = FieldReader(content)
    message_count = fields.number(8)
    fields.take(2 + 4 + 4 + 4 + 4 + 8 + 8)  # other counts and times
    size = fields.number(4)
    counts = tuple((fields.number(2), fields.number(8)) for _ in range(size // 10))
    fields.end()
    if size % 10 or sum(count for _, count in counts) != message_count:
        raise StructureError("the statistics contradict themselves")
    return Statistics(message_count, counts)


def parse_chunk_key(content: bytes) -> tuple[int, int, int]:
    """Return the key of a chunk from the content of its chunk index record.

    Args:
        content: Content of the chunk index record, without opcode and length.

    Returns:
        First log time [ns], last log time [ns] and unpacked size [bytes] of the chunk. Together
        they identify the chunk.

    Raises:
        StructureError: The content is not that of a chunk index.
    """
    fields = FieldReader(content)
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
    """Check that the content of a record is a number of bytes and then exactly two texts.

    Args:
        content: Content of a header or attachment index record.
        numbers: Number of bytes before the first text; their values are not checked.

    Raises:
        StructureError: The content has another structure.
    """
    fields = FieldReader(content)
    fields.take(numbers)
    fields.text()
    fields.text()
    fields.end()


def check_metadata(content: bytes) -> str:
    """Check the content of a metadata record and return the record's name.

    Args:
        content: Content of the record, without opcode and length.

    Returns:
        Name of the metadata record.

    Raises:
        StructureError: The content is not that of a metadata record.
    """
    fields = FieldReader(content)
    name = fields.text()
    fields.table()
    fields.end()
    return name


def check_metadata_index(content: bytes) -> None:
    """Check the content of a metadata index record.

    Args:
        content: Content of the record, without opcode and length.

    Raises:
        StructureError: The content is not that of a metadata index.
    """
    fields = FieldReader(content)
    fields.take(8 + 8)
    fields.text()
    fields.end()
