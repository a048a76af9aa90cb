"""The goal of a motion: the position to which the tip shall go."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from mhsb_model.types import Position

GOAL_POSITION_TOLERANCE = 1e-4
"""Largest distance along each axis between goals that count as the same [m]."""

MIN_METRES = 0.1
"""Smallest distance that messages give in metres [m]."""


@dataclass(frozen=True)
class Goal:
    """A position in `base_link` to which the tip shall go.

    Attributes:
        stamp_ns: Stamp of the goal, which identifies it [ns].
        x: Forward coordinate [m].
        z: Upward coordinate [m].
        y: Coordinate to the left, for arms that slew [m]; None for others.
    """

    stamp_ns: int
    x: float
    z: float
    y: float | None = None

    @property
    def position(self) -> Position:
        """Position (x, z), or (x, y, z) if the goal has a y [m]."""
        return (self.x, self.z) if self.y is None else (self.x, self.y, self.z)

    @classmethod
    def at(cls, stamp_ns: int, position: Position) -> Goal:
        """Make a goal from a position.

        Args:
            stamp_ns: Stamp of the goal [ns].
            position: (x, z), or (x, y, z) for an arm that slews [m].

        Returns:
            The goal; its y is None for a position of two coordinates.
        """
        x, *y, z = position
        return cls(stamp_ns, x, z, *y)

    def moved_to(self, position: Position) -> Goal:
        """Return a goal with the same stamp at another position.

        Args:
            position: (x, z), or (x, y, z) for an arm that slews, in `base_link` [m].
        """
        return Goal.at(self.stamp_ns, position)

    @property
    def position_text(self) -> str:
        """Text of the position, for instance "(0.55, 0.6) m"."""
        return format_position(self.position)

    def is_at_same_position(self, other: Goal) -> bool:
        """Return whether two goals are within 0.1 mm of each other along each axis.

        A plan to one of these goals then also reaches the other.

        Raises:
            ValueError: Only one of the goals has a y.
        """
        pairs = zip(self.position, other.position, strict=True)
        return max(abs(one - another) for one, another in pairs) <= GOAL_POSITION_TOLERANCE


def format_position(position: Iterable[float], number_format: str = ".4g") -> str:
    """Format a position for messages, for instance "(0.55, 0.6) m".

    Args:
        position: Coordinates [m]; they are rounded to 1 nm, and −0 becomes 0.
        number_format: Format specification of each coordinate.
    """
    return f"({', '.join(format(round(value, 9) + 0.0, number_format) for value in position)}) m"


def format_distance(distance: float) -> str:
    """Format a distance for messages, for instance "9.8 mm" or "0.35 m".

    Args:
        distance: Distance [m]. It is rounded to three digits, and given in mm below MIN_METRES.
    """
    rounded = float(f"{distance:.3g}")
    return f"{1e3 * rounded:.3g} mm" if abs(rounded) < MIN_METRES else f"{rounded:g} m"
