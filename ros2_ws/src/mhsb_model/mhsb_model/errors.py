"""One failure language: every error that a user can cause derives from `MhsbError`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

MOST_PROBLEMS = 30
"""That one sentence lists."""


class MhsbError(Exception):
    """Base of all errors of the suite; its text is one sentence for the user."""

    def __reduce__(self) -> tuple[Callable[..., MhsbError], tuple[Any, ...]]:
        """Another process gets sentence and data, whatever an error is made of."""
        return _restored, (type(self), self.args, self.__dict__)


def _restored(
    kind: type[MhsbError], args: tuple[object, ...], data: Mapping[str, object]
) -> MhsbError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(data)
    return error


class ArgumentError(MhsbError):
    """What was asked for makes no sense: a value out of its range, a name that is not there,
    options that do not go together."""


class MachineFileError(MhsbError):
    """A machine file cannot be used; `problems` lists everything that is wrong, by path."""

    def __init__(self, source: str, problems: Sequence[str]) -> None:
        self.source = source
        self.problems = tuple(problems)
        told = list(self.problems[:MOST_PROBLEMS])
        if len(self.problems) > MOST_PROBLEMS:
            told.append(f"and {len(self.problems) - MOST_PROBLEMS} more")
        super().__init__(f"machine file {source}: " + "; ".join(told))


class OutOfWorkspaceError(MhsbError):
    """A tip position lies outside the region in which the arm may be asked to work."""

    def __init__(self, position: Sequence[float], limit: str) -> None:
        self.position = tuple(position)
        self.limit = limit
        place = ", ".join(f"{value:.4g}" for value in self.position)
        super().__init__(f"the tip position ({place}) m is outside the workspace: {limit}")
