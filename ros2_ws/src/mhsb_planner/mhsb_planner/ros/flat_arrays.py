"""Parameters whose value is a flat array of several rows, because ROS has no nested arrays."""

from collections.abc import Sequence
from typing import Any

from mhsb_planner.errors import RequestError

FARTHEST_POINT = 1e4
"""Largest absolute coordinate or radius of points and zones [m]."""


def split_rows(name: str, value: Any, size: int, meaning: str) -> tuple[tuple[float, ...], ...]:
    """Split the flat array of a parameter into rows of equal length.

    Args:
        name: Name of the parameter, for the error.
        value: Value of the parameter; None counts as an empty array.
        size: Length of a row.
        meaning: Meaning of the numbers in a row, for the error, such as "x z [m] of a point".

    Returns:
        One tuple of `size` floats for each row.

    Raises:
        RequestError: The value is not an array of numbers, or its length is not a multiple of
            `size`.
    """
    given = [] if value is None else value
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise RequestError(name, repr(given), f"must be an array of numbers, {meaning}")
    flat = list(given)
    if not all(type(number) in (int, float) for number in flat):
        raise RequestError(name, flat, f"must hold nothing but numbers, {meaning}")
    if len(flat) % size:
        raise RequestError(name, f"{len(flat)} numbers", f"takes {size} for each, {meaning}")
    return tuple(tuple(map(float, flat[i : i + size])) for i in range(0, len(flat), size))
