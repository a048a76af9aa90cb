"""Errors of the simulator."""

from __future__ import annotations

from collections.abc import Iterable

from mhsb_model.errors import ArgumentError, MhsbError


class SimulationDivergedError(MhsbError):
    """The simulation left the finite numbers; `quantity` names what did, `time` says when [s]."""

    def __init__(self, quantity: str, time: float) -> None:
        self.quantity = quantity
        self.time = time
        super().__init__(
            f"the simulation diverged at {time:.3f} s: {quantity} is no longer finite; reset it"
        )


class ModeError(MhsbError):
    """A mode pattern cannot be set."""


class PlantError(MhsbError):
    """An arm is not of the build that its servo knows."""


class FaultError(ArgumentError):
    """What is to fail is not there, or not written as faults are."""


class VariationError(MhsbError):
    """The variations of a machine cannot be used."""


class ScenarioError(MhsbError):
    """The scenarios of a study cannot be used."""


class TuningError(MhsbError):
    """The servo cannot be tuned."""


class HandOverError(MhsbError):
    """The simulator did not take a plan."""


class UnknownControllerError(ArgumentError):
    """No controller has the name that was asked for."""

    def __init__(self, name: str, valid: Iterable[str]) -> None:
        self.name = name
        self.valid = tuple(valid)
        super().__init__(f"there is no controller {name!r}; valid are {', '.join(self.valid)}")
