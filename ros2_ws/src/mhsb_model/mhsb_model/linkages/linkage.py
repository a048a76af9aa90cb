"""Linkages: cylinder length and moment arm as functions of the joint angle.

A linkage is one row of `LINKAGE_WIDTH` numbers, its kind first, so that kernels can take the
linkages of all joints as one array. Sign convention: r = dL/dq, so that τ = r F and the piston's
speed is r q̇; r is negative where extension turns the joint negatively. The equations of the
kinds are in `slider_crank` and `four_bar`. What is `EVEN` has L = L₀ + r q: a direct cylinder along
a telescope, with q [m] in place of an angle and r = 1, and what slews, with r its pitch radius.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages import four_bar, slider_crank
from mhsb_model.schema import Direct, FourBar, Linkage, SliderCrank
from mhsb_model.types import FloatArray

SLIDER_CRANK = 0.0
FOUR_BAR = 1.0
EVEN = 2.0
LINKAGE_WIDTH = 10
"""The kind, then the numbers of the longer kind; the shorter one leaves the last at zero."""

LAST_STEP = 1e-7
"""Newton's method has converged once a step is shorter than this [rad]."""


def linkage_row(linkage: Linkage, lower: float = 0.0) -> FloatArray:
    """Numbers of a linkage as the kernels take them, float64[LINKAGE_WIDTH].

    lower  limit [rad] of what slews, where it is at 0 m
    """
    if isinstance(linkage, SliderCrank):
        numbers = [SLIDER_CRANK, *slider_crank.numbers(linkage)]
    elif isinstance(linkage, FourBar):
        numbers = [FOUR_BAR, *four_bar.numbers(linkage)]
    elif isinstance(linkage, Direct):
        numbers = [EVEN, linkage.retracted_length, 1.0]
    else:
        radius = linkage.pitch_radius
        numbers = [EVEN, -radius * lower, radius]
    row = np.zeros(LINKAGE_WIDTH)
    row[: len(numbers)] = numbers
    return row


@kernel(inline="always")
def motion(linkage: FloatArray, q: float) -> tuple[float, float, float]:
    """L(q) [m], r = dL/dq [m] and dr/dq [m/rad] at the joint angle q [rad]."""
    if linkage[0] == EVEN:
        return linkage[1] + linkage[2] * q, linkage[2], 0.0
    return motion_at(linkage, math.cos(q), math.sin(q))


@kernel(inline="always")
def motion_at(linkage: FloatArray, cosine: float, sine: float) -> tuple[float, float, float]:
    """The same at cos q and sin q, where they are known; not for what is even."""
    if linkage[0] == FOUR_BAR:
        _, _, length, arm, slope = four_bar.motion(linkage, cosine, sine)
        return length, arm, slope
    return slider_crank.motion(linkage, cosine, sine)


@kernel
def cylinder_length(linkage: FloatArray, q: float) -> float:
    """L(q) [m]: distance between the cylinder's pins at the joint angle q [rad]."""
    return motion(linkage, q)[0]


@kernel
def moment_arm(linkage: FloatArray, q: float) -> float:
    """r = dL/dq [m]."""
    return motion(linkage, q)[1]


@kernel
def moment_arm_slope(linkage: FloatArray, q: float) -> float:
    """dr/dq [m/rad]; piston acceleration is r q̈ + dr/dq q̇²."""
    return motion(linkage, q)[2]


@kernel
def motions(linkage: FloatArray, angles: FloatArray) -> FloatArray:
    """`motion` at each of the joint angles float64[k] [rad], float64[k, 3]."""
    found = np.empty((len(angles), 3))
    for k in range(len(angles)):
        found[k, 0], found[k, 1], found[k, 2] = motion(linkage, angles[k])
    return found


@kernel
def joint_angle(
    linkage: FloatArray, length: float, lower: float, upper: float, guess: float
) -> float:
    """q with L(q) = `length` [m], between the limits [rad], by Newton's method from `guess` [rad].

    The moment arm keeps its sign between the limits, so there is one such angle; lengths beyond
    the limits give the nearer limit. Where a step leaves the interval in which the angle is known
    to be, the interval is halved. A last step of d leaves an error of d² r′/2r.
    """
    q = min(upper, max(lower, guess))
    below, above = lower - 1.0, upper + 1.0
    for _ in range(100):
        reached, arm, _ = motion(linkage, q)
        step = (length - reached) / arm
        moved = min(upper, max(lower, q + step))
        if abs(moved - q) < LAST_STEP:
            return moved
        if step > 0.0:
            below = q
        else:
            above = q
        if not below < moved < above:
            moved = 0.5 * (max(below, lower) + min(above, upper))
        q = moved
    return q


def moment_arm_range(linkage: FloatArray, lower: float, upper: float) -> tuple[float, float]:
    """Least and largest signed moment arm over [lower, upper] rad, on a 0.1° grid [m]."""
    arms = motions(linkage, angle_grid(lower, upper))[:, 1]
    return float(arms.min()), float(arms.max())


def angle_grid(lower: float, upper: float) -> FloatArray:
    """Angles from `lower` to `upper`, both included, at most 0.1° apart [rad]."""
    return np.linspace(lower, upper, max(2, math.ceil(math.degrees(upper - lower) * 10) + 1))
