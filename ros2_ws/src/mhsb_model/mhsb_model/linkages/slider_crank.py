"""Inverted slider-crank: a cylinder between a pin on the parent link and one on the child link.

    L = √(u² + v² − 2 u v cos θ),  θ = θ₀ + q

u and v are the distances of the pins from the joint's axis. θ is the angle from the parent link's
pin to the child link's pin, and θ₀ its value at q = 0.

Kernels take a linkage as a row of numbers. Element 0 is the kind of linkage, 1 is u² + v², 2 is
u v cos θ₀ and 3 is u v sin θ₀ [m²].
"""

import math

from mhsb_model.kernels.kernel import kernel
from mhsb_model.schema import SliderCrank
from mhsb_model.types import FloatArray

SMALLEST_LENGTH = 1e-9
"""Lower bound on the cylinder length [m], so that results stay finite if the pins coincide."""


def list_row_numbers(linkage: SliderCrank) -> list[float]:
    """Return the numbers that describe a slider-crank linkage in the form that kernels take.

    u and v are the distances of both pins, on the parent and the child link, from the joint's axis.
    θ₀ is the angle between the pins at q = 0. Kernels take a row of numbers that begins with the
    kind of linkage. The result does not include the kind.

    Args:
        linkage: Slider-crank of a machine file.

    Returns:
        u² + v², u v cos θ₀ and u v sin θ₀ [m²].
    """
    u, v = linkage.parent_pin.radius, linkage.child_pin.radius
    ahead = linkage.child_pin.angle - linkage.parent_pin.angle
    return [u * u + v * v, u * v * math.cos(ahead), u * v * math.sin(ahead)]


@kernel(borrows=True, forceinline=True, reads=True)
def evaluate_slider_crank(
    row: FloatArray, cosine: float, sine: float
) -> tuple[float, float, float]:
    """Compute cylinder length, moment arm and slope of the moment arm of a slider-crank.

        L = √(u² + v² − 2 u v cos θ),  r = u v sin θ / L,  dr/dq = (u v cos θ − r²) / L

    u and v are the distances of the cylinder's pins from the joint's axis. θ = θ₀ + q is the angle
    between the lines from the axis to the pins.

    Args:
        row: Numbers of the slider-crank, from `build_linkage_row`, float64[LINKAGE_WIDTH].
        cosine: cos q.
        sine: sin q.

    Returns:
        Cylinder length L [m], moment arm r = dL/dq [m], and dr/dq [m/rad].
    """
    along, across = row[2] * cosine - row[3] * sine, row[3] * cosine + row[2] * sine
    length = math.sqrt(max(row[1] - 2.0 * along, SMALLEST_LENGTH * SMALLEST_LENGTH))
    arm = across / length
    return length, arm, (along - arm * arm) / length
