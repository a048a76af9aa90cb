"""Load of processes for tests and benchmarks: busy loops, one processor for all, memory."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def run_busy_loops(count: int) -> Iterator[None]:
    """Run processes that keep processors busy while a `with` block lasts.

    The processes are killed at the end of the block, also after an exception.

    Args:
        count: Number of processes, each with an endless loop.
    """
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


@contextmanager
def restrict_to_one_processor(is_active: bool = True) -> Iterator[None]:
    """Restrict the calling thread to one processor while a `with` block lasts.

    Threads and processes that the calling thread starts in the block inherit the restriction, and
    keep it after the block. The calling thread gets its former processors back.

    Args:
        is_active: False leaves the processors as they are in the block.
    """
    before = os.sched_getaffinity(0)
    if is_active:
        os.sched_setaffinity(0, {min(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def read_resident_bytes(pid: int) -> int:
    """Read the memory of a process in RAM from /proc.

    Args:
        pid: Number of the process.

    Returns:
        Size of the memory [bytes]; 0 if the process has ended.
    """
    try:
        pages = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1]
    except (OSError, IndexError):
        return 0
    return int(pages) * os.sysconf("SC_PAGE_SIZE")
