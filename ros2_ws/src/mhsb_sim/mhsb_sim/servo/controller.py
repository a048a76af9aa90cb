"""What a servo controller is, and the signals that it works on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mhsb_model.arm_reports import Estimate
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_sim.circuit.network import Circuit
from mhsb_sim.records import Records

SENSOR = np.dtype(
    [
        ("length", "f8"),  # m, between the cylinder's pins
        ("cap_pressure", "f8"),  # Pa
        ("rod_pressure", "f8"),  # Pa
        ("line_pressure", "f8"),  # Pa
    ]
)

REFERENCE_POINTS = 6
"""Points of the reference that a controller sees, the first is now."""


@dataclass
class ServoSignals:
    """What a controller reads and writes in each step.

    reference      float64[REFERENCE_POINTS, 3, n]: now and ahead, point `AHEAD` is `preview`
                   later; q, q̇, q̈
    sensors        SENSOR[n]
    rail_pressure  float64[1], Pa, measured
    modes          uint8[n], prepared modes: in force, or about to be where modules are free
    modes_ahead    uint8[n], in force `preview` later
    serves         int64[m], actuator that each module serves, −1 where idle
    circuit        as the controller knows it, not the one that is simulated: its actuators'
                   `valve_command`, `join_command` and its modules' `flow_command`, `lend` are
                   what the controller writes; pump flows are measured by the pumps' speeds, join
                   valves and diverters follow their commands as the machine file has it
    """

    reference: FloatArray
    sensors: Records
    rail_pressure: FloatArray
    modes: ModeArray
    modes_ahead: ModeArray
    serves: IntArray
    circuit: Circuit


class Controller(Protocol):
    """A servo: position reference in, valve openings and servo pump flows out."""

    usual_error: float
    """Distance of the tip from its reference [m] that is no sign of anything wrong."""

    preview: float
    """How far ahead modes are prepared for it [s]; it sees the reference further, see signals."""

    def __init__(self, machine: Machine, signals: ServoSignals) -> None:
        """Bind to the signals that `update` will work on."""
        ...

    @property
    def estimates(self) -> list[Estimate]:
        """What it has learnt of its machine; nothing where it does not learn."""
        ...

    def update(self) -> None:
        """Write all commands for the next step, from the signals as they are now."""
        ...
