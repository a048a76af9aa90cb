"""A recorder that is killed or runs out of disk beside a moving arm: told, repaired, never felt."""

import signal
import sys

import pytest

from mhsb_model.verdict import Outcome, Verdict
from mhsb_sim.recording.bag_reader import read_recording

GOAL = (0.55, 0.30)
RECORDER = ("-m", "mhsb_sim.recording.record_command")
SMALL_DISK = 300  # KiB, filled within two seconds


@pytest.fixture
def moving(arm):
    """Function that lets the arm move while something else happens, and waits for its arrival."""

    def move(meanwhile):
        verdict = arm.ask(*GOAL)
        assert verdict.code is Verdict.OK, verdict.sentence
        meanwhile()
        assert arm.ending_of(verdict).outcome is Outcome.REACHED

    return move


def repaired(start, folder):
    child = start("mhsb_sim", "record", "--repair", folder)
    assert child.wait() == 0, child.output
    return read_recording(folder)


def test_a_killed_recorder_loses_no_more_than_its_last_chunk(arm, moving, start, tmp_path):
    recorder = start("mhsb_sim", "record", "--output", tmp_path / "bag")
    recorder.wait_for("ready")

    def kill():
        arm.serve(3.0)
        recorder.stop(signal.SIGKILL)

    last_before = arm.references[-1].stamp_ns
    moving(kill)
    recording = repaired(start, tmp_path / "bag")
    heard = [each.stamp_ns for each in arm.references if each.stamp_ns > last_before]
    # A chunk of 32 KiB and a flush every 0.25 s, at more than 100 KiB a second.
    assert (recording.references.time_ns > heard[0]).sum() > 200
    assert recording.unreadable == ()


def test_a_full_disk_ends_the_recorder_with_a_sentence_and_nobody_else(
    arm, moving, start, start_process, tmp_path
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
    recording = repaired(start, tmp_path / "bag")
    assert len(recording.references.time_ns) > 10
