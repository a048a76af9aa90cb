"""How a promise was kept: how often it was put to the test, and each time that it was broken."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Kept:
    """What became of a promise.

    tested  how many cases were looked at
    broken  one sentence for each in which it was not kept
    """

    tested: int
    broken: tuple[str, ...]

    @property
    def held(self) -> bool:
        """Whether nothing broke it."""
        return not self.broken
