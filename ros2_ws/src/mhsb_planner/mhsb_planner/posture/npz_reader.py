"""Safe reading of the arrays of an npz file from an untrusted source.

NumPy's own reader evaluates the header of an array as Python code and allocates as much memory as
its shape demands. The reader of this module accepts only headers in the exact form that NumPy
writes. It creates an array only if the file contains all its bytes.

Source: numpy.lib.format, versions 1.0 to 3.0.
"""

import lzma
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

NPY_MAGIC = b"\x93NUMPY"
"""First bytes of every npy file."""
LENGTH_FORMATS = {1: "<H", 2: "<I", 3: "<I"}
"""Format of the header's length for `struct`, by the major version of the npy format."""

LONGEST_HEADER = 1000
"""Largest accepted length of an array's header [B].

NumPy writes 118 B for an array of three dimensions."""

NPY_HEADER_PATTERN = re.compile(
    rb"\{'descr': '([<>|=][A-Za-z]\d{1,6})', 'fortran_order': (True|False), "
    rb"'shape': \(((?:\d{1,12},? ?){0,4})\), \} *\n"
)
"""Form of a header: dtype, storage order and a shape of up to four dimensions."""

DAMAGED_FILE_ERRORS = (
    KeyError,
    ValueError,
    EOFError,
    OverflowError,
    NotImplementedError,  # a compression that Python does not support
    RuntimeError,  # an encrypted member
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
)
"""Exceptions that are raised if a file is damaged or not an npz file.

OSError is not included, since it means that the file cannot be read."""


class ArchiveTooLargeError(Exception):
    """Error: a file would unpack to more bytes than allowed.

    Attributes:
        size: Unpacked size of all members [B].
    """

    def __init__(self, size: int) -> None:
        """Create the error; `size` is the unpacked size of all members [B]."""
        self.size = size
        super().__init__(f"{size} bytes")


def read_arrays(path: Path, kinds: Mapping[str, str], largest: int) -> dict[str, np.ndarray]:
    """Read arrays of an npz file from an untrusted source.

    Args:
        path: The file.
        kinds: Regular expression that the dtype must match, such as "<f8", by the name of each
            array to read.
        largest: Largest unpacked size of all members together [B].

    Returns:
        The arrays by name, each with its own memory.

    Raises:
        OSError: The file cannot be read.
        ArchiveTooLargeError: The file would unpack to more than `largest`.
        DAMAGED_FILE_ERRORS: The file is damaged, or an array is missing or of another dtype. One
            of these errors is raised.
    """
    with zipfile.ZipFile(path) as file:
        size = sum(part.file_size for part in file.infolist())
        if size > largest:
            raise ArchiveTooLargeError(size)
        return {name: _decode_array(file.read(f"{name}.npy"), kind) for name, kind in kinds.items()}


def _decode_array(content: bytes, kind: str) -> np.ndarray:
    """Decode the content of an npy file from an untrusted source.

    Args:
        content: All bytes of the file.
        kind: Regular expression that the dtype must match, such as "<f8".

    Returns:
        The array, with its own memory.

    Raises:
        ValueError: The header has another form than NumPy writes, the dtype does not match, or the
            number of bytes does not fit the shape.
    """
    if content[:6] != NPY_MAGIC or len(content) < 12 or content[6] not in LENGTH_FORMATS:
        raise ValueError("no npy file")
    form = LENGTH_FORMATS[content[6]]
    begin = 8 + struct.calcsize(form)
    (length,) = struct.unpack(form, content[8:begin])
    if length > LONGEST_HEADER:
        raise ValueError(f"a header of {length} bytes")
    header = NPY_HEADER_PATTERN.fullmatch(content[begin : begin + length])
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
