"""All kernels compiled ahead, by one process for each processor, and told as it goes on.

What needs kernels lists functions that call them, the parts: `MODULE:FUNCTION`, without arguments.
The processes take them in turn, and share what they compile through the cache; where two need the
same kernel, one of them waits (`shared_cache`). So nodes that start together compile once for all.
"""

from __future__ import annotations

import hashlib
import logging
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from tqdm import tqdm

from mhsb_model.kernels import cache_folder
from mhsb_model.process import signals_kept

_log = logging.getLogger(__name__)


def compile_ahead(parts: Sequence[str], say: Callable[[str], None] | None = None) -> None:
    """See to it that all that these functions compile is in the cache; quick where it is.

    `say` is told how far it is, a line at a time; without it a progress bar tells. What cannot be
    compiled, or kept, is logged: whoever needs it compiles it again and sees why.
    """
    cache_folder.use_kernel_cache()
    marks = _marks(parts)
    missing = [part for part in parts if not marks[part].exists()]
    if not missing:
        return
    progress = _Lines(say, len(missing)) if say else _Bar(len(missing))
    progress.tell(0)
    for done, (part, trouble) in enumerate(_called_by_workers(missing), start=1):
        if trouble:
            _log.warning("kernels of %s were not compiled ahead: %s", part, trouble)
        else:
            with suppress(OSError):  # said when the folder was chosen
                marks[part].touch()
        progress.tell(done)


class _Lines:
    """Progress for a log."""

    def __init__(self, say: Callable[[str], None], total: int) -> None:
        self._say, self._total = say, total

    def tell(self, done: int) -> None:
        self._say(f"compiling kernels, which happens once: {done} of {self._total} parts")


class _Bar:
    """Progress for a terminal; nothing elsewhere."""

    def __init__(self, total: int) -> None:
        self._bar = tqdm(total=total, desc="compiling kernels, once", disable=None)

    def tell(self, done: int) -> None:
        self._bar.update(done - self._bar.n)
        if done == self._bar.total:
            self._bar.close()


def _marks(parts: Sequence[str]) -> dict[str, Path]:
    """The file of each part that is there when it is complete, for these kernels and processor.

    And for the place of their sources, by which numba keeps them: another checkout of the same
    sources has its own.
    """
    from llvmlite import binding

    folder = Path(os.environ[cache_folder.VARIABLE])
    sources = cache_folder.fingerprint(cache_folder.kernel_sources())

    def mark(part: str) -> Path:
        words = (part, sources, __file__, sys.version, binding.get_host_cpu_name())
        return folder / f"complete-{hashlib.sha256(repr(words).encode()).hexdigest()[:16]}"

    return {part: mark(part) for part in parts}


def _called_by_workers(parts: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Parts as they are done, each with what went wrong."""
    waiting: queue.SimpleQueue[str] = queue.SimpleQueue()
    done: queue.SimpleQueue[tuple[str, str]] = queue.SimpleQueue()
    for part in parts:
        waiting.put(part)
    for _ in range(min(len(parts), len(os.sched_getaffinity(0)))):
        threading.Thread(target=_feed, args=(waiting, done), daemon=True).start()
    for _ in parts:
        yield done.get()


def _feed(
    waiting: queue.SimpleQueue[str], done: queue.SimpleQueue[tuple[str, str]]
) -> None:
    """Give one part after the other to a worker, and to another one where that has died."""
    worker = None
    with suppress(queue.Empty):
        while True:
            part = waiting.get_nowait()
            worker = worker or _worker()
            answer = _answer(worker, part)
            done.put((part, answer.strip() if answer else "its process has ended"))
            if not answer:
                worker.kill()
                worker.wait()
                worker = None
    if worker is not None:
        worker.communicate()


def _worker() -> subprocess.Popen[str]:
    """A process of `worker`. It hears no signals: it ends with its input, and so with us."""
    with signals_kept():
        return subprocess.Popen(
            [sys.executable, "-m", "mhsb_model.kernels.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )


def _answer(worker: subprocess.Popen[str], part: str) -> str:
    """A line; empty where there is nobody to give it."""
    assert worker.stdin is not None
    assert worker.stdout is not None
    try:
        worker.stdin.write(f"{part}\n")
        worker.stdin.flush()
        return worker.stdout.readline()
    except OSError:
        return ""
