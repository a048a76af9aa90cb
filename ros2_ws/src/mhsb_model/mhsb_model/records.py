"""Structured arrays for kernels, with fields that a class declares.

NumPy and numba get the dtype from the class, and mypy checks every field that a kernel reads or
writes. A misspelt field is an error before anything is compiled.

    class Spool(Record):
        position: float  # −1 … 1

    spools = create_records(Spool, 3)  # Records[Spool], all fields 0
    spools["position"] = 0.5           # Python: the field of all records, float64[3]
    spools[0].position                 # kernels: a field of one record

Settings are frozen dataclasses that are also records. Their instances are created in Python, and
kernels read a copy:

    @dataclass(frozen=True)
    class FilterSettings(Record):
        gain: float = 0.1

    settings = create_record(FilterSettings(gain=0.2))  # Records[FilterSettings], one record
"""

from dataclasses import astuple
from typing import Annotated, Any, Protocol, SupportsIndex, TypeVar, get_type_hints, overload

import numpy as np
from numpy.typing import NDArray

Int32 = Annotated[int, np.int32]
"""Type of an integer field that is stored in 32 bits."""

FIELD_TYPES: dict[Any, Any] = {float: np.float64, int: np.int64, Int32: np.int32}
"""Type in which a field is stored, by its annotation."""


class Record:
    """One record of a structured array, with its fields as annotations.

    A field may be a record itself. Only settings have instances, which `create_record` turns into
    arrays.
    """


RecordType = TypeVar("RecordType", bound=Record)


class Records(Protocol[RecordType]):
    """Structured array of records of one class: an `np.ndarray` with its `record_dtype`."""

    @property
    def dtype(self) -> np.dtype:
        """Structured dtype of the records."""

    @overload
    def __getitem__(self, key: SupportsIndex, /) -> RecordType: ...
    @overload
    def __getitem__(self, key: slice, /) -> "Records[RecordType]": ...
    @overload
    def __getitem__(self, key: str, /) -> NDArray[Any]: ...
    def __setitem__(self, key: Any, value: Any, /) -> None: ...
    def __len__(self) -> int: ...
    def copy(self) -> "Records[RecordType]":
        """Return a copy with its own memory."""


def record_dtype(kind: type[Record]) -> np.dtype[np.void]:
    """Return the structured dtype of a class of records: its fields in order, without gaps.

    Args:
        kind: Subclass of `Record` whose annotations are the fields. Each is `float`, `int`, `Int32`
            or another subclass of `Record`, which becomes a nested dtype.

    Returns:
        Structured dtype with the class's field names.
    """
    hints = get_type_hints(kind, include_extras=True)
    return np.dtype(
        [(name, FIELD_TYPES.get(hint) or record_dtype(hint)) for name, hint in hints.items()]
    )


def create_records(kind: type[RecordType], count: int) -> Records[RecordType]:
    """Create a structured array of records whose fields are all 0.

    Args:
        kind: Subclass of `Record` that declares the fields.
        count: Number of records.

    Returns:
        Array of the dtype `record_dtype(kind)`, of shape (count,).
    """
    records: Any = np.zeros(count, record_dtype(kind))
    return records


def create_record(values: RecordType) -> Records[RecordType]:
    """Copy an instance of a settings class into a structured array, which kernels can read.

    Args:
        values: Instance of a dataclass that is a subclass of `Record`.

    Returns:
        Array of the dtype `record_dtype(type(values))`, of shape (1,).
    """
    records: Any = create_records(type(values), 1)
    instance: Any = values
    records[0] = astuple(instance)
    return records
