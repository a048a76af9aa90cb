"""What a file of a recording holds and what it has lost, from one walk through it.

Lost messages are counted from the statistics at the end of the file, or else from the indexes
behind damaged chunks. Where neither tells everything, the number is a lower bound.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from mhsb_sim.recording import bag_format
from mhsb_sim.recording.data_file import DataFile
from mhsb_sim.recording.mcap_chunk import Chunk
from mhsb_sim.recording.mcap_records import (
    HEAD,
    MAX_CHUNK_SIZE,
    MESSAGE_HEAD,
    Channel,
    Opcode,
    Schema,
    StructureError,
    parse_definition,
)
from mhsb_sim.recording.mcap_structure import PLACE_OF_A_RECORD, Record
from mhsb_sim.recording.mcap_walk import MAX_CHUNK_KEYS, Damage, McapWalk, Piece, Summary

MAX_DEFINITIONS_SIZE = 16 * 1024 * 1024
"""Bytes of all schemas and channels of a file; those of the suite take 20 KB."""


MAX_LOST = 10_000
"""Damaged chunks whose messages are counted one by one."""


@dataclass
class Definitions:
    """Schemas and channels by their ids; the first one of an id holds."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    size: int = 0

    def add(self, definition: Schema | Channel) -> bool:
        """Take a definition, unless its id is there or all of them grow too large.

        Returns:
            Whether it is now there; not if another one has its id.
        """
        table = self.table(definition)
        if definition.id not in table:
            self.size += len(repr(definition))
            if self.size <= MAX_DEFINITIONS_SIZE:
                table[definition.id] = definition
        return table.get(definition.id) == definition

    def table(self, definition: Schema | Channel) -> dict[int, Any]:
        """Return all definitions of the kind of one, by their ids."""
        return self.schemas if isinstance(definition, Schema) else self.channels

    def __iter__(self) -> Iterator[Schema | Channel]:
        yield from self.schemas.values()
        yield from self.channels.values()

    def schema_of(self, channel: Channel) -> Schema | None:
        """Return the schema of a channel; None if there is none."""
        return self.schemas.get(channel.schema_id)


@dataclass
class Survey:
    """What one walk through a file has found.

    definitions   of schemas and channels, from undamaged parts, else from damaged ones
    counts        messages kept by channel
    duplicates    messages that are there a second time, which are not kept
    start_ns, end_ns   first and last time of recording of what is kept [ns]; 0 without messages
    first_damage  None in a complete file
    damaged_bytes of all damaged parts
    lost          messages lost by the index of their chunk, by first and last time in it
    is_bound      `lost` may miss some
    summary       what the file's end says; None if it is missing
    has_contradictions   one id has two definitions, so that a part is of another recording
    unlisted      messages kept that the summary does not know
    header        the file's own header; None if it is damaged
    """

    path: Path
    definitions: Definitions = field(default_factory=Definitions)
    counts: Counter[int] = field(default_factory=Counter)
    duplicates: int = 0
    start_ns: int = 0
    end_ns: int = 0
    first_damage: Damage | None = None
    damaged_bytes: int = 0
    lost: dict[tuple[int, int] | None, int] = field(default_factory=dict)
    is_bound: bool = False
    summary: Summary | None = None
    has_contradictions: bool = False
    unlisted: int = 0
    header: Record | None = None
    _repeated: Counter[int] = field(default_factory=Counter)
    _summaries: list[Summary] = field(default_factory=list)
    _chunks: dict[int, tuple[tuple[int, int, int], int]] = field(default_factory=dict)
    _sound: Definitions = field(default_factory=Definitions)
    _doubtful: Definitions = field(default_factory=Definitions)

    @property
    def kept(self) -> int:
        """Messages that can be used."""
        return sum(self.counts.values())

    @property
    def lost_count(self) -> int:
        """Messages known to be lost."""
        if self.written is not None:
            return max(0, self.written - (self.kept - self.unlisted))
        return sum(self.lost.values())

    @property
    def written(self) -> int | None:
        """Messages of the file when it was complete, by its statistics; None if they are lost."""
        if self.summary is None or self.summary.statistics is None:
            return None
        return self.summary.statistics.message_count

    @property
    def is_exact(self) -> bool:
        """Whether `lost_count` is all that was lost, and not a lower bound."""
        if self.written is None:
            return not self.is_bound
        if self.summary and self.summary.verified and self.summary.chunk_keys:
            return True
        return not self.has_contradictions and self.kept <= self.written

    @property
    def listed_chunks(self) -> frozenset[tuple[int, int, int]]:
        """Keys of the chunks in a summary whose checksum holds."""
        if self.summary is None or not self.summary.verified:
            return frozenset()
        return frozenset(self.summary.chunk_keys)

    @property
    def reason(self) -> str:
        """What is wrong with the file first, without a period; empty if nothing is."""
        damage = self.first_damage
        return f"{damage.reason} (byte {damage.begin})" if damage else ""

    def keeps(self, chunk: Chunk) -> bool:
        """Return whether a chunk is there for the first time, and note that it is."""
        identity = hash((chunk.key, chunk.unpacked))
        if identity in self._chunks:
            return False
        if len(self._chunks) < MAX_CHUNK_KEYS:
            self._chunks[identity] = (chunk.key, len(chunk.channels))
        return True

    def close(self) -> None:
        """Draw conclusions when the walk is over."""
        self._forget_found()
        self._choose_summary()
        if self.first_damage is not None:
            self._choose_definitions()
        self._judge_repeated()
        if self.written not in (None, self.kept):
            self._note(f"its statistics count {self.written} messages, it has {self.kept}")

    def _judge_repeated(self) -> None:
        """Keep chunks that are there twice if nothing else is wrong and the statistics agree."""
        repeated = self._repeated.total()
        if self.first_damage is None and self.written in (None, self.kept + repeated):
            self.counts.update(self._repeated)
        elif repeated:
            self.duplicates = repeated
            self._note("a part of it is there twice")

    def _choose_definitions(self) -> None:
        """Take those of the summary and of sound chunks, and others as far as they are needed.

        The summary's come first if its checksum holds.
        """
        everything, self.definitions, summary = self.definitions, Definitions(), self.summary
        if summary and summary.verified:
            for definition in summary.definitions:
                self.definitions.add(definition)
        for definition in self._sound:
            self.definitions.add(definition)
        self._add_needed(everything, as_they_are=True)
        self._add_needed(self._doubtful, as_they_are=False)

    def _add_needed(self, others: Definitions, as_they_are: bool) -> None:
        """Take definitions of topics that have messages and are not defined elsewhere.

        as_they_are: Take the text of a type as it is, not only if its type is known here.
        """
        held = self.definitions
        for channel_id in self.counts.keys() & others.channels.keys():
            held.add(others.channels[channel_id])
        for channel_id in self.counts.keys() & held.channels.keys():
            schema = others.schemas.get(held.channels[channel_id].schema_id)
            if schema is not None:
                held.add(schema if as_they_are else _trusted(schema))

    def _forget_found(self) -> None:
        """Leave out what is counted as lost, but was found elsewhere in the file."""
        if not self._chunks or not self.lost:
            return
        kept = np.array([key[:2] for key, _ in self._chunks.values()], dtype=np.uint64)
        self.lost = {
            times: count
            for times, count in self.lost.items()
            if times is None or not np.any((kept[:, 0] <= times[0]) & (times[1] <= kept[:, 1]))
        }

    def _choose_summary(self) -> None:
        """Take the last summary whose checksum holds and that lists some of what is kept."""
        for summary in reversed(self._summaries):
            unlisted = self._unlisted(summary)
            if unlisted < self.kept:
                self.unlisted, self.summary = unlisted, summary
                return
        if self.kept and self.summary in self._summaries:
            self.summary = None  # it is another recording's

    def _unlisted(self, summary: Summary) -> int:
        """Return how many messages are in chunks that a summary does not list."""
        listed = set(summary.chunk_keys)
        return sum(count for key, count in self._chunks.values() if key not in listed)

    # --- Pieces ----------------------------------------------------------------------------------

    def add(self, piece: Piece, file: DataFile) -> None:
        """Take a piece of the walk."""
        match piece:
            case Chunk():
                self._add_chunk(piece)
            case Schema() | Channel():
                self._define(piece)
            case Summary():
                self.summary = piece
                if piece.verified and piece.chunk_keys:
                    self._summaries.append(piece)
            case Damage():
                self._add_damage(piece, file)
            case Record(opcode=Opcode.MESSAGE):
                channel_id, _, log_ns, _ = MESSAGE_HEAD.unpack(piece.content)
                self._count(((channel_id, 1),), log_ns, log_ns)
            case Record(opcode=Opcode.HEADER) if self.header is None:
                self.header = piece

    def _add_chunk(self, chunk: Chunk) -> None:
        for _, definition in chunk.definitions:
            self._define(definition)
            if chunk.header.checksum:
                self._sound.add(definition)
        if not self.keeps(chunk):
            self._repeated.update(chunk.counts())
        elif len(chunk.channels):
            first, last, _ = chunk.key
            self._count(chunk.counts().items(), first, last)

    def _define(self, definition: Schema | Channel) -> None:
        if not self.definitions.add(definition):
            self.has_contradictions = True
            self._note(f"it has two definitions of one id, or more than {MAX_DEFINITIONS_SIZE} B")

    def _note(self, reason: str) -> None:
        """Note that something is wrong with the file though no bytes of it are lost."""
        self.first_damage = self.first_damage or Damage(0, 0, reason, 0)

    def _count(self, counts: Iterable[tuple[int, int]], first_ns: int, last_ns: int) -> None:
        """Count messages of channels, recorded from a first to a last time [ns]."""
        if not self.counts or first_ns < self.start_ns:
            self.start_ns = first_ns
        if last_ns > self.end_ns:
            self.end_ns = last_ns
        for channel_id, count in counts:
            self.counts[channel_id] += count
            if channel_id not in self.definitions.channels:
                self._note("it has messages of a topic that is not defined before")
        self.summary = None  # it is the end of what comes before it alone

    def _add_damage(self, damage: Damage, file: DataFile) -> None:
        self.first_damage = self.first_damage or damage
        self.damaged_bytes += damage.end - damage.begin
        if damage.messages is None:
            self.is_bound = True
        elif damage.messages and len(self.lost) < MAX_LOST:
            self.lost[damage.times] = damage.messages
        elif damage.messages:
            self.is_bound = True
        if damage.messages != 0:
            part = file.read(damage.begin, min(damage.end - damage.begin, MAX_CHUNK_SIZE))
            find_definitions(part, self._doubtful)


def _trusted(schema: Schema) -> Schema:
    """Return a schema from a damaged part with a text that its type is known to have, or none."""
    known = bag_format.known_definition(schema.name)
    return replace(schema, encoding=bag_format.SCHEMA_ENCODING, data=known.encode())


def find_definitions(part: bytes, found: Definitions) -> None:
    """Add schemas and channels that can still be read in a damaged part of a file."""
    tried = 0
    for match in PLACE_OF_A_RECORD.finditer(part):
        opcode, length = HEAD.unpack_from(part, match.start())
        begin = match.start() + HEAD.size
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL) or begin + length > len(part):
            continue
        tried += length
        if tried > MAX_DEFINITIONS_SIZE:
            return  # bytes that were made to be read again and again
        with suppress(StructureError):
            found.add(parse_definition(opcode, memoryview(part)[begin : begin + length]))


def survey_file(path: Path) -> Survey:
    """Walk through a file of a recording; raises BagError where it cannot be read."""
    survey = Survey(path)
    with DataFile(path) as file:
        for piece in McapWalk(file).pieces():
            survey.add(piece, file)
    survey.close()
    return survey
