"""What a servo valve is like, learnt from what has passed it: its gain and its overlap.

Over a window in which the piston moves steadily one way, the valve open by x,

    ΔL = a ∫ G |x| dt − b ∫ G dt − c ΔF/k_h   (all signed by the motion)

with G the speed per opening [m/s] of the valve that the machine file has, at the measured
pressures, F the cylinder's force and k_h the oil's stiffness by the file. A valve with g times that
gain and the overlap o has a = g/(1 − o), b = a o; oil of another bulk modulus c = β/β_true. A
Kalman filter with slowly wandering a, b, c takes up window after window. The valve is inverted by

    |x| = |u|/(a G) + o min(|u|/u_s, 1).

What the motion does not tell keeps its standard deviation. A piston that is told to move while its
reference rests, and moves less than that, tells of overlap, too, with a as it is known by then.
Source: J.-J. Slotine, W. Li, Applied Nonlinear Control, Section 8.7 (least squares with integrated
regressors); G. Tao, P. Kokotović, Adaptive Control of Plants with Unknown Dead-zones (the smooth
inverse).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray
from mhsb_sim.records import Record, Records

WINDOW = 40
"""Steps of a window."""

SLOWEST = 1e-3
"""Speed of the reference [m/s] from which on a piston moves steadily enough."""

LEAST_SHARE = 0.3
"""Share of the reference's way that a piston has to have gone for the valve to have been open."""

LEAST_TOLD = 1e-5
"""Way [m] that a resting piston has to lack of what it was told, to be learnt from."""

DEVIATION = (0.15, 0.02, 0.3)
"""Standard deviations of a, b, c before anything is learnt."""

WANDER = (2e-3, 3e-4, 3e-3)
"""Standard deviations by which they may wander from window to window."""

READING, MODEL = 3e-6, 0.03
"""Standard deviation of a window's way: by reading its length [m], and as a share of itself."""

GAIN_RANGE = (0.5, 1.6)
LARGEST_OVERLAP = 0.06
"""What is taken for an estimate at most."""

EDGE = 3e-4
"""u_s: demand [m/s] below which the overlap is crossed in part, so that noise does not cross it."""

VALVE = np.dtype(
    [
        ("gain", "f8"),  # a
        ("overlap", "f8"),  # o
        ("opening", "f8"),  # x of the last step, 0 where the valve was not the servo's to open
        ("speed_gain", "f8"),  # G of the last step [m/s]
        ("steps", "i8"),  # of the window so far
        ("sign", "f8"),  # of the motion in it, or of the opening where the reference rests
        ("moves", "i8"),  # 1 where the reference moves in it
        ("opened", "f8"),  # m, ∫ G |x| dt
        ("open", "f8"),  # m, ∫ G dt
        ("wanted", "f8"),  # m, ∫ |v_ref| dt
        ("length", "f8"),  # m, at its start
        ("force", "f8"),  # N, at its start
    ]
)


class Valves(NamedTuple):
    """What is known of n valves."""

    records: Records  # VALVE[n]
    estimate: FloatArray  # [n, 3] a, b, c
    covariance: FloatArray  # [n, 3, 3]


def valves_of(count: int) -> Valves:
    """Valves as the machine file has them, not known well."""
    records = np.zeros(count, VALVE)
    records["gain"] = 1.0
    covariance = np.tile(np.diag(np.square(DEVIATION)), (count, 1, 1))
    return Valves(records, np.tile(np.array([1.0, 0.0, 1.0]), (count, 1)), covariance)


@kernel(inline="always")
def inverse(valve: Record, demand: float) -> float:
    """Opening for the piston speed `demand` [m/s]."""
    across = min(max(demand / EDGE, -1.0), 1.0)
    return demand / (valve.speed_gain * valve.gain) + valve.overlap * across


@kernel(borrows=True)
def learn(
    valves: Valves,
    j: int,
    speed: float,
    length: float,
    force: float,
    stiffness: float,
    step: float,
) -> None:
    """Take a step into valve j's window, and learn from the window when it is full.

    speed: v_ref [m/s]; length [m] and force [N] measured now; stiffness: k_h [N/m].
    """
    valve = valves.records[j]
    opening, gain = valve.opening, valve.speed_gain
    moves = abs(speed) >= SLOWEST
    sign = math.copysign(1.0, speed if moves else opening)
    steady = opening * sign > 0.0 and abs(opening) < 1.0
    if not steady or (valve.steps > 0 and (sign != valve.sign or moves != valve.moves)):
        valve.steps = 0
        return
    if valve.steps == 0:
        valve.sign, valve.moves, valve.length, valve.force = sign, moves, length, force
        valve.opened = valve.open = valve.wanted = 0.0
        valve.steps = 1
        return
    valve.opened += gain * abs(opening) * step
    valve.open += gain * step
    valve.wanted += abs(speed) * step
    valve.steps += 1
    if valve.steps <= WINDOW:
        return
    valve.steps = 0
    way = sign * (length - valve.length)
    squeezed = sign * (force - valve.force) / stiffness
    estimate, covariance = valves.estimate[j], valves.covariance[j]
    if moves:
        if way < LEAST_SHARE * valve.wanted:
            return
        update(estimate, covariance, way, valve.opened, -valve.open, -squeezed)
    else:
        passed = estimate[0] * valve.opened
        told = passed - estimate[1] * valve.open - estimate[2] * squeezed
        if told < max(way, 0.0) + LEAST_TOLD:
            return
        update(estimate, covariance, way - passed, 0.0, -valve.open, -squeezed)
    a, b = estimate[0], estimate[1]
    valve.gain = min(max(a, GAIN_RANGE[0]), GAIN_RANGE[1])
    valve.overlap = min(max(b / valve.gain, 0.0), LARGEST_OVERLAP)


@kernel(borrows=True)
def update(
    estimate: FloatArray, covariance: FloatArray, y: float, p: float, s: float, f: float
) -> None:
    """Kalman filter: y = p a + s b + f c + noise. Writes estimate[3] and covariance[3, 3]."""
    row = (p, s, f)
    for i in range(3):
        covariance[i, i] += WANDER[i] * WANDER[i]
    carried = (
        covariance[0, 0] * p + covariance[0, 1] * s + covariance[0, 2] * f,
        covariance[1, 0] * p + covariance[1, 1] * s + covariance[1, 2] * f,
        covariance[2, 0] * p + covariance[2, 1] * s + covariance[2, 2] * f,
    )
    spread = READING * READING + MODEL * MODEL * y * y
    away = y
    for i in range(3):
        spread += row[i] * carried[i]
        away -= row[i] * estimate[i]
    for i in range(3):
        estimate[i] += carried[i] / spread * away
        for k in range(3):
            covariance[i, k] -= carried[i] * carried[k] / spread
