"""Parameters of keep-out zones: flat arrays, a kind of zone each, for the whole arm or its tip.

Every planner node has all of them, whatever its arm: a zone of a kind that the arm cannot have is
refused with the kinds that it can, where a parameter that is not there would be ignored, and the
arm would move through the zone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from rclpy.node import Node

from mhsb_model.machine import Machine
from mhsb_model.obstacles.zones import IN_PLANE, IN_SPACE, Numbers, Zones, zone_numbers
from mhsb_planner.errors import RequestError
from mhsb_planner.ros.flat_arrays import declare_array, rows_of

PLANAR_TEXTS = {
    "boxes": "x z x z [m] of two opposite corners",
    "circles": "x z [m] of the centre, radius [m]",
}
SPATIAL_TEXTS = {
    "boxes": "x y z x y z [m] of two opposite corners",
    "cylinders": "x y [m] of the upright axis, z z [m] of both ends, radius [m]",
    "spheres": "x y z [m] of the centre, radius [m]",
}
"""What the numbers of a zone are, of arms in a plane, and of those that slew."""


class ZoneParameter(NamedTuple):
    """What a parameter sets: field of `Zones`, kind of zone, and what keeps out of it."""

    field: str
    kind: str
    who: str


ZONES = {
    f"{tip}zone_{kind}": ZoneParameter(f"{tip}{kind}", kind, who)
    for tip, who in (("", "the whole arm"), ("tip_", "the tip"))
    for kind in dict.fromkeys([*IN_PLANE, *IN_SPACE])
}


def declare_zones(node: Node, machine: Machine) -> None:
    """Declare all of them, with the zones of the machine file."""
    for name, (field, kind, who) in ZONES.items():
        zones = getattr(machine.zones, field)
        text = f"keep-out {kind} for {who}, one after the other: {_numbers(kind)}"
        declare_array(node, name, [value for zone in zones for value in zone], text)


def zones_of(values: Mapping[str, Any], slews: bool) -> Zones:
    """The zones of the parameters' values; raises RequestError where these are none.

    slews  whether they are those of an arm that slews
    """
    return Zones(**{each.field: _zones(name, values[name], slews) for name, each in ZONES.items()})


def _numbers(kind: str) -> str:
    """What each zone of a kind is given by, for all arms."""
    planar, spatial = PLANAR_TEXTS.get(kind), SPATIAL_TEXTS.get(kind)
    if planar and spatial:
        return f"{planar}; where the arm slews {spatial}"
    if planar:
        return f"{planar}; only where the arm does not slew"
    return f"{spatial}; only where the arm slews"


def _zones(name: str, value: Any, slews: bool) -> tuple[Numbers, ...]:
    """Zones of a flat array; raises RequestError where it is not one, or not of such an arm."""
    kind, there = ZONES[name].kind, zone_numbers(slews)
    if kind in there:
        texts = SPATIAL_TEXTS if slews else PLANAR_TEXTS
        return rows_of(name, value, len(there[kind]), texts[kind])
    if rows_of(name, value, 1, "none for this arm"):
        where = "joint 1 slews, its zones are in space" if slews else "this arm moves in x and z"
        others = " or ".join(f"{name.removesuffix(kind)}{other}" for other in there)
        raise RequestError(name, list(value), f"must be empty: {where}; give {others}")
    return ()
