"""Options that change a machine: its payload, and the error if a value does not suit it."""

from typing import Annotated, Any

import tyro

from mhsb_model.command_line import NumberRange, UsageError
from mhsb_model.errors import MachineFileError
from mhsb_model.machine import Machine

OptionalPayload = Annotated[float | None, tyro.conf.arg(metavar="KG"), NumberRange(0.0, 1e4)]
"""Mass at the tip [kg], or None."""


def change_machine(machine: Machine, **changes: Any) -> Machine:
    """Return a machine with some values replaced.

    Args:
        machine: The arm as its file has it.
        **changes: New values by name, as `Machine.changed` takes them, such as `payload` [kg]; None
            keeps a value.

    Returns:
        The changed machine; `machine` stays as it is.

    Raises:
        UsageError: A value is out of its range.
    """
    try:
        return machine.changed(**changes)
    except MachineFileError as error:
        raise UsageError("; ".join(error.problems)) from error
