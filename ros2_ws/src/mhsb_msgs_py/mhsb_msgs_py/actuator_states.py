"""Codec: `ActuatorSample` as sensor_msgs/JointState with one name for each quantity.

No standard message speaks of hydraulic actuators. JointState has a stamp and named numbers, and
plotting tools show them by name; so each quantity is an entry `actuator_1/cap_pressure` whose
value, in SI units, stands in `position`. `velocity` and `effort` stay empty.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from mhsb_model.types import FloatArray, frozen
from mhsb_msgs_py import checks, stamps


@dataclass(frozen=True)
class ActuatorSample:
    """State of the hydraulics of n actuators at one time; all arrays are float64[n].

    stamp_ns          absolute time, ns
    cap_pressure      in the cap-side chamber, Pa
    rod_pressure      in the rod-side chamber, Pa
    supply_pressure   in the line that feeds the actuator's valve, Pa
    force             of the cylinder, p_A A - p_B a, N
    piston_speed      positive extending, m/s
    supply_flow       from the line through the valve, m³/s
    valve_opening     of the servo valve, -1 to 1, positive extends
    servo_pump_flow   of the actuator's own booster module, m³/s
    servo_pump_speed  of the same pump, share of the speed of full flow
    """

    stamp_ns: int
    cap_pressure: FloatArray
    rod_pressure: FloatArray
    supply_pressure: FloatArray
    force: FloatArray
    piston_speed: FloatArray
    supply_flow: FloatArray
    valve_opening: FloatArray
    servo_pump_flow: FloatArray
    servo_pump_speed: FloatArray

    def __post_init__(self) -> None:
        for name in QUANTITIES:
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), np.float64)))


QUANTITIES = tuple(field.name for field in fields(ActuatorSample) if field.name != "stamp_ns")


def entry_names(actuator_names: Sequence[str]) -> list[str]:
    """Names of all entries: for each actuator all quantities, in the order of the dataclass."""
    return [f"{actuator}/{quantity}" for actuator in actuator_names for quantity in QUANTITIES]


def encode(sample: ActuatorSample, actuator_names: Sequence[str]) -> JointState:
    """Message of a sample of n actuators, n names."""
    table = np.stack([getattr(sample, quantity) for quantity in QUANTITIES], axis=1)
    return JointState(
        header=Header(stamp=stamps.to_time(sample.stamp_ns)),
        name=entry_names(actuator_names),
        position=array("d", table.ravel()),
    )


def decode(message: JointState, actuator_names: Sequence[str]) -> ActuatorSample:
    """The sample of a message, actuators in the order of `actuator_names`.

    Raises MessageError where names, sizes or numbers are not right.
    """
    order = checks.joint_order("actuator states", message.name, entry_names(actuator_names))
    checks.empty("velocity", message.velocity)
    checks.empty("effort", message.effort)
    table = checks.values("position", message.position, order)
    columns = table.reshape(len(actuator_names), len(QUANTITIES)).T
    return ActuatorSample(stamps.from_time(message.header.stamp), *columns)
