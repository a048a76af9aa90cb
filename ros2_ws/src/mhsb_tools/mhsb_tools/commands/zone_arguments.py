"""Command-line options for keep-out zones, which are added to those of the machine file."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from mhsb_model.command_line import UsageError
from mhsb_model.machine import Machine
from mhsb_model.obstacles.zones import Numbers, zone_numbers
from mhsb_tools.commands.plan_arguments import POSITION_RANGE
from mhsb_tools.machine_arguments import change_machine

BOX_METAVAR, SPACE_BOX_METAVAR = "X1 Z1 X2 Z2", "X1 Y1 Z1 X2 Y2 Z2"
CIRCLE_METAVAR, CYLINDER_METAVAR, SPHERE_METAVAR = (
    "X Z RADIUS",
    "X Y Z_MIN Z_MAX RADIUS",
    "X Y Z RADIUS",
)


@dataclass(frozen=True)
class ZoneArguments:
    """Options for keep-out zones. Boxes are for all arms, circles for those that do not slew.

    Attributes:
        zone_box: Two opposite corners [m] of a box that plans keep out of, beside the machine
            file's zones, with Y where the arm slews; may be given several times.
        zone_circle: Centre and radius [m] of a circle that plans keep out of; may be given several
            times; for arms that do not slew.
        zone_cylinder: Axis, ends and radius [m] of an upright cylinder that plans keep out of; may
            be given several times; for arms that slew.
        zone_sphere: Centre and radius [m] of a sphere that plans keep out of; may be given several
            times; for arms that slew.
    """

    zone_box: Annotated[
        tuple[Numbers, ...],
        tyro.conf.arg(metavar="X1 [Y1] Z1 X2 [Y2] Z2"),
        tyro.conf.UseAppendAction,
        POSITION_RANGE,
    ] = ()
    zone_circle: Annotated[
        tuple[tuple[float, float, float], ...],
        tyro.conf.arg(metavar=CIRCLE_METAVAR),
        tyro.conf.UseAppendAction,
        POSITION_RANGE,
    ] = ()
    zone_cylinder: Annotated[
        tuple[tuple[float, float, float, float, float], ...],
        tyro.conf.arg(metavar=CYLINDER_METAVAR),
        tyro.conf.UseAppendAction,
        POSITION_RANGE,
    ] = ()
    zone_sphere: Annotated[
        tuple[tuple[float, float, float, float], ...],
        tyro.conf.arg(metavar=SPHERE_METAVAR),
        tyro.conf.UseAppendAction,
        POSITION_RANGE,
    ] = ()

    def add_to(self, machine: Machine) -> Machine:
        """Return the machine with its own keep-out zones and the zones of these options.

        Args:
            machine: The arm; not changed.

        Raises:
            UsageError: A zone is of a kind that this arm cannot have, or a value is wrong.
        """
        return add_zones(
            machine,
            boxes=self.zone_box,
            circles=self.zone_circle,
            cylinders=self.zone_cylinder,
            spheres=self.zone_sphere,
        )


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
        **given: Zones by kind: `boxes`, `circles`, `cylinders` or `spheres`. Each kind is a tuple
            of zones, and each zone is a tuple of numbers [m] in the order of its command-line
            option. Boxes are for all arms, circles for arms that do not slew, the others for arms
            that slew.

    Returns:
        A new machine with its own zones and the given ones.

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
