"""What decoding checks in every message with named joints; each check says what is wrong."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from mhsb_model.types import FloatArray, IntArray
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.point_arrays import Rows


def joint_order(what: str, given: Sequence[str], expected: Sequence[str]) -> IntArray:
    """Where each expected name stands among the given ones, int64[len(expected)]."""
    if list(given) == list(expected):
        return np.arange(len(expected))
    times = Counter(given)
    duplicate = sorted(name for name, count in times.items() if count > 1)
    unknown = [name for name in times if name not in expected]
    missing = [name for name in expected if name not in given]
    for fault, faulty in (("given twice", duplicate), ("unknown", unknown), ("missing", missing)):
        if faulty:
            raise MessageError(
                f"{what}: {', '.join(faulty)} {fault}; "
                f"give each of {', '.join(expected)} once, in any order"
            )
    return np.array([list(given).index(name) for name in expected], dtype=np.int64)


def values(what: str, given: Sequence[float], order: IntArray) -> FloatArray:
    """Finite values, one for each name, in the expected order, float64[names]."""
    return _table([given], order, lambda _: what)[0]


def point_table(field: str, rows: Rows, order: IntArray) -> FloatArray:
    """An array of all points, as `values` each, float64[points, names]."""
    return _table(rows, order, lambda index: f"{field} of point {index}")


def empty(what: str, given: Sequence[float]) -> None:
    """An array that has no meaning here must be left out."""
    if len(given) != 0:
        raise MessageError(f"{what} has {len(given)} values; leave it empty")


def empty_rows(field: str, rows: Rows) -> None:
    """An array that has no meaning here must be left out in all points."""
    index, length = _first_of_other_length(rows, 0)
    if index >= 0:
        raise MessageError(f"{field} of point {index} has {length} values; leave it empty")


def point_times(
    what: str, times_ns: Sequence[int] | IntArray, *, apart_ns: int | None = None
) -> IntArray:
    """Times of points: at least one, the first 0, strictly increasing, int64[points] ns.

    Where `apart_ns` is given, neighbours may be at most that far apart.
    """
    if len(times_ns) == 0:
        raise MessageError(f"{what} has no points; give at least one")
    times = np.asarray(times_ns, dtype=np.int64)
    if times[0] != 0:
        raise MessageError(
            f"{what} starts {times[0] / 1e9:g} s after its stamp; the first point must be at 0"
        )
    gaps = np.diff(times)
    if np.any(gaps <= 0):
        point = int(np.argmax(gaps <= 0)) + 1
        raise MessageError(
            f"{what} point {point} at {times[point] / 1e9:g} s does not come after "
            f"point {point - 1} at {times[point - 1] / 1e9:g} s; times must increase"
        )
    if apart_ns is not None and np.any(gaps > apart_ns):
        point = int(np.argmax(gaps > apart_ns)) + 1
        raise MessageError(
            f"{what} point {point} comes {gaps[point - 1] / 1e6:g} ms after the one before; "
            f"give points at most {apart_ns / 1e6:g} ms apart"
        )
    return times


def _table(rows: Rows, order: IntArray, what: Callable[[int], str]) -> FloatArray:
    """Finite values, a row for each; `what(row)` is what a row is called in errors."""
    index, length = _first_of_other_length(rows, len(order))
    if index >= 0:
        raise MessageError(
            f"{what(index)} has {length} values; give one for each of {len(order)} names"
        )
    numbers = np.array(rows, dtype=np.float64)[:, order]
    if not np.all(np.isfinite(numbers)):
        index, column = np.argwhere(~np.isfinite(numbers))[0]
        raise MessageError(
            f"{what(int(index))} has {numbers[index, column]} for name {column + 1}; "
            "give finite numbers"
        )
    return numbers


def _first_of_other_length(rows: Rows, length: int) -> tuple[int, int]:
    """Index and length of the first row that has another length, or -1 for both."""
    if isinstance(rows, np.ndarray):
        return (-1, -1) if rows.shape[1] == length else (0, rows.shape[1])
    return next(((i, len(row)) for i, row in enumerate(rows) if len(row) != length), (-1, -1))
