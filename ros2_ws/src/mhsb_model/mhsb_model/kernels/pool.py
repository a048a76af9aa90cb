"""Compilation of all kernels ahead of their use, in one process for each processor.

The caller lists functions without arguments that call the kernels, as `MODULE:FUNCTION`. Each
process takes one function after the other. The processes share compiled kernels through the cache.
If two processes need the same kernel, one of them waits (`shared_cache`). So nodes that start
together compile each kernel only once.
"""

import hashlib
import importlib
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
from mhsb_model.process import signals_blocked

_log = logging.getLogger(__name__)


def compile_ahead(
    parts: Sequence[str], report_progress: Callable[[str], None] | None = None
) -> None:
    """Compile all kernels that the given functions call, unless they are in the cache already.

    Worker processes call the functions; each processor has one worker. A marker file in the cache
    records each function that has succeeded, so repeated calls return quickly. If the cache cannot
    be written, nothing is done. If a function fails, this is only logged: whoever calls its kernels
    later compiles them and gets the error.

    Args:
        parts: Functions without arguments that call the kernels, as `MODULE:FUNCTION`.
        report_progress: Function that gets a line of text at the start and after each function.
            None shows a progress bar; without a terminal, it prints one line on stderr.
    """
    cache_folder.set_kernel_cache_folder()
    if cache_folder.find_write_problem(Path(os.environ[cache_folder.CACHE_VARIABLE])):
        return
    marks = _find_marker_files(parts)
    missing = [part for part in parts if not marks[part].exists()]
    if not missing:
        return
    calls = tqdm(
        _call_in_workers(missing),
        "compiling kernels, once",
        len(missing),
        disable=True if report_progress else None,
    )
    if calls.disable and not report_progress:
        print("compiling kernels, once; half a minute, on a busy machine minutes", file=sys.stderr)
    report = report_progress or (lambda line: None)
    words = f"compiling kernels, which happens once: %d of {len(missing)} parts"
    report(words % 0)
    for done, (part, trouble) in enumerate(calls, start=1):
        if trouble:
            _log.warning("kernels of %s were not compiled ahead: %s", part, trouble)
        else:
            with suppress(OSError):  # a warning was logged when the folder was chosen
                marks[part].touch()
        report(words % done)


def _find_marker_files(parts: Sequence[str]) -> dict[str, Path]:
    """Return the path of each function's marker file.

    The file exists if the kernels that the function calls are in the cache. The file's name is a
    hash of the function's name, all kernel sources, their folder, the Python version and the
    processor. The folder is included because numba identifies kernels by it, too. NUMBA_CACHE_DIR
    must be set.

    Args:
        parts: Functions as `MODULE:FUNCTION`.

    Returns:
        Path of the marker file by function, whether or not the file exists.
    """
    from llvmlite import binding

    folder = Path(os.environ[cache_folder.CACHE_VARIABLE])
    sources = cache_folder.fingerprint_of_kernel_sources()

    def marker_file(part: str) -> Path:
        """Return the marker file of one function in the cache folder."""
        words = (part, sources, __file__, sys.version, binding.get_host_cpu_name())
        return folder / f"complete-{hashlib.sha256(repr(words).encode()).hexdigest()[:16]}"

    return {part: marker_file(part) for part in parts}


def _call_in_workers(parts: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Call functions in parallel worker processes, one for each available processor.

    Args:
        parts: Functions without arguments, as `MODULE:FUNCTION`.

    Yields:
        Function and error message, in the order in which the calls end. The message is empty if the
        call succeeded.
    """
    waiting: queue.SimpleQueue[str] = queue.SimpleQueue()
    done: queue.SimpleQueue[tuple[str, str]] = queue.SimpleQueue()
    for part in parts:
        waiting.put(part)
    for _ in range(min(len(parts), len(os.sched_getaffinity(0)))):
        threading.Thread(target=_serve_queue, args=(waiting, done), daemon=True).start()
    # The caller needs numba to load the kernels, and imports it while it has nothing else to do.
    importlib.import_module("mhsb_model.kernels.compiled")
    for _ in parts:
        yield done.get()


def _serve_queue(waiting: queue.SimpleQueue[str], done: queue.SimpleQueue[tuple[str, str]]) -> None:
    """Pass functions from a queue to one worker process, until the queue is empty.

    This function runs in a thread of its own. The worker process is started for the first function
    from the queue. If the worker dies, its current function counts as failed, and a new worker is
    started for the next function. At the end the worker is stopped.

    Args:
        waiting: Functions that are not started yet, as `MODULE:FUNCTION`; shared by all threads.
        done: Receives each function and its error message; the message is empty if the call
            succeeded.
    """
    worker = None
    with suppress(queue.Empty):
        while True:
            part = waiting.get_nowait()
            worker = worker or _start_worker()
            answer = _call_in_worker(worker, part)
            done.put((part, answer.strip() if answer else "its process has ended"))
            if not answer:
                worker.kill()
                worker.wait()
                worker = None
    if worker is not None:
        worker.communicate()


def _start_worker() -> subprocess.Popen[str]:
    """Start a worker process that calls functions by name, connected by pipes.

    SIGINT, SIGTERM and SIGHUP stay blocked in the worker. The worker ends when its input is closed,
    which also happens when this process ends.

    Returns:
        The running process, with text pipes to its input and from its output.
    """
    with signals_blocked():
        return subprocess.Popen(
            [sys.executable, "-m", "mhsb_model.kernels.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )


def _call_in_worker(worker: subprocess.Popen[str], part: str) -> str:
    """Pass one function to a worker process and wait for its answer.

    Args:
        worker: Worker process, connected by text pipes.
        part: Function as `MODULE:FUNCTION`.

    Returns:
        Answer with its line end: only a line end for success, else an error message. Empty if the
        worker has died.
    """
    assert worker.stdin is not None
    assert worker.stdout is not None
    try:
        worker.stdin.write(f"{part}\n")
        worker.stdin.flush()
        return worker.stdout.readline()
    except OSError:
        return ""
