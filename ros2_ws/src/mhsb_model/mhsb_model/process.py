"""What SIGINT and SIGTERM do, from a process's first instruction to its last.

A console script calls an entry point that is made by `command` or `node`: it takes care of signals
and only then imports the module that does the work, since most of a start goes into imports.

A signal ends a node with code 0. While it starts there is nothing to save, and it ends at once,
from a thread of its own: the main one may be compiling for seconds. Inside `orderly`, whoever
serves is given time to end by himself.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

INTERRUPTED = 130
"""Exit code of a command that was interrupted."""

ORDERLY_END = 1.5
"""Time that a process is given to end by itself after a signal [s]."""

SIGNALS = (signal.SIGINT, signal.SIGTERM)

MALLOC = ((-3, 2**18), (-1, 2**18), (-8, 2))
"""glibc's M_MMAP_THRESHOLD, M_TRIM_THRESHOLD [bytes] and M_ARENA_MAX: see `give_back_memory`."""

_signalled = threading.Event()
_times_to_end: list[float] = []
"""Of the `orderly` blocks that are being executed [s]."""

_last_deeds: list[Callable[[], None]] = []
"""What is done before a node is ended from outside of its main thread."""


def give_back_memory() -> None:
    """Let what large arrays took go back to the system as soon as they are free.

    Otherwise glibc takes ever larger ones from its heaps, one for each thread, and a long search
    leaves holes there. Where the C library is another one nothing happens.
    """
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        for option, value in MALLOC:
            library.mallopt(option, value)


def command(module: str) -> Callable[[], int]:
    """Entry point of the command `module.main`; an interrupt ends it silently with code 130."""

    def enter() -> int:
        signal.signal(signal.SIGINT, _exit_interrupted)
        _let_signals_in()
        main: Callable[[], int] = importlib.import_module(module).main
        signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            return main()
        except KeyboardInterrupt:
            return INTERRUPTED
        finally:
            signal.signal(signal.SIGINT, _exit_interrupted)

    return enter


def node(module: str) -> Callable[[], NoReturn]:
    """Entry point of the node `module.main`, which SIGINT and SIGTERM end with code 0."""

    def enter() -> NoReturn:
        _watch_signals()
        give_back_memory()
        _leave(importlib.import_module(module).main())

    return enter


@contextmanager
def orderly(seconds: float = ORDERLY_END) -> Iterator[None]:
    """A block in which a signal does not end a node at once: it has `seconds` to do so itself."""
    _times_to_end.append(seconds)
    try:
        yield
    finally:
        _times_to_end.remove(seconds)


@contextmanager
def signals_kept() -> Iterator[None]:
    """For starting a child: signals that reach it early wait until its entry point is there."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def signalled() -> bool:
    """Whether a signal has asked this node to end."""
    return _signalled.is_set()


def before_an_end_at_once(deed: Callable[[], None]) -> None:
    """Have something put away, quickly, where a signal ends a node that cannot do it itself."""
    _last_deeds.append(deed)


def run_named(entries: Mapping[str, Any]) -> NoReturn:
    """For `python -m PACKAGE.executables NAME ARGUMENTS`, as `ros2 run PACKAGE NAME ARGUMENTS`."""
    sys.argv[0] = sys.argv.pop(1)
    sys.exit(entries[sys.argv[0]]())


def _exit_interrupted(number: int, frame: object) -> NoReturn:
    """In place of KeyboardInterrupt, which an import turns into errors of its own."""
    os._exit(INTERRUPTED)


def _let_signals_in() -> None:
    """Whoever started this process may have blocked them until somebody is there to hear them."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


def _watch_signals() -> None:
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    for number in SIGNALS:
        signal.signal(number, _leave_it_to_the_watch)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reader,), name="signals", daemon=True).start()
    _let_signals_in()


def _leave_it_to_the_watch(number: int, frame: object) -> None:
    """What Python calls for a signal, between two instructions of the main thread."""


def _watch(reader: int) -> None:
    """Wait for a signal, then see to it that this process ends."""
    os.read(reader, 1)
    _signalled.set()
    time.sleep(max(_times_to_end, default=0.0))
    for deed in _last_deeds:
        with suppress(Exception):
            deed()
    _leave(0)


def _leave(code: int) -> NoReturn:
    """End without the interpreter's cleaning up, which a signal or a library's thread can spoil."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(Exception):
            stream.flush()
    os._exit(code)
