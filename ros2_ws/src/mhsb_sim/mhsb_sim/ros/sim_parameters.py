"""Parameters of the simulator node: declaration, ranges, and what a change is refused for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_model.errors import ArgumentError
from mhsb_model.machine import Machine, load_machine
from mhsb_sim.errors import FaultError
from mhsb_sim.servo import CONTROLLERS
from mhsb_sim.simulation.faults import KINDS, NONE, parse_faults
from mhsb_sim.simulation.plant_files import load_plant
from mhsb_sim.simulation.symptoms import SupervisionLimits

HEAVIEST_PAYLOAD = 1e4  # kg
SLOWEST, FASTEST = 0.01, 50.0
"""Range of real_time_factor."""

SUPERVISED = {
    "following_error": ("of a joint, measured against reference [rad]", (1e-3, 10.0)),
    "overpressure": ("of a chamber or line, share of its relief valve's setting", (0.1, 10.0)),
    "supply_loss": ("of a line, share of the main pump's pressure that it lacks", (0.05, 2.0)),
    "held": ("time for which the guard holds the plan [s]", (0.01, 1e4)),
    "silent_sensor": ("time for which a sensor tells no number [s]", (1e-3, 1e4)),
    "frozen_pressure": ("time for which a pressure sensor tells the very same [s]", (0.02, 1e4)),
    "frozen_length": ("way of a piston while its sensor tells the very same [m]", (1e-5, 1e3)),
    "jumping_length": ("by how much a length leaps, over what a piston goes", (0.1, 1e4)),
    "disagreeing_line": ("pressure by which a line is off all others [Pa]", (1e4, 1e9)),
    "disagreeing_valve": ("way of a piston that its opening does not explain [m]", (1e-5, 1e3)),
    "saturation": ("time with a valve fully open or a servo pump at full speed [s]", (0.01, 1e4)),
}
"""What supervision watches: meaning and range of the limits of each symptom."""

CHECKED = (
    "real_time_factor",
    "publish_clock",
    "fault",
    *(f"{symptom}_{kind}" for symptom in SUPERVISED for kind in ("warning", "limit")),
)
"""Parameters that may not go together, or not be known."""


@dataclass(frozen=True)
class SimParameters:
    """What the parameters ask for.

    seed              of the sensor noise
    controller        name of the servo's controller
    real_time_factor  simulated seconds per second
    publish_clock     whether the simulator is the source of /clock
    payload           at the tip, kg
    fault             what fails, as `simulation.faults` has it
    limits            of supervision
    """

    seed: int
    controller: str
    real_time_factor: float
    publish_clock: bool
    payload: float
    fault: str
    limits: SupervisionLimits


def declare_machine(node: Node) -> Machine:
    """Declare `machine` and read the file that it names; raises MachineFileError."""
    descriptor = ParameterDescriptor(
        description="machine file (YAML); empty for the suite's own arm", read_only=True
    )
    node.declare_parameter("machine", "", descriptor)
    return load_machine(node.get_parameter("machine").value or None)


def declare_plant(node: Node, machine: Machine) -> Machine:
    """Declare `plant` and read the file that it names; raises MachineFileError."""
    descriptor = ParameterDescriptor(
        description="plant file (YAML): what the simulated arm has other than the `machine` that "
        "its servo knows, or a whole machine file; empty where there is no difference",
        read_only=True,
    )
    node.declare_parameter("plant", "", descriptor)
    file = node.get_parameter("plant").value
    return load_plant(machine, Path(file)) if file else machine


def declare(node: Node, plant: Machine) -> SimParameters:
    """Declare all other parameters and read them; ArgumentError where they do not go together."""
    node.declare_parameter(
        "seed",
        0,
        ParameterDescriptor(
            description="of the sensor noise",
            read_only=True,
            integer_range=[IntegerRange(from_value=0, to_value=2**31 - 1, step=1)],
        ),
    )
    node.declare_parameter(
        "controller",
        "coordinated",
        ParameterDescriptor(
            description=f"of the servo, one of {', '.join(CONTROLLERS)}", read_only=True
        ),
    )
    node.declare_parameter(
        "publish_clock",
        False,
        ParameterDescriptor(description="be the source of /clock", read_only=True),
    )
    node.declare_parameter(
        "real_time_factor",
        1.0,
        _ranged("simulated seconds per second; other than 1 needs publish_clock", SLOWEST, FASTEST),
    )
    node.declare_parameter(
        "payload",
        plant.arrays.payload,
        _ranged("at the tip [kg]; the servo is not told", 0.0, HEAVIEST_PAYLOAD),
    )
    node.declare_parameter(
        "fault",
        NONE,
        ParameterDescriptor(
            description=f"what fails: KIND, KIND:PLACE or KIND:PLACE:VALUE, several separated by "
            f"commas; {NONE}, {', '.join(KINDS)}"
        ),
    )
    for symptom, (text, limits) in SUPERVISED.items():
        warning, stop = getattr(SupervisionLimits(), symptom)
        name, unit = f"{symptom}_warning", f"{text}: beyond it the arm"
        node.declare_parameter(name, warning, _ranged(f"{unit} warns", *limits))
        node.declare_parameter(f"{symptom}_limit", stop, _ranged(f"{unit} is stopped", *limits))
    result = check(node, plant, node.get_parameters(list(CHECKED)))
    if not result.successful:
        raise ArgumentError(result.reason)
    return read(node)


def read(node: Node) -> SimParameters:
    """The parameters as they are now."""

    def value(name: str) -> Any:
        return node.get_parameter(name).value

    return SimParameters(
        value("seed"),
        value("controller"),
        value("real_time_factor"),
        value("publish_clock"),
        value("payload"),
        value("fault"),
        SupervisionLimits(
            **{name: (value(f"{name}_warning"), value(f"{name}_limit")) for name in SUPERVISED}
        ),
    )


def check(node: Node, plant: Machine, changes: Sequence[Parameter]) -> SetParametersResult:
    """Whether a set of changes can be made, and the reason where not."""
    after = {name: node.get_parameter(name).value for name in CHECKED}
    after |= {change.name: change.value for change in changes}
    reasons = (
        _not_the_systems_time(after["real_time_factor"], after["publish_clock"]),
        _unknown_fault(after["fault"], plant),
        *(_disordered(name, after) for name in SUPERVISED),
    )
    reason = next(filter(None, reasons), None)
    return SetParametersResult(successful=reason is None, reason=reason or "")


def _not_the_systems_time(factor: float, publish_clock: bool) -> str | None:
    if factor != 1.0 and not publish_clock:
        return (
            f"real_time_factor {factor:g} needs publish_clock: true, and use_sim_time: true in "
            "the other nodes, for simulated time is not the system's then"
        )
    return None


def _unknown_fault(text: str, plant: Machine) -> str | None:
    try:
        parse_faults(text, plant)
    except FaultError as error:
        return str(error)
    return None


def _disordered(symptom: str, after: Mapping[str, float]) -> str | None:
    warning, limit = after[f"{symptom}_warning"], after[f"{symptom}_limit"]
    if warning <= limit:
        return None
    return (
        f"{symptom}_warning {warning:g} is beyond {symptom}_limit {limit:g}; a warning comes first"
    )


def _ranged(text: str, lowest: float, highest: float) -> ParameterDescriptor:
    return ParameterDescriptor(
        description=text,
        floating_point_range=[FloatingPointRange(from_value=lowest, to_value=highest, step=0.0)],
    )
