"""Faults that can be injected into a running simulation, to test supervision.

A fault is written KIND, KIND:PLACE or KIND:PLACE:VALUE. Several faults are separated by commas, for
instance `servo_pump_dead:2, pressure_offset:actuator_1.cap_pressure:5e5`.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from mhsb_model.circuit.quantities import CircuitConstants
from mhsb_model.machine import Machine
from mhsb_model.records import Records
from mhsb_model.schema import SupplySag
from mhsb_sim.circuit.network import Circuit
from mhsb_sim.errors import FaultError
from mhsb_sim.simulation.sensors import SensorChannel


def compute_sag_pressure(nominal: float, sag: SupplySag, time: float) -> float:
    """Compute the pressure that the main pump keeps during a supply sag.

    The pressure falls linearly from `nominal` to `sag.pressure` in the time `sag.fall`, and stays
    there for `sag.duration`. Then it rises linearly to `nominal` in the time `sag.fall`.

    Args:
        nominal: Pressure without the sag [Pa].
        sag: The sag: `start` [s], `fall` (duration of the fall) [s], `duration` of the low pressure
            [s], and low `pressure` [Pa].
        time: Time since the start of the simulation [s].

    Returns:
        Pressure [Pa].
    """
    since = time - sag.start
    left = sag.fall + sag.duration + sag.fall - since
    share = min(since, left) / sag.fall
    return nominal + min(max(share, 0.0), 1.0) * (sag.pressure - nominal)


NO_FAULT = "none"
"""Text that stands for no fault."""


class FaultTarget(NamedTuple):
    """The parts of a simulation that can fail.

    Attributes:
        circuit: The circuit with all its components.
        channels: The sensors, SensorChannel[4 n + 1 + m]; see `sensors.build_channels`.
    """

    circuit: Circuit
    channels: Records[SensorChannel]


class Fault(NamedTuple):
    """A fault: its kind, place and size.

    Attributes:
        kind: Key of `FAULT_KINDS`.
        place: Index among the places of this kind.
        value: Size in the unit of the kind; NaN if the kind has none.
    """

    kind: str
    place: int = 0
    value: float = math.nan


class FaultKind(NamedTuple):
    """A kind of fault.

    Attributes:
        places: Key of `list_places` for the possible places; empty if the fault concerns the whole
            part.
        part: Part of the circuit or of the sensors that fails; see `_select_parts`.
        fields: What the fault writes into that part: number by field, None for the fault's value.
        default_value: Value if none is given; None if a fault of this kind has no value.
        unit: Unit of the value.
        limits: Smallest and largest value.
    """

    places: str
    part: str
    fields: Mapping[str, float | None]
    default_value: float | None = None
    unit: str = ""
    limits: tuple[float, float] = (0.0, 0.0)


def parse_faults(text: str, machine: Machine) -> tuple[Fault, ...]:
    """Parse the text of one or several faults.

    Args:
        text: Faults separated by commas. Each is KIND:PLACE if the kind has places, otherwise KIND.
            A kind that has a value may add it: KIND:PLACE:VALUE or KIND::VALUE. Empty words and
            "none" are skipped.
        machine: The machine. Its actuators, sensors and servo pumps are the possible places.

    Returns:
        The faults in the order of the text.

    Raises:
        FaultError: A kind, place or value is not valid. The error names the valid ones.
    """
    words = [word.strip() for word in text.split(",")]
    return tuple(_parse_fault(word, machine) for word in words if word not in ("", NO_FAULT))


def _parse_fault(word: str, machine: Machine) -> Fault:
    """Parse one fault.

    Args:
        word: KIND:PLACE if the kind has places, otherwise KIND. A kind that has a value may add it:
            KIND:PLACE:VALUE or KIND::VALUE.
        machine: The machine. Its actuators, sensors and servo pumps are the possible places.

    Returns:
        The fault. Without a value in the word it has the default value of its kind, or NaN if the
        kind has none.

    Raises:
        FaultError: The kind is unknown, the place is missing or not valid, or the value is out of
            range. Or a value is given for a kind without values.
    """
    name, place, value = (*word.split(":", 2), "", "")[:3]
    kind = FAULT_KINDS.get(name)
    if kind is None:
        raise FaultError(
            f"there is no fault {name!r}; valid are {NO_FAULT}, {', '.join(FAULT_KINDS)}"
        )
    places = list_places(machine)[kind.places]
    if place not in (places or ("",)):
        valid = f"one of {', '.join(places)}" if places else "no place"
        raise FaultError(f"the fault {word!r} is at {place or 'no place'}; {name} takes {valid}")
    number = math.nan if kind.default_value is None else kind.default_value
    if value:
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if kind.default_value is None or not math.isfinite(number):
            valid = "none" if kind.default_value is None else f"a number in {kind.unit}"
            raise FaultError(f"the fault {word!r} has the value {value!r}; {name} takes {valid}")
        least, greatest = kind.limits
        if not least <= number <= greatest:
            raise FaultError(
                f"the fault {word!r} has the value {value!r}; {name} takes {least:g} to "
                f"{greatest:g} {kind.unit}"
            )
    return Fault(name, places.index(place) if places else 0, number)


def set_faults(
    faults: Sequence[Fault], plant: FaultTarget, constants: Records[CircuitConstants]
) -> None:
    """Make all parts of a plant healthy, then set faults.

    A fault of a kind without places holds for all records of its part.

    Args:
        faults: All faults that are to exist; others end.
        plant: The plant, changed in place.
        constants: Constants of the circuit without faults, CircuitConstants[1]. They are copied
            into the circuit before the faults are set.
    """
    parts = _select_parts(plant)
    parts["constants"][:] = constants
    for part, fields in HEALTHY_VALUES.items():
        for name, healthy in fields.items():
            parts[part][name] = healthy
    for fault in faults:
        kind = FAULT_KINDS[fault.kind]
        where = fault.place if kind.places else slice(None)
        for name, value in kind.fields.items():
            parts[kind.part][name][where] = fault.value if value is None else value


def _select_parts(plant: FaultTarget) -> dict[str, Records[Any]]:
    """Return the arrays of a plant into which faults are written, by name.

    `constants` belong to the whole circuit. `actuators`, `servo_pumps`, `sensors` and `pressures`
    (the pressure sensors alone) have a record for each place.
    """
    circuit, channels = plant
    return {
        "constants": circuit.constants,
        "actuators": circuit.actuators,
        "servo_pumps": circuit.modules,
        "sensors": channels,
        "pressures": channels[len(circuit.actuators) :],
    }


def list_places(machine: Machine) -> dict[str, list[str]]:
    """List the names of the places at which faults are possible.

    Args:
        machine: The machine with its actuators, sensors and servo pumps.

    Returns:
        Names by the kind of place; none for the kind "". Length and pressure sensors have the order
        of the channels. Servo pumps have their numbers, from 1, as names.
    """
    names = machine.actuator_names
    kinds = "cap_pressure", "rod_pressure", "line_pressure"
    lengths = [f"{name}.length" for name in names]
    pressures = [f"{name}.{kind}" for name in names for kind in kinds]
    return {
        "": [],
        "actuator": list(names),
        "servo_pump": [str(k + 1) for k in range(machine.arrays.module_count)],
        "length": lengths,
        "pressure": pressures,
        "sensor": lengths + pressures,
    }


HEALTHY_VALUES = {
    "actuators": {"follows_command": 1.0, "seized": 0.0, "leakage": 1.0},
    "servo_pumps": {"flow_ratio": 1.0, "runs_on": 0.0, "lag_ratio": 1.0},
    "sensors": {"dead": 0.0, "frozen": 0.0, "error": 0.0, "error_rate": 0.0},
}
"""Values in a healthy plant of all fields that a fault may write, by part of the plant."""

FAULT_KINDS = {
    "main_pump": FaultKind("", "constants", {"main_pump_flow": 0.0}),
    "supply_sag": FaultKind("", "constants", {"supply_pressure": None}, 3.3e6, "Pa", (1e3, 5e7)),
    "servo_pumps": FaultKind("", "servo_pumps", {"flow_ratio": 0.0}),
    "servo_pump_dead": FaultKind("servo_pump", "servo_pumps", {"flow_ratio": 0.0}),
    "servo_pump_slow": FaultKind(
        "servo_pump", "servo_pumps", {"lag_ratio": None}, 20.0, "times its lag", (0.01, 1e4)
    ),
    "servo_pump_stuck_on": FaultKind("servo_pump", "servo_pumps", {"runs_on": 1.0}),
    "valve_stuck": FaultKind("actuator", "actuators", {"seized": 1.0}),
    "valve_hard_over": FaultKind(
        "actuator",
        "actuators",
        {"follows_command": 0.0, "runaway": None},
        1.0,
        "shares of its stroke",
        (-1.0, 1.0),
    ),
    "leakage": FaultKind(
        "actuator", "actuators", {"leakage": None}, 5.0, "times that of the file", (0.0, 1e4)
    ),
    "sensor_dead": FaultKind("sensor", "sensors", {"dead": 1.0}),
    "sensor_frozen": FaultKind("sensor", "sensors", {"frozen": 1.0}),
    "length_offset": FaultKind("length", "sensors", {"error": None}, 5e-3, "m", (-10.0, 10.0)),
    "length_drift": FaultKind(
        "length", "sensors", {"error_rate": None}, 2e-3, "m/s", (-10.0, 10.0)
    ),
    "pressure_offset": FaultKind("pressure", "pressures", {"error": None}, 1e6, "Pa", (-1e8, 1e8)),
    "pressure_drift": FaultKind(
        "pressure", "pressures", {"error_rate": None}, 2e5, "Pa/s", (-1e9, 1e9)
    ),
}
"""Kinds of faults by name.

They are: the main pump gives no flow, or less pressure; all servo pumps stand still, one stands
still, one is slow, one runs at full speed; a spool stays where it is, one goes to an end; a line
leaks; a sensor gives no reading, a constant one, one with an offset, or one with a growing offset.
"""
