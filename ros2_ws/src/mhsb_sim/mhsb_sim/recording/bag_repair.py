"""Making a recording whole that was cut off: everything up to the tear is kept."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Iterator
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Channel, Footer, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from mhsb_sim.recording import bag_format
from mhsb_sim.recording.bag_format import BagError, BagTopic
from mhsb_sim.recording.bag_writer import BagWriter


def repair(folder: Path) -> int:
    """Rewrite the recording in `folder` up to its tear; returns the number of messages kept.

    The torn file is replaced only when the new one is complete. Raises BagError where there is
    no recording, or where it is complete already.
    """
    torn = _data_file(folder)
    if (folder / bag_format.METADATA_FILE).exists() and _ends_well(torn):
        raise BagError(f"the recording {folder} is complete; there is nothing to repair")
    scratch = folder / "repair"
    shutil.rmtree(scratch, ignore_errors=True)  # of a repair that was itself cut off
    # The new file is named as the old one, since the metadata hold its name.
    with BagWriter(scratch / torn.stem.removesuffix("_0")) as bag:
        _copy(torn, bag)
    bag.path.replace(torn)
    (bag.folder / bag_format.METADATA_FILE).replace(folder / bag_format.METADATA_FILE)
    shutil.rmtree(scratch)
    return bag.message_count


def _data_file(folder: Path) -> Path:
    """The one file of a recording, also where its folder has been renamed."""
    usual = bag_format.data_file(folder)
    found = [usual] if usual.exists() else sorted(folder.glob("*_0.mcap"))
    if len(found) != 1:
        raise BagError(f"{folder} holds no file {usual.name}; name the folder of a recording")
    return found[0]


def _ends_well(file: Path) -> bool:
    """Whether a recording's file has its end."""
    size = file.stat().st_size
    with file.open("rb") as content:
        content.seek(max(0, size - len(MCAP0_MAGIC)))
        return content.read() == MCAP0_MAGIC


def _copy(torn: Path, bag: BagWriter) -> None:
    schemas: dict[int, Schema] = {}
    names: dict[int, str] = {}
    for record in _records(torn):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in names:
            names[record.id] = record.topic
            qos = record.metadata.get("offered_qos_profiles", "")
            bag.add_topic(BagTopic(record.topic, schemas[record.schema_id].name, qos))
        elif isinstance(record, Message):
            bag.write(names[record.channel_id], record.data, record.log_time, record.publish_time)


def _records(torn: Path) -> Iterator[McapRecord]:
    """All records up to the tear, or to the end where only the metadata are missing."""
    with torn.open("rb") as file:
        try:
            for record in StreamReader(file).records:
                if isinstance(record, Footer):
                    return
                yield record
        except (McapError, EOFError, struct.error, ValueError):
            return  # how the reader meets the end of a record that is not all there
