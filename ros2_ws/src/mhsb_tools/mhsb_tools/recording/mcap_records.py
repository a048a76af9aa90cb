"""Strict parsing of MCAP records: every stated length is compared with the bytes that exist.

A record consists of one byte of opcode, eight bytes of length, and its content
(https://mcap.dev/spec). A file may come from an untrusted source. Memory for a record is therefore
allocated only after its stated length has been checked. The length must lie within the file and
below the bounds of this module. The library `mcap` reads the fields, from a stream that contains
only the bytes of the record.
"""

import struct
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from typing import Any

from mcap import records
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap.writer import MCAP0_MAGIC

from mhsb_tools.recording import bag_format

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
"""First bytes of a chunk's packed content, by the name of its compression; empty for none."""


class StructureError(Exception):
    """Error: bytes of the file are not a valid record; its message has no period."""


FIRST_PRIVATE_OPCODE = 0x80
"""First of the opcodes that are reserved for applications."""

RECORD_PARSERS: dict[int, Callable[[ReadDataStream], Any]] = {
    Opcode.HEADER: records.Header.read,
    Opcode.FOOTER: records.Footer.read,
    Opcode.SCHEMA: records.Schema.read,
    Opcode.CHANNEL: records.Channel.read,
    Opcode.CHUNK_INDEX: records.ChunkIndex.read,
    Opcode.ATTACHMENT: records.Attachment.read,
    Opcode.ATTACHMENT_INDEX: records.AttachmentIndex.read,
    Opcode.STATISTICS: records.Statistics.read,
    Opcode.METADATA: records.Metadata.read,
    Opcode.METADATA_INDEX: records.MetadataIndex.read,
    Opcode.SUMMARY_OFFSET: records.SummaryOffset.read,
    Opcode.DATA_END: records.DataEnd.read,
}
"""Functions that read the fields of a record's content, by opcode; all kinds but chunks, messages
and message indexes.
"""


class _RecordStream(ReadDataStream):
    """Stream of one record's content; reading beyond its end raises EndOfFile."""

    def read(self, length: int) -> bytes:
        """Return the next bytes.

        Raises:
            EndOfFile: The content has fewer bytes left.
        """
        data = super().read(length)
        if len(data) < length:
            raise EndOfFile
        return data


def parse_record(opcode: int, content: bytes | memoryview) -> Any:
    """Parse the content of a record and check it.

    Args:
        opcode: Opcode of the record, one of RECORD_PARSERS.
        content: Content of the record, without opcode and length.

    Returns:
        The record, of a class of `mcap.records`. If a schema contains a ROS message definition that
        is not UTF-8, `with_known_text` has replaced this definition.

    Raises:
        StructureError: The fields do not fill the content exactly, or a text is not in UTF-8. Or a
            schema has the id 0. Or, in statistics, the channels' message counts do not add up to
            the total.
    """
    stream = _RecordStream(BytesIO(content))
    try:
        record = RECORD_PARSERS[opcode](stream)
    except (EndOfFile, OverflowError):
        raise StructureError("a field is longer than its record") from None
    except UnicodeDecodeError:
        raise StructureError("a text is not in UTF-8") from None
    if stream.count != len(content):
        raise StructureError("a record is longer than its fields")
    if isinstance(record, Schema) and record.id == 0:
        raise StructureError("a schema has the id 0")
    if isinstance(record, Schema) and not _is_usable_text(record):
        record = with_known_text(record)
    counts = record.channel_message_counts if isinstance(record, records.Statistics) else None
    if counts is not None and sum(counts.values()) != record.message_count:
        raise StructureError("the statistics contradict themselves")
    return record


def _is_usable_text(schema: Schema) -> bool:
    """Return whether the text of a schema can be used as it is.

    Args:
        schema: The schema.

    Returns:
        False if it is a ROS message definition (encoding `ros2msg`) that is not UTF-8. Schemas of
        other encodings may be binary, so the result is True.
    """
    if schema.encoding != bag_format.SCHEMA_ENCODING:
        return True
    try:
        schema.data.decode()
    except UnicodeDecodeError:
        return False
    return True


def with_known_text(schema: Schema) -> Schema:
    """Return a copy of a schema with the message definition that ROS has for the schema's type.

    Args:
        schema: The schema; its name and its id are kept.

    Returns:
        The copy. Its definition is empty if the installed ROS packages do not have the type.
    """
    known = bag_format.get_type_definition(schema.name)
    return replace(schema, encoding=bag_format.SCHEMA_ENCODING, data=known.encode())


def parse_definition(opcode: int, content: bytes | memoryview) -> Schema | Channel:
    """Parse the content of a schema or channel record.

    Args:
        opcode: Opcode of the record: SCHEMA or CHANNEL.
        content: Content of the record, without opcode and length.

    Returns:
        The schema or channel.

    Raises:
        StructureError: The content cannot be parsed as a schema or channel, or has more than
            MAX_DEFINITION_SIZE bytes.
    """
    if len(content) > MAX_DEFINITION_SIZE:
        raise StructureError(f"a definition has {len(content)} bytes")
    definition: Schema | Channel = parse_record(opcode, content)
    return definition


def serialize_record(record: records.McapRecord) -> bytes:
    """Serialize an MCAP record.

    Args:
        record: The record.

    Returns:
        Its bytes with opcode and length.
    """
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())
