"""Faults that can be injected into a running simulation, to see what supervision makes of them."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from mhsb_model.types import FloatArray
from mhsb_sim.circuit.network import Circuit
from mhsb_sim.records import Records


class Fault(StrEnum):
    """What fails, as long as it is set."""

    NONE = "none"
    SENSOR = "sensor"  # the first actuator's line pressure sensor gives NaN
    SERVO_PUMPS = "servo_pumps"  # their motors have no power left
    MAIN_PUMP = "main_pump"  # it delivers nothing


def set_fault(
    fault: Fault, circuit: Circuit, healthy: Records, noise_scale: FloatArray
) -> None:
    """Make a circuit as the fault has it, and all else in it healthy.

    healthy: CONSTANTS[1] without fault; noise_scale: float64[4 n + 1 + m], standard deviations of
    the sensors in the order of `sensors.channels_of`, which may become NaN.
    """
    circuit.constants[:] = healthy
    if fault is Fault.SENSOR:
        noise_scale[len(circuit.actuators) + 2] = np.nan
    elif fault is Fault.SERVO_PUMPS:
        circuit.constants["servo_pump_power"] = 0.0
    elif fault is Fault.MAIN_PUMP:
        circuit.constants["main_pump_flow"] = 0.0
