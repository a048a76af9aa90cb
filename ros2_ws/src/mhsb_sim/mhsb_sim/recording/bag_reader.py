"""Reading a recording from its folder; everything that reads recordings does so by this module."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from mhsb_msgs_py.topics import SUITE_TOPICS, Topic
from mhsb_sim.recording.bag_folder import BagFolder, examine
from mhsb_sim.recording.bag_format import SERIALIZATION, BagError
from mhsb_sim.recording.data_file import DataFile
from mhsb_sim.recording.mcap_chunk import Chunk, RawMessage
from mhsb_sim.recording.mcap_records import MESSAGE_HEAD, Opcode
from mhsb_sim.recording.mcap_structure import Record
from mhsb_sim.recording.mcap_survey import Definitions, Survey
from mhsb_sim.recording.mcap_walk import McapWalk
from mhsb_sim.recording.recording import RecordedMessage, Recording, decoded


def read_recording(folder: Path, namespace: str = "", slews: bool = False) -> Recording:
    """Read the recording in a folder.

    Args:
        folder: Of the recording.
        namespace: Below which its topics are, such as `/left`.
        slews: Whether its arm slews.

    Raises:
        BagError: The folder is no complete recording, or has no joint states that can be read.
    """
    namespace = namespace.rstrip("/")
    bag = examine(folder)
    if bag.problem:
        raise BagError(f"the recording {folder} is not complete: {bag.problem}; {bag.advice}")
    messages = partial(_messages, bag, _names(namespace))
    return decoded(messages, f"the recording {folder}", namespace, slews)


def _names(namespace: str) -> dict[str, Topic]:
    """Return the suite's topics by their names in a recording."""
    return {
        topic.name if topic.name.startswith("/") else f"{namespace}/{topic.name}": topic
        for topic in SUITE_TOPICS
    }


def _messages(bag: BagFolder, names: dict[str, Topic]) -> Iterator[RecordedMessage]:
    """Yield the messages of topics in the order of the files.

    Raises BagError at the first damage, or at the end where messages are missing.
    """
    kept = 0
    for path in bag.files:
        survey = Survey(path)
        with DataFile(path) as file:
            for piece in McapWalk(file).pieces():
                survey.add(piece, file)
                _check(bag, survey)
                messages: Iterator[RawMessage] = iter(())
                if isinstance(piece, Chunk):
                    messages = piece.messages()
                elif isinstance(piece, Record) and piece.opcode == Opcode.MESSAGE:
                    messages = iter([_loose_message(file, piece)])
                yield from _of_topics(messages, survey.definitions, names)
        survey.close()
        _check(bag, survey)
        kept += survey.kept
    if kept != bag.listed:
        raise BagError(
            f"the recording {bag.path} is not complete: its metadata count {bag.listed} messages, "
            f"its files have {kept}; {bag.advice}"
        )


def _check(bag: BagFolder, survey: Survey) -> None:
    """Raise BagError if a file is damaged."""
    if survey.first_damage is not None:
        raise BagError(
            f"the recording {bag.path} is damaged: in {survey.path.name} {survey.reason}; "
            f"{bag.advice}"
        )


def _loose_message(file: DataFile, record: Record) -> RawMessage:
    """Return a message that stands outside of chunks."""
    content = file.read(record.begin, record.length)
    channel_id, _, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(content)
    return RawMessage(channel_id, log_ns, publish_ns, content[MESSAGE_HEAD.size :])


def _of_topics(
    messages: Iterator[RawMessage], definitions: Definitions, names: dict[str, Topic]
) -> Iterator[RecordedMessage]:
    """Yield the messages of some topics with these and the types that they are said to have."""
    known: dict[int, tuple[Topic, str] | None] = {}
    for message in messages:
        channel_id = message.channel_id
        if channel_id not in known:
            channel = definitions.channels[channel_id]
            schema = definitions.schema_of(channel)
            type_name = schema.name[:80] if schema else "no type"
            if channel.encoding != SERIALIZATION:
                type_name += f" in {channel.encoding[:20]}"
            topic = names.get(channel.topic)
            known[channel_id] = (topic, type_name) if topic else None
        if found := known[channel_id]:
            yield RecordedMessage(*found, message.log_ns, message.data)
