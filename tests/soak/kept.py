"""Result of the check of one promise: how often it was tested, and each time that it was broken."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PromiseResult:
    """Result of the check of one promise.

    Attributes:
        tested: Number of cases that were examined.
        violations: One sentence for each case in which the promise was broken.
    """

    tested: int
    violations: tuple[str, ...]

    @property
    def is_kept(self) -> bool:
        """True if no case broke the promise."""
        return not self.violations
