"""Making a damaged recording whole: what is left of it is kept, and the original beside it.

A repaired file is written beside the damaged one, read again, and only then takes its name; the
damaged one is kept as NAME.mcap.torn. Nothing is changed where nothing can be read.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from mcap.data_stream import RecordBuilder
from mcap.records import Header, Metadata

from mhsb_sim.recording import bag_format
from mhsb_sim.recording.bag_folder import BagFolder, examine
from mhsb_sim.recording.bag_format import METADATA_FILE, BagContents, BagError, BagTopic
from mhsb_sim.recording.data_file import DataFile
from mhsb_sim.recording.mcap_chunk import Chunk
from mhsb_sim.recording.mcap_copy import McapCopy
from mhsb_sim.recording.mcap_records import HEAD, Channel, Opcode, Schema, check_metadata
from mhsb_sim.recording.mcap_structure import Record
from mhsb_sim.recording.mcap_survey import Definitions, Survey, survey_file
from mhsb_sim.recording.mcap_walk import McapWalk

TORN = ".torn"
BAG_METADATA = "rosbag2"
"""Name of the record in which rosbag2 repeats the metadata of a file."""

UNKNOWN_TYPE = "unknown_msgs/msg/Unknown"
"""Type of topics whose definition is lost."""


@dataclass(frozen=True)
class Repair:
    """What a repair has done.

    kept       messages in the recording now
    lost       messages that it has lost; a lower bound unless `is_exact`
    lost_bytes of damaged parts
    repeated   messages that stood in it twice and are kept once
    unlisted   messages kept that the damaged file's own summary did not count
    nameless   messages kept whose topic and type are lost; they are on /unknown/channel_ID
    originals  names of what is kept of the damaged recording; empty if no file was replaced
    is_complete  whether the recording was complete already, and nothing was changed
    """

    kept: int
    lost: int = 0
    is_exact: bool = True
    lost_bytes: int = 0
    repeated: int = 0
    unlisted: int = 0
    nameless: int = 0
    originals: tuple[str, ...] = ()
    is_complete: bool = False

    def sentence(self, folder: Path) -> str:
        """Return what a user is told."""
        if self.is_complete:
            return f"{folder} is complete with {self.kept} messages; nothing was changed"
        at_least = "" if self.is_exact else "at least "
        words = f"kept {self.kept} messages in {folder}"
        if self.lost or self.lost_bytes or not self.is_exact:
            words += f"; lost {at_least}{self.lost} messages, {self.lost_bytes} bytes"
        for count, meaning in (
            (self.repeated, "stood there twice and are kept once"),
            (self.unlisted, "of those kept are not in the file's own summary"),
            (self.nameless, "of those kept have lost their topic and are on /unknown"),
        ):
            words += f"; {count} {meaning}" if count else ""
        if self.originals:
            words += f"; the damaged recording is kept as {', '.join(self.originals)}"
        return words


def repair(folder: Path) -> Repair:
    """Make the recording in a folder whole.

    Raises BagError, and changes nothing, where there is no recording, where nothing can be read
    from it, or where the repaired one cannot be written.
    """
    bag = examine(folder)
    surveys = [survey_file(path) for path in bag.files]
    kept = sum(survey.kept for survey in surveys)
    damaged = [survey for survey in surveys if survey.first_damage is not None]
    if not bag.problem and not damaged and kept == bag.listed:
        return Repair(kept, is_complete=True)
    if damaged and not kept:
        raise BagError(
            f"nothing can be read from {damaged[0].path}: {damaged[0].reason}; nothing was changed"
        )
    try:
        originals = _replace(bag, surveys)
    except OSError as error:
        raise BagError(
            f"{folder} cannot be repaired: {error.strerror or error}; the damaged recording is kept"
        ) from error
    return Repair(
        kept,
        sum(survey.lost_count for survey in surveys) + sum(bag.missing.values()),
        all(survey.is_exact for survey in surveys) and all(bag.missing.values()),
        sum(survey.damaged_bytes for survey in surveys),
        sum(survey.duplicates for survey in surveys),
        sum(survey.unlisted for survey in surveys),
        sum(_nameless(survey) for survey in surveys),
        tuple(originals),
    )


def _replace(bag: BagFolder, surveys: list[Survey]) -> list[str]:
    """Write repaired files beside damaged ones, then exchange them; returns names of originals."""
    contents: dict[str, BagContents] = {}
    repaired: dict[Path, Path] = {}
    originals = []
    with _temporary_files() as parts:
        for survey in surveys:
            name = survey.path.name
            if survey.first_damage is None:
                contents[name] = contents_of(survey, survey.counts, survey.definitions)
            elif survey.kept:
                repaired[survey.path], contents[name] = _rewrite(survey, parts)
        for survey in surveys:
            if survey.first_damage is not None:
                part = repaired.get(survey.path)
                originals.append(_set_aside(survey.path, part))
                if part is not None:
                    parts.remove(part)
        metadata = bag.path / METADATA_FILE
        if metadata.exists() or metadata.is_symlink():
            originals.append(_set_aside(metadata, None))
        bag_format.write_metadata(bag.path, contents)
        _sync(bag.path)
    return originals


@contextlib.contextmanager
def _temporary_files() -> Iterator[list[Path]]:
    """Context manager of a list whose files are removed at the end."""
    parts: list[Path] = []
    try:
        yield parts
    finally:
        for part in parts:
            with contextlib.suppress(OSError):
                part.unlink()


def _rewrite(survey: Survey, parts: list[Path]) -> tuple[Path, BagContents]:
    """Write what is left of a file beside it, and read it again."""
    path = survey.path
    descriptor, name = tempfile.mkstemp(".part", f".{path.name}.", path.parent)
    parts.append(part := Path(name))
    with open(descriptor, "wb") as stream, DataFile(path) as file:
        contents = _copy(survey, file, stream)
        stream.flush()
        os.fchmod(stream.fileno(), path.stat().st_mode & 0o777)
        os.fsync(stream.fileno())
    again = survey_file(part)
    if again.first_damage is not None or again.kept != survey.kept:
        raise BagError(f"{path} cannot be repaired; the damaged recording is kept")
    return part, contents


def _copy(survey: Survey, file: DataFile, stream: IO[bytes]) -> BagContents:
    """Write everything of a file that can be used."""
    listed = survey.listed_chunks
    copy = McapCopy(stream, _complete_definitions(survey), _header(survey), listed)
    seen = Survey(survey.path)
    for piece in McapWalk(file).pieces():
        if isinstance(piece, Chunk) and seen.keeps(piece):
            copy.add_chunk(piece)
        elif isinstance(piece, Record) and piece.opcode == Opcode.MESSAGE:
            copy.add_message(file.read(piece.at, HEAD.size + piece.length))
        elif isinstance(piece, Record) and piece.opcode in (Opcode.ATTACHMENT, Opcode.METADATA):
            content = file.read(piece.begin, piece.length)
            if piece.opcode == Opcode.ATTACHMENT or check_metadata(content) != BAG_METADATA:
                copy.add_other(piece.opcode, content)
    copy.flush()
    contents = contents_of(survey, copy.counts, copy.definitions)
    text = bag_format.metadata_text({survey.path.name: contents})
    copy.add_other(Opcode.METADATA, _content(Metadata(BAG_METADATA, {"serialized_metadata": text})))
    copy.finish()
    return contents


def _complete_definitions(survey: Survey) -> Definitions:
    """Return the definitions of a file, with ones of no meaning where they are lost."""
    found = survey.definitions
    definitions = Definitions(dict(found.schemas), dict(found.channels))
    for channel_id in survey.counts:
        if channel_id not in definitions.channels:
            topic = f"/unknown/channel_{channel_id}"
            schema_id = _unknown_schema(definitions)
            channel = Channel(channel_id, schema_id, topic, bag_format.SERIALIZATION, ())
            definitions.channels[channel_id] = channel
    for channel in list(definitions.channels.values()):
        if channel.schema_id not in (0, *definitions.schemas):
            definitions.schemas[channel.schema_id] = Schema(
                channel.schema_id, UNKNOWN_TYPE, bag_format.SCHEMA_ENCODING, b""
            )
    return definitions


def _unknown_schema(definitions: Definitions) -> int:
    """Return the id of the type that stands for unknown ones, the highest that is not used."""
    used = {channel.schema_id for channel in definitions.channels.values()}
    for schema_id, schema in definitions.schemas.items():
        if schema.name == UNKNOWN_TYPE:
            return schema_id
    free = next(n for n in range(2**16 - 1, 0, -1) if n not in used | definitions.schemas.keys())
    definitions.schemas[free] = Schema(free, UNKNOWN_TYPE, bag_format.SCHEMA_ENCODING, b"")
    return free


def _nameless(survey: Survey) -> int:
    """Return how many messages kept have lost their topic."""
    return sum(n for each, n in survey.counts.items() if each not in survey.definitions.channels)


def _header(survey: Survey) -> bytes:
    """Return the content of a file's header record, or of one that is right for ROS."""
    if survey.header is not None:
        return survey.header.content
    return _content(Header(bag_format.PROFILE, "mhsb"))


def _content(record: Header | Metadata) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())[HEAD.size :]


def contents_of(
    survey: Survey, counts: Mapping[int, int], definitions: Definitions
) -> BagContents:
    """Return what a file holds, as metadata say it.

    Args:
        survey: Of the file, for its times.
        counts: Messages by channel.
        definitions: Of the channels, and of further ones without messages.
    """
    topics: Counter[BagTopic] = Counter()
    for channel in definitions.channels.values():
        topics[_topic(channel, definitions)] += counts.get(channel.id, 0)
    return BagContents(survey.start_ns, survey.end_ns, tuple(topics.items()))


def _topic(channel: Channel, definitions: Definitions) -> BagTopic:
    schema = definitions.schema_of(channel)
    type_name = schema.name if schema else UNKNOWN_TYPE
    return BagTopic(
        channel.topic,
        type_name,
        channel.value("offered_qos_profiles"),
        channel.encoding,
        channel.value("topic_type_hash") or bag_format.known_type_hash(type_name),
    )


def _set_aside(path: Path, part: Path | None) -> str:
    """Give a file the first free name NAME.torn, NAME.torn.1 ..., and its own name to another.

    Args:
        path: The file, a link possibly; whatever it is stays as it is.
        part: What takes its name; None for nothing.

    Returns:
        Its new name.
    """
    for number in itertools.count():
        torn = path.with_name(f"{path.name}{TORN}{f'.{number}' if number else ''}")
        try:
            os.link(path, torn, follow_symlinks=False)
        except FileExistsError:
            continue
        except OSError:  # a file system without links
            if torn.exists() or torn.is_symlink():
                continue
            os.rename(path, torn)
        break
    if part is not None:
        os.replace(part, path)
    elif path.exists() or path.is_symlink():
        os.unlink(path)
    return torn.name


def _sync(folder: Path) -> None:
    """Have the operating system write the names in a folder."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
