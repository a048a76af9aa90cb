"""Inverted slider-crank: a cylinder between a pin on the parent link and one on the child link.

    L = √(u² + v² − 2 u v cos θ),  θ = θ₀ ± q

with the pins' distances u, v from the joint's axis and the angle θ between them as seen from it.
A row of its numbers holds u [m], v [m], θ₀ [rad], dθ/dq [±1] behind the kind of linkage.
"""

from __future__ import annotations

import math

from numba import njit

from mhsb_model.schema import SliderCrank
from mhsb_model.types import FloatArray


def numbers(linkage: SliderCrank) -> list[float]:
    """What a row holds behind the kind of linkage."""
    ahead = linkage.child_pin.angle - linkage.parent_pin.angle
    direction = 1.0 if ahead > 0 else -1.0
    return [linkage.parent_pin.radius, linkage.child_pin.radius, direction * ahead, direction]


@njit(cache=True, nogil=True)
def cylinder_length(row: FloatArray, q: float) -> float:
    """L [m] at the joint angle q [rad]: distance between the cylinder's pins."""
    u, v = row[1], row[2]
    theta = row[3] + row[4] * q
    return math.sqrt(u * u + v * v - 2.0 * u * v * math.cos(theta))


@njit(cache=True, nogil=True)
def moment_arm(row: FloatArray, q: float) -> float:
    """r = dL/dq = ±u v sin θ / L [m]."""
    u, v = row[1], row[2]
    theta = row[3] + row[4] * q
    return row[4] * u * v * math.sin(theta) / cylinder_length(row, q)


@njit(cache=True, nogil=True)
def moment_arm_slope(row: FloatArray, q: float) -> float:
    """dr/dq = (u v cos θ − r²) / L [m/rad]."""
    u, v = row[1], row[2]
    theta = row[3] + row[4] * q
    r = moment_arm(row, q)
    return (u * v * math.cos(theta) - r * r) / cylinder_length(row, q)
