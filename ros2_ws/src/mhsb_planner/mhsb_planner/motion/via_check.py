"""Check of via points: points that the tip passes on its way, each within a given distance."""

import numpy as np

from mhsb_model.types import FloatArray
from mhsb_planner.errors import place_text

TOLERANCE_FACTOR = 1.02
"""Factor on the tolerance of via points that may have been passed already [-]."""

ViaPoint = tuple[float, ...]
"""Via point (x, z) [m], or (x, y, z) if joint 1 slews, followed by its tolerance [m].

The tip must pass the point at a distance of at most the tolerance."""


def describe_first_missed(tip: FloatArray, passing: tuple[ViaPoint, ...]) -> str:
    """Describe the first via point that a motion misses.

    A via point is a point that the tip must pass. The points must be passed in order, so the search
    for a point begins where the previous point was passed. The tip is assumed to move straight
    between two positions.

    Args:
        tip: Tip positions in time order, shape (k, 2 or 3) [m].
        passing: Via points in order; the last number of each is its tolerance [m].

    Returns:
        Clause that names the point, the least distance of the tip from it, and the tolerance [mm].
        Empty if all points are passed.
    """
    count, away = _count_passed(tip, passing)
    if count == len(passing):
        return ""
    *point, tolerance = passing[count]
    return (
        f"the tip passes {place_text(tuple(point))} at {1000 * away:.3g} mm, "
        f"at most {1000 * tolerance:.3g} mm is allowed"
    )


def find_points_ahead(tip: FloatArray, passing: tuple[ViaPoint, ...]) -> tuple[ViaPoint, ...]:
    """Return the via points that a motion has not passed yet.

    A via point is a point that the tip must pass. Tolerances are widened by TOLERANCE_FACTOR. So a
    point that was passed at the edge of its tolerance still counts if the motion is sampled at
    other times.

    Args:
        tip: Tip positions so far in time order, shape (k, 2 or 3) [m].
        passing: Via points in order; the last number of each is its tolerance [m].

    Returns:
        The remaining via points in order, with their original tolerances; empty if all are passed.
    """
    edged = tuple((*point, TOLERANCE_FACTOR * tolerance) for *point, tolerance in passing)
    return passing[_count_passed(tip, edged)[0] :]


def _count_passed(tip: FloatArray, passing: tuple[ViaPoint, ...]) -> tuple[int, float]:
    """Count the via points that a motion passes in order.

    The search for a point begins in the segment in which the previous point was passed.

    Args:
        tip: Tip positions in time order, shape (k, 2 or 3) [m].
        passing: Via points in order; the last number of each is its tolerance [m].

    Returns:
        Number of points passed, and least distance of the tip from the next point [m]. The distance
        is 0 if all points are passed.
    """
    first = 0
    for count, (*point, tolerance) in enumerate(passing):
        away = _compute_segment_distances(tip[first:], np.array(point))
        within = np.flatnonzero(away <= tolerance)
        if len(within) == 0:
            return count, float(away.min())
        first += int(within[0])
    return len(passing), 0.0


def _compute_segment_distances(tip: FloatArray, point: FloatArray) -> FloatArray:
    """Compute the distance of a point from each straight segment between successive tip positions.

    Args:
        tip: Tip positions, shape (k, 2 or 3) [m].
        point: Position of the point, shape (2 or 3,) [m].

    Returns:
        Distances, shape (k - 1,) [m]; for a single tip position its distance, shape (1,).
    """
    if len(tip) < 2:
        return np.linalg.norm(tip - point, axis=1)
    begin, along = tip[:-1], np.diff(tip, axis=0)
    square = np.maximum(np.sum(along**2, axis=1), np.finfo(float).tiny)
    share = np.clip(np.sum((point - begin) * along, axis=1) / square, 0.0, 1.0)
    return np.linalg.norm(begin + share[:, None] * along - point, axis=1)
