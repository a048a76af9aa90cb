"""Reading a recording from its folder; every command that reads recordings uses this module."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from mcap.opcode import Opcode

from mhsb_msgs_py.topics import SUITE_TOPICS, Topic
from mhsb_tools.recording.bag_folder import BagFolder, find_data_files
from mhsb_tools.recording.bag_format import SERIALIZATION_FORMAT, BagError
from mhsb_tools.recording.data_file import DataFile
from mhsb_tools.recording.mcap_chunk import Chunk, RawMessage, get_message_at
from mhsb_tools.recording.mcap_structure import RecordFrame
from mhsb_tools.recording.mcap_survey import Definitions, Survey
from mhsb_tools.recording.mcap_walk import McapWalk
from mhsb_tools.recording.recording import RecordedMessage, Recording, decode_recording


def read_recording(folder: Path, namespace: str = "", slews: bool = False) -> Recording:
    """Read and decode the recording in a folder.

    Args:
        folder: Folder of the recording.
        namespace: Namespace of the recorded topics, such as `/left`; empty for none.
        slews: Whether the recorded arm slews, so that its goals have a y coordinate.

    Returns:
        All messages on the suite's topics, decoded. A message that is damaged or has a wrong type
        is left out and noted in `unreadable`.

    Raises:
        BagError: The folder has no recording, the recording is damaged or incomplete, or it has no
            readable joint states.
    """
    namespace = namespace.rstrip("/")
    bag = find_data_files(folder)
    if bag.problem:
        raise BagError(f"the recording {folder} is not complete: {bag.problem}; {bag.advice}")
    names = {
        topic.name if topic.name.startswith("/") else f"{namespace}/{topic.name}": topic
        for topic in SUITE_TOPICS
    }
    messages = partial(_messages, bag, names)
    return decode_recording(messages, f"the recording {folder}", namespace, slews)


def _messages(bag: BagFolder, names: dict[str, Topic]) -> Iterator[RecordedMessage]:
    """Yield the recorded messages of the suite's topics, in the order of the files.

    Files are read and checked chunk by chunk. Some messages may therefore be yielded before an
    error is raised.

    Args:
        bag: Recording with its data files, whose metadata could be read (`bag.problem` is None).
        names: Topics to yield, by their absolute names.

    Yields:
        Each message as bytes, with its topic, its type as the file states it, and its log time
        [ns].

    Raises:
        BagError: A file is damaged, or the files have another number of messages than the metadata
            state (`bag.listed_count`). The numbers are compared only at the end.
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
                    messages = iter([get_message_at(file.read(piece.at, piece.end - piece.at), 0)])
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
        bag: Recording that the error names.
        survey: Findings so far in one data file of the recording.
    """
    if survey.first_damage is not None:
        raise BagError(
            f"the recording {bag.path} is damaged: in {survey.path.name} {survey.reason}; "
            f"{bag.advice}"
        )


def _select_topics(
    messages: Iterator[RawMessage], definitions: Definitions, names: dict[str, Topic]
) -> Iterator[RecordedMessage]:
    """Yield the messages of selected topics; messages of all other topics are skipped.

    Each message gets the name of its type as the file states it, or "no type" if the file states
    none. If the messages are not encoded as CDR, ` in ENCODING` is appended, so that the name
    equals no ROS type. The type is cut to 80 characters, and ENCODING to 20.

    Args:
        messages: Messages of one file.
        definitions: Channels and schemas of the file. It must have the channel of each message.
        names: Topics to yield, by their absolute names.

    Yields:
        The messages in the given order, each with its topic, type and log time [ns].
    """
    known: dict[int, tuple[Topic, str] | None] = {}
    for message in messages:
        channel_id = message.channel_id
        if channel_id not in known:
            channel = definitions.channels[channel_id]
            schema = definitions.schema_of(channel)
            type_name = schema.name[:80] if schema else "no type"
            if channel.message_encoding != SERIALIZATION_FORMAT:
                type_name += f" in {channel.message_encoding[:20]}"
            topic = names.get(channel.topic)
            known[channel_id] = (topic, type_name) if topic else None
        if found := known[channel_id]:
            yield RecordedMessage(*found, message.log_ns, message.data)
