"""Base class and common types of all errors that a user can cause."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

MAX_LISTED_PROBLEMS = 30
"""Largest number of problems that one error message lists."""


class MhsbError(Exception):
    """Base of all errors of the suite; its text is one sentence for the user."""

    def __reduce__(self) -> tuple[Callable[..., MhsbError], tuple[Any, ...]]:
        """Pickle class, sentence and attributes, whatever arguments `__init__` takes."""
        return _restored, (type(self), self.args, self.__dict__)


def _restored(
    kind: type[MhsbError], args: tuple[object, ...], data: Mapping[str, object]
) -> MhsbError:
    """Make an error again from the values that `MhsbError.__reduce__` pickles.

    `__init__` is not called.

    Args:
        kind: Class of the error.
        args: `args` of the exception, the sentence first.
        data: All other attributes by name.

    Returns:
        The error.
    """
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(data)
    return error


class ArgumentError(MhsbError):
    """A request makes no sense.

    A value is out of its range, a name does not exist, or options contradict each other.
    """


class MachineFileError(MhsbError):
    """A machine file cannot be used.

    Attributes:
        source: Name of the file.
        problems: Everything that is wrong, each as `path: sentence`. The error message lists the
            first `MAX_LISTED_PROBLEMS`.
    """

    def __init__(self, source: str, problems: Sequence[str]) -> None:
        """Make the message from the file and its problems.

        Args:
            source: Name of the file.
            problems: Everything that is wrong, each as `path: sentence`. All are kept in the
                attribute. The message lists the first `MAX_LISTED_PROBLEMS` and the number of the
                others.
        """
        self.source = source
        self.problems = tuple(problems)
        listed = list(self.problems[:MAX_LISTED_PROBLEMS])
        if len(self.problems) > MAX_LISTED_PROBLEMS:
            listed.append(f"and {len(self.problems) - MAX_LISTED_PROBLEMS} more")
        super().__init__(f"machine file {source}: " + "; ".join(listed))


class OutOfWorkspaceError(MhsbError):
    """A tip position lies outside the region in which the arm may be asked to work.

    Attributes:
        position: The position in `base_link` [m].
        limit: Sentence that says which limit is violated.
    """

    def __init__(self, position: Sequence[float], limit: str) -> None:
        """Make the message from the position and the violated limit.

        Args:
            position: Tip position in `base_link` [m].
            limit: Sentence that says which limit is violated.
        """
        self.position = tuple(position)
        self.limit = limit
        place = ", ".join(f"{value:.4g}" for value in self.position)
        super().__init__(f"the tip position ({place}) m is outside the workspace: {limit}")
