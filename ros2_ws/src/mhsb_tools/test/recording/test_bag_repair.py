"""Repair keeps what is not damaged, counts what is, and never loses the original."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.rosbag2 import Reader

from mhsb_tools.recording import bag_format
from mhsb_tools.recording.bag_format import BagError, BagTopic
from mhsb_tools.recording.bag_repair import Repair, repair_recording
from mhsb_tools.recording.bag_writer import BagWriter
from mhsb_tools.recording.record_command import record

TOPIC = BagTopic("/modes", "std_msgs/msg/UInt8MultiArray", "")
COUNT = 3000
FOREIGN_TYPE, FOREIGN_TEXT = "com3_msgs/msg/JointCmd", b"string[] joint_name\nfloat64[] position\n"


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
    path = bag_format.get_data_file_path(folder)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    (folder / bag_format.METADATA_FILE).unlink()


@pytest.mark.parametrize("share", [0.3, 0.5001, 0.77, 0.95, 0.999])
def test_what_stands_before_the_tear_is_kept_in_order(whole, share):
    tear(whole, share)
    kept = repair_recording(whole).kept
    assert times(whole) == list(range(kept))
    assert kept > (share - 0.35) * COUNT
    names = sorted(path.name for path in whole.iterdir())
    assert names == ["bag_0.mcap", "bag_0.mcap.torn", "metadata.yaml"]


def test_a_recording_that_lacks_its_metadata_alone_loses_nothing(whole):
    (whole / bag_format.METADATA_FILE).unlink()
    assert repair_recording(whole) == Repair(COUNT)
    assert times(whole) == list(range(COUNT))


def test_a_torn_recording_in_which_every_schema_id_is_taken_keeps_its_messages(tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    with bag_format.get_data_file_path(folder).open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        for _ in range(2**16 - 1):
            schema = writer.register_schema(TOPIC.type_name, "ros2msg", b"")
        channel = writer.register_channel(TOPIC.name, "cdr", schema)
        for number in range(10):
            writer.add_message(channel, number, bytes(40), number)
        writer.finish()
    path = bag_format.get_data_file_path(folder)
    path.write_bytes(path.read_bytes()[:-100])
    assert repair_recording(folder).kept == 10
    assert times(folder) == list(range(10))


def test_a_tear_in_noise_is_a_tear(whole):
    path = bag_format.get_data_file_path(whole)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2] + b"\xff" * 1000)
    (whole / bag_format.METADATA_FILE).unlink()
    kept = repair_recording(whole).kept
    assert times(whole) == list(range(kept))
    assert kept > 0.15 * COUNT


def test_a_folder_of_the_users_own_is_not_touched(whole):
    tear(whole, 0.9)
    (whole / "repair").mkdir()
    (whole / "repair" / "notes.txt").write_text("precious")
    kept = repair_recording(whole).kept
    assert times(whole) == list(range(kept))
    assert (whole / "repair" / "notes.txt").read_text() == "precious"


def test_a_file_that_was_cut_off_later_is_mended_though_its_metadata_are_there(whole):
    path = bag_format.get_data_file_path(whole)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    kept = repair_recording(whole).kept
    assert times(whole) == list(range(kept))
    assert kept > 0.15 * COUNT
    assert repair_recording(whole) == Repair(kept, is_complete=True)


def test_a_torn_recording_whose_folder_was_renamed_is_mended_under_its_own_name(whole):
    tear(whole, 0.8)
    renamed = whole.rename(whole.with_name("kept"))
    kept = repair_recording(renamed).kept
    assert times(renamed) == list(range(kept))
    names = sorted(path.name for path in renamed.iterdir())
    assert names == ["bag_0.mcap", "bag_0.mcap.torn", "metadata.yaml"]


def test_a_complete_recording_is_left_alone(whole):
    before = {path.name: path.read_bytes() for path in whole.iterdir()}
    assert repair_recording(whole) == Repair(COUNT, is_complete=True)
    assert {path.name: path.read_bytes() for path in whole.iterdir()} == before


def test_a_folder_without_a_recording_is_refused(tmp_path):
    with pytest.raises(BagError, match=r"holds no file .*; name the folder of a recording"):
        repair_recording(tmp_path)


def test_the_command_prints_what_it_kept_and_lost_as_json(whole, capsys):
    tear(whole, 0.5)
    assert record(repair=whole, json=True) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["folder"] == str(whole)
    assert printed["messages"] == len(times(whole))
    assert printed["lost_bytes"] > 0
    assert printed["lost_is_exact"] is False
    assert printed["originals"] == ["bag_0.mcap.torn"]


def damage(path: Path, at: int, content: bytes) -> None:
    """Write bytes over a place of a file."""
    with path.open("r+b") as file:
        file.seek(at)
        file.write(content)


def test_a_chunk_whose_checksum_fails_is_lost_alone_and_counted(whole):
    path = bag_format.get_data_file_path(whole)
    original = path.read_bytes()
    damage(path, len(original) // 2, b"\xff")
    torn = path.read_bytes()
    done = repair_recording(whole)
    assert done.kept + done.lost == COUNT
    assert 0 < done.lost < 500
    assert done.is_exact
    assert times(whole) == sorted(times(whole))
    assert len(times(whole)) == done.kept
    assert (whole / "bag_0.mcap.torn").read_bytes() == torn


def test_a_file_that_begins_wrongly_is_recovered_whole(whole):
    path = bag_format.get_data_file_path(whole)
    damage(path, 0, bytes(8))
    done = repair_recording(whole)
    assert (done.kept, done.lost) == (COUNT, 0)
    assert times(whole) == list(range(COUNT))


@pytest.mark.parametrize(
    "content", [b"", b"\x89MCAP0\r\n", bytes(100_000), b"no recording\n" * 9000]
)
def test_a_file_of_which_nothing_can_be_read_is_left_as_it_is(whole, content):
    path = bag_format.get_data_file_path(whole)
    path.write_bytes(content)
    before = {each.name: each.read_bytes() for each in whole.iterdir()}
    with pytest.raises(BagError, match=r"nothing can be read from .*; nothing was changed"):
        repair_recording(whole)
    assert {each.name: each.read_bytes() for each in whole.iterdir()} == before


def test_originals_are_numbered_where_earlier_ones_are_kept(whole):
    path = bag_format.get_data_file_path(whole)
    for number in range(3):
        damage(path, path.stat().st_size // 2 + 40_000 * number, b"\xff\xfe")
        assert repair_recording(whole).lost > 0
    names = {each.name for each in whole.iterdir()}
    assert {"bag_0.mcap.torn", "bag_0.mcap.torn.1", "bag_0.mcap.torn.2"} < names


def test_all_files_of_a_recording_are_repaired_and_listed(copy_of, originals):
    folder = copy_of("split")
    (folder / "metadata.yaml").unlink()
    path = folder / "bag_2.mcap"
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    done = repair_recording(folder)
    written = [len(each) for each in originals["split"].written.values()]
    assert written[0] + written[1] < done.kept < sum(written)
    with Reader(folder) as reader:
        assert reader.message_count == done.kept == len(list(reader.messages()))
    text = (folder / bag_format.METADATA_FILE).read_text()
    assert all(f"bag_{number}.mcap" in text for number in range(3))


def test_a_file_without_anything_beside_good_ones_is_set_aside(copy_of, originals):
    folder = copy_of("split")
    (folder / "bag_2.mcap").write_bytes(b"")
    done = repair_recording(folder)
    written = [len(each) for each in originals["split"].written.values()]
    assert done.kept == written[0] + written[1]
    assert not (folder / "bag_2.mcap").exists()
    assert (folder / "bag_2.mcap.torn").read_bytes() == b""
    assert repair_recording(folder).is_complete


def test_types_that_nobody_knows_here_are_kept_with_their_own_text(copy_of, originals):
    folder = copy_of("foreign")
    path = folder / "bag_0.mcap"
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    repair_recording(folder)
    with path.open("rb") as file:
        schemas = make_reader(file).get_summary().schemas.values()
    assert {each.name: each.data for each in schemas}[FOREIGN_TYPE] == FOREIGN_TEXT
    with Reader(folder) as reader:
        kept = Counter(each.topic for each, _, _ in reader.messages())
    written = Counter(topic for topic, _, _ in originals["foreign"].written["bag_0.mcap"])
    assert 0 < kept["/zx200/front_cmd"] < written["/zx200/front_cmd"]


def test_a_full_disk_leaves_everything_as_it_was(whole):
    path = bag_format.get_data_file_path(whole)
    damage(path, path.stat().st_size // 2, b"\xff")
    before = {each.name: each.read_bytes() for each in whole.iterdir()}
    script = f"""
import sys
from mhsb_tools.recording.record_command import main
sys.argv = ["record", "--repair", {str(whole)!r}]
sys.exit(main())
"""
    limit = 100_000
    child = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert child.returncode == 1
    assert child.stderr == (
        f"record: {whole} cannot be repaired: File too large; the damaged recording is kept\n"
    )
    assert {each.name: each.read_bytes() for each in whole.iterdir()} == before
