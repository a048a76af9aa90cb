"""Symptoms by which it shows that an arm does not do what its servo wants: one class each.

A symptom is a number that is small while all is well; what it may amount to, for a warning and
before the arm is stopped, is in `SupervisionLimits`. A further one is a class and a line in
`SYMPTOMS` with its pair of limits.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray
from mhsb_sim.simulation.diagnosis import (
    DisagreeingLine,
    DisagreeingValve,
    FrozenLength,
    FrozenPressure,
    JumpingLength,
    SilentSensor,
)
from mhsb_sim.simulation.sample import WATCH_PERIOD_NS, Finding, Sample

LASTING = 5
"""Looks that a pressure has to last for; shorter peaks and dips count for nothing."""

ALL_LACK = 0.1
"""Share of P_S that every line lacks where the main pump is to blame."""

FULL = 0.99
"""Share from which on a command counts as all that there is."""


@dataclass(frozen=True)
class SupervisionLimits:
    """What each symptom may amount to: beyond the first it warns, beyond the second it stops.

    following_error  of a joint, measured against reference, rad
    overpressure     of a chamber or line, share of its relief valve's setting
    supply_loss      of a line, share of the main pump's pressure that it lacks
    saturation       time for which a valve is fully open or a servo pump at full speed, s
    held             time for which the guard holds the plan, s

    And what names a part that has failed, see `diagnosis`:

    silent_sensor       time for which it tells no number, s
    frozen_pressure     time for which its sensor tells the very same, s
    frozen_length       way of a piston during which its sensor does, m
    jumping_length      by how much a length leaps, over what a piston goes
    disagreeing_line    how far one in N is off all others, Pa
    disagreeing_valve   way of a piston that its opening does not explain, m
    """

    following_error: tuple[float, float] = (0.03, 0.06)
    overpressure: tuple[float, float] = (0.85, 0.97)
    supply_loss: tuple[float, float] = (0.6, 0.8)
    saturation: tuple[float, float] = (0.3, 1.0)
    held: tuple[float, float] = (1.0, 3.0)
    silent_sensor: tuple[float, float] = (0.005, 0.01)
    frozen_pressure: tuple[float, float] = (0.12, 0.2)
    frozen_length: tuple[float, float] = (3e-4, 6e-4)
    jumping_length: tuple[float, float] = (0.8, 1.0)
    disagreeing_line: tuple[float, float] = (2.5e5, 5e5)
    disagreeing_valve: tuple[float, float] = (5e-4, 8e-4)


class Symptom(Protocol):
    """Something that is looked at every `WATCH_PERIOD_NS`.

    closes  whether valves are closed at once where it stops the arm: nobody can brake it
    """

    name: str
    unit: str
    closes: bool

    def __init__(self, machine: Machine) -> None:
        """Begin anew: nothing has lasted yet."""
        ...

    def look(self, sample: Sample) -> Finding:
        """Its size now."""
        ...


class FollowingError:
    """max |q_ref − q| over the joints; of one that slides as a share of its range, π for all."""

    name, unit = "following_error", "rad"
    closes = False

    def __init__(self, machine: Machine) -> None:
        self._names, self._units = machine.joint_names, machine.joint_units
        self._radians = machine.radians

    def look(self, sample: Sample) -> Finding:
        """The joint that is furthest off."""
        off = np.abs(sample.reference.position - sample.measured.position)
        size = off / self._radians
        j = int(np.argmax(size))
        told = f"{self._names[j]} is {off[j]:.3f} {self._units[j]} off its reference"
        return Finding(float(size[j]), told)


class Overpressure:
    """max p/p_relief over chambers and lines, each the least of the last looks."""

    name, unit = "overpressure", ""
    closes = False

    def __init__(self, machine: Machine) -> None:
        actuators, chambers = machine.actuator_names, machine.chamber_reliefs
        lines = np.full(len(actuators), machine.config.circuit.line_relief_pressure)
        parts = ("cap side", "rod side", "line")
        self._names = [f"the {part} of {name}" for part in parts for name in actuators]
        self._settings = np.concatenate([chambers, chambers, lines])
        self._lasting = Lasting()

    def look(self, sample: Sample) -> Finding:
        """The chamber or line that is nearest to its relief valve's setting, or beyond."""
        of = sample.actuators
        pressure = np.concatenate([of.cap_pressure, of.rod_pressure, of.supply_pressure])
        share = self._lasting.least(pressure / self._settings)
        k = int(np.argmax(share))
        return Finding(
            float(share[k]),
            f"{self._names[k]} is at {share[k] * self._settings[k] / 1e6:.1f} MPa, "
            f"{share[k]:.2f} of its relief valve's setting",
        )


class SupplyLoss:
    """max 1 − p_line/P_S over the lines, each the least of the last looks."""

    name, unit = "supply_loss", ""
    closes = False

    def __init__(self, machine: Machine) -> None:
        self._names = machine.actuator_names
        self._supply = machine.arrays.supply_pressure
        self._lasting = Lasting()

    def look(self, sample: Sample) -> Finding:
        """The line that lacks most."""
        lacking = self._lasting.least(1.0 - sample.actuators.supply_pressure / self._supply)
        j = int(np.argmax(lacking))
        where = f"the line of {self._names[j]} lacks"
        if np.min(lacking) > ALL_LACK:
            where = "all lines lack"
        return Finding(float(lacking[j]), f"{where} {lacking[j]:.2f} of the main pump's pressure")


class Saturation:
    """Time for which a valve's or servo pump's command has been all that there is."""

    name, unit = "saturation", "s"
    closes = False

    def __init__(self, machine: Machine) -> None:
        pumps = range(1, machine.arrays.module_count + 1)
        self._names = [
            *(f"the valve of {name} has been fully open" for name in machine.actuator_names),
            *(f"servo pump {number} has been at full speed" for number in pumps),
        ]
        self._looks = np.zeros(len(self._names))

    def look(self, sample: Sample) -> Finding:
        """What has been saturated longest."""
        of = sample.actuators
        command = np.abs(np.concatenate([of.valve_command, of.servo_pump_command]))
        self._looks = np.where(command >= FULL, self._looks + 1.0, 0.0)
        k = int(np.argmax(self._looks))
        time = float(self._looks[k]) * WATCH_PERIOD_NS / SECOND_NS
        return Finding(time, f"{self._names[k]} for {time:.2f} s")


class Held:
    """Time for which the guard has held the plan, since nothing else keeps the arm from sagging."""

    name, unit = "held", "s"
    closes = False

    def __init__(self, machine: Machine) -> None:
        pass

    def look(self, sample: Sample) -> Finding:
        """How long it has been."""
        text = f"the plan has been held for {sample.held:.2f} s: {sample.why_held}"
        return Finding(sample.held, text)


class Lasting:
    """What a quantity has been at least through the last looks."""

    def __init__(self) -> None:
        self._last: deque[FloatArray] = deque(maxlen=LASTING)

    def least(self, now: FloatArray) -> FloatArray:
        """The least of the last looks, this one included; 0 until there are enough of them."""
        self._last.append(now)
        if len(self._last) < LASTING:
            return np.zeros_like(now)
        return np.min(self._last, axis=0)


SYMPTOMS: tuple[type[Symptom], ...] = (
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
    Held,
)
