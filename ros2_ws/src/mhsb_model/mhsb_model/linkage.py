"""Linkages: cylinder length and moment arm as functions of the joint angle.

A linkage is one row of `LINKAGE_WIDTH` numbers, its kind first, so that kernels can take the
linkages of all joints as one array. Sign convention: r = dL/dq, so that τ = r F and the piston's
speed is r q̇; r is negative where extension turns the joint negatively.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mhsb_model.schema import Linkage, SliderCrank
from mhsb_model.types import FloatArray

SLIDER_CRANK = 0.0
LINKAGE_WIDTH = 5
"""kind, then for a slider-crank: u [m], v [m], θ at q = 0 [rad], dθ/dq [±1]."""


def linkage_row(linkage: Linkage) -> FloatArray:
    """Numbers of a linkage as the kernels take them, float64[LINKAGE_WIDTH]."""
    return _slider_crank_row(linkage)


def _slider_crank_row(linkage: SliderCrank) -> FloatArray:
    ahead = linkage.child_pin.angle - linkage.parent_pin.angle
    direction = 1.0 if ahead > 0 else -1.0
    return np.array(
        [
            SLIDER_CRANK,
            linkage.parent_pin.radius,
            linkage.child_pin.radius,
            direction * ahead,
            direction,
        ]
    )


@njit(cache=True, nogil=True)
def cylinder_length(linkage: FloatArray, q: float) -> float:
    """L = √(u² + v² − 2 u v cos θ), θ = θ₀ ± q [m]: distance between the cylinder's pins."""
    u, v = linkage[1], linkage[2]
    theta = linkage[3] + linkage[4] * q
    return math.sqrt(u * u + v * v - 2.0 * u * v * math.cos(theta))


@njit(cache=True, nogil=True)
def moment_arm(linkage: FloatArray, q: float) -> float:
    """r = dL/dq = ±u v sin θ / L [m]."""
    u, v = linkage[1], linkage[2]
    theta = linkage[3] + linkage[4] * q
    return linkage[4] * u * v * math.sin(theta) / cylinder_length(linkage, q)


@njit(cache=True, nogil=True)
def moment_arm_slope(linkage: FloatArray, q: float) -> float:
    """dr/dq = (u v cos θ − r²) / L [m/rad]; piston acceleration is r q̈ + dr/dq q̇²."""
    u, v = linkage[1], linkage[2]
    theta = linkage[3] + linkage[4] * q
    r = moment_arm(linkage, q)
    return (u * v * math.cos(theta) - r * r) / cylinder_length(linkage, q)


@njit(cache=True, nogil=True)
def joint_angle(
    linkage: FloatArray, length: float, lower: float, upper: float, guess: float
) -> float:
    """q with L(q) = `length` [m], between the limits [rad], by Newton's method from `guess` [rad].

    The moment arm keeps its sign between the limits, so there is one such angle; lengths beyond
    the limits give the nearer limit.
    """
    q = min(upper, max(lower, guess))
    for _ in range(50):
        step = (length - cylinder_length(linkage, q)) / moment_arm(linkage, q)
        moved = min(upper, max(lower, q + step))
        if abs(moved - q) < 1e-15:
            return moved
        q = moved
    return q


def moment_arm_range(linkage: FloatArray, lower: float, upper: float) -> tuple[float, float]:
    """Least and largest signed moment arm over [lower, upper] rad, on a 0.1° grid [m]."""
    steps = max(2, int(math.degrees(upper - lower) * 10) + 1)
    arms = [moment_arm(linkage, q) for q in np.linspace(lower, upper, steps)]
    return min(arms), max(arms)
