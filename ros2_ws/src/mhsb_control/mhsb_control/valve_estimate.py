"""Estimates of the servo valves' gain and overlap, from openings and piston motion.

In a window the piston moves steadily in one direction, with the valve open by x. Then

    ΔL = a ∫ G |x| dt − b ∫ G dt − c ΔF/k_h   (all signed by the motion)

G is the piston speed per opening [m/s] of the machine file's valve at the measured pressures. F is
the cylinder force and k_h the oil's stiffness by the file. A valve with g times the file's gain and
the overlap o has a = g/(1 − o) and b = a o. Oil of another bulk modulus has c = β/β_true. A Kalman
filter updates a, b, c window by window; they follow slow random walks. The valve is inverted by

    |x| = |u|/(a G) + o min(|u|/u_s, 1).

A parameter without data keeps its standard deviation. A piston may be commanded to move while its
reference rests. If it moves less than commanded, that indicates overlap, with a as estimated by
then.

Source: J.-J. Slotine, W. Li, Applied Nonlinear Control, Section 8.7 (least squares with integrated
regressors); G. Tao, P. Kokotović, Adaptive Control of Plants with Unknown Dead-zones (the smooth
inverse).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.records import Record, Records, create_records
from mhsb_model.types import FloatArray

WINDOW_STEPS = 40
"""Number of steps in a window."""

MIN_MOVING_SPEED = 1e-3
"""Piston speed of the reference [m/s] above which a motion counts as steady."""

MIN_STROKE_SHARE = 0.3
"""Share of the reference's stroke that a piston must have moved for the valve to have been open."""

MIN_STROKE_LAG = 1e-5
"""Smallest lag of a resting piston behind its commanded stroke that is used for estimation [m]."""

INITIAL_DEVIATIONS = (0.15, 0.02, 0.3)
"""Initial standard deviations of a, b, c."""

DRIFT_DEVIATIONS = (2e-3, 3e-4, 3e-3)
"""Standard deviations of the random walks of a, b, c in one window."""

LENGTH_DEVIATION, STROKE_DEVIATION = 3e-6, 0.03
"""Standard deviations of a window's stroke: by length readings [m], and as a share of itself."""

GAIN_RANGE = (0.5, 1.6)
"""Smallest and largest a that are used for the valve's inverse."""
LARGEST_OVERLAP = 0.06
"""Largest overlap that is used for the valve's inverse, as a share of the spool's stroke."""

OVERLAP_SPEED = 3e-4
"""u_s: demand [m/s] below which the overlap is crossed in part, so that noise does not cross it."""


class EstimatedValve(Record):
    """Estimates of one valve that its inverse uses, and its present window."""

    gain: float
    """Estimate a, limited to GAIN_RANGE."""
    overlap: float
    """Overlap o, limited to 0 … LARGEST_OVERLAP."""
    opening: float
    """Opening x of the last step; 0 if the servo did not set it freely."""
    speed_gain: float
    """Speed G per opening in the last step [m/s]."""
    steps: int
    """Number of steps in the present window."""
    sign: float
    """Sign of the motion in the window, or of the opening if the reference rests."""
    moves: int
    """1 if the reference moves in the window."""
    opening_integral: float
    """∫ G |x| dt [m]."""
    gain_integral: float
    """∫ G dt [m]."""
    reference_stroke: float
    """∫ |v_ref| dt [m]."""
    length: float
    """Cylinder length at the start of the window [m]."""
    force: float
    """Cylinder force at the start of the window [N]."""


class ValveEstimates(NamedTuple):
    """Estimates of n valves."""

    records: Records[EstimatedValve]  # [n]
    estimate: FloatArray  # [n, 3] a, b, c
    covariance: FloatArray  # [n, 3, 3] covariance of a, b, c


def build_valve_estimates(count: int) -> ValveEstimates:
    """Return the initial estimates of valves: a = c = 1, b = 0, with INITIAL_DEVIATIONS.

    Args:
        count: Number n of valves.

    Returns:
        The estimates.
    """
    records = create_records(EstimatedValve, count)
    records["gain"] = 1.0
    covariance = np.tile(np.diag(np.square(INITIAL_DEVIATIONS)), (count, 1, 1))
    return ValveEstimates(records, np.tile(np.array([1.0, 0.0, 1.0]), (count, 1)), covariance)


@kernel(inline="always")
def compute_opening(valve: EstimatedValve, demand: float) -> float:
    """Return the valve opening that produces a demanded piston speed.

        x = u/(G a) + o clip(u/u_s, −1, 1)

    Args:
        valve: Estimates and window of the valve.
        demand: u, piston speed [m/s].

    Returns:
        Opening x, a share of the spool's stroke, not limited to −1 … 1. Positive extends.
    """
    across = min(max(demand / OVERLAP_SPEED, -1.0), 1.0)
    return demand / (valve.speed_gain * valve.gain) + valve.overlap * across


@kernel(borrows=True)
def accumulate_valve_window(
    valves: ValveEstimates,
    j: int,
    speed: float,
    length: float,
    force: float,
    stiffness: float,
    step: float,
) -> None:
    """Add one step of a valve to its window, and update the estimate if the window is full.

    A window is discarded if the valve saturates, is shut or opens against the motion, or if the
    reference reverses, starts or stops. If the reference moves, a full window updates a, b and c by
    the balance of the module's text. It is skipped if the piston moved less than MIN_STROKE_SHARE
    of the reference's stroke.

    If the reference rests, the sign of the opening counts as direction. A full window is then used
    only if the piston moved at least MIN_STROKE_LAG less than the estimates predict. Its balance
    takes the term of a as known.

    Args:
        valves: Estimates, updated in place. After an update also `gain`, limited to GAIN_RANGE, and
            `overlap`, limited to 0 … LARGEST_OVERLAP.
        j: Index of the valve.
        speed: v_ref, piston speed of the reference [m/s].
        length: Measured cylinder length [m].
        force: Measured cylinder force [N].
        stiffness: k_h, stiffness of the oil [N/m].
        step: Control period [s].
    """
    valve = valves.records[j]
    opening, gain = valve.opening, valve.speed_gain
    moves = abs(speed) >= MIN_MOVING_SPEED
    sign = math.copysign(1.0, speed if moves else opening)
    steady = opening * sign > 0.0 and abs(opening) < 1.0
    if not steady or (valve.steps > 0 and (sign != valve.sign or moves != valve.moves)):
        valve.steps = 0
        return
    if valve.steps == 0:
        valve.sign, valve.moves, valve.length, valve.force = sign, moves, length, force
        valve.opening_integral = valve.gain_integral = valve.reference_stroke = 0.0
        valve.steps = 1
        return
    valve.opening_integral += gain * abs(opening) * step
    valve.gain_integral += gain * step
    valve.reference_stroke += abs(speed) * step
    valve.steps += 1
    if valve.steps <= WINDOW_STEPS:
        return
    valve.steps = 0
    way = sign * (length - valve.length)
    squeezed = sign * (force - valve.force) / stiffness
    estimate, covariance = valves.estimate[j], valves.covariance[j]
    if moves:
        if way < MIN_STROKE_SHARE * valve.reference_stroke:
            return
        update_valve_filter(
            estimate, covariance, way, valve.opening_integral, -valve.gain_integral, -squeezed
        )
    else:
        passed = estimate[0] * valve.opening_integral
        unexplained = passed - estimate[1] * valve.gain_integral - estimate[2] * squeezed
        if unexplained < max(way, 0.0) + MIN_STROKE_LAG:
            return
        update_valve_filter(
            estimate, covariance, way - passed, 0.0, -valve.gain_integral, -squeezed
        )
    a, b = estimate[0], estimate[1]
    valve.gain = min(max(a, GAIN_RANGE[0]), GAIN_RANGE[1])
    valve.overlap = min(max(b / valve.gain, 0.0), LARGEST_OVERLAP)


@kernel(borrows=True)
def update_valve_filter(
    estimate: FloatArray, covariance: FloatArray, y: float, p: float, s: float, f: float
) -> None:
    """Update a, b, c from the balance of a window, by a Kalman filter.

        y = p a + s b + f c + noise

    The variances of a, b and c first grow by the squares of DRIFT_DEVIATIONS. The noise has the
    standard deviation LENGTH_DEVIATION and the share STROKE_DEVIATION of y.

    Args:
        estimate: a, b, c, float64[3]. Written in place.
        covariance: Their covariance, float64[3, 3]. Written in place.
        y: Stroke of the window [m].
        p: Coefficient of a [m].
        s: Coefficient of b [m].
        f: Coefficient of c [m].
    """
    row = (p, s, f)
    for i in range(3):
        covariance[i, i] += DRIFT_DEVIATIONS[i] * DRIFT_DEVIATIONS[i]
    carried = (
        covariance[0, 0] * p + covariance[0, 1] * s + covariance[0, 2] * f,
        covariance[1, 0] * p + covariance[1, 1] * s + covariance[1, 2] * f,
        covariance[2, 0] * p + covariance[2, 1] * s + covariance[2, 2] * f,
    )
    spread = LENGTH_DEVIATION * LENGTH_DEVIATION + STROKE_DEVIATION * STROKE_DEVIATION * y * y
    away = y
    for i in range(3):
        spread += row[i] * carried[i]
        away -= row[i] * estimate[i]
    for i in range(3):
        estimate[i] += carried[i] / spread * away
        for k in range(3):
            covariance[i, k] -= carried[i] * carried[k] / spread
