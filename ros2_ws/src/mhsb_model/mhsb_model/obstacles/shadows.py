"""Shadows: projections of zones in space into the arm's plane while the slew turns it.

A shadow covers all points of the plane that are in a zone at any slew angle between two given
angles, in the plane's own coordinates. Joint 2 is at a distance a ahead of the slew's axis. A point
(x, y) has the distance ρ = √(x² + y²) from this axis.

- The shadow of a sphere of radius R around (x, y, z) is the circle of radius R around (ρ − a, z).
- The shadow of a box or cylinder is a rectangle: its heights, and its distances from the slew's
  axis within the sector through which the plane turns.

A link of radius c must also keep clear of what lies beside its plane. So the sector is widened by
asin(c/ρ₀) on both sides, with the zone's least distance ρ₀ from the axis. A point outside the
sector is farther than ρ₀ sin(asin(c/ρ₀)) = c from the plane. A point inside the sector has its
image (ρ, z) in the shadow. The distance of such a point from a point (r, z') of the plane is at
least √((r − ρ)² + (z' − z)²). So a posture that keeps c from a shadow keeps c from its zone. The
part of the plane behind the axis meets the zones of the opposite sector, mirrored.
"""

import math

import numpy as np

from mhsb_model.obstacles.zones import (
    BOX_KIND,
    CIRCLE_KIND,
    CYLINDER_KIND,
    KIND_COLUMN,
    LINK_COLUMN,
    OBSTACLE_COLUMN,
    RADIUS_COLUMN,
    ROW_WIDTH,
    SHAPE_COLUMN,
    SPACE_BOX_KIND,
    SPHERE_KIND,
    Obstacles,
)
from mhsb_model.types import FloatArray, frozen

WHOLE_TURN = 2.0 * math.pi
"""Whole turn [rad]."""

AT_AXIS = 1e-6
"""Distance from the axis below which a zone reaches the arm's plane at every slew angle [m]."""


def compute_shadows(
    zones: Obstacles, offset: float, start_angle: float, end_angle: float
) -> Obstacles:
    """Compute the shadows of all zones in space for a range of slew angles.

    A shadow is an obstacle in the arm's plane. It covers the points of the plane that are in the
    zone at any of these slew angles. A zone has up to two shadows, one ahead of the slew's axis and
    one behind it. The zone has no shadow if the plane does not reach it. The range of angles is
    widened, so that links with a radius keep clear of zones beside the plane. The widening is
    computed from link radii that include the margin of discrete paths.

    Args:
        zones: Obstacles of the slewing arm; obstacles in its plane are ignored.
        offset: Distance of joint 2 ahead of the slew's axis [m].
        start_angle: Slew angle at one end of the turn [rad].
        end_angle: Slew angle at the other end, in either order [rad].

    Returns:
        Obstacles for the planar part of the arm (`Machine.planar_arm`), without rows if no zone has
        a shadow. `names` has the names of all `zones`, with or without a shadow.
    """
    rows, path_rows = [], []
    low, high = min(start_angle, end_angle), max(start_angle, end_angle)
    for k in np.flatnonzero(zones.is_in_space):
        own, grown = zones.rows[k], zones.path_rows[k]
        wider = _compute_sector_margin(grown)
        for side, turn in ((1.0, 0.0), (-1.0, math.pi)):
            between = compute_distance_range(grown, low - wider + turn, high + wider + turn)
            if between is None:
                continue
            rows.append(_project_zone(own, offset, side, between))
            path_rows.append(rows[-1].copy())
            path_rows[-1][RADIUS_COLUMN] = grown[RADIUS_COLUMN]
    shape = (-1, ROW_WIDTH)
    of_links, of_paths = (frozen(np.array(each).reshape(shape)) for each in (rows, path_rows))
    return Obstacles(of_links, of_paths, zones.names)


def _compute_sector_margin(row: FloatArray) -> float:
    """Compute the angle to add to a range of slew angles so that zones beside the plane count.

        asin(c/ρ₀)

    A link of radius c also touches zones beside the arm's plane. The range of slew angles is
    therefore widened by this angle on both sides. ρ₀ is the zone's least distance from the slew's
    axis.

    Args:
        row: Zone in space, a row of the obstacle table, float64[ROW_WIDTH], with c in
            RADIUS_COLUMN.

    Returns:
        Angle on each side [rad]. It is π (the whole turn) if ρ₀ is no larger than c, or no larger
        than AT_AXIS.
    """
    nearest = compute_distance_range(row, 0.0, WHOLE_TURN)
    if nearest is None or nearest[0] <= max(row[RADIUS_COLUMN], AT_AXIS):
        return math.pi
    return math.asin(row[RADIUS_COLUMN] / nearest[0])


def _project_zone(
    row: FloatArray, offset: float, side: float, distances: tuple[float, float]
) -> FloatArray:
    """Compute the obstacle row of a zone's shadow in the arm's plane.

    Args:
        row: Zone in space, a row of the obstacle table, float64[ROW_WIDTH].
        offset: Distance of joint 2 ahead of the slew's axis [m].
        side: 1 for the part of the plane ahead of the axis, −1 for the part behind it.
        distances: Least and greatest horizontal distance of the zone from the slew's axis, within
            the sector that the plane sweeps [m]. Not used for a sphere.

    Returns:
        Row of a circle (for a sphere) or a box in the plane, float64[ROW_WIDTH]. The result's link
        index is one less than in `row`, since the planar arm has no slew.
    """
    shadow = np.zeros_like(row)
    shadow[[KIND_COLUMN, LINK_COLUMN]] = BOX_KIND, row[LINK_COLUMN] - 1
    shadow[[RADIUS_COLUMN, OBSTACLE_COLUMN]] = row[[RADIUS_COLUMN, OBSTACLE_COLUMN]]
    if row[KIND_COLUMN] == SPHERE_KIND:
        x, y, z, radius = row[SHAPE_COLUMN : SHAPE_COLUMN + 4]
        shadow[KIND_COLUMN] = CIRCLE_KIND
        shadow[SHAPE_COLUMN : SHAPE_COLUMN + 3] = side * math.hypot(x, y) - offset, z, radius
        return shadow
    heights = SHAPE_COLUMN + 2, SHAPE_COLUMN + (5 if row[KIND_COLUMN] == SPACE_BOX_KIND else 3)
    near, far = sorted(side * distance - offset for distance in distances)
    shadow[SHAPE_COLUMN : SHAPE_COLUMN + 4] = near, row[heights[0]], far, row[heights[1]]
    return shadow


def compute_distance_range(row: FloatArray, low: float, high: float) -> tuple[float, float] | None:
    """Compute how near and how far a zone is from the slew's axis within a sector of slew angles.

    Distances are horizontal. The extrema lie at the ends of the sector, or at special angles of the
    zone within it: corners and normals of a box, centre and tangents of a circle. Rays at these
    angles are intersected with the zone.

    Args:
        row: Zone in space, a row of the obstacle table, float64[ROW_WIDTH].
        low: Start of the sector [rad].
        high: End of the sector, counter-clockwise from `low` and not below it [rad].

    Returns:
        Least and greatest distance of the part of the zone in the sector [m]; None if no part of
        the zone is in the sector.
    """
    angles = [low, high]
    for special in _special_angles(row):
        first = special + math.ceil((low - special) / WHOLE_TURN) * WHOLE_TURN
        if first <= high:
            angles.append(first)
    hits = [hit for angle in angles if (hit := _intersect_ray(row, angle)) is not None]
    if not hits:
        return None
    return min(near for near, _ in hits), max(far for _, far in hits)


def _special_angles(row: FloatArray) -> list[float]:
    """Return the angles at which a zone's distance from the slew's axis can have an extremum.

    A horizontal ray from the axis enters the zone at one distance and leaves it at another. Both
    are functions of the ray's angle.

    Args:
        row: Zone in space, a row of the obstacle table, float64[ROW_WIDTH].

    Returns:
        Angles [rad]. For a box, these are the directions of its corners and of its faces' normals.
        Seen from above, a sphere or an (upright) cylinder is a circle. For a circle, the angles are
        the directions of the centre and of both tangents. If the axis is inside the circle, centre
        ± π/2 takes the place of the tangents.
    """
    if row[KIND_COLUMN] == SPACE_BOX_KIND:
        across, along = (
            row[[SHAPE_COLUMN, SHAPE_COLUMN + 3]],
            row[[SHAPE_COLUMN + 1, SHAPE_COLUMN + 4]],
        )
        corners = [math.atan2(y, x) for y in along for x in across]
        return [*corners, 0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi]
    x, y, radius = _circle(row)
    center, distance = math.atan2(y, x), math.hypot(x, y)
    # Slightly inside the tangents, so that rounding cannot make a ray miss the circle.
    aside = math.asin(radius / distance) * (1.0 - 1e-9) if distance > radius else 0.5 * math.pi
    return [center - aside, center, center + aside]


def _circle(row: FloatArray) -> tuple[float, float, float]:
    """Return centre x, y and radius of a cylinder or sphere as seen from above [m].

    Args:
        row: Zone in space, a row of the obstacle table, float64[ROW_WIDTH].
    """
    return (
        row[SHAPE_COLUMN],
        row[SHAPE_COLUMN + 1],
        row[SHAPE_COLUMN + (4 if row[KIND_COLUMN] == CYLINDER_KIND else 3)],
    )


def _intersect_ray(row: FloatArray, angle: float) -> tuple[float, float] | None:
    """Intersect a horizontal ray from the slew's axis with a zone, as seen from above.

    Args:
        row: Zone in space, a row of the obstacle table, float64[ROW_WIDTH].
        angle: Direction of the ray [rad].

    Returns:
        Distances from the axis at which the ray enters and leaves the zone [m]. The first is 0 if
        the axis is in the zone. None if the ray misses the zone.
    """
    cosine, sine = math.cos(angle), math.sin(angle)
    if row[KIND_COLUMN] != SPACE_BOX_KIND:
        x, y, radius = _circle(row)
        along, across = x * cosine + y * sine, y * cosine - x * sine
        half = radius * radius - across * across
        if half < 0.0 or along + math.sqrt(half) < 0.0:
            return None
        return max(0.0, along - math.sqrt(half)), along + math.sqrt(half)
    near, far = 0.0, math.inf
    for axis, slope in ((0, cosine), (1, sine)):
        low, high = row[SHAPE_COLUMN + axis], row[SHAPE_COLUMN + 3 + axis]
        if abs(slope) < 1e-12:
            if not low <= 0.0 <= high:
                return None
            continue
        one, other = low / slope, high / slope
        near, far = max(near, min(one, other)), min(far, max(one, other))
    return (near, far) if near <= far * (1.0 + 1e-12) and far >= 0.0 else None
