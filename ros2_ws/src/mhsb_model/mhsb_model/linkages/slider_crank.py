"""Inverted slider-crank: a cylinder between a pin on the parent link and one on the child link.

    L = √(u² + v² − 2 u v cos θ),  θ = θ₀ + q

with the pins' distances u, v from the joint's axis and the angle θ from the parent link's pin to
the child link's. A row of its numbers holds u² + v², u v cos θ₀ and u v sin θ₀ [m²] behind the kind
of linkage.
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
    u, v = linkage.parent_pin.radius, linkage.child_pin.radius
    ahead = linkage.child_pin.angle - linkage.parent_pin.angle
    return [u * u + v * v, u * v * math.cos(ahead), u * v * math.sin(ahead)]


@kernel(inline="always")
def motion(row: FloatArray, cosine: float, sine: float) -> tuple[float, float, float]:
    """L [m], r = dL/dq [m] and dr/dq [m/rad] at cos q and sin q of the joint angle q.

    r = u v sin θ / L, dr/dq = (u v cos θ − r²) / L
    """
    along, across = row[2] * cosine - row[3] * sine, row[3] * cosine + row[2] * sine
    length = math.sqrt(max(row[1] - 2.0 * along, SMALLEST_LENGTH * SMALLEST_LENGTH))
    arm = across / length
    return length, arm, (along - arm * arm) / length
