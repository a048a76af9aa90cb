"""Registered controllers, and the schema of a machine file that includes their gains."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, ValidationError, create_model

from mhsb_control.controller import Controller, LearningController, ServoSignals
from mhsb_control.coordinated import CoordinatedController
from mhsb_control.errors import PressureSensorsError, UnknownControllerError
from mhsb_control.estimates_file import ActuatorResponse
from mhsb_control.independent import IndependentController
from mhsb_control.lag_compensated import LagCompensatedController
from mhsb_model import machine as machines
from mhsb_model.errors import ArgumentError, MachineFileError
from mhsb_model.files.schema_problems import describe_validation_errors
from mhsb_model.machine import Machine
from mhsb_model.schema import MachineConfig, Servo

REGISTERED_CONTROLLERS: dict[str, type[Controller]] = {
    "coordinated": CoordinatedController,
    "independent": IndependentController,
    "lag_compensated": LagCompensatedController,
}
"""Controller class for each name that a user can select."""


class _ServoWithoutOtherSections(Servo):
    """Section `servo` that refuses keys and sections that are not declared."""

    model_config = ConfigDict(extra="forbid")


def build_schema(controllers: Mapping[str, type[Controller]]) -> type[MachineConfig]:
    """Build the schema of a machine file with an optional section of gains for each controller.

    Sections and keys in `servo` that nothing declares are refused.

    Args:
        controllers: Controller classes by name. The name is also that of the controller's section
            in `servo`.

    Returns:
        Subclass of `MachineConfig`. To be picklable, it must be assigned to the name
        `MachineConfigWithGains` of this module.
    """
    sections: dict[str, Any] = {
        name: (controller.gains_section, controller.gains_section())
        for name, controller in controllers.items()
    }
    servo = create_model(
        "ServoWithGains",
        __base__=_ServoWithoutOtherSections,
        __doc__=Servo.__doc__,
        __module__=__name__,
        **sections,
    )
    return create_model(
        "MachineConfigWithGains",
        __base__=MachineConfig,
        __doc__=MachineConfig.__doc__,
        __module__=__name__,
        servo=(servo, ...),
    )


MachineConfigWithGains = build_schema(REGISTERED_CONTROLLERS)
"""Schema of a machine file with the gains of all registered controllers."""

ServoWithGains = MachineConfigWithGains.model_fields["servo"].annotation
"""Schema of its section `servo`; pickled machines contain it."""


def get_controller_class(name: str) -> type[Controller]:
    """Return the controller class that is registered under a name.

    Args:
        name: Key of `REGISTERED_CONTROLLERS`, for instance "coordinated".

    Returns:
        The class, not an instance.

    Raises:
        UnknownControllerError: No controller has this name. The error lists the valid names.
    """
    try:
        return REGISTERED_CONTROLLERS[name]
    except KeyError:
        raise UnknownControllerError(name, REGISTERED_CONTROLLERS) from None


def select_controllers(machine: Machine) -> tuple[str, ...]:
    """Return the names of the controllers that suit the sensors of a machine.

    If the machine has pressure sensors, these are the controllers that read pressures. Otherwise
    they are the controllers that do not read pressures.

    Args:
        machine: The machine as declared in its file (the real one may differ).

    Returns:
        Keys of `REGISTERED_CONTROLLERS`, in their order.
    """
    fitted = measures_pressures(machine)
    return tuple(name for name in REGISTERED_CONTROLLERS if reads_pressures(name) == fitted)


def default_controller(machine: Machine) -> str:
    """Return the name of the controller that a machine gets if none is selected.

    The result is the first registered controller that suits the machine's sensors.

    Args:
        machine: The machine as declared in its file (the real one may differ).
    """
    return select_controllers(machine)[0]


def measures_pressures(machine: Machine) -> bool:
    """Return whether a machine has pressure sensors."""
    return machine.config.imperfections.sensors.pressure != "none"


def reads_pressures(name: str) -> bool:
    """Return whether a registered controller reads pressures.

    Args:
        name: Name of the controller.

    Returns:
        The controller's attribute `reads_pressures`; True if the controller does not have this
        attribute.

    Raises:
        UnknownControllerError: No controller has this name.
    """
    return bool(getattr(get_controller_class(name), "reads_pressures", True))


def load_machine(path: str | Path | None = None) -> Machine:
    """Load a machine from a YAML file, and check the gains of all registered controllers.

    Args:
        path: The machine file, or the name of a machine of the suite such as `excavator`. None or
            an empty text loads the suite's own arm.

    Returns:
        The machine. If it is copied with other values, the copy is checked in the same way.

    Raises:
        MachineFileError: The file cannot be read, breaks a rule, or has wrong gains.
    """
    return machines.load_machine(path, MachineConfigWithGains)


def read_gains(machine: Machine, name: str) -> Any:
    """Return the gains of a controller from the machine's file.

    Args:
        machine: The machine. Its gains may be unchecked.
        name: Name of a registered controller, such as "coordinated".

    Returns:
        Instance of the controller's `gains_section`. Gains that section `servo.NAME` of the file
        leaves out have their defaults.

    Raises:
        UnknownControllerError: No controller has this name.
        MachineFileError: The section has a wrong value or an unknown key.
    """
    schema = get_controller_class(name).gains_section
    content = machine.config.servo.model_dump(include={name}).get(name, {})
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        problems = describe_validation_errors(error, schema, f"servo.{name}")
        raise MachineFileError(machine.name, problems) from error


def make_controller(
    name: str,
    machine: Machine,
    signals: ServoSignals,
    learnt: Mapping[str, ActuatorResponse] | None = None,
) -> Controller:
    """Make a new controller with the gains of the machine's file.

    Args:
        name: Name of a registered controller, such as "coordinated".
        machine: The machine as declared in its file (the real one may differ).
        signals: Arrays that the controller reads and writes in each step. They must contain present
            readings.
        learnt: Learnt response of each actuator by its name; the controller's first estimate. None:
            the controller begins with the values of the machine file.

    Returns:
        The controller, in its initial state.

    Raises:
        UnknownControllerError: No controller has this name.
        MachineFileError: The gains in the machine's file are wrong.
        PressureSensorsError: The controller reads pressures that the machine does not measure.
        ArgumentError: `learnt` is given, but the controller does not learn.
    """
    if reads_pressures(name) and not measures_pressures(machine):
        raise PressureSensorsError(name, machine.name, select_controllers(machine))
    controller = get_controller_class(name)(machine, signals, read_gains(machine, name))
    if learnt is not None:
        check_keeps_estimates(name)
        if isinstance(controller, LearningController):
            controller.restore(learnt)
    return controller


def check_keeps_estimates(name: str) -> None:
    """Raise ArgumentError if a controller learns nothing that an estimates file could keep.

    Args:
        name: Name of a controller.

    Raises:
        UnknownControllerError: No controller has this name.
        ArgumentError: The controller is no `LearningController`.
    """
    if not issubclass(get_controller_class(name), LearningController):
        keeping = [
            each
            for each, kind in REGISTERED_CONTROLLERS.items()
            if issubclass(kind, LearningController)
        ]
        raise ArgumentError(
            f"estimates_file has no effect with the controller {name!r}, which keeps no estimates; "
            f"leave it out, or use {' or '.join(keeping)}"
        )
