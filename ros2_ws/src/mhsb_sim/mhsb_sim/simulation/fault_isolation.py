"""Symptoms that name the failed part, from sensor readings and servo commands alone.

Each symptom compares two signals that cannot disagree in a healthy arm, even if the arm differs
from its machine file. The tolerances allow for such differences. A fault that stays within the
tolerances is not found.

Source: R. Isermann, Fault-Diagnosis Systems, 2006 (parity relations, plausibility of signals).
"""

import math
from dataclasses import dataclass

import numpy as np

from mhsb_model.circuit.constants import build_cylinders, compute_full_pump_flow
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray
from mhsb_sim.simulation.sample import WATCH_PERIOD_NS, ArmSample, Finding, Symptom
from mhsb_sim.simulation.sensors import Sensed, compute_length_errors

WATCH_PERIOD = WATCH_PERIOD_NS / SECOND_NS
"""Time between two samples [s]."""
PRESSURE_NAMES = "cap pressure", "rod pressure", "line pressure"
"""Names of the columns of `Sensed.pressure` in texts."""
LINE_SENSOR = 2
"""Last of these columns; those before it belong to the chambers."""
JUMP_NOISE_FACTOR = 6.0
"""Standard deviations of noise that are no jump [-]; exceeded once in 5e8 readings."""


@dataclass(frozen=True)
class IsolationSettings:
    """Tuned numbers of all symptoms, beside their limits.

    Their sensitivity has not been measured: draws of random plants run without supervision.
    """

    min_duration_samples: int = 5
    """Number of samples that a deviation must last, one every WATCH_PERIOD_NS, 1 … 100.

    Shorter peaks and dips of pressures are ignored. A pump's deviation that lasts longer may
    explain another symptom. Origin: chosen."""
    common_loss_share: float = 0.1
    """Share of P_S that every line lacks if the main pump is the cause, 0 … 1.

    Origin: chosen; droop and check valves take 1 %. It only selects the words of the clause."""
    stopped_flow_share: float = 0.05
    """Share of its full flow up to which a servo pump counts as stopped, 0 … 1.

    Origin: chosen."""
    farthest_jump: float = 3e-3
    """Longest stroke of a piston in WATCH_PERIOD [m], 1e-4 … 1.

    Origin: chosen; a piston does not reach 0.3 m/s."""
    settled_time: float = 2.0
    """Time after which nothing of a boost is left in a line [s], 0.1 … 100.

    Origin: chosen."""
    line_smoothing: float = 0.05
    """Gain of the low-pass filter of pressure differences per sample, above 0 … 1.

    Origin: a time constant of twenty samples; pressures oscillate at 5 Hz and more."""
    valve_gain_tolerance: float = 0.4
    """Tolerance of a valve's gain against the machine file, as a share of a speed, 0 … 1.

    Origin: config/variations.yaml has 0.2; the rest covers the bulk modulus."""
    valve_opening_tolerance: float = 0.05
    """Tolerance of a valve's opening, as a share of the spool's stroke, 0 … 1.

    Origin: config/variations.yaml has an overlap of 0.03; the rest covers the delay."""
    slowest_speed: float = 3e-3
    """Unexplained speed that is ignored [m/s], 0 … 0.1.

    Origin: chosen."""
    forgetting_time: float = 0.5
    """Time constant in which the unexplained stroke is forgotten [s], 0.01 … 100.

    Origin: chosen."""
    pump_deviation: float = 0.2
    """Deviation of a pump that counts, as a share of its full flow, 0 … 1.

    Origin: allows three times the machine file's lag, with `pump_failure_time`."""
    pump_failure_time: float = 0.2
    """Duration of a deviation that is a failure [s], 0.01 … 10.

    Origin: allows three times the machine file's lag, with `pump_deviation`."""


ISOLATION_SETTINGS = IsolationSettings()
"""Settings of all symptoms."""

CHAMBER_SIGNS = np.array([[1.0], [-1.0]])
"""Direction in which the oil of each chamber, cap side and rod side, moves the piston [-]."""
OPENING_SLACK = ISOLATION_SETTINGS.valve_opening_tolerance * np.array([[-1.0], [0.0], [1.0]])
"""Differences from a valve's opening that are tolerated, as shares of the spool's stroke [-]."""


class SilentSensor(Symptom):
    """Time for which a sensor has given no reading [s]."""

    name, unit = "silent_sensor", "s"
    closes_valves = True

    def __init__(self, machine: Machine) -> None:
        """Prepare the names of all sensors, in the order of `Sensed.silent`.

        Args:
            machine: The machine.
        """
        names = machine.actuator_names
        pumps = range(1, machine.arrays.module_count + 1)
        self._names = [
            *(f"the length sensor of {name}" for name in names),
            *(f"the {each} sensor of {name}" for name in names for each in PRESSURE_NAMES),
            "the pressure sensor of the rail",
            *(f"the speed sensor of servo pump {k}" for k in pumps),
        ]

    def evaluate(self, sample: ArmSample) -> Finding:
        """Find the sensor that has given no reading for the longest time.

        Args:
            sample: State of the arm, with the silent time of each sensor. Only `sensed` (sensor
                readings) is read.

        Returns:
            Time without a reading [s], and a clause that names the sensor. If all sensors give
            readings, the time is 0 and the clause names the first sensor.
        """
        silent = sample.sensed.silent
        k = int(np.argmax(silent))
        return Finding(
            float(silent[k]), lambda: f"{self._names[k]} has given no reading for {silent[k]:.3f} s"
        )


class FrozenPressure(Symptom):
    """Time for which a pressure sensor has repeated its reading while other readings change [s]."""

    name, unit = "frozen_pressure", "s"
    closes_valves = True

    def __init__(self, machine: Machine) -> None:
        """Prepare the names of all pressure sensors except the rail's, and set their times to 0.

        Args:
            machine: The machine.
        """
        self._names = [
            f"the {kind} sensor of {name}"
            for name in machine.actuator_names
            for kind in PRESSURE_NAMES
        ]
        self._before = np.full((machine.joint_count, len(PRESSURE_NAMES)), np.nan)
        self._same = np.zeros((machine.joint_count, len(PRESSURE_NAMES)))

    def evaluate(self, sample: ArmSample) -> Finding:
        """Find the pressure sensor whose reading has been unchanged for the longest time.

        A changed reading sets the time of its sensor to 0. If at least one reading has changed
        since the previous call, WATCH_PERIOD is added to the times of all other sensors. If no
        reading has changed, no time is changed: the sensors may be slower than the calls.

        Args:
            sample: State of the arm. Only `sensed` (sensor readings) is read.

        Returns:
            Time without change [s], and a clause that names the sensor.
        """
        now = sample.sensed.pressure
        changed = now != self._before
        self._before = now
        self._same = np.where(changed, 0.0, self._same + float(changed.any()) * WATCH_PERIOD)
        k = int(np.argmax(self._same))
        time = float(self._same.flat[k])
        return Finding(time, lambda: f"{self._names[k]} has repeated its reading for {time:.2f} s")


class FrozenLength(Symptom):
    """Stroke of a piston's reference since the reading of its length sensor last changed [m].

    The stroke is updated only with a new reading, since sensors may be slower than supervision. If
    the new reading differs from the one before, the stroke is 0. A sensor without noise is not
    examined, since it repeats its reading whenever the piston rests.
    """

    name, unit = "frozen_length", "m"
    closes_valves = True

    def __init__(self, machine: Machine) -> None:
        """Begin without readings; the first call of `evaluate` stores readings and references.

        Args:
            machine: The machine.
        """
        self._machine = machine
        self._reading_ns = -1
        self._reading = np.full(machine.joint_count, np.nan)
        self._reference_length = np.zeros(machine.joint_count)
        self._stroke = np.zeros(machine.joint_count)

    def evaluate(self, sample: ArmSample) -> Finding:
        """Find the length sensor that is most likely frozen.

        This is the sensor whose piston should have moved farthest since the sensor's reading last
        changed. A sensor without noise never counts as frozen.

        Args:
            sample: State of the arm.

        Returns:
            Change of this piston's reference length [m] from the first reading with the present
            value to the newest reading, and a clause that names the sensor.
        """
        sensed = sample.sensed
        if sensed.reading_ns != self._reading_ns:
            wanted = self._machine.cylinder_lengths(sample.reference.position)
            is_sound = (sensed.length != self._reading) | (sensed.length_noise == 0.0)
            self._reference_length = np.where(is_sound, wanted, self._reference_length)
            self._reading_ns, self._reading = sensed.reading_ns, sensed.length
            self._stroke = np.abs(wanted - self._reference_length)
        j = int(np.argmax(self._stroke))
        return Finding(
            float(self._stroke[j]),
            lambda: (
                f"the length sensor of {self._machine.actuator_names[j]} has repeated its reading "
                f"while its piston was to move {1e3 * self._stroke[j]:.2f} mm"
            ),
        )


def compute_frozen_length_time(machine: Machine, limit: float) -> float:
    """Compute the time after which a frozen length sensor is found while its piston moves at V_max.

    Args:
        machine: The machine, with the rate of its sensors.
        limit: Stroke of the piston beyond which the sensor counts as frozen [m].

    Returns:
        Longest time from the last sound reading to the finding [s]. It consists of n periods of
        readings (of at least one watch period each) and one watch period. n is the smallest number
        of periods in which the fastest piston moves farther than `limit`. The time is infinite if
        the sensors have no noise, since supervision does not examine them.
    """
    if not compute_length_errors(machine).noise.any():
        return math.inf
    rate = machine.config.imperfections.sensors.rate
    period = max(1.0 / rate if rate else 0.0, WATCH_PERIOD)
    stroke = float(machine.arrays.max_piston_speed.max()) * period
    return (math.floor(limit / stroke) + 1) * period + WATCH_PERIOD


class JumpingLength(Symptom):
    """Jump of a length between two readings, divided by the longest stroke in that time [-].

    The longest stroke is `farthest_jump` in each WATCH_PERIOD. Six standard deviations of the
    difference of two readings are added, so that noise alone is no jump.
    """

    name, unit = "jumping_length", ""
    closes_valves = True

    def __init__(self, machine: Machine) -> None:
        """Begin without a sample."""
        self._names = machine.actuator_names
        self._before: Sensed | None = None

    def evaluate(self, sample: ArmSample) -> Finding:
        """Find the sensor whose length has changed most, relative to what a sound sensor can show.

        The change is counted from the readings of the previous call, which the object keeps.

        Args:
            sample: State of the arm. Only `sensed` (sensor readings) is read.

        Returns:
            Magnitude of the change divided by the largest change of a sound sensor [-], and a
            clause with the sensor's name and the signed change in mm. The largest change is
            `farthest_jump` times the number of watch periods between the readings (at least 1),
            plus JUMP_NOISE_FACTOR standard deviations of the noise of a difference. The value is 0
            in the first call.
        """
        now, before = sample.sensed, self._before or sample.sensed
        self._before = now
        periods = max((now.reading_ns - before.reading_ns) / WATCH_PERIOD_NS, 1.0)
        way = now.length - before.length
        noise = JUMP_NOISE_FACTOR * math.sqrt(2.0) * now.length_noise
        share = np.abs(way) / (ISOLATION_SETTINGS.farthest_jump * periods + noise)
        j = int(np.argmax(share))
        return Finding(
            float(share[j]),
            lambda: f"the length sensor of {self._names[j]} has leapt by {1e3 * way[j]:.1f} mm",
        )


class DisagreeingLine(Symptom):
    """Lasting pressure difference between an unboosted line and all other unboosted lines [Pa].

    All lines of actuators in mode N are at the main pump's pressure, behind their check valves. So
    they are compared with each other, and with the main pump's pressure of the machine file. A line
    that a servo pump still feeds is not compared.
    """

    name, unit = "disagreeing_line", "Pa"
    closes_valves = True

    def __init__(self, machine: Machine) -> None:
        """Set each line's time in mode N and its filtered difference from the other lines to 0.

        Args:
            machine: The machine.
        """
        self._names = machine.actuator_names
        self._supply = machine.arrays.supply_pressure
        self._full = machine.arrays.servo_pump_flow
        self._since = np.zeros(machine.joint_count)
        self._apart = [0.0] * machine.joint_count

    def evaluate(self, sample: ArmSample) -> Finding:
        """Find the unboosted line whose pressure differs most from all other unboosted lines.

        Lines are compared if their actuators have been in mode N (main pump alone), with their
        servo pumps stopped, for `settled_time`. All of them should have the main pump's pressure
        P_S. For each compared line, the differences to the other compared lines and to P_S are
        computed. The difference of smallest magnitude is passed through a low-pass filter. For a
        line that is not compared, or is the only one, the filter gets 0.

        Args:
            sample: State of the arm. Only `sensed` (sensor readings) is read.

        Returns:
            Magnitude of the largest filtered difference [Pa], and a clause that names the pressure
            sensor of that line.
        """
        sensed = sample.sensed
        line = sensed.pressure[:, LINE_SENSOR].tolist()  # Python's numbers are faster one by one
        pumps = min(len(sensed.modes), len(sensed.pump_flow))
        feeds = np.zeros(len(line), dtype=bool)
        feeds[:pumps] = (
            sensed.pump_flow[:pumps] > ISOLATION_SETTINGS.stopped_flow_share * self._full
        )
        unboosted = (sensed.modes == Mode.N) & ~feeds
        self._since = np.where(unboosted, self._since + WATCH_PERIOD, 0.0)
        counts = (self._since > ISOLATION_SETTINGS.settled_time).tolist()
        for j in range(len(line)):
            others = [other for i, other in enumerate(line) if counts[i] and i != j]
            differences = [line[j] - other for other in (*others, self._supply)]
            least = min(differences, key=abs) if counts[j] and others else 0.0
            self._apart[j] += ISOLATION_SETTINGS.line_smoothing * (least - self._apart[j])
        j = int(np.argmax(np.abs(self._apart)))
        apart, name = self._apart[j], self._names[j]
        return Finding(
            abs(apart),
            lambda: f"the line pressure sensor of {name} is {apart / 1e6:.2f} MPa off the others",
        )


class DisagreeingValve(Symptom):
    """Stroke of a piston that its valve's opening does not explain.

    Each chamber, A (cap side) and B (rod side), explains a piston speed by the valve's opening and
    the pressures [m/s]:

        v_A = (Q_A − C_A ṗ_A)/A,   v_B = (Q_B + C_B ṗ_B)/a

    Q_A flows into chamber A and Q_B out of chamber B [m³/s]. C is the capacity of a chamber
    [m³/Pa], ṗ the rate of its pressure [Pa/s], A and a are the piston areas [m²]. All speeds
    between v_A and v_B count as explained. Tolerances for gain, overlap and delay of the valve
    widen this range. The part of the speed beyond the range is integrated to a stroke, which decays
    with the time constant `forgetting_time`.
    """

    name, unit = "disagreeing_valve", "m"
    closes_valves = True

    def __init__(self, machine: Machine) -> None:
        """Set the unexplained stroke of each piston to 0.

        Args:
            machine: The machine, with areas, valve coefficients and oil of the comparison.
        """
        arrays, self._names = machine.arrays, machine.actuator_names
        self._cylinders = build_cylinders(machine)
        self._bulk_modulus = machine.config.circuit.bulk_modulus
        self._area = np.stack([arrays.cap_area, arrays.rod_area])
        self._swept = self._cylinders["swept_volume_factor"] * self._area
        self._valve_coefficient, self._tank = arrays.valve_coefficient, arrays.tank_pressure
        self._largest_drop = machine.config.hydraulics.valve.largest_drop
        self._unexplained = np.zeros(machine.joint_count)
        self._before: Sensed | None = None
        self._opened = np.zeros(machine.joint_count)

    def evaluate(self, sample: ArmSample) -> Finding:
        """Find the piston with the largest stroke that its valve's opening does not explain.

        The measured speed is compared with the range of speeds that opening and pressures explain.
        The part beyond this range and its tolerances is integrated to a stroke, which decays with
        the time constant `forgetting_time`.

        Args:
            sample: State of the arm. Only `sensed` (sensor readings) is read.

        Returns:
            Unexplained stroke of that piston [m], and a clause that names its actuator. In the
            first sample the stroke is 0 and the clause empty.
        """
        now, before = sample.sensed, self._before
        opened = self._opened
        self._before, self._opened = now, now.valve_command
        if before is None:
            return Finding(0.0, str)
        speed = (now.length - before.length) / WATCH_PERIOD
        lowest, highest = self._compute_explained_speeds(
            before, now, np.array([opened, now.valve_command])
        )
        beyond = np.maximum(
            lowest - speed, speed - highest
        ) - ISOLATION_SETTINGS.valve_gain_tolerance * np.abs(speed)
        beyond = np.maximum(beyond - ISOLATION_SETTINGS.slowest_speed, 0.0)
        self._unexplained += (
            beyond - self._unexplained / ISOLATION_SETTINGS.forgetting_time
        ) * WATCH_PERIOD
        j = int(np.argmax(self._unexplained))
        far = float(self._unexplained[j])
        return Finding(
            far,
            lambda: (
                f"the valve or the length sensor of {self._names[j]} fails: its piston has gone "
                f"{1e3 * far:.2f} mm that the opening of its valve does not explain"
            ),
        )

    def _compute_explained_speeds(
        self, before: Sensed, now: Sensed, opening: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Compute the range of piston speeds that valve openings and pressures explain.

        Each chamber gives one speed, by the equations of the class: the piston takes up the valve's
        flow minus the oil that a pressure change compresses. Pressures and lengths are means of two
        samples. Pressure rates are the differences of the two samples divided by WATCH_PERIOD. Each
        of the two valve commands is evaluated as it is, and with `valve_opening_tolerance` added
        and subtracted. With two chambers, this gives twelve speeds. The range covers all of them.

        Args:
            before: Readings of the last sample.
            now: Readings of this sample.
            opening: Valve commands at both samples, −1 … 1, float64[2, n].

        Returns:
            Lowest and highest speed of each piston, both float64[n], [m/s]. Each is moved outwards
            by the share `valve_gain_tolerance` of its magnitude.
        """
        own = self._cylinders
        pressure = 0.5 * (before.pressure + now.pressure)
        rate = (now.pressure - before.pressure) / WATCH_PERIOD
        length = 0.5 * (before.length + now.length)
        stroke = np.array([length - own["min_length"], own["max_length"] - length])
        capacity = (own["dead_volume"] + self._swept * stroke) / self._bulk_modulus
        compressed = CHAMBER_SIGNS * capacity * rate[:, :LINE_SENSOR].T
        chamber = pressure[:, :LINE_SENSOR].T
        fed = np.maximum(pressure[:, LINE_SENSOR] - chamber, 0.0)
        emptied = np.maximum(chamber - self._tank, 0.0)
        root = np.sqrt(np.minimum(np.array([fed, emptied]), self._largest_drop))[:, :, None]
        openings = (opening[:, None] + OPENING_SLACK).reshape(-1, opening.shape[1])
        opens = CHAMBER_SIGNS[:, :, None] * openings > 0.0
        flow = self._valve_coefficient * openings * np.where(opens, root[0], root[1])
        explained = (flow - compressed[:, None]) / self._area[:, None]
        lowest, highest = explained.min(axis=(0, 1)), explained.max(axis=(0, 1))
        return lowest - ISOLATION_SETTINGS.valve_gain_tolerance * np.abs(
            lowest
        ), highest + ISOLATION_SETTINGS.valve_gain_tolerance * np.abs(highest)


class ServoPumpMonitor:
    """Monitor that finds servo pumps that do not follow their commands.

    The flow of each pump is compared with the flow of a simulated healthy pump that gets the same
    command. The healthy pump has the lag and at most the power of the machine file. A pump counts
    as failed if it deviates by more than `pump_deviation` for `pump_failure_time`. Both tolerances
    allow a pump lag three times as long as in the machine file.

    Attributes:
        failures: Clause that describes each failed pump, by the pump's index from 0.
    """

    def __init__(self, machine: Machine) -> None:
        """Begin with all pumps healthy and at rest.

        Args:
            machine: The machine, with lag, full flow and power of its pumps.
        """
        oil, arrays = machine.config.circuit, machine.arrays
        self._supply = arrays.supply_pressure
        self._full = compute_full_pump_flow(machine)
        self._power = arrays.servo_pump_efficiency * oil.servo_pump_power
        self._decay = math.exp(-WATCH_PERIOD / oil.servo_pump_lag)
        self._healthy = np.zeros(arrays.module_count)
        self._lasting = np.zeros(arrays.module_count)
        self.failures: dict[int, str] = {}

    def update(self, sensed: Sensed) -> bool:
        """Compare all pumps with simulated healthy ones, and record new failures in `failures`.

        A healthy pump follows its command with the lag of the machine file, limited by its power at
        the highest line pressure. A pump fails if its flow has deviated by more than
        `pump_deviation` for longer than `pump_failure_time`. Each call counts as WATCH_PERIOD.

        Args:
            sensed: Readings and commands of this sample; flows, commanded flows and line pressures
                are used.

        Returns:
            True if this call has found a new failed pump.
        """
        boost = max(sensed.pressure[:, LINE_SENSOR].max() - self._supply, 1.0)
        goal = np.minimum(sensed.pump_command, self._power / boost)
        self._healthy += (1.0 - self._decay) * (goal - self._healthy)
        apart = np.abs(sensed.pump_flow - self._healthy) / self._full
        self._lasting = np.where(
            apart > ISOLATION_SETTINGS.pump_deviation, self._lasting + WATCH_PERIOD, 0.0
        )
        found = set(
            np.flatnonzero(self._lasting > ISOLATION_SETTINGS.pump_failure_time).tolist()
        ) - set(self.failures)
        for k in sorted(found):
            self.failures[k] = self._describe_pump(k, sensed)
        return bool(found)

    def describe_suspects(self, sensed: Sensed) -> str:
        """Describe the pumps that have failed, and pumps that may be failing.

        A pump may be failing if it has deviated from a healthy pump for longer than
        `min_duration_samples`.

        Args:
            sensed: Readings and commands of this sample.

        Returns:
            Clauses separated by commas; empty if there is no such pump.
        """
        least = ISOLATION_SETTINGS.min_duration_samples * WATCH_PERIOD
        late = np.flatnonzero(self._lasting > least).tolist()
        new = [self._describe_pump(k, sensed) for k in late if k not in self.failures]
        return ", ".join([*self.failures.values(), *new])

    def _describe_pump(self, k: int, sensed: Sensed) -> str:
        """Describe the actual and the commanded speed of a pump, as shares of its full speed.

        Args:
            k: Index of the pump, from 0.
            sensed: Readings and commands of this sample.

        Returns:
            A clause for a person.
        """
        share, commanded = sensed.pump_flow[k] / self._full, sensed.pump_command[k] / self._full
        does = (
            "stands still"
            if share < ISOLATION_SETTINGS.stopped_flow_share
            else f"runs at {share:.2f} of its full speed"
        )
        return f"servo pump {k + 1} {does}, commanded to run at {commanded:.2f}"
