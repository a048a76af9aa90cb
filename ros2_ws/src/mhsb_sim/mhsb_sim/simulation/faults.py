"""Faults that can be injected into a running simulation, to see what supervision makes of them.

A fault is written KIND, KIND:PLACE or KIND:PLACE:VALUE, several separated by commas, for instance
`servo_pump_dead:2, pressure_offset:actuator_1.cap_pressure:5e5`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from mhsb_model.machine import Machine
from mhsb_sim.circuit.network import Circuit
from mhsb_sim.errors import FaultError
from mhsb_sim.records import Records

NONE = "none"


class Plant(NamedTuple):
    """What can fail.

    circuit   with all that belongs to it
    channels  CHANNEL[4 n + 1 + m] of its sensors, see `sensors.channels_of`
    """

    circuit: Circuit
    channels: Records


class Fault(NamedTuple):
    """What fails, at which of its kind's places, and how far, in the kind's unit."""

    kind: str
    place: int = 0
    value: float = math.nan


class Kind(NamedTuple):
    """A way to fail.

    places  where it can be, by name; none where there is but one
    usual   value where none is given; None where a fault of this kind has none
    unit    of the value
    apply   makes it so
    limits  least and greatest value
    """

    places: Callable[[Machine], Sequence[str]]
    usual: float | None
    unit: str
    apply: Callable[[Plant, int, float], None]
    limits: tuple[float, float] = (0.0, 0.0)


def parse_faults(text: str, machine: Machine) -> tuple[Fault, ...]:
    """The faults that a text asks for; raises FaultError."""
    words = [word.strip() for word in text.split(",")]
    return tuple(_parsed(word, machine) for word in words if word not in ("", NONE))


def _parsed(word: str, machine: Machine) -> Fault:
    name, place, value = (*word.split(":", 2), "", "")[:3]
    kind = KINDS.get(name)
    if kind is None:
        raise FaultError(f"there is no fault {name!r}; valid are {NONE}, {', '.join(KINDS)}")
    places = kind.places(machine)
    if place not in (places or ("",)):
        valid = f"one of {', '.join(places)}" if places else "no place"
        raise FaultError(f"the fault {word!r} is at {place or 'no place'}; {name} takes {valid}")
    number = math.nan if kind.usual is None else kind.usual
    if value:
        number = _number(value)
        if kind.usual is None or not math.isfinite(number):
            valid = "none" if kind.usual is None else f"a number in {kind.unit}"
            raise FaultError(f"the fault {word!r} has the value {value!r}; {name} takes {valid}")
        least, greatest = kind.limits
        if not least <= number <= greatest:
            raise FaultError(
                f"the fault {word!r} has the value {value!r}; {name} takes {least:g} to "
                f"{greatest:g} {kind.unit}"
            )
    return Fault(name, places.index(place) if places else 0, number)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def set_faults(faults: Sequence[Fault], plant: Plant, constants: Records) -> None:
    """Make a plant as faults have it, and all else in it healthy; CONSTANTS[1] without faults."""
    circuit, channels = plant
    circuit.constants[:] = constants
    for records, values in (
        (circuit.actuators, {"obeys": 1.0, "seized": 0.0, "leakage": 1.0}),
        (circuit.modules, {"strength": 1.0, "runs_on": 0.0, "slowness": 1.0}),
        (channels, {"dead": 0.0, "frozen": 0.0, "error": 0.0, "error_rate": 0.0}),
    ):
        for name, value in values.items():
            records[name] = value
    for fault in faults:
        KINDS[fault.kind].apply(plant, fault.place, fault.value)


# --- Where ---------------------------------------------------------------------------------------


def _one(machine: Machine) -> Sequence[str]:
    return ()


def _actuators(machine: Machine) -> Sequence[str]:
    return machine.actuator_names


def _servo_pumps(machine: Machine) -> Sequence[str]:
    return [str(k + 1) for k in range(machine.arrays.module_count)]


def _lengths(machine: Machine) -> Sequence[str]:
    return [f"{name}.length" for name in machine.actuator_names]


def _pressures(machine: Machine) -> Sequence[str]:
    kinds = "cap_pressure", "rod_pressure", "line_pressure"
    return [f"{name}.{kind}" for name in machine.actuator_names for kind in kinds]


def _sensors(machine: Machine) -> Sequence[str]:
    """In the order of the channels."""
    return [*_lengths(machine), *_pressures(machine)]


# --- What ----------------------------------------------------------------------------------------


def _main_pump(plant: Plant, place: int, value: float) -> None:
    plant.circuit.constants["main_pump_flow"] = 0.0


def _supply_sag(plant: Plant, place: int, value: float) -> None:
    plant.circuit.constants["supply_pressure"] = value


def _servo_pumps_off(plant: Plant, place: int, value: float) -> None:
    plant.circuit.modules["strength"] = 0.0


def _servo_pump_dead(plant: Plant, place: int, value: float) -> None:
    plant.circuit.modules["strength"][place] = 0.0


def _servo_pump_slow(plant: Plant, place: int, value: float) -> None:
    plant.circuit.modules["slowness"][place] = value


def _servo_pump_stuck_on(plant: Plant, place: int, value: float) -> None:
    plant.circuit.modules["runs_on"][place] = 1.0


def _valve_stuck(plant: Plant, place: int, value: float) -> None:
    plant.circuit.actuators["seized"][place] = 1.0


def _valve_hard_over(plant: Plant, place: int, value: float) -> None:
    plant.circuit.actuators["obeys"][place] = 0.0
    plant.circuit.actuators["runaway"][place] = value


def _leakage(plant: Plant, place: int, value: float) -> None:
    plant.circuit.actuators["leakage"][place] = value


def _sensor_dead(plant: Plant, place: int, value: float) -> None:
    plant.channels["dead"][place] = 1.0


def _sensor_frozen(plant: Plant, place: int, value: float) -> None:
    plant.channels["frozen"][place] = 1.0


def _length_offset(plant: Plant, place: int, value: float) -> None:
    plant.channels["error"][place] = value


def _length_drift(plant: Plant, place: int, value: float) -> None:
    plant.channels["error_rate"][place] = value


def _pressure_offset(plant: Plant, place: int, value: float) -> None:
    plant.channels["error"][len(plant.circuit.actuators) + place] = value


def _pressure_drift(plant: Plant, place: int, value: float) -> None:
    plant.channels["error_rate"][len(plant.circuit.actuators) + place] = value


KINDS = {
    "main_pump": Kind(_one, None, "", _main_pump),
    "supply_sag": Kind(_one, 3.3e6, "Pa", _supply_sag, (1e3, 5e7)),
    "servo_pumps": Kind(_one, None, "", _servo_pumps_off),
    "servo_pump_dead": Kind(_servo_pumps, None, "", _servo_pump_dead),
    "servo_pump_slow": Kind(_servo_pumps, 20.0, "times its lag", _servo_pump_slow, (0.01, 1e4)),
    "servo_pump_stuck_on": Kind(_servo_pumps, None, "", _servo_pump_stuck_on),
    "valve_stuck": Kind(_actuators, None, "", _valve_stuck),
    "valve_hard_over": Kind(_actuators, 1.0, "shares of its stroke", _valve_hard_over, (-1.0, 1.0)),
    "leakage": Kind(_actuators, 5.0, "times that of the file", _leakage, (0.0, 1e4)),
    "sensor_dead": Kind(_sensors, None, "", _sensor_dead),
    "sensor_frozen": Kind(_sensors, None, "", _sensor_frozen),
    "length_offset": Kind(_lengths, 5e-3, "m", _length_offset, (-10.0, 10.0)),
    "length_drift": Kind(_lengths, 2e-3, "m/s", _length_drift, (-10.0, 10.0)),
    "pressure_offset": Kind(_pressures, 1e6, "Pa", _pressure_offset, (-1e8, 1e8)),
    "pressure_drift": Kind(_pressures, 2e5, "Pa/s", _pressure_drift, (-1e9, 1e9)),
}
"""By name: main pump without flow, or at less pressure; servo pumps that stand still, one that
does, one that is slow, one that runs at full speed; a spool that stays where it is, one that goes
to an end; a line that leaks; a sensor that tells no number, always the same, too much, or more and
more too much."""
