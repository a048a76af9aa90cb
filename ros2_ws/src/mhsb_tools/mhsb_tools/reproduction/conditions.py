"""Condition by which an expectation is judged: a number within a bound."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class BoundCheck:
    """Condition that a number reaches a bound, or does not exceed it.

    Attributes:
        name: What the number is.
        value: The number; nan misses every bound.
        bound: The bound.
        scale: Distance from the bound at which the condition counts as wholly missed.
        least: True if the bound is a lower bound, False if it is an upper bound.
    """

    name: str
    value: float
    bound: float
    scale: float
    least: bool

    @property
    def met(self) -> bool:
        """True if the condition holds; False for a value that is not a number."""
        return self.value >= self.bound if self.least else self.value <= self.bound

    @property
    def shortfall(self) -> float:
        """Distance of the value from the bound as a share of `scale`, at most 1.

        0 if the condition holds, 1 for nan.
        """
        if self.met:
            return 0.0
        if math.isnan(self.value):
            return 1.0
        return min(1.0, abs(self.value - self.bound) / self.scale)

    def __str__(self) -> str:
        word = "at least" if self.least else "at most"
        return f"{self.name} {self.value:.3g} ({word} {self.bound:.3g})"


def at_least(name: str, value: float, bound: float, scale: float) -> BoundCheck:
    """Return the condition value ≥ bound."""
    return BoundCheck(name, value, bound, scale, least=True)


def at_most(name: str, value: float, bound: float, scale: float) -> BoundCheck:
    """Return the condition value ≤ bound."""
    return BoundCheck(name, value, bound, scale, least=False)
