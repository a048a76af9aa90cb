"""What is asked of a planner: where the tip shall go."""

from __future__ import annotations

from dataclasses import dataclass

SAME_PLACE = 1e-4  # m


@dataclass(frozen=True)
class Goal:
    """Where the tip shall go: x forward, z up from the base [m]; `stamp_ns` is the goal's id."""

    stamp_ns: int
    x: float
    z: float

    def same_place(self, other: Goal) -> bool:
        """Whether both lie within 0.1 mm in x and z: a plan to one leads to the other, too."""
        return max(abs(self.x - other.x), abs(self.z - other.z)) <= SAME_PLACE
