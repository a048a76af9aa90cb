"""Errors of the controllers."""

from collections.abc import Iterable
from pathlib import Path

from mhsb_model.errors import ArgumentError, MhsbError


class UnknownControllerError(ArgumentError):
    """Error: no controller is registered under the requested name."""

    def __init__(self, name: str, valid: Iterable[str]) -> None:
        """Make the message from the requested name and the valid names.

        Args:
            name: The requested name.
            valid: Names of the registered controllers.
        """
        super().__init__(f"there is no controller {name!r}; valid are {', '.join(valid)}")


class PressureSensorsError(ArgumentError):
    """Error: a controller reads pressures on a machine that measures none."""

    def __init__(self, name: str, machine: str, suitable: Iterable[str]) -> None:
        """Make the message from the names of controller, machine and suitable controllers.

        Args:
            name: Name of the controller.
            machine: Name of the machine, which measures no pressures.
            suitable: Names of the registered controllers that read no pressures.
        """
        super().__init__(
            f"the controller {name!r} reads pressures, which {machine} does not measure "
            f"(imperfections.sensors.pressure: none); use {' or '.join(suitable)}"
        )


class EstimatesFileError(MhsbError):
    """Error: a file of estimates cannot be used."""

    def __init__(self, path: Path, reason: str) -> None:
        """Make the message from the file and the reason.

        Args:
            path: The file of estimates.
            reason: Clause that says why the file cannot be used, and what to do.
        """
        super().__init__(f"estimates file {path}: {reason}")
