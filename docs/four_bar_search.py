"""Find a four-bar for a joint.

    python docs/four_bar_search.py -110 40 -45 165    # --help explains the four numbers

Differential evolution over lengths and angles of a four-bar and its two ways of being assembled,
for the moment arm that differs least from the wanted one between the limits. The cylinder is
fixed in the given direction from the joint, in the parent link's frame; that is a free choice, as
all pins can be turned about the joint together.
"""

from __future__ import annotations

import math
import sys
from typing import Annotated, Literal

import numpy as np
from scipy.optimize import differential_evolution
from tyro.conf import Positional
from tyro.conf import arg as describe

from mhsb_model import command_line
from mhsb_model.command_line import NumberRange
from mhsb_model.kernels.kernel import kernel
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

ANGLE_RANGE = NumberRange(-360.0, 360.0, "°")
"""Range of the joint limits and of the direction."""

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


@kernel
def cost(row: FloatArray, grid: FloatArray, wanted: float) -> float:
    """Largest relative deviation of the arm, and what breaks a rule, as a penalty."""
    deviation, locked, shortest, longest = 0.0, 0.0, 1e9, 0.0
    for q in grid:
        cosine = abs(four_bar.cos_transmission_angle(row, q))
        locked += max(0.0, cosine - LARGEST_COSINE)
        length, arm, _ = linkage.evaluate_linkage(row, q)
        deviation = max(deviation, abs(arm / wanted - 1.0))
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
            deviation, BOUNDS, (side,), seed=0, maxiter=300, popsize=15, tol=1e-3
        )
        found.append((result.fun, side, result.x))
    _, side, x = min(found, key=lambda each: each[0])
    return as_linkage(x, side, direction)


def search(
    lower: Annotated[float, Positional, describe(metavar="LOWER"), ANGLE_RANGE],
    upper: Annotated[float, Positional, describe(metavar="UPPER"), ANGLE_RANGE],
    arm: Annotated[float, Positional, describe(metavar="ARM"), NumberRange(-100.0, 100.0, "mm")],
    direction: Annotated[float, Positional, describe(metavar="DIRECTION"), ANGLE_RANGE],
) -> None:
    """Search the four-bar with the most constant moment arm, and print it for a machine file.

    Pins and bars are 30 to 100 mm long, the cylinder's pin is 120 to 450 mm from the joint. For a
    larger machine, divide ARM by a factor and multiply all lengths of the result by it.

    Args:
        lower: Lower limit of the joint [°].
        upper: Upper limit of the joint [°].
        arm: Wanted moment arm [mm]: positive if a longer cylinder means a larger joint
            angle, else negative.
        direction: Direction from the joint to the cylinder's pin on the parent link [°]: 0 ahead
            along this link, 90 above it, 180 back along it.

    Raises:
        UsageError: `lower` is not below `upper`, or `arm` is 0.
    """
    if lower >= upper:
        raise command_line.UsageError(f"LOWER {lower:g}° must be below UPPER {upper:g}°")
    if arm == 0.0:
        raise command_line.UsageError("ARM must not be 0 mm: such a cylinder turns nothing")
    low, high = math.radians(lower), math.radians(upper)
    best = find_four_bar(low, high, 1e-3 * arm, math.radians(direction))
    for name, value in best.model_dump().items():
        print(f"{name}: {value}")
    least, largest = linkage.moment_arm_range(linkage.build_linkage_row(best), low, high)
    print(f"# arm {1e3 * least:.1f} … {1e3 * largest:.1f} mm")


if __name__ == "__main__":
    sys.exit(command_line.run(search))
