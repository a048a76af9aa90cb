"""Four-bar linkage: the cylinder drives a rocker, a coupler drives the joint.

In the parent link's frame, with the origin O on the joint's axis: rocker pivot R, cylinder pin K,
child pin C(q), rocker tip P, at which rocker (a = |PR|), coupler (b = |PC|) and rod meet. The four
bars are parent link RO, child link OC, coupler CP and rocker PR. With D = |CR|, points as complex
numbers and × for the plane's cross product:

    cos μ = (a² + b² − D²) / 2 a b                    transmission angle, rocker to coupler
    P − R = a (C − R) (a − b e^{−iσμ}) / D²           σ = ±1: P left or right of R → C
    ω = dφ/dq = (C × P) / ((P − R) × (P − C))         rocker's turn per joint's turn
    L = |P − K|,  r = dL/dq = ω ((P − R) × (P − K)) / L

The equation of ω follows from the constant length of the coupler: (P − C)·(Ṗ − Ċ) = 0.

Kernels take a linkage as a row of numbers. Element 0 is the kind of linkage, 1 and 2 are R (x, z)
[m], 3 and 4 are K (x, z) [m], 5 is a [m], 6 is b [m], 7 is σ, 8 and 9 are C (x, z) at q = 0 [m].

Source: loop closure, R. L. Norton, Design of Machinery, Sections 4.5, 4.10 (transmission angle) and
6.7 (velocities).
"""

import math

from mhsb_model.kernels.kernel import kernel
from mhsb_model.schema import FourBar, Pin
from mhsb_model.types import FloatArray

SIDE_SIGNS = {"left": 1.0, "right": -1.0}
"""Sign σ by the side of the line R → C on which the rocker tip P lies."""

SMALLEST_SINE = 1e-3
"""Lower bound on |sin μ|, so that results stay finite if the linkage cannot be assembled."""

SMALLEST_DISTANCE = 1e-6
"""Lower bound on distances [m], so that results stay finite in singular positions."""


def list_row_numbers(linkage: FourBar) -> list[float]:
    """Return the numbers that describe a four-bar linkage in the form that kernels take.

    The order is: rocker pivot (x, z) and cylinder pin (x, z) [m]; lengths of rocker and coupler
    [m]; +1 or −1 for the rocker tip to the left or right of the line from rocker pivot to child
    pin; child pin (x, z) at q = 0 [m]. Points are in the parent link's frame with the origin at the
    joint. Kernels take a row of numbers that begins with the kind of linkage. The result does not
    include the kind.

    Args:
        linkage: Four-bar of a machine file.

    Returns:
        Nine numbers.
    """
    return [
        *_cartesian(linkage.rocker_pivot),
        *_cartesian(linkage.parent_pin),
        linkage.rocker_length,
        linkage.coupler_length,
        SIDE_SIGNS[linkage.rocker_side],
        *_cartesian(linkage.child_pin),
    ]


def _cartesian(pin: Pin) -> tuple[float, float]:
    """Return the coordinates (x, z) of a pin [m]."""
    return pin.radius * math.cos(pin.angle), pin.radius * math.sin(pin.angle)


@kernel
def cos_transmission_angle(row: FloatArray, q: float) -> float:
    """Compute the cosine of the transmission angle of a four-bar linkage.

    The transmission angle µ is the angle between rocker and coupler.

    Args:
        row: Numbers of the four-bar, from `build_linkage_row`, float64[LINKAGE_WIDTH].
        q: Joint angle [rad].

    Returns:
        cos µ. If it is outside [−1, 1], the linkage cannot be assembled at this angle.
    """
    a, b = row[5], row[6]
    cx, cz = _child_pin(row, math.cos(q), math.sin(q))
    dx, dz = cx - row[1], cz - row[2]
    return (a * a + b * b - dx * dx - dz * dz) / (2.0 * a * b)


@kernel(borrows=True, forceinline=True, reads=True)
def _child_pin(row: FloatArray, cosine: float, sine: float) -> tuple[float, float]:
    """Return the position of a four-bar's pin on the child link, turned by the joint angle q.

    Args:
        row: Numbers of the four-bar, from `build_linkage_row`, float64[LINKAGE_WIDTH].
        cosine: cos q.
        sine: sin q.

    Returns:
        (x, z) in the parent link's frame, with the origin at the joint [m].
    """
    return row[8] * cosine - row[9] * sine, row[8] * sine + row[9] * cosine


@kernel(borrows=True, forceinline=True, reads=True)
def evaluate_four_bar(
    row: FloatArray, cosine: float, sine: float
) -> tuple[float, float, float, float, float]:
    """Compute rocker, cylinder length and moment arm of a four-bar linkage at a joint angle.

    Points are in the parent link's frame, with the origin at the joint: rocker pivot R, cylinder
    pin K, child pin C, and rocker tip P. The cylinder pushes at P. Vectors are the rocker W = P −
    R, the coupler V = P − C and the cylinder U = P − K. a and b are the lengths of rocker and
    coupler, and µ is the transmission angle between them. σ = ±1 says on which side of the line RC
    the tip P is. × is the cross product:

        W×V = σ a b sin µ,   ω = C×P / W×V
        L = |U|,   r = ω W×U / L
        (W×V)′ = ω W·(W − V) − W·C
        ω′ = (ω C·W − C·P − ω (W×V)′) / (W×V)
        r′ = (ω′ W×U + ω² W·(K − R)) / L − r²/L

    A prime is a derivative with respect to the joint angle q, and ω the rocker's turn per turn of
    the joint. If the linkage cannot be assembled, the results are finite but have no meaning.

    Args:
        row: Numbers of the four-bar, from `build_linkage_row`, float64[LINKAGE_WIDTH].
        cosine: cos q.
        sine: sin q.

    Returns:
        Rocker W as x and z [m], cylinder length L [m], moment arm r = dL/dq [m], and dr/dq [m/rad].
    """
    rx, rz, kx, kz, a, b, side = row[1], row[2], row[3], row[4], row[5], row[6], row[7]
    cx, cz = _child_pin(row, cosine, sine)
    dx, dz = cx - rx, cz - rz
    square = max(dx * dx + dz * dz, SMALLEST_DISTANCE * SMALLEST_DISTANCE)
    cos_mu = (a * a + b * b - square) / (2.0 * a * b)
    sin_mu = side * math.sqrt(max(1.0 - cos_mu * cos_mu, SMALLEST_SINE * SMALLEST_SINE))
    lever = a * b * sin_mu
    along, across = a * (a - b * cos_mu) / square, lever / square
    wx, wz = along * dx - across * dz, across * dx + along * dz
    px, pz = rx + wx, rz + wz
    ux, uz = px - kx, pz - kz
    omega = (cx * pz - cz * px) / lever
    length = max(math.sqrt(ux * ux + uz * uz), SMALLEST_DISTANCE)
    turned = wx * uz - wz * ux
    arm = omega * turned / length
    c_w = cx * wx + cz * wz
    lever_slope = omega * (wx * dx + wz * dz) - c_w
    omega_slope = (omega * c_w - cx * px - cz * pz - omega * lever_slope) / lever
    turned_slope = omega * (wx * (kx - rx) + wz * (kz - rz))
    slope = (omega_slope * turned + omega * turned_slope - arm * arm) / length
    return wx, wz, length, arm, slope
