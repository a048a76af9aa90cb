"""Where a motion may end: the goal, points around it that do as well, and the end link's angle.

Regions are given by offsets from the goal, which is one of their points. Planners look at some of
these: the goal itself and points up to `SPACING` apart, the region's edge among them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from mhsb_model.types import FloatArray
from mhsb_planner.errors import RequestError

Point = tuple[float, float]

Angle = float | tuple[float, float] | None
"""End-link angle ψ at the goal [rad]: itself, the least and the greatest that will do, or free."""

SPACING = 0.05  # m
MOST_RINGS = 3
MOST_ON_SEGMENT, MOST_ALONG_BOX = 21, 5

AT_GOAL_DISTANCE = 1e-4
"""A tip at rest within this of the goal has nothing to do [m]."""

AT_GOAL_ANGLE = 1e-3  # rad, of the end link, where one is asked for

FARTHEST = 100.0
"""Sizes of regions [m], at most: far beyond what any arm reaches."""

WIDEST_ANGLE = 100.0
"""Of the end link, either way [rad]: some turns more than any arm makes."""

INSIDE = 1.0 - 1e-9
"""Points at a disc's edge lie inside by this factor, whatever the rounding."""


@dataclass(frozen=True)
class _Region:
    """Raises RequestError for sizes that are not finite, not above 0 or beyond FARTHEST."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not math.isfinite(value) or (field.name not in ("x", "z") and value <= 0.0):
                rule = "must be finite" if field.name in ("x", "z") else "must be above 0 m"
                raise RequestError(f"goal region's {field.name}", value, rule)
            if abs(value) > FARTHEST:
                rule = f"must be at most {FARTHEST:g} m"
                raise RequestError(f"goal region's {field.name}", value, rule)


@dataclass(frozen=True)
class Disc(_Region):
    """All points within `radius` m of the goal: a tolerance."""

    radius: float

    @property
    def offsets(self) -> FloatArray:
        """Points from the goal, itself first, float64[k, 2] m."""
        rings = min(MOST_RINGS, math.ceil(self.radius / SPACING))
        angle = np.arange(8) * math.pi / 4
        rim = INSIDE * self.radius * np.column_stack([np.cos(angle), np.sin(angle)])
        return np.vstack([np.zeros(2), *(rim * (i + 1) / rings for i in range(rings))])

    def distance(self, offset: Point) -> float:
        """How far a point is from the region [m]; 0 inside."""
        return max(0.0, math.hypot(*offset) - self.radius)


@dataclass(frozen=True)
class Segment(_Region):
    """The straight line from the goal to the point (x, z) m beyond it."""

    x: float
    z: float

    @property
    def offsets(self) -> FloatArray:
        """Points from the goal, itself first, float64[k, 2] m."""
        count = math.ceil(math.hypot(self.x, self.z) / SPACING) + 1
        share = np.linspace(0.0, 1.0, min(MOST_ON_SEGMENT, max(5, count)))
        return share[:, None] * [self.x, self.z]

    def distance(self, offset: Point) -> float:
        """How far a point is from the region [m]; 0 on it."""
        square = self.x**2 + self.z**2
        along = 0.0 if square == 0.0 else (offset[0] * self.x + offset[1] * self.z) / square
        share = min(1.0, max(0.0, along))
        return math.hypot(offset[0] - share * self.x, offset[1] - share * self.z)


@dataclass(frozen=True)
class Box(_Region):
    """The rectangle that reaches half_x and half_z m to either side of the goal."""

    half_x: float
    half_z: float

    @property
    def offsets(self) -> FloatArray:
        """Points from the goal, itself first, float64[k, 2] m."""
        x, z = (self._along(half) for half in (self.half_x, self.half_z))
        grid = np.column_stack([each.ravel() for each in np.meshgrid(x, z)])
        return np.vstack([np.zeros(2), grid[np.any(grid != 0.0, axis=1)]])

    @staticmethod
    def _along(half: float) -> FloatArray:
        count = min(MOST_ALONG_BOX // 2, math.ceil(half / SPACING))
        return half * np.arange(-count, count + 1) / count

    def distance(self, offset: Point) -> float:
        """How far a point is from the region [m]; 0 inside."""
        beyond_x, beyond_z = abs(offset[0]) - self.half_x, abs(offset[1]) - self.half_z
        return math.hypot(max(0.0, beyond_x), max(0.0, beyond_z))


Region = Disc | Segment | Box


def region_of(
    tolerance: float | None, segment: Point | None, box: Point | None
) -> Region | None:
    """The region that users ask for by at most one of these, each None where it is not asked for.

    tolerance [m]; segment: (x, z) m from the goal to its other end; box: (x, z) m, half its sizes.
    Raises RequestError where more than one is given.
    """
    given = {"tolerance": tolerance, "segment": segment, "box": box}
    names = [name for name, value in given.items() if value is not None]
    if len(names) > 1:
        rule = "must be one of tolerance, segment, box"
        raise RequestError("goal region", " and ".join(names), rule)
    if tolerance is not None:
        return Disc(tolerance)
    if segment is not None:
        return Segment(*segment)
    return None if box is None else Box(*box)


def tips(goal: Point, region: Region | None) -> FloatArray:
    """The points (x, z) m at which a plan may end, the goal first, float64[k, 2]."""
    offsets = np.zeros((1, 2)) if region is None else region.offsets
    return np.asarray(goal, dtype=np.float64) + offsets


def check_angle(psi: Angle) -> None:
    """Raise RequestError where it is not an angle or a range of angles within WIDEST_ANGLE."""
    for angle in psi if isinstance(psi, tuple) else (psi,):
        if angle is not None and math.isfinite(angle) and abs(angle) > WIDEST_ANGLE:
            rule = f"must be from {-WIDEST_ANGLE:g} to {WIDEST_ANGLE:g} rad"
            raise RequestError("goal_psi", psi, rule)
    if isinstance(psi, tuple):
        low, high = psi
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            rule = "must be two finite angles in rad, the least first"
            raise RequestError("range of goal_psi", psi, rule)
    elif psi is not None and not math.isfinite(psi):
        raise RequestError("goal_psi", psi, "must be a finite angle in rad")


def angle_range(psi: Angle) -> tuple[float, float] | None:
    """The least and the greatest ψ [rad]; None where all will do."""
    if psi is None or not isinstance(psi, tuple):
        return None if psi is None else (psi, psi)
    return None if psi[1] - psi[0] >= 2 * math.pi else psi


def is_met(
    goal: Point,
    region: Region | None,
    psi: Angle,
    tip: FloatArray,
    angle: float,
    near: float,
    near_angle: float,
) -> bool:
    """Whether a tip (x, z) m and an end-link angle [rad] are what is asked for.

    near [m], near_angle [rad]: by how much either may miss it
    """
    offset = float(tip[0]) - goal[0], float(tip[1]) - goal[1]
    away = math.hypot(*offset) if region is None else region.distance(offset)
    if away > near:
        return False
    wanted = angle_range(psi)
    if wanted is None:
        return True
    beyond = (angle - wanted[0] + near_angle) % (2 * math.pi)
    return beyond <= wanted[1] - wanted[0] + 2 * near_angle
