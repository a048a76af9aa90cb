"""A number that must reach a bound, or stay below it: what an expectation is judged by."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Condition:
    """A number that must reach a bound, or stay below it.

    scale is the distance from the bound at which the condition counts as wholly missed.
    """

    name: str
    value: float
    bound: float
    scale: float
    least: bool

    @property
    def met(self) -> bool:
        """Whether it holds; never for a value that is not a number."""
        return self.value >= self.bound if self.least else self.value <= self.bound

    @property
    def shortfall(self) -> float:
        """How far it is from being met, 0 … 1."""
        if self.met:
            return 0.0
        if math.isnan(self.value):
            return 1.0
        return min(1.0, abs(self.value - self.bound) / self.scale)

    def __str__(self) -> str:
        word = "at least" if self.least else "at most"
        return f"{self.name} {self.value:.3g} ({word} {self.bound:.3g})"


def at_least(name: str, value: float, bound: float, scale: float) -> Condition:
    """value ≥ bound."""
    return Condition(name, value, bound, scale, least=True)


def at_most(name: str, value: float, bound: float, scale: float) -> Condition:
    """value ≤ bound."""
    return Condition(name, value, bound, scale, least=False)
