"""Errors of the simulator."""

from mhsb_model.errors import ArgumentError, MachineFileError, MhsbError


class SimulationDivergedError(MhsbError):
    """The state of the simulation is not finite, or far too large.

    Attributes:
        quantity: Name of the quantity that is not finite.
        time: Simulated time at which it was found [s].
    """

    def __init__(self, quantity: str, time: float) -> None:
        """Build the error with its sentence; both arguments become attributes.

        Args:
            quantity: Name of the quantity that is not finite.
            time: Simulated time [s].
        """
        self.quantity = quantity
        self.time = time
        super().__init__(
            f"the simulation diverged at {time:.3f} s: {quantity} is no longer finite; reset it"
        )


class ModeError(MhsbError):
    """A mode pattern cannot be set."""


class PlantError(MhsbError):
    """The simulated arm has other numbers of joints or modules than its servo assumes."""


class PlantFileError(MachineFileError):
    """A plant file cannot be used."""

    kind = "plant file"


class FaultError(ArgumentError):
    """A fault to be injected does not exist, or is not written correctly."""


class HandOverError(MhsbError):
    """The simulator did not take a plan."""
