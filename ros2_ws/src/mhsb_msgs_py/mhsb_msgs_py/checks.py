"""Checks of messages with named joints, which decoders call; each error names the problem."""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from mhsb_model.types import FloatArray, IntArray
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.point_arrays import Rows


def find_joint_order(what: str, given: Sequence[str], expected: Sequence[str]) -> IntArray:
    """Find the index of each expected name among the given names.

    Args:
        what: Name of the message or list for the error, such as "joint states".
        given: Names in the message.
        expected: Names that must each be given once, in any order.

    Returns:
        Index into `given` for each expected name, int64[len(expected)].

    Raises:
        MessageError: Names are given twice, unknown or missing. The error states the first of these
            three problems that exists, and lists all names with this problem.
    """
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


def check_values(what: str, given: Sequence[float], order: IntArray) -> FloatArray:
    """Check that an array has one finite value for each name, and reorder the values.

    Args:
        what: Name of the array for the error, such as "position".
        given: One value for each name of the message, in the order of the message.
        order: Index into `given` of each expected name, from `find_joint_order`.

    Returns:
        Values in the order of the expected names, float64[len(order)].

    Raises:
        MessageError: The number of values is wrong, or a value is not finite.
    """
    return _reorder_rows([given], order, lambda _: what)[0]


def check_point_table(field: str, rows: Rows, order: IntArray) -> FloatArray:
    """Check that each point has one finite value for each name, and reorder the values.

    Args:
        field: Name of the array for the error, such as "positions".
        rows: Values of each point in the order of the message: a 2-D array, or one sequence for
            each point.
        order: Index into a row of each expected name, from `find_joint_order`.

    Returns:
        Values in the order of the expected names, float64[points, len(order)].

    Raises:
        MessageError: The number of values of a point is wrong, or a value is not finite.
    """
    return _reorder_rows(rows, order, lambda index: f"{field} of point {index}")


def check_empty(what: str, given: Sequence[float]) -> None:
    """Raise MessageError if an array that must be empty has values.

    Args:
        what: Name of the array, for the error.
        given: Values of the array.
    """
    if len(given) != 0:
        raise MessageError(f"{what} has {len(given)} values; leave it empty")


def check_empty_rows(field: str, rows: Rows) -> None:
    """Raise MessageError if any point has values in an array that must be empty.

    The error names the first such point and the number of its values.

    Args:
        field: Name of the array, for the error.
        rows: Values of each point: a 2-D array, or one sequence for each point.
    """
    index, length = _find_row_of_other_length(rows, 0)
    if index >= 0:
        raise MessageError(f"{field} of point {index} has {length} values; leave it empty")


def check_point_times(
    what: str, times_ns: Sequence[int] | IntArray, *, max_spacing_ns: int | None = None
) -> IntArray:
    """Check that there is at least one point time, and that times begin at 0 and increase strictly.

    Args:
        what: Name of the message for the error, such as "the trajectory".
        times_ns: Times after the stamp [ns].
        max_spacing_ns: Largest time between neighbours [ns]; None for no limit.

    Returns:
        The times, int64[points], [ns].

    Raises:
        MessageError: There is no point, the first time is not 0, times do not increase strictly, or
            two neighbours are farther apart than `max_spacing_ns`.
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
    if max_spacing_ns is not None and np.any(gaps > max_spacing_ns):
        point = int(np.argmax(gaps > max_spacing_ns)) + 1
        raise MessageError(
            f"{what} point {point} comes {gaps[point - 1] / 1e6:g} ms after the one before; "
            f"give points at most {max_spacing_ns / 1e6:g} ms apart"
        )
    return times


def _reorder_rows(rows: Rows, order: IntArray, name_of_row: Callable[[int], str]) -> FloatArray:
    """Check that each row has one finite value for each name, and reorder the values.

    Args:
        rows: Values: a 2-D array, or one sequence for each row.
        order: Index into a row for each column of the result.
        name_of_row: Function that returns the name of a row for errors, from the row's index.

    Returns:
        Values, float64[rows, len(order)].

    Raises:
        MessageError: A row has another length than `order`, or a value is not finite.
    """
    index, length = _find_row_of_other_length(rows, len(order))
    if index >= 0:
        raise MessageError(
            f"{name_of_row(index)} has {length} values; give one for each of {len(order)} names"
        )
    numbers = np.array(rows, dtype=np.float64)[:, order]
    if not np.all(np.isfinite(numbers)):
        index, column = np.argwhere(~np.isfinite(numbers))[0]
        raise MessageError(
            f"{name_of_row(int(index))} has {numbers[index, column]} for name {column + 1}; "
            "give finite numbers"
        )
    return numbers


def _find_row_of_other_length(rows: Rows, length: int) -> tuple[int, int]:
    """Find the first row whose length is not the expected one.

    Args:
        rows: A 2-D array, or one sequence for each row.
        length: Expected length.

    Returns:
        Index and length of the row; -1 and -1 if all rows have the expected length.
    """
    if isinstance(rows, np.ndarray):
        return (-1, -1) if rows.shape[1] == length else (0, rows.shape[1])
    return next(((i, len(row)) for i, row in enumerate(rows) if len(row) != length), (-1, -1))
