"""Zones in space as the arm's plane meets them while it turns: their shadows.

A shadow is what of the plane a zone takes, at any of the slew's angles between two, in the plane's
own coordinates: of a sphere of radius R around (x, y, z) the circle of radius R around (ρ − a, z),
of a box or a cylinder the rectangle of its heights and of its distances from the slew's axis in
the sector that is turned through, with ρ = √(x² + y²) and joint 2 at a ahead of that axis.

A link of radius c keeps clear of what lies beside its plane, too: the sector is taken wider by
asin(c/ρ₀) on both sides, with ρ₀ the zone's least distance from the axis. What is beyond that is
farther than ρ₀ sin(asin(c/ρ₀)) = c from the whole plane. What lies within has, at (ρ, z), a point
of the shadow, and is no nearer to a point (r, z') of the plane than √((r − ρ)² + (z' − z)²). So a
posture that keeps c from a shadow keeps c from its zone. What of the plane is behind the axis meets
the zones of the opposite sector, mirrored.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.obstacles.zones import (
    BOX,
    BOX_IN_SPACE,
    CIRCLE,
    CYLINDER,
    KIND,
    NUMBER,
    PART,
    RADIUS,
    ROW_WIDTH,
    SHAPE,
    SPHERE,
    Obstacles,
)
from mhsb_model.types import FloatArray, frozen

WHOLE_TURN = 2.0 * math.pi

AT_AXIS = 1e-6
"""A zone that is nearer than this to the axis stands in every plane [m]."""


def shadows_between(zones: Obstacles, offset: float, began: float, ended: float) -> Obstacles:
    """Shadows of all zones in space, for an arm's plane, between two angles of the slew [rad].

    zones   obstacles of the whole arm
    offset  of joint 2 ahead of the slew's axis [m]
    """
    rows, path_rows = [], []
    low, high = min(began, ended), max(began, ended)
    for k in np.flatnonzero(zones.in_space):
        own, grown = zones.rows[k], zones.path_rows[k]
        wider = _beside(grown)
        for side, turn in ((1.0, 0.0), (-1.0, math.pi)):
            between = distances_between(grown, low - wider + turn, high + wider + turn)
            if between is None:
                continue
            rows.append(_in_plane(own, offset, side, between))
            path_rows.append(rows[-1].copy())
            path_rows[-1][RADIUS] = grown[RADIUS]
    shape = (-1, ROW_WIDTH)
    of_links, of_paths = (frozen(np.array(each).reshape(shape)) for each in (rows, path_rows))
    return Obstacles(of_links, of_paths, zones.names)


def _beside(row: FloatArray) -> float:
    """By how much an angle may differ from a zone's for a link to get near to it [rad]."""
    nearest = distances_between(row, 0.0, WHOLE_TURN)
    if nearest is None or nearest[0] <= max(row[RADIUS], AT_AXIS):
        return math.pi
    return math.asin(row[RADIUS] / nearest[0])


def _in_plane(
    row: FloatArray, offset: float, side: float, between: tuple[float, float]
) -> FloatArray:
    """The row of a shadow: of the zone of `row`, at such distances from the axis [m].

    side  1 ahead of the axis, −1 behind it
    """
    shadow = np.zeros_like(row)
    shadow[[KIND, PART]] = BOX, row[PART] - 1
    shadow[[RADIUS, NUMBER]] = row[[RADIUS, NUMBER]]
    if row[KIND] == SPHERE:
        x, y, z, radius = row[SHAPE:SHAPE + 4]
        shadow[KIND] = CIRCLE
        shadow[SHAPE:SHAPE + 3] = side * math.hypot(x, y) - offset, z, radius
        return shadow
    heights = SHAPE + 2, SHAPE + (5 if row[KIND] == BOX_IN_SPACE else 3)
    near, far = sorted(side * distance - offset for distance in between)
    shadow[SHAPE:SHAPE + 4] = near, row[heights[0]], far, row[heights[1]]
    return shadow


def distances_between(row: FloatArray, low: float, high: float) -> tuple[float, float] | None:
    """A zone's least and greatest distance from the axis [m] in a sector [rad]; None: it is
    elsewhere.

    Along a face the distance of a ray's hit is d/cos(θ − θₙ), along a circle it grows from the
    centre's angle to both tangents: what is least or greatest lies at the sector's ends, at
    corners, normals, the centre or tangents.
    """
    angles = [low, high]
    for special in _special_angles(row):
        first = special + math.ceil((low - special) / WHOLE_TURN) * WHOLE_TURN
        if first <= high:
            angles.append(first)
    hits = [hit for angle in angles if (hit := _hit(row, angle)) is not None]
    if not hits:
        return None
    return min(near for near, _ in hits), max(far for _, far in hits)


def _special_angles(row: FloatArray) -> list[float]:
    if row[KIND] == BOX_IN_SPACE:
        across, along = row[[SHAPE, SHAPE + 3]], row[[SHAPE + 1, SHAPE + 4]]
        corners = [math.atan2(y, x) for y in along for x in across]
        return [*corners, 0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi]
    x, y, radius = _circle(row)
    center, distance = math.atan2(y, x), math.hypot(x, y)
    # just inside the tangents, where a ray still meets the circle
    aside = math.asin(radius / distance) * (1.0 - 1e-9) if distance > radius else 0.5 * math.pi
    return [center - aside, center, center + aside]


def _circle(row: FloatArray) -> tuple[float, float, float]:
    """x, y and radius of a cylinder or a sphere seen from above [m]."""
    return row[SHAPE], row[SHAPE + 1], row[SHAPE + (4 if row[KIND] == CYLINDER else 3)]


def _hit(row: FloatArray, angle: float) -> tuple[float, float] | None:
    """Distances at which a ray from the axis enters and leaves a zone seen from above [m]."""
    cosine, sine = math.cos(angle), math.sin(angle)
    if row[KIND] != BOX_IN_SPACE:
        x, y, radius = _circle(row)
        along, across = x * cosine + y * sine, y * cosine - x * sine
        half = radius * radius - across * across
        if half < 0.0 or along + math.sqrt(half) < 0.0:
            return None
        return max(0.0, along - math.sqrt(half)), along + math.sqrt(half)
    near, far = 0.0, math.inf
    for axis, slope in ((0, cosine), (1, sine)):
        low, high = row[SHAPE + axis], row[SHAPE + 3 + axis]
        if abs(slope) < 1e-12:
            if not low <= 0.0 <= high:
                return None
            continue
        one, other = low / slope, high / slope
        near, far = max(near, min(one, other)), min(far, max(one, other))
    return (near, far) if near <= far * (1.0 + 1e-12) and far >= 0.0 else None
