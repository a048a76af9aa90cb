"""Reading a data file of a recording at any position, with a bounded amount of work.

A recording may come from an untrusted source. Its files may be pipes, devices, link loops or sparse
files of a terabyte, and their content may be made so that a search never ends. A file is therefore
opened without blocking and must be a regular file. It can be read only within a budget in
proportion to its size.
"""

import errno
import os
import stat
from contextlib import AbstractContextManager
from pathlib import Path

from mhsb_tools.recording.bag_format import BagError

FREE_WORK = 1024**3
"""Bytes of a file of any size that may be read, and unpacked; this takes a second or two."""

READ_FACTOR, UNPACK_FACTOR = 20, 100
"""Multiples of a file's size that may be read, and unpacked, beyond FREE_WORK.

A recording is read twice at most and unpacks to a few times its size. Only a file that was made for
the purpose takes more. Larger factors let such a file take longer.
"""

COST_OF_A_MESSAGE = 256
"""Bytes by which each message in a chunk is charged to the budget for unpacking."""

COST_OF_A_READ = 64
"""Bytes by which each read is charged to the budget for reading, for the time of the call."""

READ_AHEAD_SIZE = 64 * 1024
"""Bytes that are read ahead if fewer are wanted."""


class DataFile(AbstractContextManager["DataFile"]):
    """Regular file, open for reading within budgets of bytes; use it as a context manager.

    One budget is for bytes read, FREE_WORK + READ_FACTOR · size. The other is for bytes unpacked,
    FREE_WORK + UNPACK_FACTOR · size.

    Attributes:
        path: The file.
        size: Its size when it was opened [bytes].
    """

    def __init__(self, path: Path) -> None:
        """Open a file and set its budgets for reading and unpacking.

        Args:
            path: The file; symbolic links are followed.

        Raises:
            BagError: The file cannot be opened or is not a regular file.
        """
        self.path = path
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise BagError(f"{path} cannot be read: {error.strerror}; check it") from error
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            os.close(descriptor)
            raise BagError(f"{path} cannot be read: it is no regular file; name a recording's own")
        self.size = status.st_size
        self._file = os.fdopen(descriptor, "rb", READ_AHEAD_SIZE)
        self._read_left = FREE_WORK + READ_FACTOR * self.size
        self._unpack_left = FREE_WORK + UNPACK_FACTOR * self.size

    def __exit__(self, *failure: object) -> None:
        """Close the file."""
        self._file.close()

    def read(self, at: int, length: int) -> bytes:
        """Read bytes at an offset, and charge them to the budget for reading.

        Each call is charged COST_OF_A_READ bytes more than it returns.

        Args:
            at: Offset of the first byte.
            length: Number of bytes.

        Returns:
            The bytes; fewer than `length` at the end of the file.

        Raises:
            BagError: The file cannot be read, or the budget for reading is used up.
        """
        length = max(0, min(length, self.size - at))
        self._read_left -= length + COST_OF_A_READ
        if self._read_left < 0:
            raise self._too_much_work("search")
        try:
            self._file.seek(at)
            return self._file.read(length)
        except OSError as error:
            raise BagError(f"{self.path} cannot be read: {error.strerror}; copy it") from error

    def count_unpacked(self, size: int) -> None:
        """Charge unpacked bytes to the budget for unpacking.

        Args:
            size: Number of bytes to charge. The caller also charges COST_OF_A_MESSAGE for each
                message.

        Raises:
            BagError: The budget for unpacking is used up.
        """
        self._unpack_left -= size
        if self._unpack_left < 0:
            raise self._too_much_work("unpack")

    def next_data(self, at: int) -> int:
        """Return the first offset, not before `at`, that is not in a hole of a sparse file.

        Args:
            at: Offset at which the search begins.

        Returns:
            The offset. It is the file's size if only holes follow, and `at` if the file system does
            not tell where holes are.
        """
        try:
            return max(at, self._file.seek(at, os.SEEK_DATA))
        except OSError as error:
            return self.size if error.errno == errno.ENXIO else at  # some file systems cannot tell

    def _too_much_work(self, verb: str) -> BagError:
        """Return the error that a budget is used up.

        Args:
            verb: Word in the message for what took too long, `search` or `unpack`.
        """
        return BagError(
            f"{self.path} takes too long to {verb}: more than {READ_FACTOR} times its size to "
            f"read, or {UNPACK_FACTOR} times unpacked; it is no recording that can be used"
        )
