"""Servo controllers, selected by name.

A new controller is a module in this package and an entry in `REGISTERED_CONTROLLERS`.
"""

from mhsb_control.registry import (
    REGISTERED_CONTROLLERS,
    default_controller,
    get_controller_class,
    load_machine,
    make_controller,
    measures_pressures,
    read_gains,
    select_controllers,
)

__all__ = [
    "REGISTERED_CONTROLLERS",
    "default_controller",
    "get_controller_class",
    "load_machine",
    "make_controller",
    "measures_pressures",
    "read_gains",
    "select_controllers",
]
