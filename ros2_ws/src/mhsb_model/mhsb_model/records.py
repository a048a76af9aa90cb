"""Structured arrays for kernels, with fields that a class declares.

NumPy and numba get the dtype from the class, and mypy checks every field that a kernel reads or
writes. A misspelt field is an error before anything is compiled.

    class Spool(Record):
        position: float  # −1 … 1

    spools = create_records(Spool, 3)  # Records[Spool], all fields 0
    spools["position"] = 0.5           # Python: the field of all records, float64[3]
    spools[0].position                 # kernels: a field of one record
"""

from __future__ import annotations

from typing import Any, Protocol, SupportsIndex, TypeAlias, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

Int32: TypeAlias = int
"""Type of an integer field that is stored in 32 bits."""

FIELD_TYPES = {"float": np.float64, "int": np.int64, "Int32": np.int32}
"""Type in which a field is stored, by the text of its annotation."""


class Record:
    """One record of a structured array, with its fields as annotations; it has no instances.

    The module of a subclass must import `annotations` from `__future__`.
    """


RecordType = TypeVar("RecordType", bound=Record)


class Records(Protocol[RecordType]):
    """Structured array of records of one class: an `np.ndarray` with its `record_dtype`."""

    @property
    def dtype(self) -> np.dtype:
        """Structured dtype of the records."""
        ...

    @overload
    def __getitem__(self, key: SupportsIndex, /) -> RecordType: ...
    @overload
    def __getitem__(self, key: slice, /) -> Records[RecordType]: ...
    @overload
    def __getitem__(self, key: str, /) -> NDArray[Any]: ...
    def __setitem__(self, key: Any, value: Any, /) -> None: ...
    def __len__(self) -> int: ...
    def copy(self) -> Records[RecordType]:
        """Return a copy with its own memory."""
        ...


def record_dtype(kind: type[Record]) -> np.dtype[np.void]:
    """Return the dtype of a class of records: its fields in order, without gaps.

    Args:
        kind: Class whose annotations are the fields, each `float`, `int` or `Int32`.

    Returns:
        Structured dtype.
    """
    return np.dtype([(name, FIELD_TYPES[text]) for name, text in kind.__annotations__.items()])


def create_records(kind: type[RecordType], count: int) -> Records[RecordType]:
    """Create records whose fields are all 0.

    Args:
        kind: Class of the records.
        count: Number of records.

    Returns:
        Array of the dtype `record_dtype(kind)`, of shape (count,).
    """
    records: Any = np.zeros(count, record_dtype(kind))
    return records
