"""Signed distances of points and of a link's line from upright boxes, cylinders and spheres.

The signed distance of a point from a convex body is negative inside. It is |p − c| − R for a
sphere. For a box or an upright cylinder let dᵢ be how far the point is beyond each face: the
distance is the norm of the positive dᵢ, or the greatest dᵢ if none is positive.

The distance is a convex function of the point, and therefore also along a line. Golden-section
search finds its least value.
"""

import math

from mhsb_model.kernels.kernel import kernel
from mhsb_model.obstacles.zones import CYLINDER_KIND, KIND_COLUMN, SHAPE_COLUMN, SPACE_BOX_KIND
from mhsb_model.types import FloatArray

GOLDEN_RATIO = 0.5 * (math.sqrt(5.0) - 1.0)
"""Factor by which each step shortens the interval, 0.618."""

SECTION_STEPS = 26
"""Number of steps of the golden-section search.

The remaining interval is 4e-6 of the line's length, which is also the largest error of a distance.
"""


@kernel(borrows=True)
def compute_point_distance(rows: FloatArray, k: int, x: float, y: float, z: float) -> float:
    """Compute the signed distance of a point from a zone in space.

    Args:
        rows: Obstacle table, float64[rows, ROW_WIDTH].
        k: Index of the row; the obstacle must be a box, cylinder or sphere in space.
        x: Point in `base_link`, forward [m].
        y: Point in `base_link`, to the left [m].
        z: Point in `base_link`, up [m].

    Returns:
        Distance from the surface [m], negative inside the zone. The link's radius, another column
        of the row, is not subtracted.
    """
    kind = rows[k, KIND_COLUMN]
    if kind == SPACE_BOX_KIND:
        dx = max(rows[k, SHAPE_COLUMN] - x, x - rows[k, SHAPE_COLUMN + 3])
        dy = max(rows[k, SHAPE_COLUMN + 1] - y, y - rows[k, SHAPE_COLUMN + 4])
        dz = max(rows[k, SHAPE_COLUMN + 2] - z, z - rows[k, SHAPE_COLUMN + 5])
        deepest = max(dx, max(dy, dz))
        if deepest <= 0.0:
            return deepest
        dx, dy, dz = max(0.0, dx), max(0.0, dy), max(0.0, dz)
        return math.sqrt(dx * dx + dy * dy + dz * dz)
    aside = math.hypot(x - rows[k, SHAPE_COLUMN], y - rows[k, SHAPE_COLUMN + 1])
    if kind == CYLINDER_KIND:
        dr = aside - rows[k, SHAPE_COLUMN + 4]
        dz = max(rows[k, SHAPE_COLUMN + 2] - z, z - rows[k, SHAPE_COLUMN + 3])
        return math.hypot(dr, dz) if dr > 0.0 and dz > 0.0 else max(dr, dz)
    return math.hypot(aside, z - rows[k, SHAPE_COLUMN + 2]) - rows[k, SHAPE_COLUMN + 3]


@kernel(borrows=True)
def compute_line_distance(
    rows: FloatArray, k: int, slew: float, ra: float, za: float, rb: float, zb: float
) -> float:
    """Compute the least signed distance of a link's line from a zone in space.

    The line from a to b lies in the arm's plane, which the slew turns about the vertical. The
    distance is convex along the line, so a golden-section search finds the least value.

    Tested against SciPy's bounded minimisation, and points along the line.

    Args:
        rows: Obstacle table, float64[rows, ROW_WIDTH].
        k: Index of the row; the obstacle must be a box, cylinder or sphere in space.
        slew: Angle of the slew [rad].
        ra: Distance of a from the slew's axis, negative behind it [m].
        za: Height of a [m].
        rb: Distance of b from the slew's axis, negative behind it [m].
        zb: Height of b [m].

    Returns:
        Distance [m], negative if the line enters the zone. The link's radius is not subtracted.
    """
    cosine, sine = math.cos(slew), math.sin(slew)
    low, high = 0.0, 1.0
    one, other = 1.0 - GOLDEN_RATIO, GOLDEN_RATIO
    r, z = ra + one * (rb - ra), za + one * (zb - za)
    at_one = compute_point_distance(rows, k, r * cosine, r * sine, z)
    r, z = ra + other * (rb - ra), za + other * (zb - za)
    at_other = compute_point_distance(rows, k, r * cosine, r * sine, z)
    least = min(
        min(at_one, at_other),
        min(
            compute_point_distance(rows, k, ra * cosine, ra * sine, za),
            compute_point_distance(rows, k, rb * cosine, rb * sine, zb),
        ),
    )
    for _ in range(SECTION_STEPS):
        if at_one <= at_other:
            high, other, at_other = other, one, at_one
            one = high - GOLDEN_RATIO * (high - low)
            r, z = ra + one * (rb - ra), za + one * (zb - za)
            at_one = compute_point_distance(rows, k, r * cosine, r * sine, z)
            least = min(least, at_one)
        else:
            low, one, at_one = one, other, at_other
            other = low + GOLDEN_RATIO * (high - low)
            r, z = ra + other * (rb - ra), za + other * (zb - za)
            at_other = compute_point_distance(rows, k, r * cosine, r * sine, z)
            least = min(least, at_other)
    return least
