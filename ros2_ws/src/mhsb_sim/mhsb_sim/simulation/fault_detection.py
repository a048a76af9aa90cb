"""Symptoms which show that an arm does not do what its servo commands, one class for each.

A symptom is a number that is small while all is well. `SupervisionLimits` holds the value at which
it warns and the value at which the arm is stopped. A new symptom is a class and an entry in
`SYMPTOM_KINDS`, with its pair of limits.
"""

from dataclasses import dataclass
from functools import reduce
from typing import Self

import numpy as np

from mhsb_control import get_controller_class
from mhsb_model.arrays import MAX_CHAMBER_PRESSURE_SHARE
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray
from mhsb_sim.simulation.fault_isolation import (
    ISOLATION_SETTINGS,
    DisagreeingLine,
    DisagreeingValve,
    FrozenLength,
    FrozenPressure,
    JumpingLength,
    SilentSensor,
)
from mhsb_sim.simulation.sample import WATCH_PERIOD_NS, ArmSample, Finding, Symptom

ROUNDING_TOLERANCE = 1e-5
"""Difference from 1 up to which a command is saturated [-]."""


@dataclass(frozen=True)
class SupervisionLimits:
    """Limits of the symptoms, each as a pair (value to warn, value to stop the arm).

    The symptoms from `silent_sensor` on name a part that has failed; see `fault_isolation`.

    Attributes:
        following_error: Deviation of a joint from its reference [rad].
        overpressure: Pressure of a chamber or line, as a share of its relief valve's setting.
        supply_loss: Share of the main pump's pressure that a line lacks.
        saturation: Time with a valve fully open or a servo pump at full speed [s].
        held: Time for which the mode guard holds the plan [s].
        silent_sensor: Time for which a sensor gives no reading [s].
        frozen_pressure: Time for which a pressure sensor repeats its reading [s].
        frozen_length: Stroke of a piston's reference while its sensor repeats its reading [m].
        jumping_length: Jump of a length between two samples, as a multiple of the longest stroke of
            a piston in that time.
        disagreeing_line: Pressure difference of a line in mode N to all other such lines [Pa].
        disagreeing_valve: Stroke of a piston that its valve's opening does not explain [m].
    """

    following_error: tuple[float, float] = (0.03, 0.06)
    overpressure: tuple[float, float] = (MAX_CHAMBER_PRESSURE_SHARE, 0.97)
    supply_loss: tuple[float, float] = (0.6, 0.8)
    saturation: tuple[float, float] = (0.3, 1.0)
    held: tuple[float, float] = (1.0, 3.0)
    silent_sensor: tuple[float, float] = (0.005, 0.01)
    frozen_pressure: tuple[float, float] = (0.12, 0.2)
    frozen_length: tuple[float, float] = (3e-4, 6e-4)
    jumping_length: tuple[float, float] = (0.8, 1.0)
    disagreeing_line: tuple[float, float] = (2.5e5, 5e5)
    disagreeing_valve: tuple[float, float] = (5e-4, 8e-4)

    @classmethod
    def for_controller(cls, name: str) -> Self:
        """Build the limits that are usual with a controller.

        Args:
            name: Name of a registered controller. It may declare limits of its own, as
                `mhsb_control.controller.Controller` describes.

        Raises:
            UnknownControllerError: No controller has this name.
        """
        return cls(**getattr(get_controller_class(name), "supervision_limits", {}))


class FollowingError(Symptom):
    """Largest deviation of a joint from its reference, max |q_ref − q| [rad].

    Deviations of a sliding joint are scaled so that its whole range counts as π rad.
    """

    name, unit = "following_error", "rad"

    def __init__(self, machine: Machine) -> None:
        """Store names, units and radian equivalents of the joints."""
        self._names, self._units = machine.joint_names, machine.joint_units
        self._radians = machine.radian_equivalents

    def evaluate(self, sample: ArmSample) -> Finding:
        """Find the joint that deviates most from its reference.

        Args:
            sample: State of the arm.

        Returns:
            Deviation of that joint [rad], and a clause that names it. The deviation of a sliding
            joint is scaled so that its range counts as π rad.
        """
        off = np.abs(sample.reference.position - sample.measured.position)
        size = off / self._radians
        j = int(np.argmax(size))
        return Finding(
            float(size[j]),
            lambda: f"{self._names[j]} is {off[j]:.3f} {self._units[j]} off its reference",
        )


class Overpressure(Symptom):
    """Largest ratio p/p_relief of pressure to relief setting over all chambers and lines [-].

    Each pressure counts with its lowest value in the last `min_duration_samples` samples, so that
    short peaks are ignored.
    """

    name, unit = "overpressure", ""

    def __init__(self, machine: Machine) -> None:
        """Store names and relief settings of all cap sides, then all rod sides, then all lines.

        Args:
            machine: The machine.
        """
        actuators, chambers = machine.actuator_names, machine.chamber_reliefs
        lines = np.full(len(actuators), machine.config.circuit.line_relief_pressure)
        parts = ("cap side", "rod side", "line")
        self._names = [f"the {part} of {name}" for part in parts for name in actuators]
        self._settings = np.concatenate([chambers, chambers, lines])
        self._lasting = MinimumFilter()

    def evaluate(self, sample: ArmSample) -> Finding:
        """Find the chamber or line with the highest lasting ratio of pressure to relief setting.

        The lasting ratio is the lowest one in the last `min_duration_samples` samples; 0 if there
        are fewer samples yet.

        Args:
            sample: State of the arm.

        Returns:
            The highest lasting ratio [-], and a clause that names the chamber or line.
        """
        of = sample.actuators
        pressure = np.concatenate([of.cap_pressure, of.rod_pressure, of.supply_pressure])
        share = self._lasting.update(pressure / self._settings)
        k = int(np.argmax(share))
        return Finding(
            float(share[k]),
            lambda: (
                f"{self._names[k]} is at {share[k] * self._settings[k] / 1e6:.1f} MPa, "
                f"{share[k]:.2f} of its relief valve's setting"
            ),
        )


class SupplyLoss(Symptom):
    """Largest share of the main pump's pressure that a supply line lacks, 1 − p_line/P_S [-].

    p_line is the pressure of the line, and P_S that of the main pump. Each line counts with its
    smallest share in the last `min_duration_samples` samples, so that short dips are ignored.
    """

    name, unit = "supply_loss", ""

    def __init__(self, machine: Machine) -> None:
        """Store the names of the actuators, and the main pump's pressure P_S of the machine file.

        Args:
            machine: The machine.
        """
        self._names = machine.actuator_names
        self._supply = machine.arrays.supply_pressure
        self._lasting = MinimumFilter()

    def evaluate(self, sample: ArmSample) -> Finding:
        """Find the line with the largest lasting lack of pressure.

        The lasting lack of a line is the smallest lack of the last `min_duration_samples` samples.
        It is 0 as long as there are fewer samples.

        Args:
            sample: State of the arm.

        Returns:
            Lasting lack of that line as a share of the main pump's pressure P_S, and a clause that
            names the line. If every line lacks more than `common_loss_share`, the clause says "all
            lines".
        """
        lacking = self._lasting.update(1.0 - sample.actuators.supply_pressure / self._supply)
        j = int(np.argmax(lacking))
        where = f"the line of {self._names[j]} lacks"
        if np.min(lacking) > ISOLATION_SETTINGS.common_loss_share:
            where = "all lines lack"
        return Finding(
            float(lacking[j]), lambda: f"{where} {lacking[j]:.2f} of the main pump's pressure"
        )


class Saturation(Symptom):
    """Time for which the command of a valve or of a servo pump has been saturated [s]."""

    name, unit = "saturation", "s"

    def __init__(self, machine: Machine) -> None:
        """Store the clauses of the findings, and set all counters to 0.

        The order is: valves of all actuators, then servo pumps of all modules.

        Args:
            machine: The machine.
        """
        pumps = range(1, machine.arrays.module_count + 1)
        self._names = [
            *(f"the valve of {name} has been fully open" for name in machine.actuator_names),
            *(f"servo pump {number} has been at full speed" for number in pumps),
        ]
        self._saturated_samples = np.zeros(len(self._names))

    def evaluate(self, sample: ArmSample) -> Finding:
        """Update the time for which each command has been saturated, and return the longest.

        A command is saturated if its magnitude is 1, up to rounding; -1 is saturated, too. One
        unsaturated sample resets the time of its command to 0. Each call counts as WATCH_PERIOD_NS,
        so call it once in that period.

        Args:
            sample: State of the arm.

        Returns:
            Longest time [s], and a clause that names the valve or pump. If nothing is saturated,
            the time is 0 and the clause names the first valve.
        """
        of = sample.actuators
        command = np.abs(np.concatenate([of.valve_command, of.servo_pump_command]))
        saturated = np.abs(command - 1.0) <= ROUNDING_TOLERANCE
        self._saturated_samples = np.where(saturated, self._saturated_samples + 1.0, 0.0)
        k = int(np.argmax(self._saturated_samples))
        time = float(self._saturated_samples[k]) * WATCH_PERIOD_NS / SECOND_NS
        return Finding(time, lambda: f"{self._names[k]} for {time:.2f} s")


class HeldPlan(Symptom):
    """Time for which the mode guard has held the plan, because the arm would sag otherwise."""

    name, unit = "held", "s"

    def evaluate(self, sample: ArmSample) -> Finding:
        """Return the time for which the mode guard has held the plan.

        The mode guard holds the plan nearly still if the arm would sag otherwise.

        Args:
            sample: State of the arm.

        Returns:
            The time [s], and a clause with the time and the reason. The time is 0 if the plan is
            not held.
        """
        return Finding(
            sample.held,
            lambda: f"the plan has been held for {sample.held:.2f} s: {sample.hold_reason}",
        )


class MinimumFilter:
    """Filter that gives the smallest value of each element of an array in its last samples."""

    def __init__(self) -> None:
        """Begin without samples."""
        self._last: list[FloatArray] = []

    def update(self, now: FloatArray) -> FloatArray:
        """Add a sample, and return the minimum of the last `min_duration_samples` samples.

        Args:
            now: New sample, an array in any unit.

        Returns:
            Minimum of each element, of the same shape and unit. All are 0 until there are
            `min_duration_samples` samples.
        """
        self._last = [now, *self._last[: ISOLATION_SETTINGS.min_duration_samples - 1]]
        if len(self._last) < ISOLATION_SETTINGS.min_duration_samples:
            return np.zeros_like(now)
        return reduce(np.minimum, self._last)


SYMPTOM_KINDS: tuple[type[Symptom], ...] = (
    SilentSensor,
    FrozenPressure,
    FrozenLength,
    JumpingLength,
    DisagreeingLine,
    DisagreeingValve,
    FollowingError,
    Overpressure,
    SupplyLoss,
    Saturation,
    HeldPlan,
)
"""Symptoms in the order of their evaluation; the first one above its limit stops the arm."""

PRESSURE_SYMPTOM_KINDS = (FrozenPressure, DisagreeingLine, DisagreeingValve)
"""Symptoms that need pressure sensors."""
