"""Child processes of the suite's commands: started, waited for, and ended cleanly."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections import deque
from contextlib import nullcontext
from pathlib import Path
from types import TracebackType

from mhsb_model.errors import MhsbError
from mhsb_model.process import signals_kept

END_TIMEOUT = 10.0
"""Time that a process is given to end by itself after SIGINT [s]."""

LAST_LINES = 20


class ChildEndedError(MhsbError):
    """A process that a command depends on could not do its work."""


class ChildProcess:
    """One of the suite's executables as a child process, for the length of a `with` block."""

    def __init__(
        self, package: str, executable: str, *arguments: str, log: Path | None = None
    ) -> None:
        """Start what `ros2 run` would start; the end of its output is kept, all of it in `log`."""
        self.name = executable
        self._log = log
        with signals_kept():
            self._process = subprocess.Popen(
                [sys.executable, "-u", "-m", f"{package}.executables", executable, *arguments],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                start_new_session=True,  # Ctrl-C is for the command, which then ends its children
            )
        self._lines: deque[str] = deque(maxlen=LAST_LINES)
        self._said = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> ChildProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.end()

    def wait_for(self, word: str, timeout: float) -> str:
        """What was printed from `word` on in its line; ChildEndedError where it is not, in time."""
        with self._said:
            found = self._said.wait_for(
                lambda: self.said(word) or self._process.poll() is not None, timeout
            )
        self.check()
        if not found:
            raise ChildEndedError(f"{self.name} did not say '{word}' within {timeout:g} s")
        line = next(line for line in list(self._lines) if word in line)
        return line[line.index(word) :]

    def said(self, word: str) -> bool:
        """Whether `word` is in one of the last lines that were printed."""
        return any(word in line for line in list(self._lines))

    @property
    def exit_code(self) -> int | None:
        """None as long as it runs."""
        return self._process.poll()

    def send(self, signal_number: int) -> None:
        """Send a signal, if it still runs."""
        if self.exit_code is None:
            self._process.send_signal(signal_number)

    def check(self) -> None:
        """Raise ChildEndedError, with its last line, where the process has ended."""
        code = self._process.poll()
        if code is not None:
            self._reader.join(1.0)
            last = self._lines[-1] if self._lines else "it printed nothing"
            raise ChildEndedError(f"{self.name} ended with exit code {code}: {last}")

    @property
    def resident_bytes(self) -> int:
        """Memory that it occupies; 0 when it has ended."""
        try:
            pages = Path(f"/proc/{self._process.pid}/statm").read_text(encoding="ascii").split()[1]
        except (OSError, IndexError):
            return 0
        return int(pages) * os.sysconf("SC_PAGE_SIZE")

    def end(self, signal_number: int = signal.SIGINT) -> int:
        """End the process by a signal, by force where that does not do; its exit code."""
        self.send(signal_number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(END_TIMEOUT)
        if self.exit_code is None:
            self._process.kill()
        code = self._process.wait()
        self._reader.join(1.0)
        return code

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._log.open("w", encoding="utf-8") if self._log else nullcontext() as log:
            for line in self._process.stdout:
                if log is not None:
                    log.write(line)
                    log.flush()
                with self._said:
                    self._lines.append(line.rstrip())
                    self._said.notify_all()
        with self._said:
            self._said.notify_all()
