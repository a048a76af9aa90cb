"""Child processes of the suite's commands: start, wait for output, and end cleanly."""

import signal
import subprocess
import sys
import threading
from collections import deque
from contextlib import AbstractContextManager, suppress

from mhsb_model.errors import MhsbError
from mhsb_model.process import signals_blocked

END_TIMEOUT = 10.0
"""Longest wait for a process to end by itself after the signal that ends it [s]."""

LAST_LINES = 20
"""Number of output lines of a child process that are kept in memory."""


class ChildEndedError(MhsbError):
    """A child process that ended early, did not print an expected text, or cannot be reached."""


class ChildProcess(AbstractContextManager["ChildProcess"]):
    """Child process that runs one of the suite's executables; use it as a context manager.

    Leaving the `with` block ends the process. Its standard output and standard error are read by a
    thread, and the last LAST_LINES lines are kept.

    Attributes:
        name: Name of the executable, used in error messages.
    """

    def __init__(self, package: str, executable: str, *arguments: str) -> None:
        """Start an executable in the way `ros2 run PACKAGE EXECUTABLE ARGUMENTS` does.

        The child gets a new session, so Ctrl-C in the terminal does not reach it. The parent
        process must end it, by `end` or by leaving the `with` block. Standard output and standard
        error are read together in a thread.

        Args:
            package: Python package whose module `executables` has the entry point.
            executable: Name of the entry point in that module.
            arguments: Command-line arguments of the executable.
        """
        self.name = executable
        with signals_blocked():
            self._process = subprocess.Popen(
                [sys.executable, "-u", "-m", f"{package}.executables", executable, *arguments],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                start_new_session=True,  # Ctrl-C must reach only the command
            )
        self._lines: deque[str] = deque(maxlen=LAST_LINES)
        self._output_changed = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __exit__(self, *failure: object) -> None:
        """End the process, whether or not the block raised an exception."""
        self.end()

    def wait_for(self, text: str, timeout: float) -> str:
        """Wait until the process has printed a text.

        The lines kept in memory (the last LAST_LINES) are searched first, then each new line.

        Args:
            text: Text to wait for; part of a line is enough.
            timeout: Longest wait [s].

        Returns:
            The rest of the first line with `text`, from the beginning of `text` to the end of the
            line.

        Raises:
            ChildEndedError: The process has ended, even if it printed the text before. Or the text
                did not come within `timeout`.
        """
        found: list[str] = []  # later lines may push the line out of those that are kept

        def has_printed_or_ended() -> bool:
            """Add the kept lines with `text` to `found`, and return True if the wait is over.

            The wait is over if there is such a line, or if the process has ended.
            """
            found.extend(line for line in list(self._lines) if text in line)
            return bool(found) or self._process.poll() is not None

        with self._output_changed:
            self._output_changed.wait_for(has_printed_or_ended, timeout)
        self.check_running()
        if not found:
            raise ChildEndedError(f"{self.name} did not say '{text}' within {timeout:g} s")
        return found[0][found[0].index(text) :]

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Exit code of the process; None while it runs, negative if a signal ended it."""
        return self._process.poll()

    def send(self, signal_number: int) -> None:
        """Send a signal to the process, or do nothing if it has ended."""
        if self.exit_code is None:
            self._process.send_signal(signal_number)

    def check_running(self) -> None:
        """Raise ChildEndedError if the process has ended; do nothing while it runs.

        The error's message has the exit code and the last line of output.
        """
        code = self._process.poll()
        if code is not None:
            self._reader.join(1.0)
            last = self._lines[-1] if self._lines else "it printed nothing"
            raise ChildEndedError(f"{self.name} ended with exit code {code}: {last}")

    def end(self, signal_number: int = signal.SIGINT) -> int:
        """Send a signal to the process and wait until it has ended.

        If it has not ended END_TIMEOUT seconds after the signal, it is killed by SIGKILL. If it has
        ended before, only its exit code is returned.

        Args:
            signal_number: Signal that asks the process to end.

        Returns:
            Exit code of the process; −N if signal N ended it.
        """
        self.send(signal_number)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_TIMEOUT)
        if self.exit_code is None:
            self._process.kill()
        code = self._process.wait()
        self._reader.join(1.0)
        return code

    def _read(self) -> None:
        """Read the process's output until it is closed; runs in a separate thread.

        After each line and at the end, threads that wait in `wait_for` are woken.
        """
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.keep_line(line)
        with self._output_changed:
            self._output_changed.notify_all()

    def keep_line(self, line: str) -> None:
        """Add a line to the kept last lines, and wake threads that wait in `wait_for`.

        Args:
            line: Line of the process's output, with its line break.
        """
        with self._output_changed:
            self._lines.append(line.rstrip())
            self._output_changed.notify_all()
