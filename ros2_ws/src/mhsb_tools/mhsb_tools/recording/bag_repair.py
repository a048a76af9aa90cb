"""Repair of a damaged recording: a new file gets all readable messages, the damaged file stays.

A repaired file is first written into a temporary folder, and read again as a check. Then the
damaged file is renamed to NAME.mcap.torn, and the repaired file gets the name NAME.mcap. If no
message can be read, no file is changed.
"""

import itertools
import os
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema

from mhsb_tools.recording import bag_format
from mhsb_tools.recording.bag_folder import BagFolder, find_data_files
from mhsb_tools.recording.bag_format import METADATA_FILE, BagContents, BagError, BagTopic
from mhsb_tools.recording.data_file import DataFile
from mhsb_tools.recording.mcap_chunk import Chunk
from mhsb_tools.recording.mcap_copy import McapCopy
from mhsb_tools.recording.mcap_records import serialize_record
from mhsb_tools.recording.mcap_structure import RecordFrame
from mhsb_tools.recording.mcap_survey import Definitions, Survey, survey_file
from mhsb_tools.recording.mcap_walk import McapWalk

TORN_SUFFIX = ".torn"
"""Suffix of the names under which damaged files are kept."""

BAG_METADATA = "rosbag2"
"""Name of the MCAP metadata record in which rosbag2 stores a copy of the file's metadata."""

UNKNOWN_TYPE = "unknown_msgs/msg/Unknown"
"""ROS type that a topic gets if its own type is lost."""


@dataclass(frozen=True)
class Repair:
    """Result of a repair.

    Attributes:
        kept: Number of messages in the recording after the repair.
        lost: Number of messages that are lost; a lower bound if `is_exact` is False.
        is_exact: Whether `lost` is the exact number.
        lost_bytes: Total size of the damaged parts [bytes].
        repeated: Number of messages left out because the recording has another copy of them.
        unlisted: Number of kept messages that the summary of the damaged file did not list.
        nameless: Number of kept messages whose topic and type are lost. Their new topic is
            /unknown/channel_ID, where ID is the number of their channel.
        originals: New names of the damaged files; empty if no file was renamed.
        is_complete: True if the recording was complete before, so that no file was changed.
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
        """Describe the result of a repair in one sentence without a period.

        Args:
            folder: Folder of the recording, as the user named it.

        Returns:
            The sentence. For a complete recording it has the number of messages and says that
            nothing was changed. Otherwise it begins with the number of kept messages. Lost messages
            and bytes follow if there are any, or if their number is not exact. Then come the
            numbers of repeated, unlisted and nameless messages that are above 0. At the end are the
            new names of the damaged files.
        """
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


def repair_recording(folder: Path) -> Repair:
    """Repair the recording in a folder.

    A complete recording does not change. Otherwise a new file with all readable messages takes the
    place of each damaged data file, and new metadata are written. The damaged files and the old
    metadata stay in the folder; `.torn` is appended to their names.

    Args:
        folder: Folder of the recording.

    Returns:
        Numbers of kept and lost messages, and the new names of the damaged files.

    Raises:
        BagError: There is no recording in the folder, no message can be read, or the repaired files
            cannot be written. If no message can be read, nothing is changed.
    """
    bag = find_data_files(folder)
    surveys = [survey_file(path) for path in bag.files]
    kept = sum(survey.kept for survey in surveys)
    damaged = [survey for survey in surveys if survey.first_damage is not None]
    if not bag.problem and not damaged and kept == bag.listed_count:
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
    """Replace the damaged data files and the metadata of a recording by repaired ones.

    All repaired files are complete on disk before the first damaged file is renamed. A damaged file
    without a readable message is renamed and not replaced. Files without damage do not change. New
    metadata are written last.

    Args:
        bag: Folder of the recording.
        surveys: Findings in each data file of the recording, in time order.

    Returns:
        New names of the damaged files and of the old metadata.

    Raises:
        OSError: A file cannot be written or renamed.
        BagError: A repaired file does not have all messages that can be read.
    """
    contents: dict[str, BagContents] = {}
    repaired: dict[Path, Path] = {}
    originals = []
    with tempfile.TemporaryDirectory(".part", ".", bag.path) as parts:
        for survey in surveys:
            name = survey.path.name
            if survey.first_damage is None:
                contents[name] = summarize_contents(survey, survey.counts, survey.definitions)
            elif survey.kept:
                repaired[survey.path] = Path(parts, name)
                contents[name] = _rewrite(survey, repaired[survey.path])
        for survey in surveys:
            if survey.first_damage is not None:
                originals.append(_rename_to_torn(survey.path, repaired.get(survey.path)))
        metadata = bag.path / METADATA_FILE
        if metadata.exists() or metadata.is_symlink():
            originals.append(_rename_to_torn(metadata, None))
        bag_format.write_metadata(bag.path, contents)
        _sync(bag.path)
    return originals


def _rewrite(survey: Survey, part: Path) -> BagContents:
    """Write the readable part of a damaged file into a new file, and check the new file.

    The new file gets the permissions of the damaged one. The function waits until the new file is
    on the disk, and reads it once more.

    Args:
        survey: Findings in the damaged file.
        part: Path of the new file.

    Returns:
        Topics, times and message counts of the new file for the metadata.

    Raises:
        BagError: The new file is damaged, or does not have as many messages as can be read from the
            old one.
        OSError: The new file cannot be written.
    """
    path = survey.path
    with part.open("wb") as stream, DataFile(path) as file:
        contents = _copy_readable_parts(survey, file, stream)
        stream.flush()
        os.fchmod(stream.fileno(), path.stat().st_mode & 0o777)
        os.fsync(stream.fileno())
    again = survey_file(part)
    if again.first_damage is not None or again.kept != survey.kept:
        raise BagError(f"{path} cannot be repaired; the damaged recording is kept")
    return contents


def _copy_readable_parts(survey: Survey, file: DataFile, stream: IO[bytes]) -> BagContents:
    """Copy all usable records of a damaged MCAP file into a new one.

    A chunk (group of records that are packed together) may occur several times; it is written once.
    Messages outside chunks are put into new chunks. Attachments and metadata records are copied.
    The metadata record of rosbag2 is an exception: a new one is written at the end.

    Args:
        survey: Findings in the damaged file.
        file: The damaged file.
        stream: Open binary file that receives the copy.

    Returns:
        Topics, times and message counts of the new file.

    Raises:
        BagError: The budget for reading or unpacking is used up.
    """
    listed = survey.listed_chunks
    header = survey.header or Header(bag_format.MCAP_PROFILE, "mhsb")
    copy = McapCopy(stream, _complete_definitions(survey), header, listed)
    seen = Survey(survey.path)
    for piece in McapWalk(file).iterate_pieces():
        if isinstance(piece, Chunk) and seen.register_chunk(piece):
            copy.add_chunk(piece)
        elif isinstance(piece, RecordFrame) and piece.opcode == Opcode.MESSAGE:
            copy.add_message(file.read(piece.at, piece.end - piece.at))
        elif isinstance(piece, RecordFrame) and (
            piece.opcode == Opcode.ATTACHMENT
            or (piece.opcode == Opcode.METADATA and piece.content.name != BAG_METADATA)
        ):
            copy.add_attachment_or_metadata(file.read(piece.at, piece.end - piece.at))
    copy.flush()
    contents = summarize_contents(survey, copy.counts, copy.definitions)
    text = bag_format.format_metadata({survey.path.name: contents})
    own = Metadata(BAG_METADATA, {"serialized_metadata": text})
    copy.add_attachment_or_metadata(serialize_record(own))
    copy.finish(contents.start_ns, contents.end_ns)
    return contents


def _complete_definitions(survey: Survey) -> Definitions:
    """Return the schemas and channels of a file, with substitutes for those that are lost.

    If messages refer to a channel whose record is lost, a channel with the topic
    /unknown/channel_ID is added. Its schema gets the highest id that no schema has and no channel
    refers to; if there is none, the channel has no schema. If a channel refers to a schema that is
    not there, a schema of the type UNKNOWN_TYPE is added. It has no message definition.

    Args:
        survey: Findings in the file; not changed.

    Returns:
        A new set of definitions, with the channel of every message and the schema of every channel.
        A channel with the schema id 0 has no schema.
    """
    found = survey.definitions
    schemas, channels = dict(found.schemas), dict(found.channels)
    used = {*schemas, *(channel.schema_id for channel in channels.values())}
    free = next((number for number in range(2**16 - 1, 0, -1) if number not in used), 0)
    for channel_id in survey.counts.keys() - channels.keys():
        topic, encoding = f"/unknown/channel_{channel_id}", bag_format.SERIALIZATION_FORMAT
        channels[channel_id] = Channel(channel_id, topic, encoding, {}, free)
    for schema_id in {channel.schema_id for channel in channels.values()} - {0, *schemas}:
        schemas[schema_id] = Schema(schema_id, b"", bag_format.SCHEMA_ENCODING, UNKNOWN_TYPE)
    return Definitions(schemas, channels)


def _nameless(survey: Survey) -> int:
    """Count the kept messages whose topic is unknown, because their channel's record is lost."""
    return sum(n for each, n in survey.counts.items() if each not in survey.definitions.channels)


def summarize_contents(
    survey: Survey, counts: Mapping[int, int], definitions: Definitions
) -> BagContents:
    """Collect the topics, times and message counts of a data file for the metadata.

    Args:
        survey: Findings in the file; only its first and last log time are used.
        counts: Number of messages by channel id; a missing id means 0.
        definitions: Schemas and channels of the file.

    Returns:
        First and last log time of the file, and each topic with its number of messages. If several
        channels have equal topics, types and other properties, their messages are added up.
    """
    topics: Counter[BagTopic] = Counter()
    for channel in definitions.channels.values():
        topics[_topic(channel, definitions)] += counts.get(channel.id, 0)
    return BagContents(survey.start_ns, survey.end_ns, tuple(topics.items()))


def _topic(channel: Channel, definitions: Definitions) -> BagTopic:
    """Convert a channel of an MCAP file to a topic of the metadata.

    Args:
        channel: The channel.
        definitions: Schemas of the file. If the channel's schema is not among them, the topic gets
            the type UNKNOWN_TYPE.

    Returns:
        The topic. If the channel has no type hash, it gets the hash of the ROS type of that name.
        The hash is empty if the installed ROS packages do not have the type.
    """
    schema = definitions.schema_of(channel)
    type_name = schema.name if schema else UNKNOWN_TYPE
    return BagTopic(
        channel.topic,
        type_name,
        channel.metadata.get("offered_qos_profiles", ""),
        channel.message_encoding,
        channel.metadata.get("topic_type_hash") or bag_format.compute_type_hash(type_name),
    )


def _rename_to_torn(path: Path, replacement: Path | None) -> str:
    """Rename a damaged file, and optionally put another file in its place.

    The new name is the first free one of NAME.torn, NAME.torn.1, NAME.torn.2 and so on. First, a
    hard link gives the damaged file its new name. Then `replacement` takes over the old name, or
    the old name is deleted. On a file system without hard links, the file is renamed instead.

    Args:
        path: The damaged file. If it is a symbolic link, the link is renamed, not its target.
        replacement: File that gets the old name; None leaves the old name free.

    Returns:
        The new name of the damaged file, without its folder.

    Raises:
        OSError: The file cannot be renamed or replaced.
    """
    for number in itertools.count():
        torn = path.with_name(f"{path.name}{TORN_SUFFIX}{f'.{number}' if number else ''}")
        try:
            os.link(path, torn, follow_symlinks=False)
        except FileExistsError:
            continue
        except OSError:  # a file system without links
            if torn.exists() or torn.is_symlink():
                continue
            os.rename(path, torn)
        break
    if replacement is not None:
        os.replace(replacement, path)
    elif path.exists() or path.is_symlink():
        os.unlink(path)
    return torn.name


def _sync(folder: Path) -> None:
    """Write the names of a folder's files to the disk, and wait until this is done (fsync)."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
