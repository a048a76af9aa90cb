"""Servo controllers, by name; another one is a file here and a line in `CONTROLLERS`."""

from __future__ import annotations

from mhsb_sim.errors import UnknownControllerError
from mhsb_sim.servo.controller import Controller
from mhsb_sim.servo.coordinated import CoordinatedController
from mhsb_sim.servo.independent import IndependentController

CONTROLLERS: dict[str, type[Controller]] = {
    "coordinated": CoordinatedController,
    "independent": IndependentController,
}


def controller_class(name: str) -> type[Controller]:
    """The controller of that name; raises UnknownControllerError."""
    try:
        return CONTROLLERS[name]
    except KeyError:
        raise UnknownControllerError(name, CONTROLLERS) from None
