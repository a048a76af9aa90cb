"""Estimates of the servo valves' gain and overlap, from openings and piston motion.

A window is a sequence of control steps in which the piston moves steadily in one direction, with
the valve open by x. Then

    ΔL = g ∫ G |x| dt − b ∫ G (1 − |x|) dt − c ΔF/k_h   (all signed by the motion)

x is the present opening, computed from the commands with their delay and the lag of the spool. G is
the piston speed per opening [m/s] of the machine file's valve at the measured pressures. ΔL and ΔF
are the changes of cylinder length and cylinder force. k_h is the stiffness of the oil from the
file. A valve has g times the file's gain, and the overlap o. It passes g (|x| − o)/(1 − o) times
the flow of the file's fully open valve. So b = g o/(1 − o). Each direction has an overlap of its
own, b₊ in extension and b₋ in retraction. Oil of another bulk modulus has c = β/β_true. A Kalman
filter updates g, b₊, b₋, c of all valves after each window. These parameters follow slow random
walks. The valve is inverted by

    |x| = |u| (1 − o)/(g G) + o min(|u|/u_s, 1),    o = b/(g + b).

The valves of a machine are of one make. So each overlap is the sum of a common overlap and a
deviation of its own. Before any data, all overlaps have the correlation ρ:

    b_i = b₀ + d_i,    Var b₀ = ρ σ²,    Var d_i = (1 − ρ) σ²

If one valve shows an overlap, a similar overlap is assumed for each other valve until that valve
has moved.

An estimate of g outside its limits is moved to the limit along the covariance P. Here x is the
vector of the estimates:

    x ← x − P e (g − g_limit)/P_gg,    e has 1 at g, else 0

A piston may creep because its valve has hardly crossed its overlap. With the projection, this
counts as overlap and not as a valve without gain.

A parameter without data keeps its standard deviation. Two other kinds of windows are used. In the
first, the piston is commanded to move although its reference rests. If it moves less than
commanded, this indicates overlap, and the window is evaluated with the present g. In the second,
the piston does not move although its reference does. The overlap is then at least the value that
explains the missing motion. This is only a lower bound, so it does not make the estimate more
certain. If overlap i rises by Δb to the bound, all overlaps move along P, and g and c are kept:

    b_m ← b_m + P_mi/P_ii Δb,    P_ii ← max(P_ii, Δb²)

While the reference moves, several windows in sequence must show an unlikely lag, because a slow
valve or a late command also delays the piston.

Source: J.-J. Slotine, W. Li, Applied Nonlinear Control, Section 8.7 (least squares with integrated
regressors); G. Tao, P. Kokotović, Adaptive Control of Plants with Unknown Dead-zones (the smooth
inverse); D. Simon, Kalman filtering with state constraints, IET Control Theory and Applications 4,
2010 (projection onto a limit); A. Gelman et al., Bayesian Data Analysis, Chapter 5 (quantities with
a common part).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mhsb_control.delay_line import build_delay_lines, delay_value
from mhsb_control.machine_scales import compute_angle_strokes
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.records import Record, Records, create_record, create_records
from mhsb_model.types import FloatArray


@dataclass(frozen=True)
class ValveSettings(Record):
    """Tuned numbers of the valves' estimates and of their inverse."""

    window_steps: int = 40
    """Number of steps in a window, 5 … 500.

    Origin: at V_max the pistons of the suite's own arm move 160 times the deviation of a reading in
    40 ms, and the motion counts as steady for so long.

    30 % smaller and larger, N = 5: RMS error −16.9 and −11.2 % (mhsb_arm3; overshoot −0.14 and
    −0.09 MPa), +2.6 and −8.2 % (excavator; overshoot +0.10 and −1.38 MPa, falls +0 and −1)."""
    min_moving_speed: float = 1.0 / 80.0
    """Piston speed of the reference above which a motion counts as steady [V_max], 0 … 1.

    Origin: chosen; with 1/12 the RMS error of 3 sequences of the excavator with a hidden overlap of
    25 % is 1.6 instead of 1.2 mm/m.

    30 % smaller and larger: not measured."""
    min_stroke_share: float = 0.3
    """Share of the reference's stroke that a piston must have moved in a window, 0 … 1.

    A piston that moved less was stuck, and its valve may have been shut. Origin: chosen.

    30 % smaller and larger, N = 5: RMS error −1.8 and +0.1 % (mhsb_arm3), +0.1 and 0 %
    (excavator; overshoot −1.31 and +0.00 MPa)."""
    significant_deviations: float = 3.0
    """Number of standard deviations by which a window's stroke must be too short, 1 … 100.

    In standard deviations of a measured stroke, a lag then indicates overlap. In those of the
    predicted stroke, a window is then surprising. Origin: three standard deviations.

    30 % smaller and larger, N = 5, for overlap alone: RMS error −3.6 and −0.6 % (mhsb_arm3), −3.8
    and −0.8 % (excavator; overshoot −2.25 and +0.32 MPa). For surprises alone: −3.9 and −3.2 %
    (mhsb_arm3), −3.9 and −4.8 % (excavator; overshoot +2.65 and +0.39 MPa)."""
    gain_deviation: float = 0.15
    """Initial standard deviation of g [-], above 0 … 1.

    Origin: config/variations.yaml, a valve gain of 0.8 … 1.2 evenly has 0.12.

    30 % smaller and larger, N = 5: RMS error −15.9 and −1.4 % (mhsb_arm3), −5.0 and −2.3 %
    (excavator; overshoot −2.31 and −0.39 MPa)."""
    overlap_deviation: float = 0.02
    """Initial standard deviation of b₊ and b₋ [-], above 0 … 0.5.

    Origin: config/variations.yaml, an overlap of 0 … 3 % of the stroke has a root mean square of
    0.017.

    30 % smaller and larger, N = 5: RMS error −8.3 and −5.4 % (mhsb_arm3), −4.8 and −0.6 %
    (excavator; overshoot −0.13 and −2.51 MPa)."""
    overlap_correlation: float = 0.9
    """ρ: correlation of all overlaps of a machine before anything is measured, 0 … 1.

    Origin: chosen; with 0 each valve has to stall in each direction before its overlap is known,
    with 0.99 unequal overlaps are learnt slowly."""
    compressibility_deviation: float = 0.3
    """Initial standard deviation of c [-], above 0 … 2.

    Origin: config/variations.yaml, a bulk modulus of 0.6 … 1.6 GPa against 1 GPa.

    30 % smaller and larger, N = 5: RMS error −6.3 and −3.3 % (mhsb_arm3), −0.3 and +2.0 %
    (excavator; overshoot −2.19 and −2.30 MPa)."""
    gain_drift: float = 2e-3
    """Standard deviation of the random walk of g in one window [-], 0 … 0.1.

    Origin: chosen; g changes by 0.01 in a second of motion.

    30 % smaller and larger, N = 5: RMS error −3.3 and −8.6 % (mhsb_arm3), −2.2 and +2.6 %
    (excavator; overshoot −2.24 and −1.28 MPa)."""
    overlap_drift: float = 3e-4
    """Standard deviation of the random walk of b₊ and b₋ in one window [-], 0 … 0.1.

    Origin: chosen; they change by 0.0015 in a second of motion.

    30 % smaller and larger, N = 5: RMS error −4.9 and −3.5 % (mhsb_arm3), +5.4 and −7.4 %
    (excavator; overshoot +0.31 and −3.75 MPa)."""
    compressibility_drift: float = 3e-3
    """Standard deviation of the random walk of c in one window [-], 0 … 0.1.

    Origin: chosen; c changes by 0.015 in a second of motion.

    30 % smaller and larger, N = 5: RMS error −3.9 and −3.1 % (mhsb_arm3), −3.0 and +1.7 %
    (excavator; overshoot −2.60 and +0.11 MPa)."""
    angle_deviation: float = 6.7e-5
    """Standard deviation of a window's stroke due to length readings, as a joint angle [rad], 0 …
    0.01.

    Multiplied by the largest moment arm of the joint it is a stroke: 3 µm for 45 mm. Origin: one
    step of a 16-bit encoder is 96 µrad, whose quantization error has 28 µrad at each end; the rest
    is sensor noise.

    30 % smaller and larger, N = 5: RMS error −2.4 and −3.3 % (mhsb_arm3), +2.7 and +6.7 %
    (excavator; overshoot −0.28 and −0.80 MPa)."""
    stroke_deviation: float = 0.03
    """Standard deviation of a window's stroke, as a share of itself, 0 … 1.

    Origin: chosen; it covers errors of G within a window.

    30 % smaller and larger, N = 5: RMS error −3.8 and −12.1 % (mhsb_arm3), −0.9 and +3.0 %
    (excavator; overshoot −1.73 and −1.11 MPa)."""
    min_gain: float = 0.5
    """Smallest estimate of g [-], above 0 … 1.

    If a piston moves less than this share of its predicted stroke, overlap is the cause. Origin:
    plausibility; half of the smallest valve gain in config/variations.yaml would be 0.4.

    30 % smaller and larger, N = 5: RMS error +8.1 and −2.9 % (mhsb_arm3), +0.3 and +0.4 %
    (excavator)."""
    max_gain: float = 1.6
    """Largest estimate of g [-], 1 … 10.

    Origin: plausibility; config/variations.yaml has a valve gain of up to 1.2.

    30 % smaller and larger, N = 5: RMS error −13.4 and 0 % (mhsb_arm3), +31.8 and 0 %
    (excavator; overshoot −2.68 and +0.00 MPa, falls +1 and +0)."""
    max_overlap: float = 0.45
    """Largest overlap that the inverse uses, as a share of the spool's stroke, 0 … 0.5.

    Origin: valves of excavators have a dead band of 38 to 48 % of the command.

    30 % smaller and larger, N = 5: no effect on mhsb_arm3 and excavator."""
    declared_overlap_share: float = 0.2
    """Initial standard deviation of a declared overlap, as a share of it, 0 … 1.

    It is added to `overlap_deviation`. Origin: chosen.

    30 % smaller and larger, N = 5: no effect on mhsb_arm3 and excavator, which declare none."""
    min_surprises: int = 3
    """Number of surprising windows in sequence after which overlap counts as the cause, 1 … 25.

    A piston that lags because of a slow valve or a late command catches up within fewer windows.
    Origin: 120 ms, six times a lag or delay of 20 ms. With 2, 3 and 5 windows, 0, 1 and 2 of 3
    sequences of mhsb_arm3 reach their end if its valve lag is 20 ms. With an overlap of 25 %, 3, 3
    and 2 do (excavator: overshoot 1.2, 3.1 and 3.8 MPa)."""
    min_driving_pressure: float = 8.0
    """Smallest line pressure beyond p_L at which a standing piston indicates overlap, 0 … 1000.

    In laminar pressures of the valve; p_L is the load pressure. At a lower pressure, even an open
    valve passes almost no flow. Origin: chosen.

    30 % smaller and larger, N = 5: RMS error 0 and 0 % (mhsb_arm3), +22.9 and 0 % (excavator)."""
    overlap_speed: float = 0.025
    """u_s: demanded speed below which the overlap is only partly crossed [V_max], above 0 … 1.

    Origin: chosen, so that sensor noise at rest does not cross the overlap.

    30 % smaller and larger, N = 5: RMS error −3.5 and −4.6 % (mhsb_arm3; overshoot +0.03 and
    −0.07 MPa), −0.9 and +3.6 % (excavator; overshoot −2.70 and −1.76 MPa)."""
    min_pressure_drop: float = 0.4
    """Smallest pressure drop that is assumed over a valve edge [laminar pressures], above 0 … 100.

    Origin: chosen, so that openings stay moderate if the line pressure hardly exceeds the load
    pressure.

    30 % smaller and larger, N = 5: RMS error −10.2 and −1.7 % (mhsb_arm3; overshoot +0.16 and
    −0.01 MPa), −1.1 and +1.9 % (excavator; overshoot +0.06 and −0.25 MPa)."""


class EstimatedValve(Record):
    """Estimates of one valve that its inverse uses, and its present window."""

    moving_speed: float
    """Speed of the reference above which a motion counts as steady [m/s]."""
    crossing_speed: float
    """Demanded speed u_s below which the overlap is only partly crossed [m/s]."""
    length_deviation: float
    """Standard deviation of a window's stroke due to length readings [m]."""
    min_driving_pressure: float
    """Smallest `driving_pressure` at which a standing piston indicates overlap [Pa]."""
    gain: float
    """Estimate g, within `min_gain` … `max_gain`."""
    opening: float
    """Opening x of the last step; 0 if the servo did not set it freely."""
    delayed_opening: float
    """Opening whose command acts now; 0 if the servo did not set it freely."""
    acting_opening: float
    """Opening of the spool now; it follows `delayed_opening` with a lag."""
    speed_gain: float
    """Speed G per opening in the last step [m/s]."""
    driving_pressure: float
    """Line pressure beyond the load pressure in the last step [Pa]."""
    least_driving_pressure: float
    """Least `driving_pressure` in the present window [Pa]."""
    surprises: int
    """Number of surprising windows in sequence, the last window included."""
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
    lag_integral: float
    """∫ G |x_cmd − x| dt [m], with the delayed command x_cmd."""
    reference_stroke: float
    """∫ |v_ref| dt [m]."""
    length: float
    """Cylinder length at the start of the window [m]."""
    force: float
    """Cylinder force at the start of the window [N]."""


class ValveEstimates(NamedTuple):
    """Estimates of n valves."""

    records: Records[EstimatedValve]  # [n]
    estimate: FloatArray  # [n, 4] g, b₊, b₋, c
    covariance: FloatArray  # [n, 4, n, 4] covariance of these
    work: FloatArray  # [n, 4] working memory
    overlap: FloatArray  # [n, 2] overlaps o that the inverse uses, extending and retracting
    # [n, d + 1] openings x of the last steps, see `build_delay_lines`
    openings: FloatArray
    settings: Records[ValveSettings]  # [1]


def build_valve_records(
    machine: Machine, settings: ValveSettings = ValveSettings()
) -> Records[EstimatedValve]:
    """Build the records of a machine's valves, with the thresholds that follow from the machine.

    Args:
        machine: The machine as its file describes it.
        settings: Tuned numbers, relative to V_max, moment arms and laminar pressure.

    Returns:
        EstimatedValve[n] with thresholds of speed, stroke and pressure. All other fields are 0.
    """
    records = create_records(EstimatedValve, machine.joint_count)
    fastest = machine.arrays.max_piston_speed
    records["moving_speed"] = settings.min_moving_speed * fastest
    records["crossing_speed"] = settings.overlap_speed * fastest
    records["length_deviation"] = settings.angle_deviation * compute_angle_strokes(machine)
    laminar = machine.config.circuit.laminar_pressure
    records["min_driving_pressure"] = settings.min_driving_pressure * laminar
    return records


def build_valve_estimates(
    records: Records[EstimatedValve],
    overlap: FloatArray,
    declared: tuple[float, float] = (0.0, 0.0),
    settings: ValveSettings = ValveSettings(),
    step: float = 1e-3,
) -> ValveEstimates:
    """Build the initial estimates of valves: the machine file's gain and the declared overlaps o.

        g = 1,   b = o/(1 − o) for each direction,   c = 1

    g is a factor on the file's valve gain, and c a factor on the compressibility of the oil. The
    overlaps of all valves are correlated, since the valves are of one make.

    Args:
        records: Records of the valves, by `build_valve_records`. Writes `gain` in place.
        overlap: Array that becomes the result's field `overlap`, float64[n, 2]. The declared
            overlaps, at most `max_overlap`, are written in place.
        declared: Overlaps o that the machine file declares for extension and retraction, as shares
            of the spool's stroke.
        settings: Tuned numbers.
        step: Control period [s].

    Returns:
        The estimates of n valves, with their initial deviations.
    """
    count, laps = len(records), np.array(declared)
    records["gain"] = 1.0
    overlap[:] = np.minimum(laps, settings.max_overlap)
    missing = laps / (1.0 - laps)
    deviations = [
        settings.gain_deviation,
        *np.hypot(settings.overlap_deviation, settings.declared_overlap_share * missing),
        settings.compressibility_deviation,
    ]
    share = math.sqrt(settings.overlap_correlation)
    common = np.tile(np.multiply(deviations, [0.0, share, share, 0.0]), count)
    covariance = np.outer(common, common)
    np.fill_diagonal(covariance, np.tile(np.square(deviations), count))
    return ValveEstimates(
        records=records,
        estimate=np.tile([1.0, *missing, 1.0], (count, 1)),
        covariance=covariance.reshape(count, 4, count, 4),
        work=np.zeros((count, 4)),
        overlap=overlap,
        openings=build_delay_lines(count, step),
        settings=create_record(settings),
    )


@kernel(inline="always")
def compute_opening(
    gain: float, overlap: FloatArray, demand: float, ahead: float, crossing_speed: float
) -> float:
    """Return the valve opening that produces a demanded piston speed.

        x = u (1 − o)/(G g) + o clip(y + clip(w, −2, 2) clip(2 − |y|, 0, 1), −1, 1)

    with y = u/u_s and w = v/u_s. clip limits its first argument to the range of the other two. The
    first term opens the valve beyond its overlap. The second term crosses the overlap: linearly for
    small |u|, and in advance for the coming speed v. Each term uses the overlap o of its own
    direction. x is continuous in u. If |u| ≥ 2 u_s, v has no effect.

    Args:
        gain: G g, piston speed of the fully open valve [m/s].
        overlap: Overlaps o extending and retracting, as shares of the spool's stroke, float64[2].
        demand: u, piston speed [m/s].
        ahead: v, piston speed of the coming motion, for which the overlap is crossed in advance
            [m/s].
        crossing_speed: u_s, demanded speed from which on the overlap is crossed entirely [m/s].

    Returns:
        Opening x, a share of the spool's stroke, not limited to −1 … 1. Positive extends.
    """
    y, w = demand / crossing_speed, ahead / crossing_speed
    crossed = y + min(max(w, -2.0), 2.0) * min(max(2.0 - abs(y), 0.0), 1.0)
    opened = demand / gain * (1.0 - overlap[0 if demand >= 0.0 else 1])
    return opened + overlap[0 if crossed >= 0.0 else 1] * min(max(crossed, -1.0), 1.0)


@kernel(borrows=True)
def shift_opening(
    valve: EstimatedValve, openings: FloatArray, delay: int, lag: float, step: float
) -> None:
    """Compute the opening at which the spool is now, from earlier commands.

    An opening acts after the delay of commands, and the spool follows it as a first-order lag.

    Args:
        valve: Estimates of the valve. Reads `opening`; writes `delayed_opening` and
            `acting_opening` in place.
        openings: Openings of the last steps, the newest first, float64[d + 1]. Written in place.
        delay: Delay of commands, in steps.
        lag: Lag of the spool behind its command [s].
        step: Control period [s].
    """
    valve.delayed_opening = delay_value(openings, valve.opening, delay)
    valve.acting_opening += step / (lag + step) * (valve.delayed_opening - valve.acting_opening)


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
    """Add one step of a valve to its window, and update the estimates if the window is full.

    A window is discarded if the valve saturates, is shut or opens against the motion. It is also
    discarded if the reference reverses, starts or stops. The reference counts as resting below
    `moving_speed`. If it rests during the whole window, the window is used, and the sign of the
    opening serves as its direction. `evaluate_valve_window` evaluates a full window.

    Args:
        valves: Estimates, updated in place. An update also writes `gain` and `overlap`, clipped to
            their limits.
        j: Index of the valve.
        speed: v_ref, piston speed of the reference [m/s].
        length: Measured cylinder length [m].
        force: Measured cylinder force [N].
        stiffness: k_h, stiffness of the oil [N/m].
        step: Control period [s].
    """
    valve, settings = valves.records[j], valves.settings[0]
    opening, gain = valve.acting_opening, valve.speed_gain
    moves = abs(speed) >= valve.moving_speed
    sign = math.copysign(1.0, speed if moves else opening)
    delayed = valve.delayed_opening
    steady = delayed != 0.0 and opening * sign > 0.0 and abs(opening) < 1.0
    if not steady or (valve.steps > 0 and (sign != valve.sign or moves != valve.moves)):
        valve.steps = 0
        return
    if valve.steps == 0:
        valve.sign, valve.moves, valve.length, valve.force = sign, moves, length, force
        valve.opening_integral = valve.gain_integral = valve.reference_stroke = 0.0
        valve.lag_integral = 0.0
        valve.least_driving_pressure = math.inf
        valve.steps = 1
        return
    valve.opening_integral += gain * abs(opening) * step
    valve.gain_integral += gain * step
    valve.lag_integral += gain * abs(delayed - opening) * step
    valve.reference_stroke += abs(speed) * step
    valve.least_driving_pressure = min(valve.least_driving_pressure, valve.driving_pressure)
    valve.steps += 1
    if valve.steps <= settings.window_steps:
        return
    valve.steps = 0
    evaluate_valve_window(valves, j, length, force, stiffness)


@kernel(borrows=True)
def evaluate_valve_window(
    valves: ValveEstimates, j: int, length: float, force: float, stiffness: float
) -> None:
    """Update the estimates from a full window of a valve, or discard the window.

    A piston that moved less than the share `min_stroke_share` of the reference's stroke was stuck.
    A piston lags if its stroke falls short of the predicted stroke by `significant_deviations` ×
    `length_deviation` or more. A stroke backwards counts as 0 in this. There are three cases:

    - The reference moves steadily, and the piston was not stuck. The Kalman filter
      (`update_valve_filter`) updates all estimates.
    - The reference moves slowly or rests, and the piston was not stuck. If the piston lags, the
      filter updates the estimates with the present gain taken as known.
    - The piston was stuck. If it lags, the overlap of its direction rises to the value that
      explains the lag. If the reference moves, the line must also have had `min_driving_pressure`
      beyond the load pressure all the time.

    Any other window is discarded.

    The noise of a window has three parts: `length_deviation`, the share `stroke_deviation` of the
    stroke, and the stroke that corresponds to the spool's lag behind its command.

    A window is surprising if three conditions hold:

    - The reference moves.
    - The line had `min_driving_pressure` beyond the load pressure all the time.
    - The stroke is much too short: below the prediction by more than `significant_deviations`
      standard deviations, and below `min_gain` times the prediction.

    Surprising windows are not used until there are `min_surprises` of them in sequence. The most
    likely cause is then overlap, which rises to the value that explains the lag.

    Args:
        valves: Estimates, updated in place: `surprises` of the valve, and after an update all g,
            b₊, b₋, c, `gain` and `overlap` within their limits.
        j: Index of the valve.
        length: Measured cylinder length at the end of the window [m].
        force: Measured cylinder force at the end of the window [N].
        stiffness: k_h, stiffness of the oil [N/m].
    """
    valve, settings = valves.records[j], valves.settings[0]
    moves, k = valve.moves == 1, 1 if valve.sign > 0.0 else 2
    way = valve.sign * (length - valve.length)
    squeezed = valve.sign * (force - valve.force) / stiffness
    estimate, own = valves.estimate[j], valves.covariance[j]
    gain_integral, opened = valve.gain_integral, valve.opening_integral
    passed, s = estimate[0] * opened, opened - gain_integral
    lag = passed + estimate[k] * s - estimate[3] * squeezed - way
    stuck = way < settings.min_stroke_share * valve.reference_stroke
    follows = moves and not stuck
    drives = valve.least_driving_pressure >= valve.min_driving_pressure
    least = settings.significant_deviations * valve.length_deviation
    if not follows and (lag < max(-way, 0.0) + least or (moves and not drives)):
        valve.surprises = 0
        return
    unsettled = (estimate[0] + estimate[k]) * valve.lag_integral
    noise = math.hypot(valve.length_deviation, settings.stroke_deviation * way)
    noise = math.hypot(noise, unsettled)
    spread = own[k, j, k] * s * s + own[0, j, 0] * opened * opened + noise * noise
    surprising = drives and moves and lag * lag > settings.significant_deviations**2 * spread
    surprising = surprising and way < settings.min_gain * (way + lag)
    valve.surprises = valve.surprises + 1 if surprising else 0
    if 0 < valve.surprises < settings.min_surprises:
        return
    if surprising or stuck:
        raise_overlap(valves, j, k, -lag / s)
    else:
        y, p = (way, opened) if follows else (way - passed, 0.0)
        row = (p, s if k == 1 else 0.0, s if k == 2 else 0.0, -squeezed)
        update_valve_filter(valves, j, y, row, noise)
    apply_estimates(valves)


@kernel(borrows=True)
def raise_overlap(valves: ValveEstimates, j: int, k: int, rise: float) -> None:
    """Raise the estimate of one overlap, and of all overlaps that are correlated with it.

        b_m ← b_m + P_mi/P_ii Δb,    P_ii ← max(P_ii, Δb²)

    An overlap o is estimated as b = g o/(1 − o), with the gain g of the valve. b_i belongs to the
    overlap to raise, and b_m to each overlap of all valves. P is the covariance of the estimates.

    Args:
        valves: Estimates. Writes `estimate` and `covariance` (P) in place.
        j: Index of the valve.
        k: Position of the overlap b_i among the valve's estimates, 1 extending or 2 retracting.
        rise: Δb, rise of this overlap [-].
    """
    estimate, own = valves.estimate, valves.covariance[j, k]
    variance = own[j, k]
    for m in range(len(estimate)):
        for i in range(1, 3):
            estimate[m, i] += rise * own[m, i] / variance
    own[j, k] = max(variance, rise * rise)


@kernel(borrows=True)
def apply_estimates(valves: ValveEstimates) -> None:
    """Limit the estimated gains, and set the gains and overlaps that the valve inversion uses.

    If a gain g is moved to its limit, all estimates that are correlated with it move as well. The
    overlap is b/(g + b), limited to 0 … `max_overlap`.

    Args:
        valves: Estimates. Writes `estimate`, `gain` and `overlap` in place.
    """
    settings, estimate = valves.settings[0], valves.estimate
    for j in range(len(estimate)):
        valve, own = valves.records[j], valves.covariance[j, 0]
        valve.gain = min(max(estimate[j, 0], settings.min_gain), settings.max_gain)
        excess = (estimate[j, 0] - valve.gain) / own[j, 0]
        for m in range(len(estimate)):
            for i in range(4):
                estimate[m, i] -= excess * own[m, i]
    for j in range(len(estimate)):
        gain = valves.records[j].gain
        for i in range(2):
            lap = max(estimate[j, 1 + i], 0.0)
            valves.overlap[j, i] = min(lap / (gain + lap), settings.max_overlap)


@kernel(borrows=True)
def update_valve_filter(
    valves: ValveEstimates,
    j: int,
    y: float,
    row: tuple[float, float, float, float],
    noise: float,
) -> None:
    """Update the estimates of all valves from the balance of one valve's window.

        y = p g + s₊ b₊ + s₋ b₋ + f c + noise

    This is one step of a Kalman filter. g is the factor on the valve's gain, and c the factor on
    the compressibility of the oil. b₊ and b₋ stand for the overlaps of the valve. Before the
    update, the variances of this valve's parameters grow by the variances of their random walks.

    Args:
        valves: Estimates. Writes `estimate`, `covariance` and `work` in place.
        j: Index of the valve.
        y: Stroke of the window [m]. If p is 0, g is taken as known, and y is the stroke minus the
            part that g causes.
        row: Coefficients p, s₊, s₋, f [m].
        noise: Standard deviation of the noise [m].
    """
    estimate, covariance, settings = valves.estimate, valves.covariance, valves.settings[0]
    gain_drift, lap_drift = settings.gain_drift, settings.overlap_drift
    drift = (gain_drift, lap_drift, lap_drift, settings.compressibility_drift)
    own, carried, count = covariance[j], valves.work, len(estimate)
    p, up, down, f = row
    for i in range(4):
        own[i, j, i] += drift[i] * drift[i]
    for m in range(count):
        for i in range(4):
            carried[m, i] = own[0, m, i] * p + own[1, m, i] * up + own[2, m, i] * down
            carried[m, i] += own[3, m, i] * f
    spread, away = noise * noise, y
    for i in range(4):
        spread += row[i] * carried[j, i]
        away -= row[i] * estimate[j, i]
    for m in range(count):
        for i in range(4):
            estimate[m, i] += carried[m, i] / spread * away
            for n in range(count):
                for k in range(4):
                    covariance[m, i, n, k] -= carried[m, i] * carried[n, k] / spread
