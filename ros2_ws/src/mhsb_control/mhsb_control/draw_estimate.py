"""Observer of the difference between the flow that a boosted line draws and the commanded flow.

    drawn = Q − q_leak − c C ṗ,        τ ḋ = (drawn − commanded) − d

Q is the measured flow of the pumps, and q_leak the leakage. C is the line's capacity computed from
the machine file, c the estimated factor on C (`mhsb_control/line_estimate`), and ṗ the rate of the
line's pressure. The commanded flow is A_dir |u|, with the lag with which commands act. d is the
observed excess of the drawn flow; a negative d is a shortfall. τ is `observation_delay`.

A valve whose overlap is not known yet passes less flow than commanded. Lines are stiff: oil that no
piston takes raises the pressure of a line by 1 MPa in a few milliseconds. The shortfall of a line
whose pressure is far below its target is not used, since such a line has too little oil.

Source: W.-H. Chen, J. Yang, L. Guo, S. Li, Disturbance-observer-based control and related methods,
IEEE Trans. Industrial Electronics 63, 2016.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from mhsb_model.kernels.kernel import kernel
from mhsb_model.records import Record, Records, create_records


@dataclass(frozen=True)
class DrawSettings(Record):
    """Tuned numbers of the observers of drawn flow."""

    observation_delay: float = 0.02
    """Time constant τ [s], 0.001 … 1.

    Origin: longer than the delay of commands in config/variations.yaml (5 ms), shorter than a
    piston takes to start.

    30 % smaller and larger, N = 5: RMS error −5.4 and −5.8 % (mhsb_arm3), −4.3 and −1.2 %
    (excavator; overshoot −2.51 and −2.35 MPa)."""
    pressure_shortfall_scale: float = 2e5
    """Pressure below its target over which a shortfall's weight falls from 1 to 0 [Pa], 1e3 … 1e7.

    Origin: chosen; below it a line needs oil whatever its piston draws.

    30 % smaller and larger, N = 5: RMS error +2.3 and −3.5 % (mhsb_arm3), −3.5 and −5.6 %
    (excavator; overshoot −0.62 and −1.24 MPa)."""


class DrawObserver(Record):
    """Observer of one line, or of the rail."""

    pressure: float
    """Pressure in the last step [Pa]."""
    delayed_command: float
    """Commanded flow after the lag with which commands act [m³/s]."""
    excess_flow: float
    """Drawn flow less commanded flow, d [m³/s]."""


class MeasuredLine(NamedTuple):
    """Measurements of a line in one step.

    Attributes:
        pressure: Pressure of the line [Pa].
        supplied: Flow of the pumps minus leakage [m³/s].
        fed_by_pumps_only: Whether pumps alone feed the line.
    """

    pressure: float
    supplied: float
    fed_by_pumps_only: bool


def build_draw_observers(count: int) -> Records[DrawObserver]:
    """Return observers of drawn flow in their initial state, all fields 0.

    Args:
        count: Number n of lines.

    Returns:
        DrawObserver[n + 1]: one record for each line, and the last one for the rail.
    """
    return create_records(DrawObserver, count + 1)


@kernel
def update_draw_observer(
    draw: DrawObserver,
    line: MeasuredLine,
    commanded: float,
    capacity: float,
    lag: float,
    step: float,
    settings: DrawSettings,
) -> None:
    """Advance the observer of the flow that a line draws by one control step.

        τ ḋ = (supplied − capacity ṗ − Q_c) − d,    τ = observation_delay

    d is the observed excess: drawn flow minus commanded flow. Q_c is the commanded flow after a
    first-order lag. If anything but pumps may feed the line, d is set to 0.

    Args:
        draw: Observer of the line. Writes `excess_flow` (d), `delayed_command` (Q_c) [m³/s] and
            `pressure` [Pa] in place.
        line: Pressure of the line, flow that it is supplied with, and whether pumps alone feed it.
        commanded: Flow that the piston is commanded to take, not negative [m³/s].
        capacity: Estimated capacity of the line [m³/Pa].
        lag: Time constant of the lag with which the commanded flow acts [s].
        step: Control period [s].
        settings: Tuned numbers. Only `observation_delay` is read.
    """
    pressure = line.pressure
    drawn = line.supplied - capacity * (pressure - draw.pressure) / step
    draw.excess_flow += (
        step / settings.observation_delay * (drawn - draw.delayed_command - draw.excess_flow)
    )
    if not line.fed_by_pumps_only:
        draw.excess_flow = 0.0
    draw.pressure = pressure
    draw.delayed_command += step / (lag + step) * (commanded - draw.delayed_command)


@kernel
def compute_draw_shortfall(draw: DrawObserver, target: float, settings: DrawSettings) -> float:
    """Compute how much less oil a line draws than its piston is commanded to take.

    The observed shortfall is weighted by the line pressure. The weight is 1 at or above the target,
    and falls linearly to 0 at `pressure_shortfall_scale` below the target. A line at a lower
    pressure has too little oil in any case.

    Args:
        draw: Observer of the line.
        target: Target of the line pressure [Pa].
        settings: Tuned numbers.

    Returns:
        Weighted shortfall [m³/s]; 0 if the line draws more than commanded.
    """
    scale = settings.pressure_shortfall_scale
    weight = min(max((draw.pressure - target + scale) / scale, 0.0), 1.0)
    return weight * max(-draw.excess_flow, 0.0)
