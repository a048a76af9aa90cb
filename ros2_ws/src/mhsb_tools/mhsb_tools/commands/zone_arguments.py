"""Command-line options for keep-out zones, which are added to those of the machine file."""

from __future__ import annotations

from typing import Annotated

import tyro

from mhsb_model.command_line import NumberRange, UsageError
from mhsb_model.machine import Machine
from mhsb_model.obstacles.zones import Numbers, zone_numbers
from mhsb_tools.commands.plan_arguments import change_machine

BOX_METAVAR, SPACE_BOX_METAVAR = "X1 Z1 X2 Z2", "X1 Y1 Z1 X2 Y2 Z2"
CIRCLE_METAVAR, CYLINDER_METAVAR, SPHERE_METAVAR = (
    "X Z RADIUS",
    "X Y Z_MIN Z_MAX RADIUS",
    "X Y Z RADIUS",
)

ZoneBoxes = Annotated[
    tuple[Numbers, ...],
    tyro.conf.arg(
        metavar="X1 [Y1] Z1 X2 [Y2] Z2",
        help="Two opposite corners [m] of a box that plans keep out of, beside the machine file's "
        "zones, with Y where the arm slews; may be given several times.",
    ),
    tyro.conf.UseAppendAction,
    NumberRange(-1e4, 1e4),
]
ZoneCircles = Annotated[
    tuple[tuple[float, float, float], ...],
    tyro.conf.arg(
        metavar=CIRCLE_METAVAR,
        help="Centre and radius [m] of a circle that plans keep out of; may be given several "
        "times; for arms that do not slew.",
    ),
    tyro.conf.UseAppendAction,
    NumberRange(-1e4, 1e4),
]
ZoneCylinders = Annotated[
    tuple[tuple[float, float, float, float, float], ...],
    tyro.conf.arg(
        metavar=CYLINDER_METAVAR,
        help="Axis, ends and radius [m] of an upright cylinder that plans keep out of; may be "
        "given several times; for arms that slew.",
    ),
    tyro.conf.UseAppendAction,
    NumberRange(-1e4, 1e4),
]
ZoneSpheres = Annotated[
    tuple[tuple[float, float, float, float], ...],
    tyro.conf.arg(
        metavar=SPHERE_METAVAR,
        help="Centre and radius [m] of a sphere that plans keep out of; may be given several "
        "times; for arms that slew.",
    ),
    tyro.conf.UseAppendAction,
    NumberRange(-1e4, 1e4),
]
"""Types of the options `--zone-…`. Boxes are for all arms, circles for planar arms, cylinders and
spheres for arms that slew.
"""

PLANAR_OPTIONS = {
    "boxes": ("--zone-box", BOX_METAVAR),
    "circles": ("--zone-circle", CIRCLE_METAVAR),
}
SPATIAL_OPTIONS = {
    "boxes": ("--zone-box", SPACE_BOX_METAVAR),
    "cylinders": ("--zone-cylinder", CYLINDER_METAVAR),
    "spheres": ("--zone-sphere", SPHERE_METAVAR),
}
"""Option and placeholder of each kind of zone, by the field of `Zones` that it fills."""


def add_zones(machine: Machine, **given: tuple[Numbers, ...]) -> Machine:
    """Return the machine with more keep-out zones.

    Args:
        machine: The arm with its own zones.
        **given: Zones [m] by field of `Zones` (`boxes`, `circles`, `cylinders`, `spheres`), each a
            tuple of numbers in the order of its option.

    Returns:
        The machine with its own zones and the given ones.

    Raises:
        UsageError: A zone is of a kind that this arm cannot have, or has the wrong number of
            values, or a value is out of range.
    """
    options = SPATIAL_OPTIONS if machine.slews else PLANAR_OPTIONS
    who = f"{machine.name} {'slews' if machine.slews else 'does not slew'}"
    for kind, zones in given.items():
        option, words = (PLANAR_OPTIONS | SPATIAL_OPTIONS | options)[kind]
        for zone in zones:
            numbers = " ".join(f"{number:g}" for number in zone)
            if kind not in options:
                instead = " or ".join(" ".join(each) for each in options.values())
                raise UsageError(f"{option} {numbers}: {who}; give {instead}")
            if len(zone) != len(zone_numbers(machine.slews)[kind]):
                raise UsageError(f"{option}: {who} and takes {words}, not {numbers or 'nothing'}")
    return change_machine(machine, zones=machine.zones.with_added(**given))
