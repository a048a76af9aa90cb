"""Sensors by class: what they add to the truth, and to how many digits they tell it.

A reading is ⌊(x + o + d t + w)/r⌉ r: true value x, offset o and drift d that are a sensor's own,
noise w of each reading, resolution r. Length is measured as a joint's angle, so that its
resolution is one of the angle [rad]; o, d, w are the cylinder's [m].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_sim.records import Records

CHANNEL = np.dtype(
    [
        ("offset", "f8"),  # at present
        ("drift", "f8"),  # of the offset, a step
        ("resolution", "f8"),  # 0 where a reading is not rounded
        ("error", "f8"),  # of one that fails, likewise the three below
        ("error_rate", "f8"),  # a second
        ("frozen", "f8"),  # 1 where it always tells `told`
        ("dead", "f8"),  # 1 where it tells no number
        ("told", "f8"),  # what it told last
        ("silent", "f8"),  # s, for which it has told no number
    ]
)


@dataclass(frozen=True)
class SensorClass:
    """Standard deviations in SI units, of an angle where it says so; None: the machine file's.

    noise       of a reading
    resolution  of a reading, rad where it is of a length
    offset      of one sensor from the next
    drift       of one sensor from the next, a second
    """

    noise: float | None = None
    resolution: float = 0.0
    offset: float = 0.0
    drift: float = 0.0


LENGTH = {
    "file": SensorClass(),
    "encoder_16_bit": SensorClass(resolution=2.0 * math.pi / 2**16),
    "encoder_13_bit": SensorClass(resolution=2.0 * math.pi / 2**13),
}
PRESSURE = {
    "file": SensorClass(),
    # 20 MPa, 16 bits, 0.025 %: calibrated against a deadweight tester
    "laboratory": SensorClass(noise=2e3, resolution=20e6 / 2**16, offset=5e3),
    # 25 MPa, 12 bits, zero 0.1 % from sensor to sensor, which temperature moves in minutes
    "industrial": SensorClass(noise=1e4, resolution=25e6 / 2**12, offset=2e4, drift=50.0),
}
PUMP_SPEED = {
    "exact": SensorClass(noise=0.0),
    # shares of full speed: 12 bits over a filter, as servo drives give it
    "resolver": SensorClass(noise=1e-3, resolution=2.0**-12),
}


def channels_of(machine: Machine, random: np.random.Generator) -> tuple[Records, FloatArray]:
    """CHANNEL[4 n + 1 + m] of a machine's sensors, and the standard deviations of their noise.

    Lengths first, then cap, rod and line pressure of each actuator, the rail's, the pumps' speeds
    [m³/s]. Offsets and drifts are drawn.
    """
    n, m = machine.joint_count, machine.arrays.module_count
    config, circuit = machine.config.servo, machine.config.circuit
    fitted = machine.config.imperfections.sensors
    full = machine.arrays.servo_pump_flow + circuit.servo_pump_flow_reserve
    kinds = (
        (n, LENGTH[fitted.length], config.length_noise, 1.0),
        (3 * n + 1, PRESSURE[fitted.pressure], config.pressure_noise, 1.0),
        (m, PUMP_SPEED[fitted.pump_speed], 0.0, full),
    )
    channels, noise, first = np.zeros(4 * n + 1 + m, CHANNEL), np.zeros(4 * n + 1 + m), 0
    for count, kind, of_file, unit in kinds:
        own = slice(first, first + count)
        noise[own] = unit * (of_file if kind.noise is None else kind.noise)
        channels["resolution"][own] = unit * kind.resolution
        channels["offset"][own] = unit * kind.offset * random.standard_normal(count)
        drift = unit * kind.drift * random.standard_normal(count)
        channels["drift"][own] = drift * machine.config.simulation.step
        first += count
    return channels, noise
