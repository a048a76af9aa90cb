"""Base class and common types of all errors that a user can cause, and hints on units."""

import difflib
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

MAX_LISTED_PROBLEMS = 30
"""Largest number of problems that one error message lists."""


class MhsbError(Exception):
    """Base of all errors of the suite; its text is one sentence for the user."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle class, sentence and attributes, so that unpickling does not call `__init__`."""
        return type(self).__new__, (type(self), *self.args), self.__dict__


def suggest_name(name: str, known_names: Iterable[str]) -> str:
    """Return "; did you mean NAME?" with the most similar known name; empty if none is similar.

    The dashes of options are ignored, since they would make all short options similar.

    Args:
        name: Name that is not known.
        known_names: All names that are known.
    """
    bare = {known.lstrip("-"): known for known in sorted(known_names)}
    near = difflib.get_close_matches(name.lstrip("-"), bare, 1)
    return f"; did you mean {bare[near[0]]}?" if near else ""


class ArgumentError(MhsbError):
    """A request makes no sense.

    A value is out of its range, a name does not exist, or options contradict each other.
    """


class MachineFileError(MhsbError):
    """A machine file cannot be used.

    Attributes:
        kind: Kind of file, such as "machine file"; the message begins with it.
        source: Name of the file.
        problems: All problems, each as `path: sentence`. The error message lists the first
            `MAX_LISTED_PROBLEMS`.
    """

    kind = "machine file"

    def __init__(self, source: str, problems: Sequence[str]) -> None:
        """Make the message from the file and its problems.

        Args:
            source: Name of the file.
            problems: All problems, each as `path: sentence` with the path of the value in the file,
                such as `joints.0.link.mass`. All are stored in the attribute `problems`. The
                message lists the first `MAX_LISTED_PROBLEMS` and the number of the others.
        """
        self.source = source
        self.problems = tuple(problems)
        super().__init__(f"{self.kind} {source}: " + "; ".join(self._list_problems()))

    def format_lines(self) -> list[str]:
        """Format the message as lines of text.

        Returns:
            For one problem, the whole message in one line. Otherwise a title with the file's kind
            and name, and an indented line for each problem. After MAX_LISTED_PROBLEMS problems, a
            last line gives the number of the others.
        """
        listed = self._list_problems()
        if len(listed) == 1:
            return [str(self)]
        return [f"{self.kind} {self.source}:", *(f"  {problem}" for problem in listed)]

    def _list_problems(self) -> list[str]:
        """Return the first `MAX_LISTED_PROBLEMS` problems; if there are more, also their number."""
        listed = list(self.problems[:MAX_LISTED_PROBLEMS])
        if len(self.problems) > MAX_LISTED_PROBLEMS:
            listed.append(f"and {len(self.problems) - MAX_LISTED_PROBLEMS} more")
        return listed


class OutOfWorkspaceError(MhsbError):
    """A tip position lies outside the region in which the arm may be asked to work.

    Attributes:
        limit: Sentence that says which limit is violated.
    """

    def __init__(self, position: Sequence[float], limit: str) -> None:
        """Make the message from the position and the violated limit.

        Args:
            position: Tip position in `base_link` [m].
            limit: Sentence that says which limit is violated; it is also stored in the attribute
                `limit`.
        """
        self.limit = limit
        place = ", ".join(f"{value:.4g}" for value in position)
        super().__init__(f"the tip position ({place}) m is outside the workspace: {limit}")


# --- Values in another unit ---------------------------------------------------------------------


OTHER_UNITS = {
    "rad": (("degrees", math.pi / 180.0),),
    "m": (("cm", 1e-2), ("mm", 1e-3)),
    "m/s": (("mm/s", 1e-3),),
    "Pa": (("bar", 1e5), ("MPa", 1e6)),
    "m³/s": (("L/min", 1e-3 / 60.0),),
    "s": (("ms", 1e-3),),
    "-": (("%", 1e-2),),
}
"""For each SI unit: other units that users may mean, each with its factor to the SI unit.

The unit "-" stands for a share."""


def suggest_unit(
    values: Sequence[float], unit: str, is_admissible: Callable[[Sequence[float]], bool]
) -> str:
    """Suggest another unit for values that are out of range, such as degrees instead of radians.

    Each unit of OTHER_UNITS is tried. It is suggested if the values are admissible when read in
    this unit.

    Args:
        values: One or several values as the user gave them, taken to be in `unit`.
        unit: SI unit that was expected, such as "rad"; "-" for a share. An unknown unit gives no
            suggestion.
        is_admissible: Function that says whether values in the SI unit are within their range.

    Returns:
        Clause to append to a sentence, such as `; in degrees? 17 degrees are 0.2967 rad`. It names
        all units that make the values admissible, and is empty if none does.
    """
    fitting = {
        name: converted
        for name, factor in OTHER_UNITS.get(unit, ())
        if is_admissible(converted := [factor * value for value in values])
    }
    if not fitting:
        return ""
    meanings = (
        f"{_format_values(values)} {name} are {_format_values(converted)} {unit}".removesuffix(" -")
        for name, converted in fitting.items()
    )
    return f"; in {' or '.join(fitting)}? {', '.join(meanings)}"


def suggest_unit_of_number(value: float, unit: str, low: float, high: float) -> str:
    """Suggest another unit for a number that is out of range, such as degrees instead of radians.

    Args:
        value: Number as the user gave it, taken to be in `unit`.
        unit: SI unit that was expected, such as "rad".
        low: Smallest admissible number in the SI unit.
        high: Largest admissible number in the SI unit.

    Returns:
        Clause to append to a sentence, such as `; in degrees? 17 degrees are 0.2967 rad`. Empty if
        no other unit brings the number into its range.
    """
    return suggest_unit([value], unit, lambda values: low <= values[0] <= high)


def _format_values(values: Sequence[float]) -> str:
    """Format numbers with four significant digits; several numbers stand in parentheses."""
    words = ", ".join(f"{value:.4g}" for value in values)
    return words if len(values) == 1 else f"({words})"
