"""Sensors of the simulated arm: records of readings, sensor classes with errors and resolution.

A reading is

    ⌊(x + o + d t + w)/r⌉ r

with the true value x, the offset o and drift d of the sensor, the noise w of each reading, and the
resolution r. ⌊ ⌉ rounds to the nearest integer. A length sensor measures the angle of a joint. So
its resolution r is an angle [rad], while o, d and w are lengths of the cylinder [m].
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mhsb_model.circuit.constants import compute_full_pump_flow
from mhsb_model.machine import Machine
from mhsb_model.records import Record, Records, create_records
from mhsb_model.schema import Sensors
from mhsb_model.types import FloatArray, ModeArray


@dataclass(frozen=True)
class ActuatorStates:
    """State of all actuators, float64[n] each unless stated otherwise, in SI units."""

    cap_pressure: FloatArray  # Pa
    rod_pressure: FloatArray  # Pa
    supply_pressure: FloatArray  # Pa, pressure of the actuator's line
    force: FloatArray  # N, p_A A − p_B a
    piston_speed: FloatArray  # m/s, positive in extension
    valve_opening: FloatArray  # −1 … 1, positive extends
    valve_command: FloatArray  # −1 … 1, opening that the servo commands
    supply_flow: FloatArray  # m³/s, from the line into the cylinder
    servo_pump_flow: FloatArray  # m³/s, float64[modules]
    servo_pump_speed: FloatArray  # share of full speed, float64[modules]
    servo_pump_command: FloatArray  # share of full speed that the servo commands, float64[modules]
    rail_pressure: float  # Pa
    manifold_pressure: float  # Pa


@dataclass(frozen=True)
class Sensed:
    """Sensor readings and commands of n actuators and m servo pumps, in SI units.

    Attributes:
        reading_ns: Simulated time of the newest readings [ns]. Slow sensors keep them meanwhile.
        length: Distance between the pins of each cylinder, float64[n], [m].
        length_noise: Standard deviation of the noise of each length, float64[n], [m].
        pressure: Pressures of cap side, rod side and line, float64[n, 3], [Pa].
        silent: Time for which each sensor has given no reading, float64[4 n + 1 + m], [s]. The
            order is: n lengths, three pressures of each actuator, pressure of the rail, m speeds of
            servo pumps.
        valve_command: Commanded opening, −1 … 1, positive extends, float64[n].
        pump_flow: Flow of each servo pump by its speed, float64[m], [m³/s].
        pump_command: Commanded flow of each servo pump, float64[m], [m³/s].
        modes: Modes that the servo prepares, uint8[n].
    """

    reading_ns: int
    length: FloatArray
    length_noise: FloatArray
    pressure: FloatArray
    silent: FloatArray
    valve_command: FloatArray
    pump_flow: FloatArray
    pump_command: FloatArray
    modes: ModeArray


class SensorChannel(Record):
    """State of one sensor, in the unit of its reading."""

    offset: float
    """Present offset, with accumulated drift."""
    drift: float
    """Change of the offset in a step."""
    resolution: float
    """Resolution; 0 if a reading is not rounded."""
    error: float
    """Additional error of a failing sensor."""
    error_rate: float
    """Change of that error in a second."""
    frozen: float
    """1 if the reading always stays at `last_reading`."""
    dead: float
    """1 if there is no reading."""
    last_reading: float
    """Last reading."""
    silent: float
    """Time for which there has been no reading [s]."""


@dataclass(frozen=True)
class SensorClass:
    """Standard deviations and resolution of a kind of sensor, in SI units.

    Attributes:
        noise: Standard deviation of a reading; None for the value of the machine file.
        resolution: Resolution of a reading.
        offset: Standard deviation of the offset among sensors.
        drift: Standard deviation of the drift among sensors, per second.

    Values of length sensors are those of the joint angle [rad]. The joint's longest moment arm
    converts noise, offset and drift to lengths.
    """

    noise: float | None = None
    resolution: float = 0.0
    offset: float = 0.0
    drift: float = 0.0

    def scale(self, file_noise: float, unit: float = 1.0) -> tuple[float, float, float, float]:
        """Return noise, resolution, offset and drift in another unit.

        Args:
            file_noise: Noise of the machine file, which counts if the class has none.
            unit: Value of one unit of the class in the other unit.
        """
        noise = file_noise if self.noise is None else self.noise
        return unit * noise, unit * self.resolution, unit * self.offset, unit * self.drift


LENGTH_CLASSES = {
    "file": SensorClass(),
    "encoder_16_bit": SensorClass(resolution=2.0 * math.pi / 2**16),
    "encoder_13_bit": SensorClass(resolution=2.0 * math.pi / 2**13),
    # inertial sensors on the links: 0.1 degrees after their filter, 0.5 degrees a minute
    "imu": SensorClass(noise=math.radians(0.1), drift=math.radians(0.5) / 60.0),
}
"""Classes of length sensors by the names of the machine file."""
PRESSURE_CLASSES = {
    "file": SensorClass(),
    "none": SensorClass(noise=0.0),  # readings stay as `ServoSignals.at_rest` assumes them
    # 20 MPa, 16 bits, 0.025 %: calibrated against a deadweight tester
    "laboratory": SensorClass(noise=2e3, resolution=20e6 / 2**16, offset=5e3),
    # 25 MPa, 12 bits, zero differs by 0.1 % among sensors and drifts with temperature in minutes
    "industrial": SensorClass(noise=1e4, resolution=25e6 / 2**12, offset=2e4, drift=50.0),
}
"""Classes of pressure sensors by the names of the machine file."""
PUMP_SPEED = {
    "exact": SensorClass(noise=0.0),
    # shares of full speed: 12 bits behind a filter, as servo drives output it
    "resolver": SensorClass(noise=1e-3, resolution=2.0**-12),
}
"""Classes of pump speed sensors by the names of the machine file, in shares of full speed."""


class LengthErrors(NamedTuple):
    """Standard deviations of the errors of n length sensors, float64[n] each.

    Attributes:
        noise: Noise of a reading [m].
        offset: Offset at the start [m].
        drift: Change of the offset [m/s].
    """

    noise: FloatArray
    offset: FloatArray
    drift: FloatArray


def select_length_class(fitted: Sensors) -> SensorClass:
    """Return the class of the length sensors, with the values of the machine file.

    Noise, offset and drift of angles in the file replace the values of the class.

    Args:
        fitted: Sensors of the machine file.
    """
    own = {
        "noise": fitted.angle_noise,
        "offset": fitted.angle_offset,
        "drift": fitted.angle_drift,
    }
    named = {name: value for name, value in own.items() if value is not None}
    return replace(LENGTH_CLASSES[fitted.length], **named)


def compute_length_errors(machine: Machine) -> LengthErrors:
    """Compute the standard deviations of the errors of a machine's length sensors.

        σ_L = σ_q max |r|

    σ_q is the standard deviation for the joint angle, of noise, offset or drift. r is the moment
    arm of the joint. If neither the file nor the class of the sensors gives a noise of the angle,
    the noise of the length is `servo.length_noise`.

    Args:
        machine: The machine; its file names the class of its length sensors.
    """
    kind, arms = (
        select_length_class(machine.config.imperfections.sensors),
        machine.longest_moment_arms,
    )
    noise = np.full(machine.joint_count, machine.config.servo.length_noise)
    if kind.noise is not None:
        noise = kind.noise * arms
    return LengthErrors(noise, kind.offset * arms, kind.drift * arms)


def build_channels(
    machine: Machine, random: np.random.Generator, period: float
) -> tuple[Records[SensorChannel], FloatArray]:
    """Build the sensors of a machine, with offsets and drifts drawn at random.

    With n actuators and m servo pumps the order is: n lengths; cap, rod and line pressure of
    actuator 1, then of actuator 2 and so on; pressure of the rail (shared boost line); speeds of
    the m servo pumps, as flows. Offsets and drifts are normally distributed, with the standard
    deviations of the sensor's class. A drift is stored as the change from one reading to the
    next.

    Args:
        machine: The simulated machine; its file names the class of each kind of sensor.
        random: Generator for offsets and drifts.
        period: Time from one reading to the next [s].

    Returns:
        Sensors, SensorChannel[4 n + 1 + m], and the standard deviation of each sensor's noise,
        float64[4 n + 1 + m], [m, Pa or m³/s].
    """
    n, m = machine.joint_count, machine.arrays.module_count
    fitted = machine.config.imperfections.sensors
    lengths, full = compute_length_errors(machine), compute_full_pump_flow(machine)
    pressure = PRESSURE_CLASSES[fitted.pressure].scale(machine.config.servo.pressure_noise)
    kinds = (
        (n, lengths.noise, select_length_class(fitted).resolution, lengths.offset, lengths.drift),
        (3 * n + 1, *pressure),
        (m, *PUMP_SPEED[fitted.pump_speed].scale(0.0, full)),
    )
    channels, noises, first = (
        create_records(SensorChannel, 4 * n + 1 + m),
        np.zeros(4 * n + 1 + m),
        0,
    )
    for count, noise, resolution, offset, drift in kinds:
        own = slice(first, first + count)
        noises[own] = noise
        channels["resolution"][own] = resolution
        channels["offset"][own] = offset * random.standard_normal(count)
        channels["drift"][own] = drift * random.standard_normal(count) * period
        first += count
    return channels, noises
