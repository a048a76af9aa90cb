"""Symptoms that name what has failed, from what sensors tell and the servo asks for alone.

They say that two things do not go together which cannot differ in a healthy arm, however unlike
its file: hence their tolerances, within which a fault stays unnamed. Source of the idea: R.
Isermann, Fault-Diagnosis Systems, 2006 (parity relations, plausibility of signals).
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray
from mhsb_sim.circuit.constants import cylinders_of
from mhsb_sim.simulation.sample import WATCH_PERIOD_NS, Finding, Sample
from mhsb_sim.simulation.sensed import Sensed

PERIOD = WATCH_PERIOD_NS / SECOND_NS
CAP, ROD, LINE = range(3)
PRESSURES = "cap pressure", "rod pressure", "line pressure"
STILL = 0.05
"""Share of its full flow up to which a servo pump feeds nothing."""


class SilentSensor:
    """Time for which a sensor has told no number."""

    name, unit = "silent_sensor", "s"
    closes = True

    def __init__(self, machine: Machine) -> None:
        names = machine.actuator_names
        pumps = range(1, machine.arrays.module_count + 1)
        self._names = [
            *(f"the length sensor of {name}" for name in names),
            *(f"the {each} sensor of {name}" for name in names for each in PRESSURES),
            "the pressure sensor of the rail",
            *(f"the speed sensor of servo pump {k}" for k in pumps),
        ]

    def look(self, sample: Sample) -> Finding:
        """What has been silent longest."""
        silent = sample.sensed.silent
        k = int(np.argmax(silent))
        return Finding(float(silent[k]), f"{self._names[k]} has told nothing for {silent[k]:.3f} s")


class FrozenPressure:
    """Time for which a pressure sensor has told the very same, while others' noise goes on."""

    name, unit = "frozen_pressure", "s"
    closes = True

    def __init__(self, machine: Machine) -> None:
        self._names = [
            f"the {kind} sensor of {name}" for name in machine.actuator_names for kind in PRESSURES
        ]
        self._before = np.full((machine.joint_count, len(PRESSURES)), np.nan)
        self._same = np.zeros((machine.joint_count, len(PRESSURES)))

    def look(self, sample: Sample) -> Finding:
        """What has not changed for longest."""
        now = sample.sensed.pressure
        changed = now != self._before
        self._before = now
        self._same = np.where(changed, 0.0, self._same + float(changed.any()) * PERIOD)
        k = int(np.argmax(self._same))
        time = float(self._same.flat[k])
        return Finding(time, f"{self._names[k]} has told the very same for {time:.2f} s")


class FrozenLength:
    """Way of a piston in the reference [m] since its length sensor told anything new."""

    name, unit = "frozen_length", "m"
    closes = True

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._told = np.full(machine.joint_count, np.nan)
        self._wanted = np.zeros(machine.joint_count)

    def look(self, sample: Sample) -> Finding:
        """The piston that has been meant to go furthest."""
        now = sample.sensed.length
        wanted = self._machine.cylinder_lengths(sample.reference.position)
        self._wanted = np.where(now != self._told, wanted, self._wanted)
        self._told = now
        way = np.abs(wanted - self._wanted)
        j = int(np.argmax(way))
        return Finding(
            float(way[j]),
            f"the length sensor of {self._machine.actuator_names[j]} has told the very same while "
            f"its piston was to go {1e3 * way[j]:.2f} mm",
        )


class JumpingLength:
    """By how much a length has leapt in a look, over what a piston goes at most."""

    name, unit = "jumping_length", ""
    closes = True

    FARTHEST: ClassVar = 3e-3
    """Way of a piston in a look [m]."""

    def __init__(self, machine: Machine) -> None:
        self._names = machine.actuator_names
        self._length: FloatArray | None = None

    def look(self, sample: Sample) -> Finding:
        """The length that has leapt furthest."""
        before, self._length = self._length, sample.sensed.length
        way = self._length - (self._length if before is None else before)
        j = int(np.argmax(np.abs(way)))
        text = f"the length sensor of {self._names[j]} has leapt by {1e3 * way[j]:.1f} mm"
        return Finding(float(abs(way[j])) / self.FARTHEST, text)


class DisagreeingLine:
    """How far a line in N tells another pressure than all others and the file [Pa], lasting.

    Behind their check valves all lines that nobody boosts are at the main pump's pressure; not one
    that its own pump feeds nevertheless.
    """

    name, unit = "disagreeing_line", "Pa"
    closes = True

    SETTLED: ClassVar = 2.0
    """Time [s] after which nothing of a boost is left in a line."""

    SMOOTHING: ClassVar = 0.05
    """Of each look, in a low-pass filter."""

    def __init__(self, machine: Machine) -> None:
        self._names = machine.actuator_names
        self._supply = machine.arrays.supply_pressure
        self._full = machine.arrays.servo_pump_flow
        self._since = np.zeros(machine.joint_count)
        self._apart = np.zeros(machine.joint_count)

    def look(self, sample: Sample) -> Finding:
        """The line that is furthest from all others."""
        sensed = sample.sensed
        line, pumps = sensed.pressure[:, LINE], min(len(sensed.modes), len(sensed.pump_flow))
        feeds = np.zeros(len(line), dtype=bool)
        feeds[:pumps] = sensed.pump_flow[:pumps] > STILL * self._full
        unboosted = (sensed.modes == Mode.N) & ~feeds
        self._since = np.where(unboosted, self._since + PERIOD, 0.0)
        counts = self._since > self.SETTLED
        for j in range(len(line)):
            others = [line[i] for i in np.flatnonzero(counts) if i != j]
            differences = [line[j] - other for other in (*others, self._supply)]
            least = min(differences, key=abs) if counts[j] and others else 0.0
            self._apart[j] += self.SMOOTHING * (least - self._apart[j])
        j = int(np.argmax(np.abs(self._apart)))
        apart = float(self._apart[j])
        name = f"the line pressure sensor of {self._names[j]}"
        return Finding(abs(apart), f"{name} is {apart / 1e6:.2f} MPa off the others")


class DisagreeingValve:
    """Way of a piston [m] that its valve's opening does not explain.

    What opening and pressures explain of its speed, by either chamber,

        v_A = (Q_A − C_A ṗ_A)/A,   v_B = (Q_B + C_B ṗ_B)/a

    counts with all between, as far as a valve with another gain, overlap and delay would give; the
    rest adds up, and is forgotten in time.
    """

    name, unit = "disagreeing_valve", "m"
    closes = True

    GAIN: ClassVar = 0.4
    OPENING: ClassVar = 0.05
    """Share of a speed, and of the stroke, by which valves may differ from the file."""

    SLOWEST: ClassVar = 3e-3
    """Speed that counts for nothing [m/s]."""

    FORGETTING: ClassVar = 0.5
    """Time in which what has added up is forgotten [s]."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._names = machine.actuator_names
        self._cylinders = cylinders_of(machine)
        self._unexplained = np.zeros(machine.joint_count)
        self._before: Sensed | None = None
        self._opened = np.zeros(machine.joint_count)

    def look(self, sample: Sample) -> Finding:
        """The piston that has gone furthest."""
        now, before = sample.sensed, self._before
        opened = self._opened
        self._before, self._opened = now, now.valve_command
        if before is None:
            return Finding(0.0, "")
        speed = (now.length - before.length) / PERIOD
        lowest, highest = self._explained(before, now, np.array([opened, now.valve_command]))
        beyond = np.maximum(lowest - speed, speed - highest) - self.GAIN * np.abs(speed)
        beyond = np.maximum(beyond - self.SLOWEST, 0.0)
        self._unexplained += (beyond - self._unexplained / self.FORGETTING) * PERIOD
        j = int(np.argmax(self._unexplained))
        far = float(self._unexplained[j])
        return Finding(
            far,
            f"the valve or the length sensor of {self._names[j]} fails: its piston has gone "
            f"{1e3 * far:.2f} mm otherwise than the valve was told to open",
        )

    def _explained(
        self, before: Sensed, now: Sensed, opening: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest speeds [m/s] that openings between these give."""
        arrays, oil, own = self._machine.arrays, self._machine.config.circuit, self._cylinders
        pressure = 0.5 * (before.pressure + now.pressure)
        rate = (now.pressure - before.pressure) / PERIOD
        length = 0.5 * (before.length + now.length)
        chambers = (
            (arrays.cap_area, CAP, length - own["min_length"], 1.0),
            (arrays.rod_area, ROD, own["max_length"] - length, -1.0),
        )
        slack = np.array([-self.OPENING, 0.0, self.OPENING])
        speeds = []
        for area, side, stroke, sign in chambers:
            capacity = (own["dead_volume"] + own["swept"] * area * stroke) / oil.bulk_modulus
            fed = np.maximum(pressure[:, LINE] - pressure[:, side], 0.0)
            emptied = np.maximum(pressure[:, side] - arrays.tank_pressure, 0.0)
            for each in (opening[:, None, :] + slack[:, None]).reshape(-1, len(area)):
                drop = np.where(sign * each > 0.0, fed, emptied)
                flow = arrays.valve_coefficient * each * np.sqrt(drop)
                speeds.append((flow - sign * capacity * rate[:, side]) / area)
        explained = np.array(speeds)
        lowest, highest = explained.min(axis=0), explained.max(axis=0)
        return lowest - self.GAIN * np.abs(lowest), highest + self.GAIN * np.abs(highest)


class ServoPumpWatch:
    """Which servo pumps do not do what they are told, and how they fail.

    A pump's flow is compared with that of a healthy one which is told the same, and has no more
    power than the file gives it; one that is apart for LASTING fails. Lags may be three times the
    file's.

    failures  how each fails, by its number; the first is 0
    """

    APART: ClassVar = 0.2
    """Share of its full flow by which a pump is apart."""

    SUSPECTED: ClassVar = 0.05
    LASTING: ClassVar = 0.2
    """Time [s] for which it is apart that may explain another symptom, or counts as failing."""

    def __init__(self, machine: Machine) -> None:
        oil, arrays = machine.config.circuit, machine.arrays
        self._supply = arrays.supply_pressure
        self._full = arrays.servo_pump_flow + oil.servo_pump_flow_reserve
        self._power = arrays.servo_pump_efficiency * oil.servo_pump_power
        self._decay = math.exp(-PERIOD / oil.servo_pump_lag)
        self._healthy = np.zeros(arrays.module_count)
        self._lasting = np.zeros(arrays.module_count)
        self.failures: dict[int, str] = {}

    def look(self, sensed: Sensed) -> bool:
        """Whether one has been found to fail that had not before."""
        boost = max(sensed.pressure[:, LINE].max() - self._supply, 1.0)
        goal = np.minimum(sensed.pump_command, self._power / boost)
        self._healthy += (1.0 - self._decay) * (goal - self._healthy)
        apart = np.abs(sensed.pump_flow - self._healthy) / self._full
        self._lasting = np.where(apart > self.APART, self._lasting + PERIOD, 0.0)
        found = set(np.flatnonzero(self._lasting > self.LASTING).tolist()) - set(self.failures)
        for k in sorted(found):
            self.failures[k] = self._sentence(k, sensed)
        return bool(found)

    def suspicion(self, sensed: Sensed) -> str:
        """Which pumps fail, or are about to be found to; empty where none is."""
        late = np.flatnonzero(self._lasting > self.SUSPECTED).tolist()
        new = [self._sentence(k, sensed) for k in late if k not in self.failures]
        return ", ".join([*self.failures.values(), *new])

    def _sentence(self, k: int, sensed: Sensed) -> str:
        share, told = sensed.pump_flow[k] / self._full, sensed.pump_command[k] / self._full
        does = "stands still" if share < STILL else f"runs at {share:.2f} of its full speed"
        return f"servo pump {k + 1} {does}, told to run at {told:.2f}"
