"""Signals at any moment of a process's life: while it imports, serves, is stuck, or just ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mhsb_model.process import signals_blocked

BOTH = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
SLOW_IMPORT = 'import sys, time\nprint("importing", flush=True)\ntime.sleep(30)\n'
STUCK = """
import time
from mhsb_model.process import grace_period

def main():
    with grace_period(0.2):
        print("serving", flush=True)
        time.sleep(30)
"""
SAVING = """
import time
from mhsb_model import process

def main():
    with process.grace_period(20.0):
        print("serving", flush=True)
        while not process.signalled():
            time.sleep(0.01)
        time.sleep(0.3)
        print("saved", end="")  # and not flushed
    return 0
"""
COMPILING = """
import ctypes

def main():
    print("in a library", flush=True)
    while True:  # a signal cuts it short
        ctypes.CDLL(None).sleep(30)  # as in a compiler: Python calls no handler meanwhile
"""
KEEPING_THE_LOCK = """
import ctypes, time
from mhsb_model import process

def main():
    with process.grace_period(0.5):
        print("serving", flush=True)
        while not process.signalled():
            time.sleep(0.01)
        time.sleep(0.1)
        ctypes.PyDLL(None).pause()  # unlike CDLL, it keeps Python's lock
"""
WAITING = """
import time

def main():
    print("waiting", flush=True)
    time.sleep(30)
"""
HEARING_NOTHING = """
import time

def main():
    print("deaf", flush=True)
    time.sleep(0.5)
    return 3
"""


LARGE_ARRAYS = """
import threading
import numpy as np
from pathlib import Path

def held():
    return 4096e-6 * int(Path("/proc/self/statm").read_text().split()[1])

def search(kept):
    for _ in range(20):
        large = [np.ones(150_000 + 20_000 * k) for k in range(12)]
        kept.append(bytes(5_000))

def main():
    before, kept = held(), []
    for _ in range(3):
        worker = threading.Thread(target=search, args=(kept,))
        worker.start()
        worker.join()
    print(held() - before)
    return 0
"""


def start(folder: Path, kind: str, body: str) -> subprocess.Popen[str]:
    """A process whose entry point is of a kind, `node` or `command`, and its module's body."""
    (folder / "work.py").write_text(body)
    return subprocess.Popen(
        [
            sys.executable,
            "-c",
            f"from mhsb_model.process import make_{kind}_entry as entry; exit(entry('work')())",
        ],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"},
    )


def ended_by(child: subprocess.Popen[str], number: int) -> tuple[int, str]:
    """Exit code and remaining output of a process that is sent a signal when it has spoken."""
    assert child.stdout is not None
    child.stdout.readline()
    child.send_signal(number)
    output, _ = child.communicate(timeout=20)
    return child.returncode, output


@BOTH
def test_a_node_that_is_still_importing_ends_with_code_0_and_silently(tmp_path, number):
    assert ended_by(start(tmp_path, "node", SLOW_IMPORT), number) == (0, "")


@BOTH
def test_a_node_whose_main_thread_is_in_a_library_ends_all_the_same(tmp_path, number):
    assert ended_by(start(tmp_path, "node", COMPILING), number) == (0, "")


@BOTH
def test_a_node_that_serves_is_given_time_to_save_what_it_has(tmp_path, number):
    assert ended_by(start(tmp_path, "node", SAVING), number) == (0, "saved")


@BOTH
def test_a_node_that_does_not_end_in_its_time_is_ended(tmp_path, number):
    assert ended_by(start(tmp_path, "node", STUCK), number) == (0, "")


@BOTH
def test_a_node_whose_main_thread_keeps_pythons_lock_after_a_signal_ends_with_code_1(
    tmp_path, number
):
    assert ended_by(start(tmp_path, "node", KEEPING_THE_LOCK), number) == (1, "")


def test_without_a_signal_a_node_ends_with_its_own_code(tmp_path):
    child = start(tmp_path, "node", HEARING_NOTHING)
    assert child.communicate(timeout=20)[0] == "deaf\n"
    assert child.returncode == 3


@pytest.mark.parametrize("body", [SLOW_IMPORT, WAITING])
def test_a_command_is_interrupted_silently_with_code_130_also_while_it_imports(tmp_path, body):
    assert ended_by(start(tmp_path, "command", body), signal.SIGINT) == (130, "")


@BOTH
def test_a_signal_that_comes_before_the_first_instruction_is_kept(tmp_path, number):
    with signals_blocked():
        child = start(tmp_path, "node", SLOW_IMPORT)
        child.send_signal(number)
    assert "importing\n".startswith(child.communicate(timeout=20)[0])  # it may end amid a line
    assert child.returncode == 0


def test_a_node_holds_no_more_memory_after_large_arrays_than_before(tmp_path):
    output, _ = start(tmp_path, "node", LARGE_ARRAYS).communicate(timeout=20)
    assert float(output) < 3.0  # MB
