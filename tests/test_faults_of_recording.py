"""A recorder that is killed or runs out of disk beside a moving arm: told, repaired, never felt."""

import json
import signal
import sys

import pytest

from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import topics
from mhsb_tools.recording import bag_format
from mhsb_tools.recording.bag_format import BagTopic
from mhsb_tools.recording.bag_reader import read_recording
from mhsb_tools.recording.bag_writer import BagWriter

GOAL = (0.55, 0.30)
RECORDER = ("-m", "mhsb_tools.executables", "mhsb", "record")
SMALL_DISK = 900  # KiB, filled within some seconds, but not before the recorder is ready


@pytest.fixture
def moving(arm):
    """Function that lets the arm move while something else happens, and waits for its arrival."""

    def move(meanwhile):
        verdict = arm.request_verdict(*GOAL)
        assert verdict.code is Verdict.OK, verdict.sentence
        meanwhile()
        assert arm.ending_of(verdict).outcome is Outcome.REACHED

    return move


def repaired(start_fork, folder):
    child = start_fork("mhsb_tools", "mhsb", "record", "--repair", folder)
    assert child.wait() == 0, child.output
    return read_recording(folder)


def test_a_killed_recorder_loses_no_more_than_its_last_chunk(arm, moving, start_fork, tmp_path):
    recorder = start_fork("mhsb_tools", "mhsb", "record", "--output", tmp_path / "bag")
    recorder.wait_for("ready")

    def kill():
        arm.serve(3.0)
        recorder.stop(signal.SIGKILL)

    last_before = arm.references[-1].stamp_ns
    moving(kill)
    recording = repaired(start_fork, tmp_path / "bag")
    heard = [each.stamp_ns for each in arm.references if each.stamp_ns > last_before]
    # A chunk of 32 KiB and a flush every 0.25 s, at more than 100 KiB a second.
    assert (recording.references.time_ns > heard[0]).sum() > 200
    assert recording.unreadable == ()


def test_a_full_disk_ends_the_recorder_with_a_sentence_and_nobody_else(
    arm, moving, start_fork, start_process, tmp_path
):
    limited = f'ulimit -f {SMALL_DISK}; exec "$0" "$@"'
    command = (sys.executable, *RECORDER, "--output", tmp_path / "bag")
    recorder = start_process("bash", "-c", limited, *command)
    recorder.wait_for("ready")
    moving(lambda: arm.until(lambda: recorder.process.poll() is not None, 30.0))
    assert recorder.wait() == 1
    assert "cannot" in recorder.output.splitlines()[-1]
    assert str(tmp_path / "bag") in recorder.output.splitlines()[-1]
    assert "Traceback" not in recorder.output
    recording = repaired(start_fork, tmp_path / "bag")
    assert len(recording.references.time_ns) > 10


def test_a_file_that_is_no_recording_stays_as_it_is_and_every_reader_says_so(start_fork, tmp_path):
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "bag_0.mcap").write_bytes(bytes(range(256)) * 400)
    (bag / "repair").mkdir()
    before = sorted(path.name for path in bag.iterdir())
    commands = {
        "record": ("record", "--repair", bag),
        "report": ("report", bag, "--output", tmp_path / "report"),
        "animate": ("animate", bag, "--output", tmp_path / "film.gif"),
        "view": ("view", bag, "--port", 0),
    }
    children = {name: start_fork("mhsb_tools", "mhsb", *words) for name, words in commands.items()}
    for name, child in children.items():
        assert child.wait() == 1, child.output
        [sentence] = child.output.splitlines()
        assert sentence.startswith(f"mhsb {name}: ")
        told = "nothing can be read" if name == "record" else "complete it by mhsb record --repair"
        assert told in sentence
    assert sorted(path.name for path in bag.iterdir()) == before
    assert (bag / "bag_0.mcap").read_bytes() == bytes(range(256)) * 400


def test_a_bad_sector_is_told_by_report_and_repaired_with_the_original_kept(start_fork, tmp_path):
    bag = tmp_path / "bag"
    with BagWriter(bag) as writer:
        topic = topics.MODES
        writer.add_topic(BagTopic("/modes", topic.type_name, bag_format.format_qos(topic.qos)))
        for number in range(3000):
            writer.write("/modes", bytes(40), number, number)
    path = bag / "bag_0.mcap"
    damaged = bytearray(path.read_bytes())
    damaged[len(damaged) // 2] ^= 0xFF
    path.write_bytes(damaged)
    report = ("report", bag, "--output", tmp_path / "report")
    refused = start_fork("mhsb_tools", *report)
    assert refused.wait() == 1
    assert "the checksum of a chunk is wrong" in refused.output
    repaired = start_fork("mhsb_tools", "mhsb", "record", "--repair", bag, "--json")
    assert repaired.wait() == 0
    told = json.loads(repaired.output)
    assert told["messages"] + told["lost_messages"] == 3000
    assert told["lost_is_exact"]
    assert (bag / "bag_0.mcap.torn").read_bytes() == damaged
    again = start_fork("mhsb_tools", "mhsb", "record", "--repair", bag)
    assert again.wait() == 0
    assert again.output.startswith(f"{bag} is complete with {told['messages']} messages; nothing")
