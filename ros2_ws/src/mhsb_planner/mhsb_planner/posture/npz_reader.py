"""Read the arrays of an npz file that may come from a stranger.

NumPy's own reader evaluates an array's header as Python and allocates what its shape asks for.
Here a header is matched against the one form in which NumPy writes it, and an array is made only
of bytes that are there.

Source: numpy.lib.format, versions 1.0 to 3.0.
"""

from __future__ import annotations

import lzma
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

MAGIC = b"\x93NUMPY"
LENGTH_FORMATS = {1: "<H", 2: "<I", 3: "<I"}
"""How the length of a header is written, by the format's major version."""

LONGEST_HEADER = 1000
"""Bytes of an array's header; NumPy writes 118 for an array of three dimensions."""

HEADER = re.compile(
    rb"\{'descr': '([<>|=][A-Za-z]\d{1,6})', 'fortran_order': (True|False), "
    rb"'shape': \(((?:\d{1,12},? ?){0,4})\), \} *\n"
)

UNREADABLE = (
    KeyError,
    ValueError,
    EOFError,
    OverflowError,
    NotImplementedError,  # a compression that Python does not have
    RuntimeError,  # a member that is encrypted
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
)
"""What is raised for files that are damaged or no npz file; OSError is of the file system."""


class ArchiveTooLargeError(Exception):
    """The arrays of a file are larger than the reader is allowed to unpack; `size` [B]."""

    def __init__(self, size: int) -> None:
        self.size = size
        super().__init__(f"{size} bytes")


def read_arrays(path: Path, kinds: Mapping[str, str], largest: int) -> dict[str, np.ndarray]:
    """Return arrays of an npz file by their names.

    Args:
        path: The file.
        kinds: Name of each array, and a regular expression that its dtype's name must match, as
            in "<f8".
        largest: Bytes that all members of the file may have together, unpacked.

    Returns:
        The arrays, which share memory with nothing else.

    Raises:
        OSError: The file cannot be read.
        ArchiveTooLargeError: It would unpack to more than `largest`.
        UNREADABLE: It is damaged, or an array is missing or of another kind.
    """
    with zipfile.ZipFile(path) as file:
        size = sum(part.file_size for part in file.infolist())
        if size > largest:
            raise ArchiveTooLargeError(size)
        return {name: _array(file.read(f"{name}.npy"), kind) for name, kind in kinds.items()}


def _array(content: bytes, kind: str) -> np.ndarray:
    """Return the array of an npy file's content; ValueError if it is not one of this kind."""
    if content[:6] != MAGIC or len(content) < 12 or content[6] not in LENGTH_FORMATS:
        raise ValueError("no npy file")
    form = LENGTH_FORMATS[content[6]]
    begin = 8 + struct.calcsize(form)
    (length,) = struct.unpack(form, content[8:begin])
    if length > LONGEST_HEADER:
        raise ValueError(f"a header of {length} bytes")
    header = HEADER.fullmatch(content[begin : begin + length])
    if header is None or not re.fullmatch(kind, header[1].decode("ascii")):
        raise ValueError("a header that NumPy does not write for such an array")
    dtype = np.dtype(header[1].decode("ascii"))
    shape = tuple(map(int, header[3].replace(b",", b" ").split()))
    count = 1
    for dimension in shape:
        count *= dimension
    if count * dtype.itemsize != len(content) - begin - length:
        raise ValueError(f"bytes for another shape than {shape}")
    values = np.frombuffer(content, dtype, count, begin + length)
    return values.reshape(shape, order="F" if header[2] == b"True" else "C").copy()
