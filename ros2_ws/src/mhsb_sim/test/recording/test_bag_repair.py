"""Repair keeps everything up to the tear, wherever the tear is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from mhsb_sim.recording import bag_format
from mhsb_sim.recording.bag_format import BagError, BagTopic
from mhsb_sim.recording.bag_repair import repair
from mhsb_sim.recording.bag_writer import BagWriter
from mhsb_sim.recording.record_command import Record

TOPIC = BagTopic("/modes", "std_msgs/msg/UInt8MultiArray", "")
COUNT = 3000


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    """A complete recording of messages that are told apart by their times."""
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(TOPIC)
        for number in range(COUNT):
            bag.write(TOPIC.name, bytes(40), number, number)
    return tmp_path / "bag"


def times(folder: Path) -> list[int]:
    with Reader(folder) as reader:
        return [time for _, time, _ in reader.messages()]


def tear(folder: Path, share: float) -> None:
    """Leave what a killed recorder leaves: no metadata, and a file that ends anywhere."""
    path = bag_format.data_file(folder)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    (folder / bag_format.METADATA_FILE).unlink()


@pytest.mark.parametrize("share", [0.05, 0.3, 0.5001, 0.77, 0.95, 0.999])
def test_what_stands_before_the_tear_is_kept_in_order(whole, share):
    tear(whole, share)
    kept = repair(whole)
    assert times(whole) == list(range(kept))
    assert kept > (share - 0.35) * COUNT
    assert sorted(path.name for path in whole.iterdir()) == ["bag_0.mcap", "metadata.yaml"]


def test_a_recording_that_lacks_its_metadata_alone_loses_nothing(whole):
    (whole / bag_format.METADATA_FILE).unlink()
    assert repair(whole) == COUNT
    assert times(whole) == list(range(COUNT))


def test_a_tear_in_noise_is_a_tear(whole):
    path = bag_format.data_file(whole)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2] + b"\xff" * 1000)
    (whole / bag_format.METADATA_FILE).unlink()
    kept = repair(whole)
    assert times(whole) == list(range(kept))
    assert kept > 0.15 * COUNT


def test_a_repair_that_was_cut_off_is_begun_anew(whole):
    tear(whole, 0.9)
    (whole / "repair" / "bag").mkdir(parents=True)
    (whole / "repair" / "bag" / "bag_0.mcap").write_bytes(b"half")
    kept = repair(whole)
    assert times(whole) == list(range(kept))


def test_a_file_that_was_cut_off_later_is_mended_though_its_metadata_are_there(whole):
    path = bag_format.data_file(whole)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    kept = repair(whole)
    assert times(whole) == list(range(kept))
    assert kept > 0.15 * COUNT
    with pytest.raises(BagError, match="is complete"):
        repair(whole)


def test_a_torn_recording_whose_folder_was_renamed_is_mended_under_its_own_name(whole):
    tear(whole, 0.8)
    renamed = whole.rename(whole.with_name("kept"))
    kept = repair(renamed)
    assert times(renamed) == list(range(kept))
    assert sorted(path.name for path in renamed.iterdir()) == ["bag_0.mcap", "metadata.yaml"]


def test_a_complete_recording_is_left_alone(whole):
    with pytest.raises(BagError, match="is complete; there is nothing to repair"):
        repair(whole)
    assert len(times(whole)) == COUNT


def test_a_folder_without_a_recording_is_refused(tmp_path):
    with pytest.raises(BagError, match=r"holds no file .*; name the folder of a recording"):
        repair(tmp_path)


def test_the_command_prints_what_it_kept_as_json(whole, capsys):
    tear(whole, 0.5)
    assert Record(repair=whole, json=True).run() == 0
    assert json.loads(capsys.readouterr().out) == {
        "folder": str(whole),
        "messages": len(times(whole)),
    }
