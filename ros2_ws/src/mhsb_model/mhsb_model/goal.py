"""What is asked of a planner: where the tip shall go."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from mhsb_model.types import Position

SAME_PLACE = 1e-4  # m


@dataclass(frozen=True)
class Goal:
    """Where the tip shall go in `base_link`: x forward, z up [m]; `stamp_ns` is the goal's id.

    y, to the left [m], is for arms that slew, and None for others.
    """

    stamp_ns: int
    x: float
    z: float
    y: float | None = None

    @property
    def position(self) -> Position:
        """(x, z), or (x, y, z)."""
        return (self.x, self.z) if self.y is None else (self.x, self.y, self.z)

    @classmethod
    def at(cls, stamp_ns: int, position: Position) -> Goal:
        """The goal at (x, z), or (x, y, z)."""
        x, *y, z = position
        return cls(stamp_ns, x, z, *y)

    def moved_to(self, position: Position) -> Goal:
        """The same goal somewhere else."""
        return Goal.at(self.stamp_ns, position)

    @property
    def place(self) -> str:
        """In words."""
        return place(self.position)

    def same_place(self, other: Goal) -> bool:
        """Whether both lie within 0.1 mm along each axis: a plan to one leads to the other, too."""
        pairs = zip(self.position, other.position, strict=True)
        return max(abs(one - another) for one, another in pairs) <= SAME_PLACE


def place(position: Iterable[float], form: str = ".4g") -> str:
    """A position in words: "(0.55, 0.6) m"; each number in this form, without rounding errors."""
    return f"({', '.join(format(round(value, 9) + 0.0, form) for value in position)}) m"
