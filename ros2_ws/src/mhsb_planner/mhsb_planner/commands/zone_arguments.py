"""Keep-out zones as arguments of commands, beside those of the machine file."""

from __future__ import annotations

from typing import Annotated

import tyro

from mhsb_model.command_line import UsageError, Within
from mhsb_model.machine import Machine
from mhsb_model.obstacles.zones import Numbers, zone_numbers
from mhsb_planner.commands.plan_arguments import as_asked

BOX, BOX_IN_SPACE = "X1 Z1 X2 Z2", "X1 Y1 Z1 X2 Y2 Z2"
CIRCLE, CYLINDER, SPHERE = "X Z RADIUS", "X Y Z_MIN Z_MAX RADIUS", "X Y Z RADIUS"

ZoneBoxes = Annotated[
    tuple[Numbers, ...],
    tyro.conf.arg(
        metavar="X1 [Y1] Z1 X2 [Y2] Z2",
        help="Two opposite corners [m] of a box that plans keep out of, beside the machine file's "
        "zones, with Y where the arm slews; may be given several times.",
    ),
    tyro.conf.UseAppendAction,
    Within(-1e4, 1e4),
]
ZoneCircles = Annotated[
    tuple[tuple[float, float, float], ...],
    tyro.conf.arg(
        metavar=CIRCLE,
        help="Centre and radius [m] of a circle that plans keep out of, likewise; for arms that do "
        "not slew.",
    ),
    tyro.conf.UseAppendAction,
    Within(-1e4, 1e4),
]
ZoneCylinders = Annotated[
    tuple[tuple[float, float, float, float, float], ...],
    tyro.conf.arg(
        metavar=CYLINDER,
        help="Axis, ends and radius [m] of an upright cylinder that plans keep out of, likewise; "
        "for arms that slew.",
    ),
    tyro.conf.UseAppendAction,
    Within(-1e4, 1e4),
]
ZoneSpheres = Annotated[
    tuple[tuple[float, float, float, float], ...],
    tyro.conf.arg(
        metavar=SPHERE,
        help="Centre and radius [m] of a sphere that plans keep out of, likewise; for arms that "
        "slew.",
    ),
    tyro.conf.UseAppendAction,
    Within(-1e4, 1e4),
]
"""Types of the options; an arm has those of `zone_numbers`."""

PLANAR_OPTIONS = {"boxes": ("--zone-box", BOX), "circles": ("--zone-circle", CIRCLE)}
SPATIAL_OPTIONS = {
    "boxes": ("--zone-box", BOX_IN_SPACE),
    "cylinders": ("--zone-cylinder", CYLINDER),
    "spheres": ("--zone-sphere", SPHERE),
}
"""By which option, and which words, a kind of zone is given."""


def with_zones(machine: Machine, **given: tuple[Numbers, ...]) -> Machine:
    """The machine with zones [m] beside its own, by the fields of `Zones`; UsageError for those
    that it cannot have."""
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
    return as_asked(machine, zones=machine.zones.with_more(**given))
