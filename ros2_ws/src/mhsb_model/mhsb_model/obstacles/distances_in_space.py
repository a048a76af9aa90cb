"""Signed distances in space: of points, and of a link's line, to upright boxes, cylinders, spheres.

The signed distance of a point to a convex body, negative inside it, is a convex function of the
point: for a sphere |p − c| − R, for a box and an upright cylinder, with dᵢ how far the point is
beyond each of its faces, the norm of those that are positive, or the greatest where none is. Along
a line it is convex as well, so that its least value is found by golden sections.
"""

from __future__ import annotations

import math

from mhsb_model.kernels.kernel import kernel
from mhsb_model.obstacles.zones import BOX_IN_SPACE, CYLINDER, KIND, SHAPE
from mhsb_model.types import FloatArray

GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)

SECTIONS = 26
"""Of a line: 4 parts in a million of its length are left then, and no distance is off by more."""


@kernel(borrows=True)
def point_in_space(rows: FloatArray, k: int, x: float, y: float, z: float) -> float:
    """Signed distance of a point in `base_link` to the zone of row k [m]."""
    kind = rows[k, KIND]
    if kind == BOX_IN_SPACE:
        dx = max(rows[k, SHAPE] - x, x - rows[k, SHAPE + 3])
        dy = max(rows[k, SHAPE + 1] - y, y - rows[k, SHAPE + 4])
        dz = max(rows[k, SHAPE + 2] - z, z - rows[k, SHAPE + 5])
        deepest = max(dx, max(dy, dz))
        if deepest <= 0.0:
            return deepest
        dx, dy, dz = max(0.0, dx), max(0.0, dy), max(0.0, dz)
        return math.sqrt(dx * dx + dy * dy + dz * dz)
    aside = math.hypot(x - rows[k, SHAPE], y - rows[k, SHAPE + 1])
    if kind == CYLINDER:
        dr = aside - rows[k, SHAPE + 4]
        dz = max(rows[k, SHAPE + 2] - z, z - rows[k, SHAPE + 3])
        return math.hypot(dr, dz) if dr > 0.0 and dz > 0.0 else max(dr, dz)
    return math.hypot(aside, z - rows[k, SHAPE + 2]) - rows[k, SHAPE + 3]


@kernel(borrows=True)
def line_in_space(
    rows: FloatArray, k: int, slew: float, ra: float, za: float, rb: float, zb: float
) -> float:
    """Least signed distance of a link's line to the zone of row k [m].

    slew  the plane's angle about the vertical [rad]; in it the line leads from the distance ra of
          the slew's axis and the height za to rb and zb [m]

    Oracle: SciPy's bounded minimisation, and points along the line.
    """
    cosine, sine = math.cos(slew), math.sin(slew)
    low, high = 0.0, 1.0
    one, other = 1.0 - GOLDEN, GOLDEN
    r, z = ra + one * (rb - ra), za + one * (zb - za)
    at_one = point_in_space(rows, k, r * cosine, r * sine, z)
    r, z = ra + other * (rb - ra), za + other * (zb - za)
    at_other = point_in_space(rows, k, r * cosine, r * sine, z)
    least = min(
        min(at_one, at_other),
        min(
            point_in_space(rows, k, ra * cosine, ra * sine, za),
            point_in_space(rows, k, rb * cosine, rb * sine, zb),
        ),
    )
    for _ in range(SECTIONS):
        if at_one <= at_other:
            high, other, at_other = other, one, at_one
            one = high - GOLDEN * (high - low)
            r, z = ra + one * (rb - ra), za + one * (zb - za)
            at_one = point_in_space(rows, k, r * cosine, r * sine, z)
            least = min(least, at_one)
        else:
            low, one, at_one = one, other, at_other
            other = low + GOLDEN * (high - low)
            r, z = ra + other * (rb - ra), za + other * (zb - za)
            at_other = point_in_space(rows, k, r * cosine, r * sine, z)
            least = min(least, at_other)
    return least
