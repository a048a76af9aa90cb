"""A file of a recording, read at any place by bounded amounts of work.

A recording may come from a stranger: its files may be pipes, devices, loops of links or holes of a
terabyte, and their content may be made so that a search takes for ever. A file is opened without
waiting, must be a regular one, and can be read within a budget that is in proportion to its size.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from types import TracebackType
from typing import Self

from mhsb_sim.recording.bag_format import BagError

FREE_WORK = 1024**3
"""Bytes that may be read, and unpacked, of a file of any size; a second or two."""

READ_FACTOR, UNPACK_FACTOR = 20, 100
"""Beyond FREE_WORK, a file's size times this may be read, and unpacked.

A recording is read twice at most, and unpacks to a few times its size; only one that was made for
the purpose takes more. Larger factors let such a file take longer.
"""

COST_OF_A_MESSAGE = 256
"""Each message in a chunk counts as so many bytes more unpacked."""

COST_OF_A_READ = 64
"""Each read counts as so many bytes more, for the time that its call takes."""

WINDOW = 64 * 1024
"""Bytes that are read ahead for reads of less than SMALL_READ."""

SMALL_READ = 4096


class DataFile:
    """A regular file, open for reading; use it as a context manager.

    Raises BagError where it cannot be read, or where reading it takes more than the budget.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise BagError(f"{path} cannot be read: {error.strerror}; check it") from error
        status = os.fstat(self._descriptor)
        if not stat.S_ISREG(status.st_mode):
            os.close(self._descriptor)
            raise BagError(f"{path} cannot be read: it is no regular file; name a recording's own")
        self.size = status.st_size
        self._window, self._window_at = b"", 0
        self._read_left = FREE_WORK + READ_FACTOR * self.size
        self._unpack_left = FREE_WORK + UNPACK_FACTOR * self.size

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.close(self._descriptor)

    def read(self, at: int, length: int) -> bytes:
        """Return the bytes from a place on, fewer at the end of the file."""
        length = max(0, min(length, self.size - at))
        self._read_left -= length + COST_OF_A_READ
        if self._read_left < 0:
            raise self._too_much_work("search")
        if length > SMALL_READ:
            return self._pread(at, length)
        begin = at - self._window_at
        if begin < 0 or begin + length > len(self._window):
            self._window, self._window_at, begin = self._pread(at, WINDOW), at, 0
        return self._window[begin : begin + length]

    def _pread(self, at: int, length: int) -> bytes:
        """Return the bytes from a place on, as the operating system has them."""
        try:
            data = os.pread(self._descriptor, length, at)
            while 0 < len(data) < length:  # one call reads 2 GiB at most, or up to a signal
                more = os.pread(self._descriptor, length - len(data), at + len(data))
                if not more:
                    break
                data += more
        except OSError as error:
            raise BagError(f"{self.path} cannot be read: {error.strerror}; copy it") from error
        return data

    def count_unpacked(self, size: int) -> None:
        """Take what is unpacked from the budget [bytes]."""
        self._unpack_left -= size
        if self._unpack_left < 0:
            raise self._too_much_work("unpack")

    def next_data(self, at: int) -> int:
        """Return the first place from `at` on that is no hole of a sparse file."""
        try:
            return max(at, os.lseek(self._descriptor, at, os.SEEK_DATA))
        except OSError as error:
            return self.size if error.errno == errno.ENXIO else at  # some file systems do not know

    def _too_much_work(self, verb: str) -> BagError:
        return BagError(
            f"{self.path} takes too long to {verb}: more than {READ_FACTOR} times its size to "
            f"read, or {UNPACK_FACTOR} times unpacked; it is no recording that can be used"
        )
