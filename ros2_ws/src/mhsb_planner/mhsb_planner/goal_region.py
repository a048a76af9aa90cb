"""Admissible ends of a motion: the goal, a region around it, and the end-link angle.

Regions are given by offsets from the goal. The goal belongs to the region. Planners try some points
of the region: the goal, and points about REGION_SPACING apart, up to the edge of the region.
"""

import math
from dataclasses import dataclass, fields

import numpy as np

from mhsb_model.errors import suggest_unit_of_number
from mhsb_model.types import FloatArray
from mhsb_planner.errors import RequestError

Point = tuple[float, float]
"""Coordinates (x, z) [m]."""

Angle = float | tuple[float, float] | None
"""Admissible end-link angle ψ at the goal [rad].

One value, a pair of least and greatest value, or None for any angle."""

REGION_SPACING = 0.05
"""Distance between neighbouring points of a region that planners try [m].

The distance is larger if the number of points reaches its upper limit.
"""
MOST_RINGS = 3
"""Largest number of rings of points that planners try in a disc."""
MOST_ON_SEGMENT, MOST_ALONG_BOX = 21, 5
"""Largest number of points that planners try on a segment, and along each side of a box."""

AT_GOAL_DISTANCE = 1e-4
"""Largest distance from the goal at which a tip at rest counts as being at the goal [m]."""

AT_GOAL_ANGLE = 1e-3
"""Largest difference at which the end link counts as being at the requested angle [rad]."""

MAX_REGION_SIZE = 100.0
"""Largest accepted size of a region [m], far beyond the reach of any arm."""

WIDEST_ANGLE = 15.0
"""Largest accepted end-link angle, in either direction [rad].

No arm makes more than two turns, so a larger angle was probably given in degrees.
"""

EDGE_FACTOR = 1.0 - 1e-9
"""Factor on a disc's radius for points at its edge [-], so that rounding leaves them inside."""


@dataclass(frozen=True)
class _Region:
    """Base class of regions, which checks their sizes.

    Raises:
        RequestError: A size is not finite, is not above 0, or exceeds MAX_REGION_SIZE.
    """

    def __post_init__(self) -> None:
        """Check all fields. Sizes must be above 0; offsets x and z may have any sign or be 0.

        Raises:
            RequestError: A value is not finite, a size is not above 0, or an absolute value exceeds
                MAX_REGION_SIZE.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            if not math.isfinite(value) or (field.name not in ("x", "z") and value <= 0.0):
                rule = "must be finite" if field.name in ("x", "z") else "must be above 0 m"
                raise RequestError(f"goal region's {field.name}", value, rule)
            if abs(value) > MAX_REGION_SIZE:
                rule = f"must be at most {MAX_REGION_SIZE:g} m"
                raise RequestError(f"goal region's {field.name}", value, rule)


@dataclass(frozen=True)
class Disc(_Region):
    """Disc around the goal: all points within a tolerance.

    Attributes:
        radius: Radius [m].
    """

    radius: float

    @property
    def size(self) -> float:
        """Largest distance of a point of the region from the goal [m]."""
        return self.radius

    @property
    def offsets(self) -> FloatArray:
        """Points that planners try, as offsets (x, z) from the goal, shape (k, 2) [m].

        The first is the goal. Then follow 8 points on each of 1 to MOST_RINGS concentric rings,
        from the inside outwards. The rings are evenly spaced up to the edge. They are at most
        REGION_SPACING apart, if MOST_RINGS rings suffice for that.
        """
        rings = min(MOST_RINGS, math.ceil(self.radius / REGION_SPACING))
        angle = np.arange(8) * math.pi / 4
        rim = EDGE_FACTOR * self.radius * np.column_stack([np.cos(angle), np.sin(angle)])
        return np.vstack([np.zeros(2), *(rim * (i + 1) / rings for i in range(rings))])

    def distance(self, offset: Point) -> float:
        """Compute the distance of a point from the disc.

        Args:
            offset: Point, as an offset (x, z) from the goal [m].

        Returns:
            Distance [m]; 0 in the disc.
        """
        return max(0.0, math.hypot(*offset) - self.radius)


@dataclass(frozen=True)
class Segment(_Region):
    """Straight line from the goal to another point.

    Attributes:
        x: Offset of the other end from the goal along x [m].
        z: Offset of the other end from the goal along z [m].
    """

    x: float
    z: float

    @property
    def size(self) -> float:
        """Largest distance of a point of the region from the goal [m]."""
        return math.hypot(self.x, self.z)

    @property
    def offsets(self) -> FloatArray:
        """Points that planners try, as offsets (x, z) from the goal, shape (k, 2) [m].

        They are 5 to MOST_ON_SEGMENT evenly spaced points from the goal to the other end. They are
        at most REGION_SPACING apart, if MOST_ON_SEGMENT points suffice for that.
        """
        count = math.ceil(math.hypot(self.x, self.z) / REGION_SPACING) + 1
        share = np.linspace(0.0, 1.0, min(MOST_ON_SEGMENT, max(5, count)))
        return share[:, None] * [self.x, self.z]

    def distance(self, offset: Point) -> float:
        """Compute the distance of a point from the segment.

        Args:
            offset: Point, as an offset (x, z) from the goal [m].

        Returns:
            Distance [m]; 0 on the segment.
        """
        square = self.x**2 + self.z**2
        along = 0.0 if square == 0.0 else (offset[0] * self.x + offset[1] * self.z) / square
        share = min(1.0, max(0.0, along))
        return math.hypot(offset[0] - share * self.x, offset[1] - share * self.z)


@dataclass(frozen=True)
class BoxRegion(_Region):
    """Rectangle with the goal at its centre.

    Attributes:
        half_x: Half of its size along x [m].
        half_z: Half of its size along z [m].
    """

    half_x: float
    half_z: float

    @property
    def size(self) -> float:
        """Largest distance of a point of the region from the goal [m]."""
        return math.hypot(self.half_x, self.half_z)

    @property
    def offsets(self) -> FloatArray:
        """Points that planners try, as offsets (x, z) from the goal, shape (k, 2) [m].

        The first is the goal. Then follow the other points of a grid with 3 to MOST_ALONG_BOX
        points along each side.
        """
        x, z = (self._coordinates(half) for half in (self.half_x, self.half_z))
        grid = np.column_stack([each.ravel() for each in np.meshgrid(x, z)])
        return np.vstack([np.zeros(2), grid[np.any(grid != 0.0, axis=1)]])

    @staticmethod
    def _coordinates(half: float) -> FloatArray:
        """Compute the coordinates of the grid's points along one side of the box.

        Args:
            half: Half of the box's size along this side, above 0 [m].

        Returns:
            3 to MOST_ALONG_BOX (an odd number) evenly spaced coordinates from −half to half [m].
            They are at most REGION_SPACING apart, if MOST_ALONG_BOX coordinates suffice for that.
        """
        count = min(MOST_ALONG_BOX // 2, math.ceil(half / REGION_SPACING))
        return half * np.arange(-count, count + 1) / count

    def distance(self, offset: Point) -> float:
        """Compute the distance of a point from the box.

        Args:
            offset: Point, as an offset (x, z) from the goal [m].

        Returns:
            Distance [m]; 0 in the box.
        """
        beyond_x, beyond_z = abs(offset[0]) - self.half_x, abs(offset[1]) - self.half_z
        return math.hypot(max(0.0, beyond_x), max(0.0, beyond_z))


Region = Disc | Segment | BoxRegion
"""Region of any kind."""


def create_region(
    tolerance: float | None, segment: Point | None, box: Point | None
) -> Region | None:
    """Create a goal region from a user's values; at most one value may be given.

    Args:
        tolerance: Radius of a disc around the goal [m], or None.
        segment: Offset (x, z) from the goal to the other end of a segment [m], or None.
        box: Half widths of a rectangle along x and z, with the goal at its centre [m], or None.

    Returns:
        The region. None if all values are None.

    Raises:
        RequestError: More than one value is given, or a value is not finite or out of range.
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
    return None if box is None else BoxRegion(*box)


def tip_positions(goal: Point, region: Region | None) -> FloatArray:
    """Compute the tip positions at which planners try to end a motion.

    Args:
        goal: Goal (x, z) in the arm's plane [m].
        region: Region around the goal. None means the goal alone.

    Returns:
        Positions (x, z), shape (k, 2) [m]. The goal comes first.
    """
    offsets = np.zeros((1, 2)) if region is None else region.offsets
    return np.asarray(goal, dtype=np.float64) + offsets


def check_angle(psi: Angle) -> None:
    """Check that the end-link angle of a request is valid.

    Args:
        psi: Angle, pair of least and greatest angle [rad], or None for any angle.

    Raises:
        RequestError: An angle is not finite, its absolute value exceeds WIDEST_ANGLE, or the first
            of two angles is greater than the second.
    """
    for angle in psi if isinstance(psi, tuple) else (psi,):
        if angle is not None and math.isfinite(angle) and abs(angle) > WIDEST_ANGLE:
            rule = f"must be from {-WIDEST_ANGLE:g} to {WIDEST_ANGLE:g} rad"
            hint = suggest_unit_of_number(angle, "rad", -WIDEST_ANGLE, WIDEST_ANGLE)
            raise RequestError("goal_psi", psi, rule + hint)
    if isinstance(psi, tuple):
        low, high = psi
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            rule = "must be two finite angles in rad, the least first"
            raise RequestError("range of goal_psi", psi, rule)
    elif psi is not None and not math.isfinite(psi):
        raise RequestError("goal_psi", psi, "must be a finite angle in rad")


def angle_range(psi: Angle) -> tuple[float, float] | None:
    """Return the least and the greatest admissible end-link angle.

    Args:
        psi: Angle, pair of least and greatest angle [rad], or None for any angle.

    Returns:
        Least and greatest angle [rad], equal if `psi` is one angle. None if any angle is
        admissible, that is, if `psi` is None or a range of a whole turn or more.
    """
    if psi is None or not isinstance(psi, tuple):
        return None if psi is None else (psi, psi)
    return None if psi[1] - psi[0] >= 2 * math.pi else psi


def is_goal_met(
    goal: Point,
    region: Region | None,
    psi: Angle,
    tip: FloatArray,
    angle: float,
    distance_tolerance: float,
    angle_tolerance: float,
) -> bool:
    """Return whether tip position and end-link angle are at the goal within tolerances.

    Args:
        goal: Goal (x, z) in the arm's plane [m].
        region: Region around the goal. None means the goal alone.
        psi: Admissible end-link angle, or pair of least and greatest angle [rad]. None means any.
        tip: Tip position (x, z) in the arm's plane [m].
        angle: End-link angle [rad]. Angles that differ by whole turns are equal.
        distance_tolerance: Allowed distance of the tip from goal or region [m].
        angle_tolerance: Allowed distance of `angle` from the admissible angles [rad].

    Returns:
        True if both are within their tolerances.
    """
    offset = float(tip[0]) - goal[0], float(tip[1]) - goal[1]
    away = math.hypot(*offset) if region is None else region.distance(offset)
    if away > distance_tolerance:
        return False
    wanted = angle_range(psi)
    if wanted is None:
        return True
    beyond = (angle - wanted[0] + angle_tolerance) % (2 * math.pi)
    return beyond <= wanted[1] - wanted[0] + 2 * angle_tolerance
