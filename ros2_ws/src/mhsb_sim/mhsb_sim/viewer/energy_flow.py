"""Where the pumps' energy goes, by what anybody can hear: to the pistons' work, and to losses.

Pumps tell what they have delivered. What of it reaches the valves is Σ p_s q_s of the lines, and
what the pistons do Σ F v, both from `actuator_states`. Between the first two lie servo pumps,
lines, relief and the valves' leakage; between the last two metering edges and the oil that returns.
"""

from __future__ import annotations

import numpy as np

from mhsb_model.types import FloatArray
from mhsb_msgs_py.actuator_states import ActuatorSample

LONGEST_GAP = 0.5
"""Nothing is counted over a longer time without a sample [s]."""

NAMES = ("main pump", "servo pumps", "into the valves", "work of the pistons")
"""Of the columns of energies: the first two are delivered, the next two are what comes of it."""


def powers(
    supply_pressure: FloatArray, supply_flow: FloatArray, force: FloatArray, speed: FloatArray
) -> FloatArray:
    """Into the valves and of the pistons [W], float64[k, 2]; arrays float64[k, n], SI units."""
    return np.stack(
        [(supply_pressure * supply_flow).sum(axis=1), (force * speed).sum(axis=1)], axis=1
    )


def cumulated(time: FloatArray, power: FloatArray) -> FloatArray:
    """Energies up to each time, by the trapezoidal rule, float64[k, 2] J; time float64[k] s."""
    step = np.diff(time)
    step[(step > LONGEST_GAP) | (step < 0.0)] = 0.0
    energy = np.zeros_like(power)
    energy[1:] = np.cumsum((power[1:] + power[:-1]) / 2 * step[:, None], axis=0)
    return energy


class EnergyFlow:
    """Energies since the first sample, while samples come."""

    def __init__(self) -> None:
        self._time: float | None = None
        self._power = np.zeros(2)
        self._used = np.zeros(2)
        self._pumps: FloatArray | None = None
        self._delivered = np.full(2, np.nan)

    def deliver(self, main_pump: float, servo_pumps: float) -> None:
        """What the pumps tell that they have delivered so far [J]; less than before begins anew."""
        pumps = np.array([main_pump, servo_pumps])
        if self._time is None:  # nobody listens to the actuators yet
            return
        if self._pumps is None or (pumps < self._pumps + self._delivered).any():
            self._pumps, self._used = pumps, np.zeros(2)
        self._delivered = pumps - self._pumps

    def use(self, sample: ActuatorSample, time: float) -> None:
        """A sample of the actuators at a time [s]."""
        [power] = powers(
            sample.supply_pressure[None],
            sample.supply_flow[None],
            sample.force[None],
            sample.piston_speed[None],
        )
        if self._time is not None and self._pumps is not None:
            both = np.array([self._time, time])
            self._used = self._used + cumulated(both, np.stack([self._power, power]))[1]
        self._time, self._power = time, power

    @property
    def energies(self) -> FloatArray:
        """In the order of `NAMES` [J]; not a number before pumps have told anything."""
        return np.concatenate([self._delivered, self._used])


def words(energies: FloatArray) -> str:
    """Where it went, in one sentence."""
    if not np.isfinite(energies).all():
        return "energy: the pumps have not told of any yet"
    delivered = float(energies[0] + energies[1])
    valves, work = float(energies[2]), float(energies[3])
    return (
        f"of {delivered:.0f} J from the pumps: **{work:.0f} J work** of the pistons, "
        f"{valves - work:.0f} J lost in valves and return oil, "
        f"{delivered - valves:.0f} J in servo pumps, lines and leakage"
    )
