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
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.records import Record, Records, create_record, create_records
from mhsb_model.types import FloatArray


@dataclass(frozen=True)
class ValveSettings(Record):
    """Tuned numbers of the valves' estimates and of their inverse."""

    window_steps: int = 40
    """Number of steps in a window, 5 … 500.

    Origin: at 12 mm/s a piston moves 160 `length_deviation` in 40 ms, and the motion counts as
    steady for so long.

    30 % smaller and larger, N = 5: RMS error −16.9 and −11.2 % (mhsb_arm3; overshoot −0.14 and
    −0.09 MPa), +2.6 and −8.2 % (excavator; overshoot +0.10 and −1.38 MPa, falls +0 and −1)."""
    min_moving_speed: float = 1e-3
    """Piston speed of the reference above which a motion counts as steady [m/s], 0 … 0.01.

    Origin: a twelfth of V_max of the suite's own arm. Slower motions inform on friction rather than
    on the valve.

    30 % smaller and larger, N = 5: RMS error −1.6 and −17.1 % (mhsb_arm3), −4.5 and +7.7 %
    (excavator; overshoot −2.52 and −0.40 MPa, falls +0 and +1)."""
    min_stroke_share: float = 0.3
    """Share of the reference's stroke that a piston must have moved in a window, 0 … 1.

    A piston that moved less was stuck, and its valve may have been shut. Origin: chosen.

    30 % smaller and larger, N = 5: RMS error −1.8 and +0.1 % (mhsb_arm3), +0.1 and 0 %
    (excavator; overshoot −1.31 and +0.00 MPa)."""
    min_stroke_lag: float = 1e-5
    """Smallest lag of a resting piston behind its commanded stroke that is used [m], 0 … 1e-3.

    Origin: three times `length_deviation`.

    30 % smaller and larger, N = 5: RMS error −3.6 and −0.6 % (mhsb_arm3), −3.8 and −0.8 %
    (excavator; overshoot −2.25 and +0.32 MPa)."""
    gain_deviation: float = 0.15
    """Initial standard deviation of a [-], above 0 … 1.

    Origin: config/variations.yaml, a valve gain of 0.8 … 1.2 evenly has 0.12; overlap adds to
    it.

    30 % smaller and larger, N = 5: RMS error −15.9 and −1.4 % (mhsb_arm3), −5.0 and −2.3 %
    (excavator; overshoot −2.31 and −0.39 MPa)."""
    overlap_deviation: float = 0.02
    """Initial standard deviation of b [-], above 0 … 0.5.

    Origin: config/variations.yaml, an overlap of 0 … 3 % of the stroke has a root mean square of
    0.017.

    30 % smaller and larger, N = 5: RMS error −8.3 and −5.4 % (mhsb_arm3), −4.8 and −0.6 %
    (excavator; overshoot −0.13 and −2.51 MPa)."""
    compressibility_deviation: float = 0.3
    """Initial standard deviation of c [-], above 0 … 2.

    Origin: config/variations.yaml, a bulk modulus of 0.6 … 1.6 GPa against 1 GPa.

    30 % smaller and larger, N = 5: RMS error −6.3 and −3.3 % (mhsb_arm3), −0.3 and +2.0 %
    (excavator; overshoot −2.19 and −2.30 MPa)."""
    gain_drift: float = 2e-3
    """Standard deviation of the random walk of a in one window [-], 0 … 0.1.

    Origin: chosen; a changes by 0.01 in a second of motion.

    30 % smaller and larger, N = 5: RMS error −3.3 and −8.6 % (mhsb_arm3), −2.2 and +2.6 %
    (excavator; overshoot −2.24 and −1.28 MPa)."""
    overlap_drift: float = 3e-4
    """Standard deviation of the random walk of b in one window [-], 0 … 0.1.

    Origin: chosen; b changes by 0.0015 in a second of motion.

    30 % smaller and larger, N = 5: RMS error −4.9 and −3.5 % (mhsb_arm3), +5.4 and −7.4 %
    (excavator; overshoot +0.31 and −3.75 MPa)."""
    compressibility_drift: float = 3e-3
    """Standard deviation of the random walk of c in one window [-], 0 … 0.1.

    Origin: chosen; c changes by 0.015 in a second of motion.

    30 % smaller and larger, N = 5: RMS error −3.9 and −3.1 % (mhsb_arm3), −3.0 and +1.7 %
    (excavator; overshoot −2.60 and +0.11 MPa)."""
    length_deviation: float = 3e-6
    """Standard deviation of a window's stroke by length readings [m], 0 … 1e-3.

    Origin: one step of a 16-bit encoder (96 µrad) over a moment arm of 45 mm is 4.3 µm, whose
    quantization error has 1.2 µm at each end; the rest is sensor noise.

    30 % smaller and larger, N = 5: RMS error −2.4 and −3.3 % (mhsb_arm3), +2.7 and +6.7 %
    (excavator; overshoot −0.28 and −0.80 MPa)."""
    stroke_deviation: float = 0.03
    """Standard deviation of a window's stroke, as a share of itself, 0 … 1.

    Origin: chosen; it covers the lag of the spool, which the balance leaves out.

    30 % smaller and larger, N = 5: RMS error −3.8 and −12.1 % (mhsb_arm3), −0.9 and +3.0 %
    (excavator; overshoot −1.73 and −1.11 MPa)."""
    min_gain: float = 0.5
    """Smallest a that the inverse uses [-], above 0 … 1.

    Origin: plausibility; half of the smallest valve gain in config/variations.yaml would be 0.4.

    30 % smaller and larger, N = 5: RMS error +8.1 and −2.9 % (mhsb_arm3), +0.3 and +0.4 %
    (excavator)."""
    max_gain: float = 1.6
    """Largest a that the inverse uses [-], 1 … 10.

    Origin: plausibility; a valve with 1.2 times the file's gain and 3 % overlap has 1.24.

    30 % smaller and larger, N = 5: RMS error −13.4 and 0 % (mhsb_arm3), +31.8 and 0 %
    (excavator; overshoot −2.68 and +0.00 MPa, falls +1 and +0)."""
    max_overlap: float = 0.06
    """Largest overlap that the inverse uses, as a share of the spool's stroke, 0 … 0.5.

    Origin: twice the largest overlap in data sheets of servo valves.

    30 % smaller and larger, N = 5: RMS error 0 and 0 % (mhsb_arm3), +1.0 and +0.4 % (excavator)."""
    overlap_speed: float = 3e-4
    """u_s: demand below which the overlap is crossed in part [m/s], above 0 … 0.01.

    Origin: chosen, so that sensor noise at rest does not cross the overlap.

    30 % smaller and larger, N = 5: RMS error −3.5 and −4.6 % (mhsb_arm3; overshoot +0.03 and
    −0.07 MPa), −0.9 and +3.6 % (excavator; overshoot −2.70 and −1.76 MPa)."""
    min_pressure_drop: float = 2e4
    """Smallest pressure drop that is assumed over a valve edge [Pa], above 0 … 1e6.

    Origin: chosen, so that openings stay moderate when a line is as low as its load.

    30 % smaller and larger, N = 5: RMS error −10.2 and −1.7 % (mhsb_arm3; overshoot +0.16 and
    −0.01 MPa), −1.1 and +1.9 % (excavator; overshoot +0.06 and −0.25 MPa)."""


class EstimatedValve(Record):
    """Estimates of one valve that its inverse uses, and its present window."""

    gain: float
    """Estimate a, limited to `min_gain` … `max_gain`."""
    overlap: float
    """Overlap o, limited to 0 … `max_overlap`."""
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
    settings: Records[ValveSettings]  # [1]


def build_valve_estimates(count: int, settings: ValveSettings = ValveSettings()) -> ValveEstimates:
    """Return the initial estimates of valves: a = c = 1, b = 0, with their initial deviations.

    Args:
        count: Number n of valves.
        settings: Tuned numbers.

    Returns:
        The estimates.
    """
    records = create_records(EstimatedValve, count)
    records["gain"] = 1.0
    deviations = (
        settings.gain_deviation,
        settings.overlap_deviation,
        settings.compressibility_deviation,
    )
    return ValveEstimates(
        records=records,
        estimate=np.tile(np.array([1.0, 0.0, 1.0]), (count, 1)),
        covariance=np.tile(np.diag(np.square(deviations)), (count, 1, 1)),
        settings=create_record(settings),
    )


@kernel(inline="always")
def compute_opening(valve: EstimatedValve, demand: float, settings: ValveSettings) -> float:
    """Return the valve opening that produces a demanded piston speed.

        x = u/(G a) + o clip(u/u_s, −1, 1)

    Args:
        valve: Estimates and window of the valve.
        demand: u, piston speed [m/s].
        settings: Tuned numbers, with `overlap_speed` u_s.

    Returns:
        Opening x, a share of the spool's stroke, not limited to −1 … 1. Positive extends.
    """
    across = min(max(demand / settings.overlap_speed, -1.0), 1.0)
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
    the balance of the module's text. It is skipped if the piston moved less than the share
    `min_stroke_share` of the reference's stroke.

    If the reference rests, the sign of the opening counts as direction. A full window is then used
    only if the piston moved at least `min_stroke_lag` less than the estimates predict. Its balance
    takes the term of a as known.

    Args:
        valves: Estimates, updated in place. After an update also `gain` and `overlap` within
            their limits.
        j: Index of the valve.
        speed: v_ref, piston speed of the reference [m/s].
        length: Measured cylinder length [m].
        force: Measured cylinder force [N].
        stiffness: k_h, stiffness of the oil [N/m].
        step: Control period [s].
    """
    valve, settings = valves.records[j], valves.settings[0]
    opening, gain = valve.opening, valve.speed_gain
    moves = abs(speed) >= settings.min_moving_speed
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
    if valve.steps <= settings.window_steps:
        return
    valve.steps = 0
    way = sign * (length - valve.length)
    squeezed = sign * (force - valve.force) / stiffness
    estimate, covariance = valves.estimate[j], valves.covariance[j]
    if moves:
        if way < settings.min_stroke_share * valve.reference_stroke:
            return
        update_valve_filter(
            estimate,
            covariance,
            way,
            valve.opening_integral,
            -valve.gain_integral,
            -squeezed,
            settings,
        )
    else:
        passed = estimate[0] * valve.opening_integral
        unexplained = passed - estimate[1] * valve.gain_integral - estimate[2] * squeezed
        if unexplained < max(way, 0.0) + settings.min_stroke_lag:
            return
        update_valve_filter(
            estimate, covariance, way - passed, 0.0, -valve.gain_integral, -squeezed, settings
        )
    a, b = estimate[0], estimate[1]
    valve.gain = min(max(a, settings.min_gain), settings.max_gain)
    valve.overlap = min(max(b / valve.gain, 0.0), settings.max_overlap)


@kernel(borrows=True)
def update_valve_filter(
    estimate: FloatArray,
    covariance: FloatArray,
    y: float,
    p: float,
    s: float,
    f: float,
    settings: ValveSettings,
) -> None:
    """Update a, b, c from the balance of a window, by a Kalman filter.

        y = p a + s b + f c + noise

    The variances of a, b and c first grow by their random walks. The noise has the standard
    deviation `length_deviation` and the share `stroke_deviation` of y.

    Args:
        estimate: a, b, c, float64[3]. Written in place.
        covariance: Their covariance, float64[3, 3]. Written in place.
        y: Stroke of the window [m].
        p: Coefficient of a [m].
        s: Coefficient of b [m].
        f: Coefficient of c [m].
        settings: Tuned numbers.
    """
    row = (p, s, f)
    drift = (settings.gain_drift, settings.overlap_drift, settings.compressibility_drift)
    for i in range(3):
        covariance[i, i] += drift[i] * drift[i]
    carried = (
        covariance[0, 0] * p + covariance[0, 1] * s + covariance[0, 2] * f,
        covariance[1, 0] * p + covariance[1, 1] * s + covariance[1, 2] * f,
        covariance[2, 0] * p + covariance[2, 1] * s + covariance[2, 2] * f,
    )
    length, stroke = settings.length_deviation, settings.stroke_deviation
    spread = length * length + stroke * stroke * y * y
    away = y
    for i in range(3):
        spread += row[i] * carried[i]
        away -= row[i] * estimate[i]
    for i in range(3):
        estimate[i] += carried[i] / spread * away
        for k in range(3):
            covariance[i, k] -= carried[i] * carried[k] / spread
