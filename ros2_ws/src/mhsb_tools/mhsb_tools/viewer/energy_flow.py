"""Flow of energy from the pumps to the pistons' work and to losses, from published messages.

The pumps report the energy that they have delivered. The power into the valves is Σ p_s q_s over
the supply lines, and the power of the pistons is Σ F v, both from `actuator_states`. Servo pumps,
lines, relief valves and leakage lose energy before the valves. Metering edges and return oil lose
energy behind them.
"""

import numpy as np

from mhsb_model.types import FloatArray
from mhsb_msgs_py.actuator_states import ActuatorSample

LONGEST_GAP = 0.5
"""Longest time between two samples over which power is integrated [s]."""

ITEM_NAMES = ("main pump", "servo pumps", "into the valves", "work of the pistons")
"""Names of the columns of energies: the first two are delivered, the other two arise from them."""


def compute_powers(
    supply_pressure: FloatArray, supply_flow: FloatArray, force: FloatArray, speed: FloatArray
) -> FloatArray:
    """Compute the hydraulic power at the inlets of all valves, and the power of all pistons.

        P_valves = Σ p_s q_s,    P_pistons = Σ F v,    sums over the actuators

    Args:
        supply_pressure: Pressure p_s of each supply line, shape (k, n) [Pa].
        supply_flow: Flow q_s from each line into its valve, shape (k, n) [m³/s].
        force: Piston force F of each cylinder, positive if the load resists extension, shape (k, n)
            [N].
        speed: Piston speed v, positive extending, shape (k, n) [m/s].

    Returns:
        Power at the valve inlets (column 0) and of the pistons (column 1), shape (k, 2) [W].
    """
    return np.stack(
        [(supply_pressure * supply_flow).sum(axis=1), (force * speed).sum(axis=1)], axis=1
    )


def integrate_power(time: FloatArray, power: FloatArray) -> FloatArray:
    """Integrate two powers over time by the trapezoidal rule.

    An interval adds nothing if it is longer than LONGEST_GAP or time decreases in it.

    Args:
        time: Times, shape (k,) [s].
        power: Powers at these times, shape (k, 2) [W].

    Returns:
        Energies from the first time up to each time, shape (k, 2) [J]; row 0 is 0.
    """
    step = np.diff(time)
    step[(step > LONGEST_GAP) | (step < 0.0)] = 0.0
    energy = np.zeros_like(power)
    energy[1:] = np.cumsum((power[1:] + power[:-1]) / 2 * step[:, None], axis=0)
    return energy


class EnergyCounter:
    """Running sums of the energies since the first report of the pumps."""

    def __init__(self) -> None:
        """Create a counter that has no samples of the actuators and no reports of the pumps yet."""
        self._time: float | None = None
        self._power = np.zeros(2)
        self._used = np.zeros(2)
        self._pumps: FloatArray | None = None
        self._delivered = np.full(2, np.nan)

    def add_pump_report(self, main_pump: float, servo_pumps: float) -> None:
        """Store the energies that the simulator reports for its pumps.

        All energies count from the first report. If an energy is smaller than in the last report,
        the simulator was restarted, and all energies count from this report instead. Reports that
        come before the first sample of the actuators are ignored.

        Args:
            main_pump: Energy that the main pump has delivered since the simulator's start [J].
            servo_pumps: Energy that the servo pumps have delivered since the simulator's start [J].
        """
        pumps = np.array([main_pump, servo_pumps])
        if self._time is None:  # no sample of the actuators has come yet
            return
        if self._pumps is None or (pumps < self._pumps + self._delivered).any():
            self._pumps, self._used = pumps, np.zeros(2)
        self._delivered = pumps - self._pumps

    def add_sample(self, sample: ActuatorSample, time: float) -> None:
        """Add the power in a sample of the actuators to two energies.

        These are the energy of the oil at the valve inlets and the work of the pistons. The power
        is integrated from the previous sample to this sample by the trapezoidal rule. Nothing is
        added if the two samples are more than LONGEST_GAP apart, or if time decreases. Before the
        first `add_pump_report`, the sample is only stored as the previous sample of the next call.

        Args:
            sample: Hydraulic states of all actuators.
            time: Time of the sample [s].
        """
        [power] = compute_powers(
            sample.supply_pressure[None],
            sample.supply_flow[None],
            sample.force[None],
            sample.piston_speed[None],
        )
        if self._time is not None and self._pumps is not None:
            both = np.array([self._time, time])
            self._used = self._used + integrate_power(both, np.stack([self._power, power]))[1]
        self._time, self._power = time, power

    @property
    def energies(self) -> FloatArray:
        """Energies of main pump, servo pumps, oil at the valve inlets, and pistons, shape (4,) [J].

        They count from the first `add_pump_report`. Before it, the first two are nan and the others
        0.
        """
        return np.concatenate([self._delivered, self._used])


def describe_energies(energies: FloatArray) -> str:
    """Describe in one sentence where the energy of the pumps went.

    Args:
        energies: Four energies [J], nan if unknown, in the order of ITEM_NAMES: of main pump, servo
            pumps, oil at the inlets of the servo valves, and work of the pistons.

    Returns:
        The sentence, with Markdown emphasis. If an energy is unknown, it says that the pumps have
        not reported any yet.
    """
    if not np.isfinite(energies).all():
        return "energy: the pumps have not told of any yet"
    delivered = float(energies[0] + energies[1])
    valves, work = float(energies[2]), float(energies[3])
    return (
        f"of {delivered:.0f} J from the pumps: **{work:.0f} J work** of the pistons, "
        f"{valves - work:.0f} J lost in valves and return oil, "
        f"{delivered - valves:.0f} J in servo pumps, lines and leakage"
    )
