"""Hints for values that were probably given in another unit, such as degrees for radians."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

OTHER_UNITS = {
    "rad": (("degrees", math.pi / 180.0),),
    "m": (("mm", 1e-3),),
    "m/s": (("mm/s", 1e-3),),
    "Pa": (("bar", 1e5), ("MPa", 1e6)),
}
"""Units that are mistaken for an SI unit, by that unit, each with its factor to SI."""


def suggest_unit(
    values: Sequence[float], unit: str, is_admissible: Callable[[Sequence[float]], bool]
) -> str:
    """Ask whether values that are out of range were meant in another unit.

    Args:
        values: The values, one or several, in the SI unit.
        unit: The SI unit.
        is_admissible: Whether values in the SI unit are within their range.

    Returns:
        Clause to append to a sentence, such as `; in degrees? 17 degrees are 0.2967 rad`. Empty if
        no other unit brings the values into their range.
    """
    fitting = {
        name: converted
        for name, factor in OTHER_UNITS.get(unit, ())
        if is_admissible(converted := [factor * value for value in values])
    }
    if not fitting:
        return ""
    meanings = (
        f"{_format_values(values)} {name} are {_format_values(converted)} {unit}"
        for name, converted in fitting.items()
    )
    return f"; in {' or '.join(fitting)}? {', '.join(meanings)}"


def suggest_unit_of_number(value: float, unit: str, low: float, high: float) -> str:
    """Return the clause of `suggest_unit` for one number that must be from `low` to `high`."""
    return suggest_unit([value], unit, lambda values: low <= values[0] <= high)


def _format_values(values: Sequence[float]) -> str:
    """Return one value, or several in parentheses, with four significant digits."""
    words = ", ".join(f"{value:.4g}" for value in values)
    return words if len(values) == 1 else f"({words})"
