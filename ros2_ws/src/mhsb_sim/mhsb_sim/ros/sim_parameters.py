"""Parameters of the simulator node: declaration, ranges, and checks of changes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_control import REGISTERED_CONTROLLERS, default_controller
from mhsb_model.errors import ArgumentError
from mhsb_model.machine import Machine
from mhsb_msgs_py.parameters import NodeParameter
from mhsb_sim.errors import FaultError
from mhsb_sim.simulation.fault_detection import SupervisionLimits
from mhsb_sim.simulation.faults import FAULT_KINDS, NO_FAULT, parse_faults
from mhsb_sim.simulation.plant_files import load_plant

HEAVIEST_PAYLOAD = 1e4
"""Upper end of the range of `payload` [kg]."""
MIN_REAL_TIME_FACTOR, MAX_REAL_TIME_FACTOR = 0.01, 50.0
"""Range of `real_time_factor`."""

SUPERVISION_LIMITS = {
    "following_error": ("of a joint, measured against reference [rad]", (1e-3, 10.0)),
    "overpressure": ("of a chamber or line, share of its relief valve's setting", (0.1, 10.0)),
    "supply_loss": ("of a line, share of the main pump's pressure that it lacks", (0.05, 2.0)),
    "held": ("time for which the reference governor holds the plan [s]", (0.01, 1e4)),
    "silent_sensor": ("time for which a sensor gives no reading [s]", (1e-3, 1e4)),
    "frozen_pressure": ("time for which a pressure sensor repeats its reading [s]", (0.02, 1e4)),
    "frozen_length": ("way of a piston while its sensor repeats its reading [m]", (1e-5, 1e3)),
    "jumping_length": ("by how much a length leaps, over what a piston goes", (0.1, 1e4)),
    "disagreeing_line": ("pressure by which a line is off all others [Pa]", (1e4, 1e9)),
    "disagreeing_valve": ("way of a piston that its opening does not explain [m]", (1e-5, 1e3)),
    "saturation": ("time with a valve fully open or a servo pump at full speed [s]", (0.01, 1e4)),
}
"""Meaning of each symptom that supervision evaluates, and range of its warning and stop limits."""

CHECKED_PARAMETERS = (
    "real_time_factor",
    "publish_clock",
    "fault",
    *(f"{symptom}_{kind}" for symptom in SUPERVISION_LIMITS for kind in ("warning", "limit")),
)
"""Parameters that are checked beyond their ranges: the values may contradict each other."""


@dataclass(frozen=True)
class SimParameters:
    """Values of the node's parameters.

    Attributes:
        seed: Seed of the sensor noise.
        controller: Name of the servo controller; empty for the default of the machine's sensors.
        estimates_file: File with the estimates that the servo has learnt; empty for none.
        real_time_factor: Simulated seconds per second of real time.
        publish_clock: Whether the simulator is the source of /clock.
        payload: Payload at the tip [kg].
        fault: Faults as text, in the form that `simulation.faults` describes.
        limits: Limits of supervision.
    """

    seed: int
    controller: str
    estimates_file: str
    real_time_factor: float
    publish_clock: bool
    payload: float
    fault: str
    limits: SupervisionLimits


def declare_plant(node: Node, machine: Machine) -> Machine:
    """Declare the parameter `plant`, and load the plant file that it names.

    The plant is the simulated machine; it may differ from the machine file that the servo knows.

    Args:
        node: The node.
        machine: The machine that the servo knows.

    Returns:
        The plant; `machine` if the parameter is empty.

    Raises:
        PlantFileError: The file is missing or not valid.
        ParameterValueError: The given value is no text.
    """
    text = (
        "plant file (YAML): what the simulated arm has other than the `machine` that its servo "
        "knows, or a whole machine file; empty where there is no difference"
    )
    file = NodeParameter("plant", "", text, read_only=True).declare(node)
    return load_plant(machine, Path(file)) if file else machine


def declare_parameters(node: Node, machine: Machine, plant: Machine) -> SimParameters:
    """Declare all parameters but `machine` and `plant`, check their values, and read them.

    The default of the controller follows from the machine's sensors. The defaults of supervision's
    limits follow from the controller.

    Args:
        node: The node.
        machine: The machine that the servo knows, for the default of the controller.
        plant: The simulated machine, for the payload's default and the places of faults.

    Returns:
        The values.

    Raises:
        ArgumentError: Values contradict each other, or a fault is not valid.
        ParameterValueError: A given value has another type than its default, or is out of range.
        UnknownControllerError: No controller has the given name.
    """
    for parameter in (
        NodeParameter("seed", 0, "of the sensor noise", (0, 2**31 - 1), read_only=True),
        NodeParameter(
            "controller",
            default_controller(machine),
            f"of the servo, one of {', '.join(REGISTERED_CONTROLLERS)}; empty for the first that "
            "suits the machine's sensors",
            read_only=True,
        ),
        NodeParameter(
            "estimates_file",
            "",
            "file (YAML) of what the servo has learnt: read at the start if it exists, written "
            "every half a minute and at the end; empty to begin anew and keep nothing",
            read_only=True,
        ),
        NodeParameter("publish_clock", False, "be the source of /clock", read_only=True),
        NodeParameter(
            "real_time_factor",
            1.0,
            "simulated seconds per second; other than 1 needs publish_clock",
            (MIN_REAL_TIME_FACTOR, MAX_REAL_TIME_FACTOR),
        ),
        NodeParameter(
            "payload",
            plant.arrays.payload,
            "at the tip [kg]; the servo does not know it",
            (0.0, HEAVIEST_PAYLOAD),
        ),
        NodeParameter(
            "fault",
            NO_FAULT,
            f"what fails: KIND, KIND:PLACE or KIND:PLACE:VALUE, several separated by commas; "
            f"{NO_FAULT}, {', '.join(FAULT_KINDS)}",
        ),
    ):
        parameter.declare(node)
    controller = node.get_parameter("controller").value or default_controller(machine)
    usual = SupervisionLimits.for_controller(controller)
    for symptom, (text, limits) in SUPERVISION_LIMITS.items():
        warning, stop = getattr(usual, symptom)
        unit = f"{text}: beyond it the arm"
        NodeParameter(f"{symptom}_warning", warning, f"{unit} warns", limits).declare(node)
        NodeParameter(f"{symptom}_limit", stop, f"{unit} is stopped", limits).declare(node)
    result = check_changes(node, plant, node.get_parameters(list(CHECKED_PARAMETERS)))
    if not result.successful:
        raise ArgumentError(result.reason)
    return read_parameters(node)


VALUE_NAMES = tuple(each.name for each in fields(SimParameters) if each.name != "limits")
"""Names of the parameters whose values `SimParameters` has under the same name."""


def read_parameters(node: Node) -> SimParameters:
    """Read the present values of all parameters but `machine` and `plant`.

    Args:
        node: The node that gets the parameters.

    Returns:
        The values. Each symptom that supervision watches, such as `following_error`, has a pair of
        limits: the value beyond which the arm warns, and the value beyond which it is stopped.
    """
    value = {name: node.get_parameter(name).value for name in (*VALUE_NAMES, *CHECKED_PARAMETERS)}
    limits = {
        symptom: (value[f"{symptom}_warning"], value[f"{symptom}_limit"])
        for symptom in SUPERVISION_LIMITS
    }
    own = {name: value[name] for name in VALUE_NAMES}
    return SimParameters(**own, limits=SupervisionLimits(**limits))


def check_changes(node: Node, plant: Machine, changes: Sequence[Parameter]) -> SetParametersResult:
    """Check whether the new values of some parameters are allowed.

    Three rules are checked. A real-time factor other than 1 needs `publish_clock`. Faults must be
    valid. For each symptom of supervision, the value at which it warns must be at most the value at
    which it stops the arm.

    Args:
        node: The node, for the values that do not change.
        plant: The simulated machine, for the places of faults.
        changes: Parameters with their new values.

    Returns:
        Success, or the first reason of the refusal.
    """
    after = {name: node.get_parameter(name).value for name in CHECKED_PARAMETERS}
    after |= {change.name: change.value for change in changes}
    reason = next(_list_problems(after, plant), "")
    return SetParametersResult(successful=not reason, reason=reason)


def _list_problems(values: Mapping[str, Any], plant: Machine) -> Iterator[str]:
    """Yield a sentence for each rule that values of parameters break.

    Args:
        values: Value of each of CHECKED_PARAMETERS by its name.
        plant: The simulated machine; its actuators, sensors and pumps are the valid places of
            faults.

    Yields:
        Sentences that name the values, and what is allowed.
    """
    factor = values["real_time_factor"]
    if factor != 1.0 and not values["publish_clock"]:
        yield (
            f"real_time_factor {factor:g} needs publish_clock: true, and use_sim_time: true in "
            "the other nodes, for simulated time is not the system's then"
        )
    try:
        parse_faults(values["fault"], plant)
    except FaultError as error:
        yield str(error)
    for symptom in SUPERVISION_LIMITS:
        warning, limit = values[f"{symptom}_warning"], values[f"{symptom}_limit"]
        if warning > limit:
            yield (
                f"{symptom}_warning {warning:g} is beyond {symptom}_limit {limit:g}; a warning "
                "comes first"
            )
