"""Servo controllers, selected by name.

A new controller is a module in this package and an entry in `REGISTERED_CONTROLLERS`.
"""

from __future__ import annotations

from mhsb_control.controller import Controller
from mhsb_control.coordinated import CoordinatedController
from mhsb_control.errors import UnknownControllerError
from mhsb_control.independent import IndependentController

REGISTERED_CONTROLLERS: dict[str, type[Controller]] = {
    "coordinated": CoordinatedController,
    "independent": IndependentController,
}
"""Controller class for each name that a user can select."""


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
