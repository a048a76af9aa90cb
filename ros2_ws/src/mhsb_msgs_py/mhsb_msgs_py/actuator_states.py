"""Codec of `ActuatorSample` as sensor_msgs/JointState with one name for each quantity.

No standard message describes hydraulic actuators. JointState has a stamp and named numbers, which
plotting tools show by name. So each quantity is an entry such as `actuator_1/cap_pressure`. Its
value in SI units is in `position`. `velocity` and `effort` stay empty.
"""

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

    Attributes:
        stamp_ns: Absolute time [ns].
        cap_pressure: Pressure in the cap-side chamber [Pa].
        rod_pressure: Pressure in the rod-side chamber [Pa].
        supply_pressure: Pressure in the line that feeds the actuator's servo valve [Pa].
        force: Piston force p_A A - p_B a [N].
        piston_speed: Speed of the piston, positive if it extends [m/s].
        supply_flow: Flow from the supply line through the valve [m^3/s].
        valve_opening: Opening of the servo valve, -1 to 1, positive if the piston extends.
        servo_pump_flow: Flow of the actuator's own booster module [m^3/s].
        servo_pump_speed: Speed of this module's pump, as a share of full speed.
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
        """Convert all arrays to read-only float64."""
        for name in SAMPLE_FIELDS:
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), np.float64)))


SAMPLE_FIELDS = tuple(field.name for field in fields(ActuatorSample) if field.name != "stamp_ns")
"""Names of the quantities of a sample, in the order of a message."""


def entry_names(actuator_names: Sequence[str]) -> list[str]:
    """Return the names of all entries of a message.

    Args:
        actuator_names: Names of the actuators.

    Returns:
        Names such as `actuator_1/cap_pressure`: for each actuator all quantities in the order of
        `ActuatorSample`.
    """
    return [f"{actuator}/{quantity}" for actuator in actuator_names for quantity in SAMPLE_FIELDS]


def encode(sample: ActuatorSample, actuator_names: Sequence[str]) -> JointState:
    """Encode a sample of n actuators.

    Args:
        sample: The sample.
        actuator_names: Names of the n actuators, in the order of the sample's arrays.

    Returns:
        Message with one entry for each actuator and quantity; the values are in `position`.
    """
    table = np.stack([getattr(sample, quantity) for quantity in SAMPLE_FIELDS], axis=1)
    return JointState(
        header=Header(stamp=stamps.to_time(sample.stamp_ns)),
        name=entry_names(actuator_names),
        position=array("d", table.ravel()),
    )


def decode(message: JointState, actuator_names: Sequence[str]) -> ActuatorSample:
    """Decode a message to a sample.

    Args:
        message: The message, with its entries in any order.
        actuator_names: Names of the actuators in the order of the result.

    Returns:
        The sample.

    Raises:
        MessageError: One of these holds. An entry is missing, unknown or given twice. An entry has
            no value, or a value that is not finite. The nanoseconds of the stamp make a second or
            more. `velocity` or `effort` is not empty.
    """
    order = checks.find_joint_order("actuator states", message.name, entry_names(actuator_names))
    checks.check_empty("velocity", message.velocity)
    checks.check_empty("effort", message.effort)
    table = checks.check_values("position", message.position, order)
    columns = table.reshape(len(actuator_names), len(SAMPLE_FIELDS)).T
    return ActuatorSample(stamps.from_time(message.header.stamp), *columns)
