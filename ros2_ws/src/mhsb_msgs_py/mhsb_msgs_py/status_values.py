"""The key/value pairs of a DiagnosticStatus, written and read by kind.

All values are strings: numbers as Python writes them (nothing is lost), times as seconds with
nine decimals.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from mhsb_model.verdict import Level
from mhsb_msgs_py import stamps
from mhsb_msgs_py.errors import MessageError


def status(
    name: str, level: Level, sentence: str, hardware_id: str, values: Mapping[str, str]
) -> DiagnosticStatus:
    """A status message with these values."""
    return DiagnosticStatus(
        level=bytes([level]),
        name=name,
        message=sentence,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )


class StatusValues:
    """The values of a status, read by key and kind; each call raises MessageError on failure."""

    def __init__(self, status: DiagnosticStatus) -> None:
        self._name = status.name
        self._texts: dict[str, str] = {}
        for item in status.values:
            if item.key in self._texts:
                raise MessageError(f"the value {item.key} of '{status.name}' is there twice")
            self._texts[item.key] = item.value

    def has(self, key: str) -> bool:
        """Whether a value is there, where it may be left out."""
        return key in self._texts

    def text(self, key: str) -> str:
        """A value as it is."""
        if key not in self._texts:
            raise MessageError(f"the value {key} of '{self._name}' is missing")
        return self._texts[key]

    def time(self, key: str) -> int:
        """A time [ns]."""
        return stamps.from_text(self.text(key))

    def number(self, key: str) -> float:
        """A number, NaN and infinity included."""
        return float(self._convert(key, float, "a number"))

    def finite(self, key: str) -> float:
        """A finite number."""
        number = self.number(key)
        if not math.isfinite(number):
            raise MessageError(
                f"the value {key} of '{self._name}' is '{self.text(key)}'; it must be finite"
            )
        return number

    def count(self, key: str) -> int:
        """A whole number."""
        return int(self._convert(key, int, "a whole number"))

    def counts(self, key: str) -> tuple[int, ...]:
        """Whole numbers with spaces in between, or none."""
        text = self.text(key)
        try:
            return tuple(int(word) for word in text.split())
        except ValueError:
            raise MessageError(
                f"the value {key} of '{self._name}' is '{text}'; it must be whole numbers"
            ) from None

    def _convert(self, key: str, kind: type[float] | type[int], meaning: str) -> float | int:
        try:
            return kind(self.text(key))
        except ValueError:
            raise MessageError(
                f"the value {key} of '{self._name}' is '{self.text(key)}'; it must be {meaning}"
            ) from None
