"""Compiling ahead: in parts, by several processes, told as it goes on, once for all programs."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

import mhsb_model

PARTS = """
import os
import time
from pathlib import Path

HERE = Path(__file__).parent

def slow():
    time.sleep(0.3)
    with (HERE / "done").open("a") as file:
        print(os.getpid(), file=file)

def quick():
    pass

def wrong():
    raise ValueError("no such type")

def deadly():
    os._exit(3)

def endless():
    (HERE / "begun").write_text(str(os.getpid()))
    time.sleep(60)
"""
PROGRAM = """
import logging, sys
from mhsb_model.kernels.cache_folder import set_kernel_cache_folder
from mhsb_model.kernels.pool import compile_ahead
logging.basicConfig(format="%(message)s", stream=sys.stdout)
set_kernel_cache_folder()
compile_ahead(sys.argv[1:], lambda line: print(line, flush=True))
print("ready", flush=True)
"""


@pytest.fixture
def start(tmp_path):
    """Function (parts..., sources) that starts a program which has these parts compiled ahead, with
    the suite as it is or, of a package, the one in the folder `sources`."""
    (tmp_path / "parts.py").write_text(PARTS)

    def run(*parts, sources=tmp_path):
        path = (str(sources), str(tmp_path), os.environ["PYTHONPATH"])
        environment = {
            **os.environ,
            "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
            "PYTHONPATH": os.pathsep.join(path),
        }
        return subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *(f"parts:{part}" for part in parts)],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    return run


def lines(child):
    """What a program has printed until its end."""
    return child.communicate(timeout=120)[0].splitlines()


def test_without_a_terminal_one_line_says_that_kernels_are_compiled(tmp_path):
    (tmp_path / "parts.py").write_text(PARTS)
    program = "from mhsb_model.kernels.pool import compile_ahead\ncompile_ahead(['parts:quick'])\n"
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONPATH": os.pathsep.join((str(tmp_path), os.environ["PYTHONPATH"])),
    }
    for expected in (1, 0):  # the second time there is nothing to compile
        done = subprocess.run(
            [sys.executable, "-c", program],
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert done.stderr.count("compiling kernels") == expected
        assert done.stdout == ""


def test_all_parts_are_done_and_told(start, tmp_path):
    assert lines(start("slow", "slow", "slow")) == [
        *(f"compiling kernels, which happens once: {done} of 3 parts" for done in range(4)),
        "ready",
    ]
    workers = (tmp_path / "done").read_text().split()
    assert len(workers) == 3
    assert len(set(workers)) == min(3, len(os.sched_getaffinity(0)))


def test_what_is_complete_is_not_done_again_and_other_parts_are(start):
    assert len(lines(start("slow"))) == 3
    assert lines(start("slow")) == ["ready"]
    assert lines(start("slow", "quick")) == [
        "compiling kernels, which happens once: 0 of 1 parts",
        "compiling kernels, which happens once: 1 of 1 parts",
        "ready",
    ]


def test_another_checkout_of_the_same_sources_has_its_own(start, tmp_path):
    assert len(lines(start("quick"))) == 3
    shutil.copytree(Path(mhsb_model.__file__).parent, tmp_path / "other" / "mhsb_model")
    assert len(lines(start("quick", sources=tmp_path / "other"))) == 3
    assert lines(start("quick", sources=tmp_path / "other")) == ["ready"]


def test_what_cannot_be_compiled_is_told_and_stops_nothing(start, tmp_path):
    printed = lines(start("wrong", "deadly", "slow", "slow"))
    assert "kernels of parts:wrong were not compiled ahead: ValueError: no such type" in printed
    assert "kernels of parts:deadly were not compiled ahead: its process has ended" in printed
    assert printed[-1] == "ready"
    assert len((tmp_path / "done").read_text().split()) == 2
    again = lines(start("wrong", "slow"))
    assert again[0] == "compiling kernels, which happens once: 0 of 1 parts"
    assert "no such type" in again[1]


def test_workers_end_with_a_program_that_is_killed(start, tmp_path):
    child = start("endless")
    while not (tmp_path / "begun").exists() or not (tmp_path / "begun").read_text():
        assert child.poll() is None
        time.sleep(0.02)
    worker = int((tmp_path / "begun").read_text())
    child.kill()
    child.communicate()
    while os.path.exists(f"/proc/{worker}"):
        time.sleep(0.02)


def test_a_worker_that_nobody_listens_to_any_more_ends_without_a_word(tmp_path):
    (tmp_path / "parts.py").write_text(PARTS)
    path = f"{tmp_path}{os.pathsep}{os.environ['PYTHONPATH']}"
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    worker = subprocess.Popen(
        [sys.executable, "-m", "mhsb_model.kernels.worker"],
        env={**os.environ, "PYTHONPATH": path},
        **pipes,
    )
    worker.stdout.close()
    worker.stdin.write(b"parts:quick\n")
    worker.stdin.flush()  # and stays open: the answer finds out first
    assert worker.wait(60) == 0
    assert worker.stderr.read() == b""
