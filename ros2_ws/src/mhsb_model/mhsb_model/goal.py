"""What is asked of a planner: where the tip shall go."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Goal:
    """Where the tip shall go: x forward, z up from the base [m]; `stamp_ns` is the goal's id."""

    stamp_ns: int
    x: float
    z: float
