"""Estimate of the lag of the servo valves, from commands, cylinder forces and piston motion.

The spool of a valve follows its command as a second-order system. The machine file gives the
damping ratio ζ and the frequency ω, and with them the lag ℓ = 2 ζ/ω. A real valve may be slower. In
a window of several control steps, a piston moves by

    ΔL = θ P(ℓ) − c ΔF/k_h
    P(ℓ) = ∫ G sign(x) max(g |x| − b (1 − |x|), 0) dt

x is the opening of a spool with the lag ℓ after the commands that have been sent. G is the piston
speed per opening [m/s]. g and b are the estimates of the valve's gain and overlap
(`mhsb_control/valve_estimate`), whose error is the factor θ. ΔF is the change of the cylinder force
[N], k_h the stiffness of the oil from the file [N/m], and c the factor on its compressibility.

For each possible lag, θ and c are found by least squares with the priors θ = 1 and c = 1 and with
exponential forgetting. Another lag is taken once its residual is clearly smaller than that of the
lag in use. All valves are of one make and share one lag. A window is used if the possible lags
predict different strokes, and if oil flowed. A valve within an unknown overlap passes none,
although it is open.

Source: L. Ljung, System Identification, Section 3.2 (a set of models of which the best is taken).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mhsb_control.valve_estimate import ValveEstimates
from mhsb_model.kernels.kernel import kernel
from mhsb_model.records import Record, Records, create_record, create_records
from mhsb_model.types import FloatArray

LAG_EXCESSES = (0.0, 2.5e-3, 5e-3, 7.5e-3, 0.01, 0.0125, 0.015, 0.0175, 0.02, 0.025)
"""Possible lags of a spool beyond that of the machine file [s].

Faster spools are not looked for, since they make no loop unstable. With an undeclared overlap of 25
%, lags of up to 40 ms took the part of the overlap, and stayed."""


@dataclass(frozen=True)
class LagSettings(Record):
    """Tuned numbers of the estimate of the servo valves' lag.

    Sensitivities are mean changes of the RMS error of mhsb_arm3 at half and twice the value. "Slow
    valve" is an undeclared lag of 20 ms, in 4 sequences of 6 goals. All goals are reached unless
    stated. No number had an effect on 3 plants of config/variations.yaml.
    """

    window_steps: int = 10
    """Number of steps in a window, 2 … 100.

    Origin: half the largest lag, so that a window sees a part of each transient.

    Half and twice, slow valve: −9.4 and +14.1 % (largest +207 %; overshoot +0.4 MPa)."""
    forgetting_factor: float = 0.98
    """Factor by which each new window reduces the weight of those before, above 0 … 1.

    Origin: L. Ljung recommends 0.98 … 0.995 for plants that change slowly.

    Half and twice the distance to 1, slow valve: no effect."""
    min_excitation: float = 0.25
    """Least difference between the predicted strokes of a used window [strokes at V_max], 0 … 10.

    Origin: chosen; a tenth of the difference that a step to full speed makes at a lag of 25 ms.

    Half and twice, slow valve: −17.5 and +66.2 %; with twice, 1 of 24 goals is missed."""
    min_flow_share: float = 0.15
    """Least share of the largest predicted stroke that the measured flow must have, 0 … 1.

    Origin: chosen; a valve within an unknown overlap passes nothing.

    Half and twice, slow valve: −1.2 and −2.1 %."""
    max_overlap_change: float = 0.01
    """Change of a valve's estimated overlap from which all sums become 0, 0 … 0.5.

    Origin: chosen; half of the initial deviation of an overlap. Without it, a sequence of mhsb_arm3
    with an undeclared overlap of 25 % and `min_evidence` 0.15 took a lag of 28 ms.

    Half and twice, slow valve: +17.0 (overshoot +0.4 MPa) and −9.0 %."""
    min_evidence: float = 0.5
    """Difference of residuals from which another lag is taken [squared strokes at V_max], 0 … 1e4.

    Origin: with 0.15 and 0.3, the RMS error of a draw from config/variations.yaml, mhsb_arm3, is
    1.11 and 1.07 instead of 1.01 mm/m, since pressures fall and G is wrong. An undeclared lag of 20
    ms is found 0.03 s later than with 0.15 (1 sequence).

    Half and twice, slow valve: −13.2 and +44.4 % (overshoot +0.4 MPa)."""
    gain_weight: float = 0.25
    """Weight of the prior θ = 1 [squared strokes at V_max], above 0 … 1e4.

    Origin: a residual of 0.05 and a deviation of θ of 0.1.

    Half and twice, slow valve: no effect; with θ taken as known, −11.8 %."""
    compressibility_weight: float = 0.03
    """Weight of the prior c = 1 [squared strokes at V_max], above 0 … 1e4.

    Origin: a residual of 0.05 and the deviation of c in config/variations.yaml, 0.3.

    Half and twice, slow valve: no effect; with c taken as known, +2.1 %."""


class LagWindow(Record):
    """Present window of a valve."""

    unit_stroke: float
    """Stroke of a window at V_max [m]."""
    length: float
    """Cylinder length at the start of the window [m]."""
    force: float
    """Cylinder force at the start of the window [N]."""
    extending_overlap: float
    """Estimated overlap with which the present sums were made, in extension [share of stroke]."""
    retracting_overlap: float
    """Estimated overlap with which the present sums were made, in retraction [share of stroke]."""
    is_usable: float
    """1 if the servo has set the opening freely in the whole window, else 0."""


class SpoolLag(Record):
    """Estimate of the lag that all servo valves share."""

    lag: float
    """Estimated lag of a spool behind its command [s]."""
    index: int
    """Index of this lag among the possible lags."""
    damping: float
    """Damping ratio ζ of a spool."""
    delay: int
    """Delay of commands with which the present sums were made, in steps."""
    steps: int
    """Number of steps in the present window."""


class LagEstimates(NamedTuple):
    """Estimate of the lag of n servo valves, with k possible lags."""

    record: Records[SpoolLag]  # [1]
    lags: FloatArray  # [k] s, possible lags, the machine file's first
    windows: Records[LagWindow]  # [n]
    # [3, n, k] opening, its rate [1/s], and stroke that is predicted in the window [m]
    spools: FloatArray
    squares: FloatArray  # [7, k] Σ p², Σ p z, Σ z², Σ p y, Σ z y, Σ y² of all windows; residual
    settings: Records[LagSettings]  # [1]


def build_lag_estimates(
    lag: float,
    damping: float,
    step: float,
    fastest: FloatArray,
    settings: LagSettings = LagSettings(),
) -> LagEstimates:
    """Build the initial estimate of the servo valves' lag: the machine file's.

    Args:
        lag: Lag of a spool in the machine file [s].
        damping: Damping ratio of a spool.
        step: Control period [s].
        fastest: Largest piston speed V_max of each cylinder, float64[n], [m/s].
        settings: Tuned numbers.

    Returns:
        The estimate, with all spools shut and no window evaluated. The possible lags are `lag` plus
        each of LAG_EXCESSES.
    """
    lags, record = lag + np.array(LAG_EXCESSES), create_records(SpoolLag, 1)
    record["lag"], record["damping"] = lag, damping
    windows = create_records(LagWindow, len(fastest))
    windows["unit_stroke"] = settings.window_steps * step * fastest
    return LagEstimates(
        record=record,
        lags=lags,
        windows=windows,
        spools=np.zeros((3, len(fastest), len(lags))),
        squares=np.zeros((7, len(lags))),
        settings=create_record(settings),
    )


def describe_lag_uncertainty(estimates: LagEstimates) -> float:
    """Return the largest difference between the estimated lag and a plausible one [s].

    A lag is plausible if its residual exceeds the least residual of all lags by less than the
    setting `min_evidence`.

    Args:
        estimates: Estimate of the lag.
    """
    residual = estimates.squares[6]
    plausible = residual < residual.min() + estimates.settings["min_evidence"][0]
    return float(abs(estimates.lags[plausible] - estimates.record["lag"][0]).max())


@kernel(borrows=True)
def advance_spools(
    lags: LagEstimates, valves: ValveEstimates, j: int, length: float, force: float, step: float
) -> None:
    """Advance the opening of a valve for each possible lag, and predict the piston's stroke.

        ẍ = ω² (x_cmd − x) − 2 ζ ω ẋ,    ω = 2 ζ/ℓ

    ℓ is the lag. The equation is integrated by the implicit Euler method. The command x_cmd counts
    when it acts. The stroke grows by the opening beyond the estimated overlap, times the piston
    speed per opening. It begins at 0 in each window. A window in which x_cmd is 0, or fully opens
    the valve, becomes unusable.

    Args:
        lags: Estimate of the lag. Writes the openings, rates and strokes of the valve's `spools` in
            place. In the first step of a window, it also writes length and force into `windows`.
        valves: Estimates of the valves with delayed openings.
        j: Index of the valve.
        length: Measured cylinder length [m].
        force: Measured cylinder force [N].
        step: Control period [s].
    """
    own, valve, window = lags.record[0], valves.records[j], lags.windows[j]
    openings, rates, strokes = lags.spools[0, j], lags.spools[1, j], lags.spools[2, j]
    command, damping, starts = valve.delayed_opening, own.damping, own.steps == 0
    if starts:
        window.length, window.force, window.is_usable = length, force, 1.0
    if command == 0.0 or abs(command) >= 1.0:
        window.is_usable = 0.0
    for i in range(len(openings)):
        turn = 2.0 * damping / lags.lags[i] * step
        change = rates[i] * step + turn * turn * (command - openings[i])
        change /= 1.0 + 2.0 * damping * turn + turn * turn
        rates[i] = change / step
        openings[i] += change
        x = abs(openings[i])
        missing = max(valves.estimate[j, 1 if openings[i] > 0.0 else 2], 0.0) * (1.0 - x)
        passed = step * valve.speed_gain * max(valve.gain * x - missing, 0.0)
        strokes[i] = 0.0 if starts else strokes[i] + math.copysign(passed, openings[i])


@kernel(borrows=True)
def accumulate_lag_window(
    lags: LagEstimates,
    valves: ValveEstimates,
    j: int,
    length: float,
    force: float,
    stiffness: float,
) -> bool:
    """Add a valve's full window to the sums of the least squares, unless it is to be discarded.

    If the estimated overlap of the valve has changed, all sums become 0 first, since the strokes
    were predicted with another one. y is the stroke, z = ΔF/k_h, and p the stroke that is predicted
    for a lag, all as shares of a window's stroke at V_max. c is the factor on the compressibility.
    A window is used if three conditions hold:

    - No step has made it unusable (`advance_spools`).
    - The predicted strokes of all lags span at least `min_excitation`.
    - |y + c z| is at least `min_flow_share` times the largest |p|.

    Args:
        lags: Estimate of the lag. Writes `squares`, and the overlaps in `windows`, in place.
        valves: Estimates of the valves with overlaps and the factor on the compressibility.
        j: Index of the valve.
        length: Measured cylinder length at the end of the window [m].
        force: Measured cylinder force at the end of the window [N].
        stiffness: k_h, stiffness of the oil [N/m].

    Returns:
        True if the window was used.
    """
    window, own, strokes, sums = lags.windows[j], lags.settings[0], lags.spools[2, j], lags.squares
    unit, overlap = window.unit_stroke, valves.overlap[j]
    change = max(
        abs(overlap[0] - window.extending_overlap), abs(overlap[1] - window.retracting_overlap)
    )
    if change > own.max_overlap_change:
        window.extending_overlap, window.retracting_overlap = overlap[0], overlap[1]
        forget_lag_windows(sums)
    y, z = (length - window.length) / unit, (force - window.force) / stiffness / unit
    flow = y + valves.estimate[j, 3] * z
    lowest, highest = math.inf, -math.inf
    for i in range(len(strokes)):
        p = strokes[i] / unit
        lowest, highest = min(lowest, p), max(highest, p)
    largest = max(highest, -lowest)
    if window.is_usable == 0.0 or highest - lowest < own.min_excitation:
        return False
    if abs(flow) < own.min_flow_share * largest:
        return False
    for i in range(len(strokes)):
        p = strokes[i] / unit
        products = (p * p, p * z, z * z, p * y, z * y, y * y)
        for k in range(6):
            sums[k, i] = own.forgetting_factor * sums[k, i] + products[k]
    return True


@kernel(borrows=True)
def forget_lag_windows(sums: FloatArray) -> None:
    """Set the sums of the least squares to 0.

    The lag in use then stays until new windows show another one.

    Args:
        sums: Field `squares` of the estimate, float64[7, k]. All rows but the last one are written
            in place.
    """
    for k in range(6):
        for i in range(sums.shape[1]):
            sums[k, i] = 0.0


@kernel(borrows=True)
def select_lag(lags: LagEstimates) -> None:
    """Compute the residual of each possible lag, and take another lag if it fits clearly better.

    Each window has the stroke y = ΔL, the compression z = ΔF/k_h and the predicted stroke p = P(ℓ).
    Σ is a sum over windows, and w_θ and w_c are the weights of the priors:

        residual = min over θ and c of Σ (y + c z − θ p)² + w_θ (θ − 1)² + w_c (c − 1)²

    Args:
        lags: Estimate of the lag. Writes the last row of `squares` in place. If the least residual
            is smaller than that of the present lag by more than `min_evidence`, also writes `lag`
            and `index` of `record`.
    """
    own, sums, settings = lags.record[0], lags.squares, lags.settings[0]
    on_gain, on_oil, best = settings.gain_weight, settings.compressibility_weight, own.index
    for i in range(len(lags.lags)):
        pp, pz, zz = sums[0, i] + on_gain, -sums[1, i], sums[2, i] + on_oil
        py, zy = sums[3, i] + on_gain, on_oil - sums[4, i]
        determinant = pp * zz - pz * pz
        gain, oil = (zz * py - pz * zy) / determinant, (pp * zy - pz * py) / determinant
        sums[6, i] = sums[5, i] + on_gain + on_oil - gain * py - oil * zy
    for i in range(len(lags.lags)):
        if sums[6, i] < sums[6, best]:
            best = i
    if sums[6, own.index] - sums[6, best] > settings.min_evidence:
        own.index, own.lag = best, lags.lags[best]


@kernel(borrows=True)
def finish_lag_step(lags: LagEstimates, is_used: bool, delay: int) -> None:
    """Finish a control step of all valves: select the lag, and count the steps of the window.

    If the estimated delay of commands has changed, all sums become 0, since they were made with
    openings of other times.

    Args:
        lags: Estimate of the lag, updated in place.
        is_used: Whether the window of any valve was used in this step.
        delay: Estimated delay of commands, in steps.
    """
    own = lags.record[0]
    if is_used:
        select_lag(lags)
    if delay != own.delay:
        own.delay = delay
        forget_lag_windows(lags.squares)
    own.steps = 0 if own.steps == lags.settings[0].window_steps else own.steps + 1
