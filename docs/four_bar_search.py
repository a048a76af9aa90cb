"""Find a four-bar for a joint.

    python docs/four_bar_search.py LOWER UPPER ARM DIRECTION    # degrees, degrees, mm, degrees

Differential evolution over lengths and angles of a four-bar and its two ways of being assembled,
for the moment arm that differs least from the wanted one between the limits. The cylinder is
fixed in the given direction from the joint, in the parent link's frame; that is a free choice, as
all pins can be turned about the joint together.
"""

from __future__ import annotations

import math
import sys
from typing import Literal

import numpy as np
from numba import njit
from scipy.optimize import differential_evolution

from mhsb_model.linkages import four_bar, linkage
from mhsb_model.schema import FourBar, Pin
from mhsb_model.types import FloatArray

PINS, BARS, TURN = (0.03, 0.1), (0.03, 0.1), (-math.pi, math.pi)
BOUNDS = (PINS, TURN, BARS, BARS, PINS, TURN, (0.12, 0.45))
"""Of the numbers that `as_linkage` takes [m, rad]."""

LARGEST_COSINE = 0.9
"""Of the transmission angle, 26° from the line in which the four-bar locks."""

DEAD_LENGTH = 0.1
"""Length of a drawn-in cylinder beyond its stroke [m]."""


Side = Literal["left", "right"]


def as_linkage(x: FloatArray, side: Side, direction: float) -> FourBar:
    """Make the four-bar of seven numbers, in the order of the fields below."""
    return FourBar(
        kind="four_bar",
        rocker_pivot=Pin(radius=x[0], angle=x[1]),
        rocker_length=x[2],
        rocker_side=side,
        coupler_length=x[3],
        child_pin=Pin(radius=x[4], angle=x[5]),
        parent_pin=Pin(radius=x[6], angle=direction),
    )


@njit(cache=True)
def cost(row: FloatArray, grid: FloatArray, wanted: float) -> float:
    """Largest relative deviation of the arm, and what breaks a rule, as a penalty."""
    deviation, locked, shortest, longest = 0.0, 0.0, 1e9, 0.0
    for q in grid:
        cosine = abs(four_bar.cos_transmission_angle(row, q))
        locked += max(0.0, cosine - LARGEST_COSINE)
        deviation = max(deviation, abs(linkage.moment_arm(row, q) / wanted - 1.0))
        length = linkage.cylinder_length(row, q)
        shortest, longest = min(shortest, length), max(longest, length)
    return deviation + 10.0 * locked + 50.0 * max(0.0, longest + DEAD_LENGTH - 2.0 * shortest)


def find_four_bar(lower: float, upper: float, wanted: float, direction: float) -> FourBar:
    """Find the four-bar whose arm keeps closest to `wanted` [m] over [lower, upper] rad."""
    grid = np.linspace(lower, upper, 45)

    def deviation(x: FloatArray, side: Side) -> float:
        return cost(linkage.build_linkage_row(as_linkage(x, side, direction)), grid, wanted)

    sides: tuple[Side, Side] = ("left", "right")
    found = []
    for side in sides:
        result = differential_evolution(
            deviation, BOUNDS, (side,), seed=0, maxiter=1000, popsize=30, tol=1e-6
        )
        found.append((result.fun, side, result.x))
    _, side, x = min(found, key=lambda each: each[0])
    return as_linkage(x, side, direction)


if __name__ == "__main__":
    lower, upper, direction = (math.radians(float(sys.argv[k])) for k in (1, 2, 4))
    best = find_four_bar(lower, upper, 1e-3 * float(sys.argv[3]), direction)
    for name, value in best.model_dump().items():
        print(f"{name}: {value}")
    least, largest = linkage.moment_arm_range(linkage.build_linkage_row(best), lower, upper)
    print(f"# arm {1e3 * least:.1f} … {1e3 * largest:.1f} mm")
