"""Parameters of the simulator node: declaration, ranges, and what a change is refused for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine, load_machine
from mhsb_sim.servo import CONTROLLERS
from mhsb_sim.simulation.faults import Fault

HEAVIEST_PAYLOAD = 1e4  # kg
SLOWEST, FASTEST = 0.01, 50.0
"""Range of real_time_factor."""


@dataclass(frozen=True)
class SimParameters:
    """What the parameters ask for.

    seed              of the sensor noise
    controller        name of the servo's controller
    real_time_factor  simulated seconds per second
    publish_clock     whether the simulator is the source of /clock
    payload           at the tip, kg
    fault             what fails
    """

    seed: int
    controller: str
    real_time_factor: float
    publish_clock: bool
    payload: float
    fault: Fault


def declare_machine(node: Node) -> Machine:
    """Declare `machine` and read the file that it names; raises MachineFileError."""
    descriptor = ParameterDescriptor(
        description="machine file (YAML); empty for the suite's own arm", read_only=True
    )
    node.declare_parameter("machine", "", descriptor)
    return load_machine(node.get_parameter("machine").value or None)


def declare(node: Node, machine: Machine) -> SimParameters:
    """Declare all other parameters and read them; MhsbError where they do not go together."""
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
        machine.arrays.payload,
        _ranged("at the tip [kg]; the servo is not told", 0.0, HEAVIEST_PAYLOAD),
    )
    node.declare_parameter(
        "fault",
        Fault.NONE.value,
        ParameterDescriptor(description=f"injected fault, one of {', '.join(Fault)}"),
    )
    reason = _unknown_fault(node.get_parameter("fault").value)
    if reason is not None:
        raise MhsbError(reason)
    settings = read(node)
    reason = _refusal(settings.real_time_factor, settings.publish_clock)
    if reason is not None:
        raise MhsbError(reason)
    return settings


def read(node: Node) -> SimParameters:
    """The parameters as they are now."""
    values = {
        name: node.get_parameter(name).value
        for name in ("seed", "controller", "real_time_factor", "publish_clock", "payload")
    }
    return SimParameters(**values, fault=Fault(node.get_parameter("fault").value))


def check(node: Node, machine: Machine, changes: Sequence[Parameter]) -> SetParametersResult:
    """Whether a set of changes can be made, and the reason where not."""
    factor = next(
        (change.value for change in changes if change.name == "real_time_factor"),
        node.get_parameter("real_time_factor").value,
    )
    reason = _refusal(factor, node.get_parameter("publish_clock").value)
    faults = [change.value for change in changes if change.name == "fault"]
    reason = reason or next(filter(None, map(_unknown_fault, faults)), None)
    return SetParametersResult(successful=reason is None, reason=reason or "")


def _refusal(factor: float, publish_clock: bool) -> str | None:
    if factor != 1.0 and not publish_clock:
        return (
            f"real_time_factor {factor:g} needs publish_clock: true, and use_sim_time: true in "
            "the other nodes, for simulated time is not the system's then"
        )
    return None


def _unknown_fault(name: str) -> str | None:
    if name in list(Fault):
        return None
    return f"there is no fault {name!r}; valid are {', '.join(Fault)}"


def _ranged(text: str, lowest: float, highest: float) -> ParameterDescriptor:
    return ParameterDescriptor(
        description=text,
        floating_point_range=[FloatingPointRange(from_value=lowest, to_value=highest, step=0.0)],
    )
