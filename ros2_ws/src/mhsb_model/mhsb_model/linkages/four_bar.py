"""Four-bar linkage: the cylinder drives a rocker, a coupler drives the joint.

In the parent link's frame, with the origin O on the joint's axis: rocker pivot R, cylinder pin K,
child pin C(q), rocker tip P, at which rocker (a = |PR|), coupler (b = |PC|) and rod meet. The four
bars are parent link RO, child link OC, coupler CP and rocker PR. With D = |CR|, points as complex
numbers and × for the plane's cross product:

    cos μ = (a² + b² − D²) / 2 a b                    transmission angle, rocker to coupler
    P − R = a (C − R) (a − b e^{−iσμ}) / D²           σ = ±1: P left or right of R → C
    ω = dφ/dq = (C × P) / ((P − R) × (P − C))         rocker's turn per joint's turn
    L = |P − K|,  r = dL/dq = ω ((P − R) × (P − K)) / L

ω says that the coupler keeps its length: (P − C)·(Ṗ − Ċ) = 0. Source: loop closure, R. L. Norton,
Design of Machinery, Sections 4.5, 4.10 (transmission angle) and 6.7 (velocities).
A row of its numbers holds, behind the kind of linkage, R, K as x, z [m], a, b [m], σ, C's radius
[m] and angle at q = 0 [rad].
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.schema import FourBar, Pin
from mhsb_model.types import FloatArray

SIDE = {"left": 1.0, "right": -1.0}

SMALLEST_SINE = 1e-3
SMALLEST_DISTANCE = 1e-6
"""sin μ and distances [m] are taken to be at least this, so that all stays finite where no
linkage can be."""


def numbers(linkage: FourBar) -> list[float]:
    """What a row holds behind the kind of linkage."""
    return [
        *_cartesian(linkage.rocker_pivot),
        *_cartesian(linkage.parent_pin),
        linkage.rocker_length,
        linkage.coupler_length,
        SIDE[linkage.rocker_side],
        linkage.child_pin.radius,
        linkage.child_pin.angle,
    ]


def _cartesian(pin: Pin) -> tuple[float, float]:
    return pin.radius * math.cos(pin.angle), pin.radius * math.sin(pin.angle)


@kernel
def cos_transmission_angle(row: FloatArray, q: float) -> float:
    """cos μ at the joint angle q [rad]; outside of [−1, 1] the linkage cannot be assembled."""
    a, b = row[5], row[6]
    dx = row[8] * math.cos(q + row[9]) - row[1]
    dz = row[8] * math.sin(q + row[9]) - row[2]
    return (a * a + b * b - dx * dx - dz * dz) / (2.0 * a * b)


@kernel
def cos_transmission_angles(row: FloatArray, angles: FloatArray) -> FloatArray:
    """cos μ at each of the joint angles float64[k] [rad], float64[k]."""
    found = np.empty(len(angles))
    for k in range(len(angles)):
        found[k] = cos_transmission_angle(row, angles[k])
    return found


@kernel(inline="always")
def motion(row: FloatArray, q: float) -> tuple[float, float, float, float, float]:
    """Rocker P − R as x, z [m], L [m], r = dL/dq [m] and dr/dq [m/rad] at the joint angle q [rad].

    With W = P − R and W×V = σ a b sin μ for V = P − C, the derivatives in q are W′ = iωW, C′ = iC,

        ω′ = (ω C·W − C·P − ω (W×V)′) / (W×V),  (W×V)′ = ω W·(W − V) − W·C
        r′ = (ω′ W×U + ω² W·(K − R)) / L − r²/L  for U = P − K
    """
    rx, rz, kx, kz, a, b, side = row[1], row[2], row[3], row[4], row[5], row[6], row[7]
    cx, cz = row[8] * math.cos(q + row[9]), row[8] * math.sin(q + row[9])
    dx, dz = cx - rx, cz - rz
    square = max(dx * dx + dz * dz, SMALLEST_DISTANCE * SMALLEST_DISTANCE)
    cosine = (a * a + b * b - square) / (2.0 * a * b)
    sine = side * math.sqrt(max(1.0 - cosine * cosine, SMALLEST_SINE * SMALLEST_SINE))
    along, across = a * (a - b * cosine) / square, a * b * sine / square
    wx, wz = along * dx - across * dz, across * dx + along * dz
    px, pz = rx + wx, rz + wz
    ux, uz = px - kx, pz - kz
    lever = a * b * sine
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
