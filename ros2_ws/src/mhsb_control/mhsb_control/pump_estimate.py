"""Estimates of the servo pumps' lag and of the delay of commands, from measured flows.

A pump has the lag τ, and its commands Q_cmd act i steps late. In a window of several steps of h
seconds each, its flow Q changes by

    ΔQ = θ Σ (Q_cmd(k − i) − Q(k)),        θ = 1 − e^(−h/τ)

The sum runs over the steps of the window. Q is measured by the pump's speed. For each possible
delay, θ is found by least squares with exponential forgetting. The delay with the least residual is
taken. All pumps are of one make and share one θ. Windows that no healthy pump would produce are
discarded. The delay applies to all commands, valve commands included.

Source: L. Ljung, System Identification, Section 3.2 (first order with a dead time, a set of models
of which the best is taken).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mhsb_control.delay_line import build_delay_lines, delay_value
from mhsb_model.circuit.quantities import ModuleState
from mhsb_model.kernels.kernel import kernel
from mhsb_model.records import Record, Records, create_records
from mhsb_model.types import FloatArray


@dataclass(frozen=True)
class DriveSettings(Record):
    """Tuned numbers of the estimates of the pumps' lag and delay."""

    window_steps: int = 10
    """Number of steps in a window, 2 … 100.

    Origin: half the lag of the suite's own pumps, so that each transient extends over several
    windows.

    30 % smaller and larger, N = 5: RMS error −11.6 and −6.0 % (mhsb_arm3), −2.4 and −0.8 %
    (excavator; overshoot −2.59 and −1.65 MPa)."""
    initial_deviation: float = 0.6
    """Initial standard deviation of θ, as a share of the machine file's value, above 0 … 10.

    Origin: config/variations.yaml, a lag of 0.5 … 3 times the file's.

    30 % smaller and larger, N = 5: RMS error −0.8 and −12.5 % (mhsb_arm3), −6.6 and +1.3 %
    (excavator; overshoot −0.11 and −1.97 MPa)."""
    flow_deviation: float = 4e-3
    """Standard deviation of ΔQ in a window, as a share of full flow, above 0 … 1.

    It covers errors of the readings, and deviations of the pump from a first-order lag. Origin:
    chosen.

    30 % smaller and larger, N = 5: RMS error −10.9 and −3.2 % (mhsb_arm3; overshoot −0.00 and
    −0.05 MPa), −4.5 and −1.3 % (excavator; overshoot −0.37 and −2.48 MPa)."""
    min_excitation: float = 0.3
    """Smallest |Σ (Q_cmd − Q)| of a used window, as a multiple of a pump's full flow, 0 … 10.

    Origin: chosen; a tenth of what a step to full flow gives in one window.

    30 % smaller and larger, N = 5: RMS error −2.6 and −5.2 % (mhsb_arm3; overshoot −0.05 and
    −0.07 MPa), −3.3 and −4.4 % (excavator; overshoot −0.49 and −2.20 MPa)."""
    forgetting_factor: float = 0.995
    """Factor by which each new window reduces the weight of earlier windows, above 0 … 1.

    Origin: L. Ljung recommends 0.98 … 0.995 for plants that change slowly.

    Distance to 1 30 % smaller and larger, N = 5: RMS error −4.3 and +2.3 % (mhsb_arm3; overshoot
    −0.07 and +0.00 MPa), −11.5 and −6.0 % (excavator; overshoot −2.89 and −0.28 MPa)."""
    min_lag_ratio: float = 0.2
    """Smallest lag of a healthy pump, in multiples of the machine file's, above 0 … 1.

    Origin: plausibility; config/variations.yaml has 0.5.

    30 % smaller and larger, N = 5: no effect on mhsb_arm3 and excavator."""
    max_lag_ratio: float = 8.0
    """Largest lag of a healthy pump, in multiples of the machine file's, 1 … 1000.

    Origin: plausibility; config/variations.yaml has 3.

    30 % smaller and larger, N = 5: RMS error −0.2 and 0 % (mhsb_arm3), +2.6 and −0.5 %
    (excavator)."""
    initial_delay_range: int = 6
    """Steps by which the delay may exceed the declared one before a pump has started, 0 … 60.

    Origin: config/variations.yaml, a delay of up to 5 ms.

    30 % smaller and larger: not measured."""
    plausible_excess: float = 9.0
    """Largest residual of a plausible delay above the least residual, in `flow_deviation`², 0 …
    1e4.

    Origin: three standard deviations.

    30 % smaller and larger, N = 5: RMS error 0 and −0.2 % (mhsb_arm3), +0.1 and +0.4 %
    (excavator; overshoot −0.10 and −1.33 MPa)."""
    min_lag_deviation: float = 0.03
    """Smallest standard deviation of the lag, as a share of it, 0 … 1.

    The estimated deviation never falls below it. Origin: chosen.

    30 % smaller and larger, N = 5: RMS error −3.2 and −10.3 % (mhsb_arm3), −3.5 and +3.1 %
    (excavator; overshoot −0.46 and −1.29 MPa)."""


class PumpDynamics(Record):
    """Estimates of lag and delay that all servo pumps share."""

    step: float
    """Control period h [s]."""
    full_flow: float
    """Largest flow of a pump [m³/s]."""
    largest_change: float
    """Largest change of flow in a step [m³/s]."""
    file_theta: float
    """θ that follows from the machine file."""
    theta: float
    """Estimate of θ."""
    lag: float
    """Estimate of the lag τ [s]."""
    deviation: float
    """Standard deviation of τ, as a share of it."""
    delay: int
    """Estimated delay, in steps."""
    max_plausible_delay: int
    """Longest plausible delay, in steps."""
    steps: int
    """Number of steps in the present window."""


class DriveEstimates(NamedTuple):
    """Estimates of how m servo pumps follow their commands."""

    record: Records[PumpDynamics]  # [1]
    # [m, d + 1] m³/s, commands of the last steps, see `build_delay_lines`; d is the longest delay
    commands: FloatArray
    previous_flow: FloatArray  # [m, 2] m³/s, flow in the last step, and at the start of the window
    # [m, d + 1] m³/s, Σ (Q_cmd − Q) in the window, for each delay
    flow_errors: FloatArray
    # [4, d + 1] Σ x², Σ x y, Σ y² of all windows, in full flows; residual
    squares: FloatArray
    flow: FloatArray  # [m] m³/s, flow at the instant when the next command begins to act
    pending: FloatArray  # [m] m³, oil delivered until then


def build_drive_estimates(
    lag: float,
    step: float,
    full_flow: float,
    slew: float,
    count: int,
    settings: DriveSettings = DriveSettings(),
    delay: float = 0.0,
) -> DriveEstimates:
    """Build the initial estimates of pump lag and command delay from the machine file's values.

    Args:
        lag: τ of a pump [s].
        step: Control period h [s].
        full_flow: Largest flow of a pump [m³/s].
        slew: Largest rate of change of the flow [m³/s²].
        count: Number m of pumps.
        settings: Tuned numbers.
        delay: Delay of commands that the machine file declares [s].

    Returns:
        Estimates with the lag of the file, and with its delay, but at most `MAX_DELAY`. The longest
        plausible delay is `initial_delay_range` steps longer than the file's delay.
    """
    commands = build_delay_lines(count, step)
    declared, longest = round(delay / step), commands.shape[1] - 1
    record = create_records(PumpDynamics, 1)
    record["step"], record["full_flow"], record["largest_change"] = step, full_flow, slew * step
    record["file_theta"] = record["theta"] = -math.expm1(-step / lag)
    record["lag"], record["deviation"] = lag, settings.initial_deviation
    record["delay"] = min(declared, longest)
    record["max_plausible_delay"] = declared + settings.initial_delay_range
    return DriveEstimates(
        record=record,
        commands=commands,
        previous_flow=np.zeros((count, 2)),
        flow_errors=np.zeros((count, longest + 1)),
        squares=np.zeros((4, longest + 1)),
        flow=np.zeros(count),
        pending=np.zeros(count),
    )


@kernel(borrows=True)
def update_drive_estimates(
    d: DriveEstimates, modules: Records[ModuleState], settings: DriveSettings
) -> bool:
    """Add one step of all pumps to the present window of steps, and predict each pump's flow.

    Call it before the pumps get new commands. Each pump's flow is predicted for the instant when
    the next command begins to act. A window has `window_steps` steps. At its end, lag and delay are
    estimated anew. Pumps whose commands differ too little from their flow, or whose flow has
    changed implausibly, do not contribute. If no pump contributes, the estimates do not change.

    Args:
        d: Estimates, updated in place. In every step `flow` gets the predicted flow [m³/s].
            `pending` gets the oil that the pump delivers from now until the next command begins to
            act [m³].
        modules: Records of the circuit's modules, [m], with measured flows and the commands of the
            last step.
        settings: Tuned numbers.

    Returns:
        True if lag and delay were estimated again in this step.
    """
    own = d.record[0]
    reach = own.largest_change / own.theta
    for k in range(len(modules)):
        flow, commands, last = modules[k].flow, d.commands[k], d.previous_flow[k, 0]
        delay_value(commands, modules[k].flow_command, 0)
        if own.steps == 0:
            d.previous_flow[k, 1] = last
            d.flow_errors[k] = 0.0
        for i in range(len(commands)):
            d.flow_errors[k, i] += min(max(commands[i] - last, -reach), reach)
        d.previous_flow[k, 0] = flow
    own.steps += 1
    updated = False
    if own.steps == settings.window_steps:
        own.steps = 0
        for k in range(len(modules)):
            rise = (d.previous_flow[k, 0] - d.previous_flow[k, 1]) / own.full_flow
            used = accumulate_pump_window(d.squares, d.flow_errors[k], rise, own, settings)
            updated = used or updated
        if updated:
            estimate_lag_and_delay(own, d.squares, settings)
    for k in range(len(modules)):
        d.flow[k], d.pending[k] = predict_pump_flow(own, modules[k].flow, d.commands[k])
    return updated


@kernel(borrows=True)
def accumulate_pump_window(
    squares: FloatArray,
    flow_errors: FloatArray,
    rise: float,
    own: PumpDynamics,
    settings: DriveSettings,
) -> bool:
    """Add a pump's window to the sums of the least squares, unless it is to be discarded.

    For the present estimate of the delay, let x be Σ (Q_cmd − Q)/`full_flow`. The window is
    discarded in two cases:

    - |x| is below `min_excitation`.
    - `rise`/x corresponds to a lag outside `min_lag_ratio` … `max_lag_ratio` times the machine
      file's.

    The weight of earlier windows is multiplied by `forgetting_factor`.

    Args:
        squares: Sums x², x y and y² for each delay in rows 0 to 2, updated in place; float64[4, d +
            1]. x is Σ (Q_cmd − Q) and y is ΔQ of a window, both divided by `full_flow`.
        flow_errors: Σ (Q_cmd − Q) of the window for each delay [m³/s], float64[d + 1].
        rise: ΔQ of the window, divided by `full_flow`.
        own: Estimates of the pumps' dynamics. Reads `delay`, `full_flow` and `file_theta`.
        settings: Tuned numbers.

    Returns:
        True if the window was used.
    """
    x = flow_errors[own.delay] / own.full_flow
    if abs(x) < settings.min_excitation:
        return False
    decay = math.log1p(-own.file_theta)
    least = -math.expm1(decay / settings.max_lag_ratio)
    most = -math.expm1(decay / settings.min_lag_ratio)
    if not least < rise / x < most:
        return False
    for i in range(len(flow_errors)):
        x = flow_errors[i] / own.full_flow
        squares[0, i] = settings.forgetting_factor * squares[0, i] + x * x
        squares[1, i] = settings.forgetting_factor * squares[1, i] + x * rise
        squares[2, i] = settings.forgetting_factor * squares[2, i] + rise * rise
    return True


@kernel(borrows=True)
def estimate_lag_and_delay(own: PumpDynamics, squares: FloatArray, settings: DriveSettings) -> None:
    """Estimate delay, θ and lag of the pumps by least squares with a prior.

    The control steps of a motion are grouped into windows. For each window, x is Σ (Q_cmd − Q) over
    its steps, and y is ΔQ, the rise of the flow. Both are divided by `full_flow`. θ_file is the
    prior, w its weight, h the control period, and σ `flow_deviation`. In the equations, Σ is a sum
    over windows:

        θ = (Σ x y + w θ_file) / (Σ x² + w),   w = (σ / (`initial_deviation` θ_file))²
        residual = Σ (y − θ x)² + w (θ − θ_file)²,   τ = −h / ln(1 − θ)

    θ and residual are computed for each delay, and the delay with the least residual is taken.
    `max_plausible_delay` becomes the longest delay whose residual exceeds the least one by less
    than `plausible_excess` σ².

    Args:
        own: Estimates of the pumps' dynamics. Writes in place `delay` and `max_plausible_delay`
            [steps], `theta`, `lag` (τ) [s], and `deviation`. `deviation` is the standard deviation
            of τ as a share of τ, at least `min_lag_deviation`.
        squares: Σ x², Σ x y, Σ y² and residual for each delay, float64[4, d + 1]. The last row is
            written in place.
        settings: Tuned numbers.
    """
    deviation = settings.flow_deviation
    prior = (deviation / (settings.initial_deviation * own.file_theta)) ** 2
    least = math.inf
    left = squares[3]
    for i in range(len(left)):
        weight = squares[0, i] + prior
        theta = (squares[1, i] + prior * own.file_theta) / weight
        left[i] = squares[2, i] - 2.0 * theta * squares[1, i] + theta * theta * squares[0, i]
        left[i] += prior * (theta - own.file_theta) ** 2
        if left[i] < least:
            least, own.delay, own.theta = left[i], i, theta
            own.deviation = max(deviation / math.sqrt(weight) / theta, settings.min_lag_deviation)
    for i in range(len(left)):
        if left[i] < least + settings.plausible_excess * deviation * deviation:
            own.max_plausible_delay = i
    own.lag = -own.step / math.log1p(-own.theta)


@kernel(borrows=True)
def predict_pump_flow(own: PumpDynamics, flow: float, commands: FloatArray) -> tuple[float, float]:
    """Predict a pump's flow at the instant when the next command begins to act.

    That instant is now plus the estimated delay. The commands that have been sent but do not act
    yet change the flow through the lag and the slew limit.

    Args:
        own: Estimates of the pumps' dynamics.
        flow: Present flow [m³/s].
        commands: Commands of the last steps, the newest first, float64[d + 1], [m³/s].

    Returns:
        Predicted flow [m³/s], and oil delivered from now until the next command begins to act [m³].
    """
    volume = 0.0
    for i in range(own.delay - 1, -1, -1):
        change = own.theta * (commands[i] - flow)
        change = min(max(change, -own.largest_change), own.largest_change)
        volume += own.step * (flow + 0.5 * change)
        flow += change
    return flow, volume
