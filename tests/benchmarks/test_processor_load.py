"""Load beside the nodes, and one processor for everything."""

from __future__ import annotations

import os
import subprocess
import sys

from benchmarks.processor_load import (
    read_resident_bytes,
    restrict_to_one_processor,
    run_busy_loops,
)


def test_what_is_started_on_one_processor_stays_there_and_the_rest_comes_back():
    before = os.sched_getaffinity(0)
    with restrict_to_one_processor():
        said = subprocess.check_output(
            [sys.executable, "-c", "import os; print(*os.sched_getaffinity(0))"], text=True
        )
        assert said.split() == [str(min(before))]
    assert os.sched_getaffinity(0) == before
    with restrict_to_one_processor(is_active=False):
        assert os.sched_getaffinity(0) == before


def test_busy_loops_end_with_their_block():
    def children() -> set[str]:
        task = f"/proc/{os.getpid()}/task/{os.getpid()}/children"
        with open(task, encoding="ascii") as file:
            return set(file.read().split())

    before = children()
    with run_busy_loops(2):
        assert len(children() - before) == 2
    assert children() <= before


def test_the_memory_of_a_process_is_that_of_its_status_and_0_after_its_end():
    with open("/proc/self/status", encoding="ascii") as file:
        [line] = [line for line in file if line.startswith("VmRSS")]
    assert abs(read_resident_bytes(os.getpid()) - 1024 * int(line.split()[1])) < 2**22
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    assert read_resident_bytes(ended.pid) == 0
