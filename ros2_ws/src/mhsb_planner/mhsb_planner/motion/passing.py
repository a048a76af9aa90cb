"""Points that a tip passes on its way, each at no more than a given distance."""

from __future__ import annotations

import numpy as np

from mhsb_model.types import FloatArray
from mhsb_planner.errors import place_text

EDGE = 1.02
"""Factor on the tolerance at which a point counts as passed already."""

Passing = tuple[float, ...]
"""(x, z) m of a point, (x, y, z) m where joint 1 slews, and at what distance the tip may pass it
[m]."""


def first_missed(tip: FloatArray, passing: tuple[Passing, ...]) -> str:
    """Which of the points a motion misses, in one sentence; empty where it passes all of them.

    tip  float64[k, 2 or 3] m, one after the other; straight lines between them will do
    The points are passed in their order: each is looked for from where the one before was passed.
    """
    count, away = _passed(tip, passing)
    if count == len(passing):
        return ""
    *point, tolerance = passing[count]
    return (
        f"the tip passes {place_text(tuple(point))} at {1000 * away:.3g} mm, "
        f"at most {1000 * tolerance:.3g} mm is allowed"
    )


def still_ahead(tip: FloatArray, passing: tuple[Passing, ...]) -> tuple[Passing, ...]:
    """Those of the points, the last ones, that a motion so far has not passed; see `first_missed`.

    A point at the very edge of its tolerance counts as passed: what a plan was found to pass is
    not passed once more because the same curve is looked at elsewhere.
    """
    edged = tuple((*point, EDGE * tolerance) for *point, tolerance in passing)
    return passing[_passed(tip, edged)[0] :]


def _passed(tip: FloatArray, passing: tuple[Passing, ...]) -> tuple[int, float]:
    """How many of the points are passed, and the distance at which the next one is missed [m]."""
    first = 0
    for count, (*point, tolerance) in enumerate(passing):
        away = _distances(tip[first:], np.array(point))
        within = np.flatnonzero(away <= tolerance)
        if len(within) == 0:
            return count, float(away.min())
        first += int(within[0])
    return len(passing), 0.0


def _distances(tip: FloatArray, point: FloatArray) -> FloatArray:
    """Of a point from the lines between tips one after the other, float64[k - 1] m."""
    if len(tip) < 2:
        return np.linalg.norm(tip - point, axis=1)
    begin, along = tip[:-1], np.diff(tip, axis=0)
    square = np.maximum(np.sum(along**2, axis=1), np.finfo(float).tiny)
    share = np.clip(np.sum((point - begin) * along, axis=1) / square, 0.0, 1.0)
    return np.linalg.norm(begin + share[:, None] * along - point, axis=1)
