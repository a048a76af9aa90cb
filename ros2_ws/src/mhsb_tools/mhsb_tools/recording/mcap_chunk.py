"""Chunks of an MCAP file: how they are unpacked within bounds, verified, and split into records.

A chunk is a record of the file that contains other records: messages, schemas and channels. They
are packed together, mostly compressed, and have one checksum.
"""

import struct
import zlib
from array import array
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from typing import NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from mhsb_tools.recording.mcap_records import (
    CHUNK_TIMES,
    FIRST_PRIVATE_OPCODE,
    MAX_CHUNK_SIZE,
    MESSAGE_HEAD,
    RECORD_HEADER,
    StructureError,
    parse_definition,
)

OFFSETS_AT_ONCE = 10_000
"""Number of message offsets that are converted to Python numbers at once."""

MAX_ZSTD_WINDOW = 128 * 1024 * 1024
"""Largest window (buffer of the decompressor) that a zstd frame may ask for [bytes]. Only the part
of the window that is in use takes memory.
"""


class ChunkHeader(NamedTuple):
    """Fields of a chunk record that describe its packed content.

    Attributes:
        unpacked_size: Size of the unpacked content [bytes].
        checksum: CRC-32 of the unpacked content; 0 if there is no checksum.
        compression: Name of the compression; empty if the content is not compressed.
    """

    unpacked_size: int
    checksum: int
    compression: str


class RawMessage(NamedTuple):
    """One message of an MCAP file.

    Attributes:
        channel_id: Id of its channel.
        log_ns: Log time, at which it was received [ns].
        publish_ns: Publish time, at which it was sent [ns].
        data: Serialized message.
    """

    channel_id: int
    log_ns: int
    publish_ns: int
    data: bytes


@dataclass(frozen=True, eq=False)
class Chunk:
    """A verified chunk.

    The arrays have one entry for each message, in the order of the messages in the chunk.

    Attributes:
        header: Fields of the chunk record.
        packed: Content as stored in the file.
        unpacked: Unpacked content, records one after the other.
        channel_ids: Channel id of each message, uint16.
        log_ns: Log time of each message [ns], uint64.
        offsets: Offset of each message's record in `unpacked`, uint64.
        definitions: Schemas and channels in the chunk, each with the offset of its record in
            `unpacked`.
    """

    header: ChunkHeader
    packed: bytes
    unpacked: bytes
    channel_ids: np.ndarray
    log_ns: np.ndarray
    offsets: np.ndarray
    definitions: tuple[tuple[int, Schema | Channel], ...]

    @property
    def key(self) -> tuple[int, int, int]:
        """First and last log time [ns] and unpacked size [bytes], which identify the chunk.

        The summary of the file states the same three numbers for each chunk. If the chunk has no
        messages, both times are 0.
        """
        if len(self.log_ns) == 0:
            return 0, 0, len(self.unpacked)
        return int(self.log_ns.min()), int(self.log_ns.max()), len(self.unpacked)

    def messages(self) -> Iterator[RawMessage]:
        """Yield the messages in the order of the chunk."""
        for offset in self.each_offset():
            yield get_message_at(self.unpacked, offset)

    def each_offset(self) -> Iterator[int]:
        """Yield the offset of each message's record in `unpacked`.

        The offsets are converted in blocks, since a list of all of them can take more memory than
        the chunk.
        """
        for first in range(0, len(self.offsets), OFFSETS_AT_ONCE):
            yield from self.offsets[first : first + OFFSETS_AT_ONCE].tolist()

    def counts(self) -> dict[int, int]:
        """Return the number of messages by channel id."""
        numbers, counts = np.unique(self.channel_ids, return_counts=True)
        return dict(zip(numbers.tolist(), counts.tolist(), strict=True))


def get_message_at(records: bytes, offset: int) -> RawMessage:
    """Return the message whose record begins at an offset.

    Args:
        records: Records one after the other, such as the unpacked content of a chunk. Their
            structure must have been checked before.
        offset: Offset of the message's record.

    Returns:
        The message.
    """
    _, length = RECORD_HEADER.unpack_from(records, offset)
    begin = offset + RECORD_HEADER.size
    channel_id, _, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(records, begin)
    data = records[begin + MESSAGE_HEAD.size : begin + length]
    return RawMessage(channel_id, log_ns, publish_ns, data)


def unpack_chunk(packed: bytes, compression: str, size: int | None) -> bytes:
    """Unpack the content of a chunk.

    Args:
        packed: Content as stored in the file.
        compression: Name of the compression: `zstd`, `lz4`, or empty for none.
        size: Size that the unpacked content must have [bytes]; None allows any size up to
            MAX_CHUNK_SIZE.

    Returns:
        The unpacked content.

    Raises:
        StructureError: The compression is unknown, the content cannot be unpacked, or its unpacked
            size is not `size` or is above MAX_CHUNK_SIZE.
    """
    if size is not None and size > MAX_CHUNK_SIZE:
        raise StructureError(
            f"a chunk states {size} bytes unpacked, above the bound of {MAX_CHUNK_SIZE}"
        )
    limit = MAX_CHUNK_SIZE if size is None else size
    try:
        if compression == "":
            data = packed
        elif compression == "zstd":
            stream = zstandard.ZstdDecompressor(max_window_size=MAX_ZSTD_WINDOW)
            data = stream.stream_reader(packed).read(limit + 1)
        elif compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=limit + 1)
        else:
            raise StructureError(f"a chunk is compressed by '{compression[:20]}', which is unknown")
    except (zstandard.ZstdError, RuntimeError, EOFError, ValueError, MemoryError):
        raise StructureError("a chunk cannot be unpacked") from None
    if len(data) > limit or (size is not None and len(data) != size):
        raise StructureError(f"a chunk does not unpack to {limit} bytes")
    return data


def open_chunk(header: ChunkHeader, packed: bytes, *, any_size: bool = False) -> Chunk:
    """Unpack a chunk, verify its checksum and find its records.

    Args:
        header: Fields of the chunk record.
        packed: Content as stored in the file.
        any_size: If True, the unpacked size in the header is ignored, because it may be damaged.
            The chunk must then have a checksum.

    Returns:
        The chunk.

    Raises:
        StructureError: The chunk is damaged or larger than MAX_CHUNK_SIZE, or `any_size` is True
            and it has no checksum.
    """
    if any_size and header.checksum == 0:
        raise StructureError("a chunk has no checksum")
    size = None if any_size else header.unpacked_size
    unpacked = unpack_chunk(packed, header.compression, size)
    if header.checksum not in (0, zlib.crc32(unpacked)):
        raise StructureError("the checksum of a chunk is wrong")
    return find_records(header, packed, unpacked)


def find_records(header: ChunkHeader, packed: bytes, unpacked: bytes) -> Chunk:
    """Find the records inside the unpacked content of a chunk.

    Some records are unusable: schemas and channels that cannot be parsed, and records of unknown
    kinds. In a chunk with a checksum they are skipped, because the right checksum shows that they
    were written like this. In a chunk without a checksum they count as damage and raise an error.

    Args:
        header: Fields of the chunk record. Its checksum must have been verified; 0 means none.
        packed: Content as stored in the file.
        unpacked: Unpacked content.

    Returns:
        The chunk with its messages and definitions.

    Raises:
        StructureError: The records do not fill the content exactly, a record has opcode 0, or a
            message is too short. In a chunk without a checksum, also if a record is unusable.
    """
    channels, log_ns, offsets = array("H"), array("Q"), array("Q")
    definitions: list[tuple[int, Schema | Channel]] = []
    view, at, end = memoryview(unpacked), 0, len(unpacked)
    message_size = MESSAGE_HEAD.size
    while at < end:
        if at + RECORD_HEADER.size > end:
            raise StructureError("a chunk ends in the middle of a record")
        opcode, length = RECORD_HEADER.unpack_from(unpacked, at)
        begin = at + RECORD_HEADER.size
        if length > end - begin:
            raise StructureError("a record reaches beyond its chunk")
        if opcode == Opcode.MESSAGE:
            if length < message_size:
                raise StructureError("a message is shorter than its head")
            channel_id, _, time_ns, _ = MESSAGE_HEAD.unpack_from(unpacked, begin)
            channels.append(channel_id)
            log_ns.append(time_ns)
            offsets.append(at)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            with nullcontext() if header.checksum == 0 else suppress(StructureError):
                definitions.append((at, parse_definition(opcode, view[begin : begin + length])))
        elif opcode == 0 or (opcode < FIRST_PRIVATE_OPCODE and header.checksum == 0):
            raise StructureError(f"a chunk holds a record of kind {opcode}")
        at = begin + length
    return Chunk(
        header,
        packed,
        unpacked,
        np.frombuffer(channels, np.uint16),
        np.frombuffer(log_ns, np.uint64),
        np.frombuffer(offsets, np.uint64),
        tuple(definitions),
    )


def compute_message_index(chunk: Chunk, channel_id: int) -> np.ndarray:
    """Compute the message index of a channel, which lists the channel's messages in a chunk.

    Args:
        chunk: The chunk.
        channel_id: Id of the channel; it need not have messages.

    Returns:
        A row for each message of the channel, in the order of the chunk, shape (messages, 2),
        little-endian uint64. Column 0 is the log time [ns], column 1 the offset of the message's
        record in the unpacked content.
    """
    rows = chunk.channel_ids == channel_id
    entries = np.empty((np.count_nonzero(rows), 2), dtype="<u8")
    entries[:, 0], entries[:, 1] = chunk.log_ns[rows], chunk.offsets[rows]
    return entries


def parse_chunk_fields(head: bytes) -> tuple[ChunkHeader, int, int]:
    """Parse the fields at the beginning of a chunk record, before its packed content.

    Args:
        head: First bytes of the record's content; CHUNK_HEAD_SIZE bytes are enough.

    Returns:
        The fields, the offset of the packed content within the record's content, and the size of
        the packed content as the record states it [bytes].

    Raises:
        StructureError: The fields cannot be parsed, or the name of the compression is too long.
    """
    try:
        _, _, size, checksum = CHUNK_TIMES.unpack_from(head)
        (length,) = struct.unpack_from("<I", head, CHUNK_TIMES.size)
        at = CHUNK_TIMES.size + 4 + length
        if length > len(head) or at + 8 > len(head):
            raise StructureError("the name of a chunk's compression is too long")
        compression = head[at - length : at].decode("ascii")
        (packed_size,) = struct.unpack_from("<Q", head, at)
    except (struct.error, UnicodeDecodeError):
        raise StructureError("a chunk has no readable head") from None
    return ChunkHeader(size, checksum, compression), at + 8, packed_size
