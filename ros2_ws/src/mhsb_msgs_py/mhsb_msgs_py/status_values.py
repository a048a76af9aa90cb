"""Key/value pairs of a DiagnosticStatus, written and read by type.

All values are strings: numbers as Python writes them, without loss, and times as seconds with nine
decimals.
"""

import math
from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import TypeVar

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from mhsb_model.verdict import Level
from mhsb_msgs_py import stamps
from mhsb_msgs_py.errors import MessageError

Value = TypeVar("Value")
Choice = TypeVar("Choice", bound=StrEnum)


def make_status(
    name: str, level: Level, sentence: str, hardware_id: str, values: Mapping[str, str]
) -> DiagnosticStatus:
    """Make a status message of /diagnostics from its parts.

    Args:
        name: Name of the status.
        level: Level of the status.
        sentence: Text of the status.
        hardware_id: Sender of the status.
        values: Texts of the values by key.

    Returns:
        The message.
    """
    return DiagnosticStatus(
        level=bytes([level]),
        name=name,
        message=sentence,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )


class StatusValues:
    """Values of a status, read by key and type; each method raises MessageError on failure."""

    def __init__(self, status: DiagnosticStatus) -> None:
        """Index the values by key.

        Args:
            status: The status.

        Raises:
            MessageError: A key exists twice.
        """
        self._name = status.name
        self._texts: dict[str, str] = {}
        for item in status.values:
            if item.key in self._texts:
                raise MessageError(f"the value {item.key} of '{status.name}' is there twice")
            self._texts[item.key] = item.value

    def has(self, key: str) -> bool:
        """Return whether the status has a value with this key."""
        return key in self._texts

    def text(self, key: str) -> str:
        """Return a value as text.

        Args:
            key: Key of the value.

        Returns:
            The text as it was sent.

        Raises:
            MessageError: The status has no value with this key.
        """
        if key not in self._texts:
            raise MessageError(f"the value {key} of '{self._name}' is missing")
        return self._texts[key]

    def time(self, key: str) -> int:
        """Return a value as time [ns].

        Raises:
            MessageError: The value is missing or no time.
        """
        return stamps.from_text(self.text(key))

    def number(self, key: str) -> float:
        """Return a value as number, which may be NaN or infinite.

        Raises:
            MessageError: The value is missing or no number.
        """
        return self._convert(key, float, "a number")

    def finite(self, key: str) -> float:
        """Return a value as a finite number.

        Args:
            key: Key of the value.

        Returns:
            The number.

        Raises:
            MessageError: The value is missing, no number, NaN or infinite.
        """
        number = self.number(key)
        if not math.isfinite(number):
            raise MessageError(
                f"the value {key} of '{self._name}' is '{self.text(key)}'; it must be finite"
            )
        return number

    def count(self, key: str) -> int:
        """Return a value as integer.

        Raises:
            MessageError: The value is missing or no whole number.
        """
        return self._convert(key, int, "a whole number")

    def counts(self, key: str) -> tuple[int, ...]:
        """Return a value as integers.

        Args:
            key: Key of the value. Its text has the integers with spaces in between.

        Returns:
            The integers; an empty tuple for an empty text.

        Raises:
            MessageError: The value is missing, or a part of it is no whole number.
        """
        return self._convert(
            key, lambda text: tuple(int(word) for word in text.split()), "whole numbers"
        )

    def choice(self, key: str, choices: type[Choice]) -> Choice:
        """Return a value as a member of an enumeration.

        Args:
            key: Key of the value. The text is the value of a member.
            choices: The enumeration.

        Returns:
            The member.

        Raises:
            MessageError: The value is missing or no member; the error lists all members.
        """
        members = ", ".join(repr(str(choice)) for choice in choices)
        return self._convert(key, choices, f"one of {members}")

    def _convert(self, key: str, convert: Callable[[str], Value], meaning: str) -> Value:
        """Convert a value from its text.

        Args:
            key: Key of the value.
            convert: Function that converts the text; it raises ValueError if it cannot.
            meaning: Words for what the text must be, such as "a whole number".

        Returns:
            The converted value.

        Raises:
            MessageError: The value is missing or cannot be converted.
        """
        try:
            return convert(self.text(key))
        except ValueError:
            raise MessageError(
                f"the value {key} of '{self._name}' is '{self.text(key)}'; it must be {meaning}"
            ) from None
