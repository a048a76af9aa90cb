"""Executables and scripts in forks of a process that has imported and loaded what nodes need.

A node starts in 0.5 s of processor time so, and in 2.2 s as a process of its own. What it is to
start, and what signals do meanwhile, is the subject of tests that use the installed executables.
"""

from __future__ import annotations

import importlib
import multiprocessing
import os
import runpy
import signal
import subprocess
import sys
from collections.abc import Callable
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path
from unittest.mock import patch

ROOT = Path(__file__).parents[2]

FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(["tests.forks.preload"])


def start_server() -> None:
    """Start the process that is forked, which finds its preload by PYTHONPATH alone."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    with patch.dict(os.environ, PYTHONPATH=path):
        forkserver.ensure_running()


class ForkedProcess:
    """A program in a fork; has what a `Child` needs of `subprocess.Popen`."""

    def __init__(
        self, program: Callable[[str], object], words: list[str], environment: dict[str, str]
    ) -> None:
        start_server()
        reader, writer = FORKS.Pipe(duplex=False)
        place = os.getcwd(), environment, writer
        self._process = FORKS.Process(target=run, args=(program, words, *place), daemon=True)
        self._process.start()
        writer.close()
        self.pid = self._process.pid
        self.stdout = os.fdopen(os.dup(reader.fileno()), encoding="utf-8", errors="replace")
        reader.close()

    def poll(self) -> int | None:
        """Exit code, None while it runs."""
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end [s]; the exit code."""
        self._process.join(timeout)
        if (code := self.poll()) is None:
            raise subprocess.TimeoutExpired(self._process.name, timeout or 0.0)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal, if it still runs."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)


def run(
    program: Callable[[str], object],
    words: list[str],
    folder: str,
    environment: dict[str, str],
    output: Connection,
) -> None:
    """Become a session of this folder, environment and output, and call the program by its name."""
    os.setsid()
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for stream in (1, 2):
        os.dup2(output.fileno(), stream)
    output.close()
    sys.stdout.reconfigure(line_buffering=True)
    sys.argv = words
    sys.exit(program(words[0]))


def call_executable(package: str, name: str) -> object:
    """Call the entry point of an installed executable."""
    return getattr(importlib.import_module(f"{package}.executables"), name)()


def run_script(file: str) -> None:
    """Run a file as `python FILE` does."""
    runpy.run_path(file, run_name="__main__")
