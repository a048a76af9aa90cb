"""Contents and losses of a recording's data file, found in one walk through it.

The number of lost messages follows from the statistics at the end of the file. Without statistics,
the message indexes after damaged chunks are counted. If the indexes are incomplete, the number is a
lower bound.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Schema

from mhsb_tools.recording.data_file import DataFile
from mhsb_tools.recording.mcap_chunk import Chunk
from mhsb_tools.recording.mcap_records import (
    MAX_CHUNK_SIZE,
    MESSAGE_HEAD,
    RECORD_HEADER,
    StructureError,
    parse_definition,
    with_known_text,
)
from mhsb_tools.recording.mcap_structure import PLACE_OF_A_RECORD, RecordFrame
from mhsb_tools.recording.mcap_walk import MAX_CHUNK_KEYS, Damage, McapWalk, Piece, Summary

MAX_DEFINITIONS_SIZE = 16 * 1024 * 1024
"""Largest total size of a file's schemas and channels [bytes]; the suite's take 20 KB. Further ones
are not stored.
"""

MAX_LOST = 10_000
"""Largest number of damaged chunks whose lost messages are counted."""


@dataclass
class Definitions:
    """Schemas and channels by their ids; the first definition of an id is never replaced.

    Iteration yields all schemas and then all channels.

    Attributes:
        schemas: Schemas by id.
        channels: Channels by id.
        size: Total length of the texts that `repr` gives for all added definitions [characters].
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    size: int = 0

    def add(self, definition: Schema | Channel) -> bool:
        """Store a schema or channel under its id.

        It is not stored if the id is taken, or if all definitions together would exceed
        MAX_DEFINITIONS_SIZE.

        Args:
            definition: Schema or channel.

        Returns:
            True if the definition, or an equal one, is now stored under its id. False if another
            one has the id, or if it exceeds the limit.
        """
        table = self.table(definition)
        if definition.id not in table:
            self.size += len(repr(definition))
            if self.size <= MAX_DEFINITIONS_SIZE:
                table[definition.id] = definition
        return table.get(definition.id) == definition

    def table(self, definition: Schema | Channel) -> dict[int, Any]:
        """Return the dictionary of all schemas, or of all channels.

        Args:
            definition: A schema asks for the schemas, a channel for the channels.

        Returns:
            Definitions by id. It is the dictionary of this object, not a copy.
        """
        return self.schemas if isinstance(definition, Schema) else self.channels

    def __iter__(self) -> Iterator[Schema | Channel]:
        yield from self.schemas.values()
        yield from self.channels.values()

    def schema_of(self, channel: Channel) -> Schema | None:
        """Return the schema of a channel; None if it has none or it is lost."""
        return self.schemas.get(channel.schema_id)


@dataclass
class Survey:
    """Findings of one walk through a data file.

    Pass each piece of the walk to `add`, and call `close` at the end. Only then are the lost
    messages, the summary and the definitions final.

    Attributes:
        path: The file.
        definitions: Schemas and channels; those from undamaged parts have precedence.
        counts: Number of kept messages by channel id.
        duplicates: Number of messages in repeated chunks that are not kept.
        start_ns: First log time of the kept messages [ns]; 0 without messages.
        end_ns: Last log time of the kept messages [ns]; 0 without messages.
        first_damage: First damage in the file; None in a complete file.
        damaged_bytes: Total size of all damaged parts [bytes].
        lost: Number of messages lost in each damaged chunk, from the chunk's message indexes. The
            key is the first and last log time of the lost messages [ns], or None if unknown.
        is_lower_bound: Whether more messages may be lost than `lost` contains.
        summary: Summary at the end of the file; None if it is missing.
        has_contradictions: Whether an id has two different definitions. A part of the file is then
            from another recording.
        unlisted: Number of kept messages in chunks that the summary does not list.
        header: The file's header; None if it is damaged.
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
    is_lower_bound: bool = False
    summary: Summary | None = None
    has_contradictions: bool = False
    unlisted: int = 0
    header: Header | None = None
    _repeated: Counter[int] = field(default_factory=Counter)
    _summaries: list[Summary] = field(default_factory=list)
    _chunks: dict[int, tuple[tuple[int, int, int], int]] = field(default_factory=dict)
    _verified_definitions: Definitions = field(default_factory=Definitions)
    _damaged_definitions: Definitions = field(default_factory=Definitions)

    @property
    def kept(self) -> int:
        """Number of messages that can be used."""
        return sum(self.counts.values())

    @property
    def lost_count(self) -> int:
        """Number of messages known to be lost.

        If the file has statistics, it is the number of messages that they state, minus the number
        of kept messages, but at least 0. Kept messages in chunks that the summary does not list are
        not subtracted. Without statistics, it is the sum of `lost`.
        """
        if self.written is not None:
            return max(0, self.written - (self.kept - self.unlisted))
        return sum(self.lost.values())

    @property
    def written(self) -> int | None:
        """Number of messages that the statistics state; None if the statistics are lost."""
        if self.summary is None or self.summary.statistics is None:
            return None
        return self.summary.statistics.message_count

    @property
    def is_exact(self) -> bool:
        """True if `lost_count` is the exact number; False if it is a lower bound.

        Without statistics, the number is exact if the message indexes of all damaged parts are
        complete. With statistics, it is exact in two cases:

        - The summary has a right checksum and lists chunks.
        - Nothing shows that kept messages are from another recording: no id has two definitions,
          and `kept` is at most `written`.
        """
        if self.written is None:
            return not self.is_lower_bound
        if self.summary and self.summary.verified and self.summary.chunk_keys:
            return True
        return not self.has_contradictions and self.kept <= self.written

    @property
    def listed_chunks(self) -> frozenset[tuple[int, int, int]]:
        """Keys of the chunks in the summary: first and last log time [ns], unpacked size [bytes].

        Empty if the summary is missing or its checksum is not verified.
        """
        if self.summary is None or not self.summary.verified:
            return frozenset()
        return frozenset(self.summary.chunk_keys)

    @property
    def reason(self) -> str:
        """Reason and offset of the first damage, without a period; empty in a complete file."""
        damage = self.first_damage
        return f"{damage.reason} (byte {damage.begin})" if damage else ""

    def register_chunk(self, chunk: Chunk) -> bool:
        """Remember a chunk, and return whether it occurs for the first time.

        A chunk is repeated if an earlier chunk has the same log times and the same unpacked
        content. At most MAX_CHUNK_KEYS chunks are remembered. A copy of a chunk that is not
        remembered also counts as occurring for the first time.

        Args:
            chunk: A verified chunk.

        Returns:
            True if the chunk occurs for the first time, False if it is repeated.
        """
        identity = hash((chunk.key, chunk.unpacked))
        if identity in self._chunks:
            return False
        if len(self._chunks) < MAX_CHUNK_KEYS:
            self._chunks[identity] = (chunk.key, len(chunk.channel_ids))
        return True

    def close(self) -> None:
        """Evaluate the findings after the walk through the file.

        It works in five steps:

        1. Remove from `lost` the messages that were found elsewhere in the file.
        2. Choose the summary that describes the kept messages.
        3. In a damaged file, choose the definitions.
        4. Decide whether messages of repeated chunks are kept.
        5. Compare the number of messages with the statistics. A difference counts as damage.
        """
        self._remove_found_losses()
        self._choose_summary()
        if self.first_damage is not None:
            self._choose_definitions()
        self._judge_repeated()
        if self.written not in (None, self.kept):
            self._note_fault(f"its statistics count {self.written} messages, it has {self.kept}")

    def _judge_repeated(self) -> None:
        """Decide whether the messages of repeated chunks are kept or are duplicates.

        In a damaged file they are duplicates. In a whole file they are duplicates only if the
        message count in its statistics does not include them. Duplicates are counted in
        `duplicates`, and the file then counts as damaged. Without repeated chunks, nothing changes.
        """
        repeated = self._repeated.total()
        if self.first_damage is None and self.written in (None, self.kept + repeated):
            self.counts.update(self._repeated)
        elif repeated:
            self.duplicates = repeated
            self._note_fault("a part of it is there twice")

    def _choose_definitions(self) -> None:
        """Choose the schemas and channels of a damaged file.

        If an id has several definitions, the most reliable one is taken.

        The order of reliability is:

        1. those in the summary, if its checksum is right;
        2. those in chunks with a checksum;
        3. all others in undamaged parts, only for channels that have messages;
        4. those in damaged parts, only for channels that have messages.
        """
        everything, self.definitions, summary = self.definitions, Definitions(), self.summary
        if summary and summary.verified:
            for definition in summary.definitions:
                self.definitions.add(definition)
        for definition in self._verified_definitions:
            self.definitions.add(definition)
        self._add_needed(everything, trust_text=True)
        self._add_needed(self._damaged_definitions, trust_text=False)

    def _add_needed(self, others: Definitions, trust_text: bool) -> None:
        """Add the channels and schemas that kept messages need and that are not defined yet.

        They are added to `self.definitions`. Existing entries stay.

        Args:
            others: Schemas and channels to choose from.
            trust_text: If True, each schema keeps its message definition. If False, the schema gets
                the message definition that ROS has for the type (`with_known_text`).
        """
        held = self.definitions
        for channel_id in self.counts.keys() & others.channels.keys():
            held.add(others.channels[channel_id])
        for channel_id in self.counts.keys() & held.channels.keys():
            schema = others.schemas.get(held.channels[channel_id].schema_id)
            if schema is not None:
                held.add(schema if trust_text else with_known_text(schema))

    def _remove_found_losses(self) -> None:
        """Remove entries of `lost` whose messages were found elsewhere in the file.

        The messages of an entry count as found if a kept chunk has a range of log times that
        contains the entry's range. Entries without log times stay.
        """
        if not self._chunks or not self.lost:
            return
        kept = np.array([key[:2] for key, _ in self._chunks.values()], dtype=np.uint64)
        self.lost = {
            times: count
            for times, count in self.lost.items()
            if times is None or not np.any((kept[:, 0] <= times[0]) & (times[1] <= kept[:, 1]))
        }

    def _choose_summary(self) -> None:
        """Choose the summary that describes the kept messages.

        `summary` becomes the last summary that has a right checksum and lists at least one kept
        chunk with messages. `unlisted` becomes the number of messages in kept chunks that it does
        not list. If there is no such summary, `summary` stays, with one exception. If messages are
        kept, and it has a right checksum and lists other chunks, it is set to None, because it
        describes another recording.
        """
        for summary in reversed(self._summaries):
            unlisted = self._unlisted(summary)
            if unlisted < self.kept:
                self.unlisted, self.summary = unlisted, summary
                return
        if self.kept and self.summary in self._summaries:
            self.summary = None  # it belongs to another recording

    def _unlisted(self, summary: Summary) -> int:
        """Count the messages in kept chunks that a summary does not list.

        Args:
            summary: The summary.

        Returns:
            The number; messages outside chunks are not counted.
        """
        listed = set(summary.chunk_keys)
        return sum(count for key, count in self._chunks.values() if key not in listed)

    # --- Pieces ----------------------------------------------------------------------------------

    def add(self, piece: Piece, file: DataFile) -> None:
        """Evaluate one piece of the file: chunk, definition, summary, damage or record.

        The attributes of this object are updated. Attachments and metadata records are ignored.

        Args:
            piece: The next piece in the order of the file.
            file: The file, from which definitions in damaged parts are read.
        """
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
            case RecordFrame(opcode=Opcode.MESSAGE):
                channel_id, _, log_ns, _ = MESSAGE_HEAD.unpack(piece.content)
                self._count(((channel_id, 1),), log_ns, log_ns)
            case RecordFrame(opcode=Opcode.HEADER) if self.header is None:
                self.header = piece.content

    def _add_chunk(self, chunk: Chunk) -> None:
        """Count the messages of a chunk and add its schemas and channels.

        If the chunk occurred before, its messages are counted separately as repeated. Definitions
        in a chunk with a checksum are also stored among the reliable ones. New messages extend the
        time span and set `summary` to None (`_count`). Faults are recorded in `first_damage`.

        Args:
            chunk: A verified chunk.
        """
        for _, definition in chunk.definitions:
            self._define(definition)
            if chunk.header.checksum:
                self._verified_definitions.add(definition)
        if not self.register_chunk(chunk):
            self._repeated.update(chunk.counts())
        elif len(chunk.channel_ids):
            first, last, _ = chunk.key
            self._count(chunk.counts().items(), first, last)

    def _define(self, definition: Schema | Channel) -> None:
        """Add a schema or channel, and record a fault of the file if that is not possible.

        Adding is not possible if the id has another definition, or if all definitions together are
        too large. In both cases `has_contradictions` is set.

        Args:
            definition: Schema or channel.
        """
        if not self.definitions.add(definition):
            self.has_contradictions = True
            self._note_fault(
                f"it has two definitions of one id, or more than {MAX_DEFINITIONS_SIZE} B"
            )

    def _note_fault(self, reason: str) -> None:
        """Record a fault in `first_damage`, unless an earlier damage is recorded there.

        The fault damages no bytes.

        Args:
            reason: What is wrong, without a period.
        """
        self.first_damage = self.first_damage or Damage(0, 0, reason, 0)

    def _count(self, counts: Iterable[tuple[int, int]], first_ns: int, last_ns: int) -> None:
        """Count messages, and extend the time span of the kept messages.

        A message on a channel that is not defined is recorded as a fault of the file. `summary` is
        set to None, because a summary that came before these messages does not cover them.

        Args:
            counts: Pairs of channel id and number of messages.
            first_ns: First log time of the messages [ns].
            last_ns: Last log time of the messages [ns].
        """
        if not self.counts or first_ns < self.start_ns:
            self.start_ns = first_ns
        self.end_ns = max(self.end_ns, last_ns)
        for channel_id, count in counts:
            self.counts[channel_id] += count
            if channel_id not in self.definitions.channels:
                self._note_fault("it has messages of a topic that is not defined before")
        self.summary = None  # a summary covers only what precedes it

    def _add_damage(self, damage: Damage, file: DataFile) -> None:
        """Record a damaged part, its lost messages, and the definitions that can be read in it.

        `is_lower_bound` is set if the number of lost messages is unknown, or if MAX_LOST damaged
        chunks with lost messages were recorded before. Definitions (schemas and channels) are
        searched in the first MAX_CHUNK_SIZE bytes of the part, and only if messages may be lost in
        it.

        Args:
            damage: The damaged part.
            file: The file.
        """
        self.first_damage = self.first_damage or damage
        self.damaged_bytes += damage.end - damage.begin
        if damage.messages is None:
            self.is_lower_bound = True
        elif damage.messages and len(self.lost) < MAX_LOST:
            self.lost[damage.times] = damage.messages
        elif damage.messages:
            self.is_lower_bound = True
        if damage.messages != 0:
            part = file.read(damage.begin, min(damage.end - damage.begin, MAX_CHUNK_SIZE))
            find_definitions(part, self._damaged_definitions)


def find_definitions(part: bytes, found: Definitions) -> None:
    """Search a damaged part of a file for readable schemas and channels.

    A candidate is a place that looks like the beginning of a schema or channel record. The search
    stops as soon as the stated lengths of all candidates, readable or not, add up to more than
    MAX_DEFINITIONS_SIZE. No input can therefore make the search endless.

    Args:
        part: Bytes of the damaged part.
        found: Definitions to which the readable schemas and channels are added in place. A schema
            or channel whose id is taken is not added.
    """
    tried = 0
    for match in PLACE_OF_A_RECORD.finditer(part):
        opcode, length = RECORD_HEADER.unpack_from(part, match.start())
        begin = match.start() + RECORD_HEADER.size
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL) or begin + length > len(part):
            continue
        tried += length
        if tried > MAX_DEFINITIONS_SIZE:
            return  # the input may be made so that the search never ends
        with suppress(StructureError):
            found.add(parse_definition(opcode, memoryview(part)[begin : begin + length]))


def survey_file(path: Path) -> Survey:
    """Read a data file of a recording once, and collect its contents, damage and losses.

    Args:
        path: The file.

    Returns:
        The findings, complete and evaluated.

    Raises:
        BagError: The file cannot be read, or its budget for reading or unpacking is used up. No
            usable recording needs more than these budgets.
    """
    survey = Survey(path)
    with DataFile(path) as file:
        for piece in McapWalk(file).iterate_pieces():
            survey.add(piece, file)
    survey.close()
    return survey
