"""Inverted slider-crank: a cylinder between a pin on the parent link and one on the child link.

    L = √(u² + v² − 2 u v cos θ),  θ = θ₀ ± q

with the pins' distances u, v from the joint's axis and the angle θ between them as seen from it.
A row of its numbers holds u [m], v [m], θ₀ [rad], dθ/dq [±1] behind the kind of linkage.
"""

from __future__ import annotations

import math

from mhsb_model.kernels.kernel import kernel
from mhsb_model.schema import SliderCrank
from mhsb_model.types import FloatArray

SMALLEST_LENGTH = 1e-9
"""L is taken to be at least this [m], so that all stays finite where no cylinder can be."""


def numbers(linkage: SliderCrank) -> list[float]:
    """What a row holds behind the kind of linkage."""
    ahead = linkage.child_pin.angle - linkage.parent_pin.angle
    direction = 1.0 if ahead > 0 else -1.0
    return [linkage.parent_pin.radius, linkage.child_pin.radius, direction * ahead, direction]


@kernel(inline="always")
def motion(row: FloatArray, q: float) -> tuple[float, float, float]:
    """L [m], r = dL/dq [m] and dr/dq [m/rad] at the joint angle q [rad].

    r = ±u v sin θ / L, dr/dq = (u v cos θ − r²) / L
    """
    u, v = row[1], row[2]
    theta = row[3] + row[4] * q
    along = u * v * math.cos(theta)
    length = max(math.sqrt(u * u + v * v - 2.0 * along), SMALLEST_LENGTH)
    arm = row[4] * u * v * math.sin(theta) / length
    return length, arm, (along - arm * arm) / length
