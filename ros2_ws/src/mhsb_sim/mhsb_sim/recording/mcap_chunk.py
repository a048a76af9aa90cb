"""Chunks of an MCAP file: unpacked within bounds, verified by their checksum, taken apart."""

from __future__ import annotations

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

from mhsb_sim.recording.mcap_records import (
    CHUNK_TIMES,
    FIRST_PRIVATE_OPCODE,
    HEAD,
    MAX_CHUNK_SIZE,
    MESSAGE_HEAD,
    Channel,
    Opcode,
    Schema,
    StructureError,
    parse_definition,
)

OFFSETS_AT_ONCE = 10_000
"""Places of messages that are made Python's numbers at once."""

MAX_ZSTD_WINDOW = 128 * 1024 * 1024
"""Memory that a zstd frame may ask for [bytes]; it is touched only as far as it is filled."""


class ChunkHeader(NamedTuple):
    """What a chunk's record says: its unpacked size [bytes], checksum (0: none) and compression."""

    unpacked_size: int
    checksum: int
    compression: str


class RawMessage(NamedTuple):
    """One message: its channel, times of recording and of sending [ns], serialized content."""

    channel_id: int
    log_ns: int
    publish_ns: int
    data: bytes


@dataclass(frozen=True, eq=False)
class Chunk:
    """A verified chunk.

    packed       as it stands in the file
    unpacked     records one after the other
    channels     channel of each message, in the order of the chunk, uint16
    log_ns       time of recording of each message [ns], uint64
    offsets      where the record of each message begins in `unpacked`, uint64
    definitions  schemas and channels in it, each with the begin of its record
    """

    header: ChunkHeader
    packed: bytes
    unpacked: bytes
    channels: np.ndarray
    log_ns: np.ndarray
    offsets: np.ndarray
    definitions: tuple[tuple[int, Schema | Channel], ...]

    @property
    def key(self) -> tuple[int, int, int]:
        """First and last time of recording [ns] and unpacked size: what a chunk index says."""
        if len(self.log_ns) == 0:
            return 0, 0, len(self.unpacked)
        return int(self.log_ns.min()), int(self.log_ns.max()), len(self.unpacked)

    def messages(self) -> Iterator[RawMessage]:
        """Yield the messages in the order of the chunk."""
        for offset in self.each_offset():
            yield message_at(self.unpacked, offset)

    def each_offset(self) -> Iterator[int]:
        """Yield where the records of messages begin; a list of all takes more than the chunk."""
        for first in range(0, len(self.offsets), OFFSETS_AT_ONCE):
            yield from self.offsets[first : first + OFFSETS_AT_ONCE].tolist()

    def counts(self) -> dict[int, int]:
        """Return the number of messages of each channel."""
        numbers, counts = np.unique(self.channels, return_counts=True)
        return dict(zip(numbers.tolist(), counts.tolist(), strict=True))


def message_at(records: bytes, offset: int) -> RawMessage:
    """Return the message whose record begins at an offset of verified records."""
    _, length = HEAD.unpack_from(records, offset)
    begin = offset + HEAD.size
    channel_id, _, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(records, begin)
    data = records[begin + MESSAGE_HEAD.size : begin + length]
    return RawMessage(channel_id, log_ns, publish_ns, data)


def unpack(packed: bytes, compression: str, size: int | None) -> bytes:
    """Return the unpacked bytes of a chunk.

    Args:
        packed: Bytes as they stand in the file.
        compression: Name as it stands in the file; empty for none.
        size: What the unpacked bytes must measure; None for anything within MAX_CHUNK_SIZE.

    Raises:
        StructureError: The size is another one or above the bound, or the bytes are damaged.
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
    """Unpack a chunk, verify its checksum and take it apart.

    Args:
        header: What its record says.
        packed: Bytes as they stand in the file.
        any_size: Take whatever size it unpacks to; its checksum must then be there.

    Raises:
        StructureError: It is damaged, or larger than is unpacked.
    """
    if any_size and header.checksum == 0:
        raise StructureError("a chunk has no checksum")
    size = None if any_size else header.unpacked_size
    unpacked = unpack(packed, header.compression, size)
    if header.checksum not in (0, zlib.crc32(unpacked)):
        raise StructureError("the checksum of a chunk is wrong")
    return take_apart(header, packed, unpacked)


def take_apart(header: ChunkHeader, packed: bytes, unpacked: bytes) -> Chunk:
    """Find the records of a chunk.

    Raises StructureError unless they fill it exactly. In a chunk whose checksum holds, definitions
    that cannot be read and records of unknown kinds are what their writer made; they are skipped.
    """
    channels, log_ns, offsets = array("H"), array("Q"), array("Q")
    definitions: list[tuple[int, Schema | Channel]] = []
    view, at, end = memoryview(unpacked), 0, len(unpacked)
    message_size = MESSAGE_HEAD.size
    while at < end:
        if at + HEAD.size > end:
            raise StructureError("a chunk ends in the middle of a record")
        opcode, length = HEAD.unpack_from(unpacked, at)
        begin = at + HEAD.size
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


def message_index(chunk: Chunk, channel_id: int) -> np.ndarray:
    """Return what the message index of a channel must hold: rows of time [ns] and offset."""
    rows = chunk.channels == channel_id
    entries = np.empty((np.count_nonzero(rows), 2), dtype="<u8")
    entries[:, 0], entries[:, 1] = chunk.log_ns[rows], chunk.offsets[rows]
    return entries


def parse_chunk_fields(head: bytes) -> tuple[ChunkHeader, int, int]:
    """Read the fields before a chunk's packed bytes, from the first bytes of its content.

    Returns:
        The header, where the packed bytes begin in the content, and how many they are to be.
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
