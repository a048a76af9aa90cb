"""Parameters of keep-out zones: a flat array for each kind of zone, for the whole arm or its tip.

Every planner node declares the parameters of all kinds. A zone of a kind that the arm cannot have
is refused, and the error names the possible kinds. If the parameter were not declared, ROS would
ignore its value, and the arm would move through the zone.
"""

from collections.abc import Mapping
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_model.machine import Machine
from mhsb_model.obstacles.zones import IN_PLANE, IN_SPACE, Numbers, Zones, zone_numbers
from mhsb_msgs_py.parameters import NodeParameter
from mhsb_planner.errors import RequestError
from mhsb_planner.ros.flat_arrays import FARTHEST_POINT, split_rows

PLANAR_TEXTS = {
    "boxes": "x z x z [m] of two opposite corners",
    "circles": "x z [m] of the centre, radius [m]",
}
"""Meaning of the numbers of a zone by kind, for arms that move in a fixed plane."""

SPATIAL_TEXTS = {
    "boxes": "x y z x y z [m] of two opposite corners",
    "cylinders": "x y [m] of the upright axis, z z [m] of both ends, radius [m]",
    "spheres": "x y z [m] of the centre, radius [m]",
}
"""Meaning of the numbers of a zone by kind, for arms that slew."""


ZONE_PARAMETERS = {
    f"{tip}zone_{kind}": f"{tip}{kind}"
    for tip in ("", "tip_")
    for kind in dict.fromkeys([*IN_PLANE, *IN_SPACE])
}
"""Field of `Zones` that each zone parameter sets, by the parameter's name.

The names are `zone_` and the kind of zone for the whole arm, such as `zone_boxes`, and `tip_zone_`
and the kind for the tip alone."""


def declare_zones(node: Node, machine: Machine) -> None:
    """Declare all zone parameters, with the zones of the machine file as initial values.

    This includes parameters of zone kinds that the arm cannot have.

    Args:
        node: Planner node.
        machine: Machine of the machine file.
    """
    for name, field in ZONE_PARAMETERS.items():
        kind, who = (
            field.removeprefix("tip_"),
            "the tip" if field.startswith("tip_") else "the whole arm",
        )
        numbers = [value for zone in getattr(machine.zones, field) for value in zone]
        text = f"keep-out {kind} for {who}, one after the other: {_describe_numbers(kind)}"
        limits = -FARTHEST_POINT, FARTHEST_POINT
        NodeParameter(name, numbers, text, limits, may_be_empty=True).declare(node)


def replace_deletions(changes: list[Parameter]) -> list[Parameter]:
    """Replace each deletion of a zone parameter by an empty array, which means no zones.

    Without this, ROS would remove the parameter, and it could not be set again.

    Args:
        changes: Parameters that will be set.

    Returns:
        The changes in the same order. Changes of other parameters are not replaced.
    """
    return [
        Parameter(change.name, Parameter.Type.DOUBLE_ARRAY, [])
        if change.name in ZONE_PARAMETERS and change.type_ is Parameter.Type.NOT_SET
        else change
        for change in changes
    ]


def make_zones(values: Mapping[str, Any], slews: bool) -> Zones:
    """Make the zones that the zone parameters describe.

    Args:
        values: Values by parameter name. All zone parameters must be present.
        slews: True if joint 1 slews. Zones then have three dimensions, otherwise two.

    Returns:
        The zones of all kinds, each with its numbers [m].

    Raises:
        RequestError: A value is not an array of numbers, its length does not fit, or it has zones
            of a kind that this arm cannot have.
    """
    return Zones(
        **{
            field: _split_zones(name, values[name], slews)
            for name, field in ZONE_PARAMETERS.items()
        }
    )


def _describe_numbers(kind: str) -> str:
    """Describe what the numbers of a zone parameter mean, for arms with and without a slew.

    Args:
        kind: Kind of zone: boxes, circles, cylinders or spheres.

    Returns:
        A text such as "x z [m] of the centre, radius [m]; only where the arm does not slew".
    """
    planar, spatial = PLANAR_TEXTS.get(kind), SPATIAL_TEXTS.get(kind)
    if planar and spatial:
        return f"{planar}; where the arm slews {spatial}"
    if planar:
        return f"{planar}; only where the arm does not slew"
    return f"{spatial}; only where the arm slews"


def _split_zones(name: str, value: Any, slews: bool) -> tuple[Numbers, ...]:
    """Split the value of a zone parameter into zones.

    Args:
        name: Name of the parameter.
        value: Value of the parameter, a flat array.
        slews: True if the arm slews.

    Returns:
        One tuple of numbers for each zone; empty if the array is empty.

    Raises:
        RequestError: The value is not an array of numbers, its length does not fit, or it has zones
            of a kind that this arm cannot have.
    """
    kind, there = ZONE_PARAMETERS[name].removeprefix("tip_"), zone_numbers(slews)
    if kind in there:
        texts = SPATIAL_TEXTS if slews else PLANAR_TEXTS
        return split_rows(name, value, len(there[kind]), texts[kind])
    if split_rows(name, value, 1, "none for this arm"):
        where = "joint 1 slews, its zones are in space" if slews else "this arm moves in x and z"
        others = " or ".join(f"{name.removesuffix(kind)}{other}" for other in there)
        raise RequestError(name, list(value), f"must be empty: {where}; give {others}")
    return ()
