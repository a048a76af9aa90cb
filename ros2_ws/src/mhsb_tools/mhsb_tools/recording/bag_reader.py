"""Reading a recording from its folder; every command that reads recordings uses this module."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from mhsb_msgs_py.topics import SUITE_TOPICS, Topic
from mhsb_tools.recording.bag_folder import BagFolder, find_data_files
from mhsb_tools.recording.bag_format import SERIALIZATION_FORMAT, BagError
from mhsb_tools.recording.data_file import DataFile
from mhsb_tools.recording.mcap_chunk import Chunk, RawMessage
from mhsb_tools.recording.mcap_records import MESSAGE_HEAD, Opcode
from mhsb_tools.recording.mcap_structure import RecordFrame
from mhsb_tools.recording.mcap_survey import Definitions, Survey
from mhsb_tools.recording.mcap_walk import McapWalk
from mhsb_tools.recording.recording import RecordedMessage, Recording, decode_recording


def read_recording(folder: Path, namespace: str = "", slews: bool = False) -> Recording:
    """Read and decode the recording in a folder.

    Args:
        folder: Folder of the recording.
        namespace: Namespace of its topics, such as `/left`; empty for none.
        slews: Whether its arm slews, so that goals have a y coordinate.

    Returns:
        All decoded messages of the suite. Messages that break their contract are left out and
        noted.

    Raises:
        BagError: The folder is no complete recording, or has no readable joint states.
    """
    namespace = namespace.rstrip("/")
    bag = find_data_files(folder)
    if bag.problem:
        raise BagError(f"the recording {folder} is not complete: {bag.problem}; {bag.advice}")
    messages = partial(_messages, bag, _map_topic_names(namespace))
    return decode_recording(messages, f"the recording {folder}", namespace, slews)


def _map_topic_names(namespace: str) -> dict[str, Topic]:
    """Return the suite's topics by their absolute names in a recording.

    Args:
        namespace: Prefix of relative topic names, without a slash at its end.
    """
    return {
        topic.name if topic.name.startswith("/") else f"{namespace}/{topic.name}": topic
        for topic in SUITE_TOPICS
    }


def _messages(bag: BagFolder, names: dict[str, Topic]) -> Iterator[RecordedMessage]:
    """Yield the recorded messages of the suite's topics, in the order of the files.

    Files are read chunk by chunk and checked on the way. An error can therefore come after some
    messages have been yielded.

    Args:
        bag: Data files, and the message count that the metadata state.
        names: Topics to yield, by their absolute names.

    Yields:
        Each message as bytes, with its topic, its stated type and its log time.

    Raises:
        BagError: A file is damaged (raised at the first damage), or the number of messages in all
            files differs from the metadata (raised at the end).
    """
    kept = 0
    for path in bag.files:
        survey = Survey(path)
        with DataFile(path) as file:
            for piece in McapWalk(file).iterate_pieces():
                survey.add(piece, file)
                _check(bag, survey)
                messages: Iterator[RawMessage] = iter(())
                if isinstance(piece, Chunk):
                    messages = piece.messages()
                elif isinstance(piece, RecordFrame) and piece.opcode == Opcode.MESSAGE:
                    messages = iter([_read_unchunked_message(file, piece)])
                yield from _select_topics(messages, survey.definitions, names)
        survey.close()
        _check(bag, survey)
        kept += survey.kept
    if kept != bag.listed_count:
        raise BagError(
            f"the recording {bag.path} is not complete: its metadata count "
            f"{bag.listed_count} messages, its files have {kept}; {bag.advice}"
        )


def _check(bag: BagFolder, survey: Survey) -> None:
    """Raise BagError if damage was found in a file.

    Args:
        bag: Recording, for the message.
        survey: Findings in one of its files so far.
    """
    if survey.first_damage is not None:
        raise BagError(
            f"the recording {bag.path} is damaged: in {survey.path.name} {survey.reason}; "
            f"{bag.advice}"
        )


def _read_unchunked_message(file: DataFile, record: RecordFrame) -> RawMessage:
    """Read a message that stands outside chunks.

    Args:
        file: File of the message.
        record: Position of the message record in the file.

    Returns:
        The message with its serialized content.
    """
    content = file.read(record.begin, record.length)
    channel_id, _, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(content)
    return RawMessage(channel_id, log_ns, publish_ns, content[MESSAGE_HEAD.size :])


def _select_topics(
    messages: Iterator[RawMessage], definitions: Definitions, names: dict[str, Topic]
) -> Iterator[RecordedMessage]:
    """Yield the messages of selected topics, each with its topic and stated type.

    If a channel's encoding is not CDR, the stated type gets ` in ENCODING` appended, so that it
    cannot be taken for a ROS type. Type and encoding are cut to 80 and 20 characters.

    Args:
        messages: Messages by channel; each channel must be in `definitions`.
        definitions: Channels and schemas of the file.
        names: Topics to yield, by their absolute names; others are skipped.

    Yields:
        The messages in the given order.
    """
    known: dict[int, tuple[Topic, str] | None] = {}
    for message in messages:
        channel_id = message.channel_id
        if channel_id not in known:
            channel = definitions.channels[channel_id]
            schema = definitions.schema_of(channel)
            type_name = schema.name[:80] if schema else "no type"
            if channel.encoding != SERIALIZATION_FORMAT:
                type_name += f" in {channel.encoding[:20]}"
            topic = names.get(channel.topic)
            known[channel_id] = (topic, type_name) if topic else None
        if found := known[channel_id]:
            yield RecordedMessage(*found, message.log_ns, message.data)
