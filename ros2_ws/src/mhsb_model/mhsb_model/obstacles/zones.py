"""Keep-out zones as a user gives them, and everything to keep clear of as rows for the kernels.

The arm keeps clear of zones, the ground, the base and itself. Zones are boxes and circles in the
arm's plane or, where joint 1 slews, upright boxes, upright cylinders and spheres in space. Each
holds for the whole arm or for its tip alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from mhsb_model.schema import (
    Box,
    BoxZone,
    CircleZone,
    CylinderZone,
    HoldsFor,
    KeepOut,
    Section,
    SphereZone,
)
from mhsb_model.types import FloatArray, frozen

BOX, CIRCLE, LINK, BOX_IN_SPACE, CYLINDER, SPHERE = range(6)
"""Kinds of obstacles; from BOX_IN_SPACE on they are in `base_link`, not in the arm's plane."""

KIND, PART, SHAPE, RADIUS, NUMBER = 0, 1, 2, 8, 9
"""Columns of a row: what an obstacle is; the link that keeps clear of it, n for the tip alone; its
shape, up to six numbers [m]: x_min, z_min, x_max, z_max of a box, x, z, radius of a circle, an
earlier link; in space x_min, y_min, z_min, x_max, y_max, z_max of a box, x, y, z_min, z_max, radius
of a cylinder, x, y, z, radius of a sphere; the link's radius, of both where the obstacle is a link;
which obstacle it is."""

ROW_WIDTH = 10

FAR = 1e3
"""The ground is a box that extends so far to all sides and down [m]."""

Numbers = tuple[float, ...]
Zone = BoxZone | CircleZone | CylinderZone | SphereZone

IN_PLANE: Mapping[str, tuple[str, ...]] = {
    "boxes": ("x_min", "z_min", "x_max", "z_max"),
    "circles": ("x", "z", "radius"),
}
IN_SPACE: Mapping[str, tuple[str, ...]] = {
    "boxes": ("x_min", "y_min", "z_min", "x_max", "y_max", "z_max"),
    "cylinders": ("x", "y", "z_min", "z_max", "radius"),
    "spheres": ("x", "y", "z", "radius"),
}
"""Zones of arms that move in a plane, and of those that slew: their numbers, by their names in a
machine file, in the order in which they are given [m]."""


def zone_numbers(slews: bool) -> Mapping[str, tuple[str, ...]]:
    """Kinds of zones that an arm keeps out of, and what each is given by."""
    return IN_SPACE if slews else IN_PLANE


@dataclass(frozen=True)
class Zones:
    """Keep-out zones as plain numbers [m], those of `IN_PLANE` or of `IN_SPACE`.

    boxes         two opposite corners each, for the whole arm
    circles       centre and radius
    cylinders     x, y of the axis, two heights, radius
    spheres       centre and radius
    tip_boxes …   for the tip alone
    """

    boxes: tuple[Numbers, ...] = ()
    circles: tuple[Numbers, ...] = ()
    cylinders: tuple[Numbers, ...] = ()
    spheres: tuple[Numbers, ...] = ()
    tip_boxes: tuple[Numbers, ...] = ()
    tip_circles: tuple[Numbers, ...] = ()
    tip_cylinders: tuple[Numbers, ...] = ()
    tip_spheres: tuple[Numbers, ...] = ()

    @classmethod
    def of(cls, keep_out: KeepOut) -> Zones:
        """Those of a machine file."""

        def numbers(field: str) -> tuple[Numbers, ...]:
            holds_for, kind = _kind_of(field)
            zones = [zone for zone in getattr(keep_out, kind) if zone.holds_for == holds_for]
            return tuple(
                tuple(getattr(zone, name) for name in _names(kind, zone)) for zone in zones
            )

        return cls(**{field.name: numbers(field.name) for field in fields(cls)})

    def with_more(self, **more: Iterable[Sequence[float]]) -> Zones:
        """These and others, by the names of the fields."""
        own = {field.name: getattr(self, field.name) for field in fields(self)}
        both = {name: (*zones, *map(tuple, more.get(name, ()))) for name, zones in own.items()}
        return Zones(**both)

    def content(self) -> dict[str, list[dict[str, Any]]]:
        """As they stand in a machine file."""
        content: dict[str, list[dict[str, Any]]] = {}
        for field in fields(self):
            holds_for, kind = _kind_of(field.name)
            zones = [_content(kind, zone, holds_for) for zone in getattr(self, field.name)]
            content.setdefault(kind, []).extend(zones)
        return content


def _kind_of(field: str) -> tuple[HoldsFor, str]:
    """For what the zones of a field of `Zones` hold, and their kind."""
    return ("tip", field.removeprefix("tip_")) if field.startswith("tip_") else ("arm", field)


def _names(kind: str, zone: Section) -> tuple[str, ...]:
    """By which numbers a zone of a machine file is given."""
    planar = kind == "circles" or getattr(zone, "y_min", 0.0) is None
    return zone_numbers(not planar)[kind]


def _content(kind: str, numbers: Numbers, holds_for: HoldsFor) -> dict[str, Any]:
    planar = kind == "circles" or (kind == "boxes" and len(numbers) == len(IN_PLANE["boxes"]))
    content = dict(zip(zone_numbers(not planar)[kind], numbers, strict=True))
    for axis in ("x", "y", "z"):  # of two opposite corners, or heights, in any order
        ends = f"{axis}_min", f"{axis}_max"
        if ends[0] in content:
            values = sorted(content[end] for end in ends)
            content |= dict(zip(ends, values, strict=True))
    return {**content, "holds_for": holds_for}


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Everything that an arm of n links keeps clear of.

    rows       float64[rows, ROW_WIDTH], one for each part of the arm that an obstacle holds for
    path_rows  the same, the margin of discrete paths added to the radii
    names      of the obstacles
    """

    rows: FloatArray
    path_rows: FloatArray
    names: tuple[str, ...]

    def name(self, row: int) -> str:
        """Of the obstacle that a row belongs to; "" for −1."""
        return self.names[int(self.rows[row, NUMBER])] if row >= 0 else ""

    @property
    def in_space(self) -> np.ndarray:
        """Which rows are of zones in space, bool[rows]."""
        return self.rows[:, KIND] >= BOX_IN_SPACE

    def and_also(self, others: Obstacles) -> Obstacles:
        """These and others."""
        shift = len(self.names) * (np.arange(ROW_WIDTH) == NUMBER)
        return Obstacles(
            frozen(np.vstack([self.rows, others.rows + shift])),
            frozen(np.vstack([self.path_rows, others.path_rows + shift])),
            self.names + others.names,
        )


NO_OBSTACLES = Obstacles(frozen(np.empty((0, ROW_WIDTH))), frozen(np.empty((0, ROW_WIDTH))), ())


def obstacles_of(keep_out: KeepOut, joints: int, beneath: int = 0) -> Obstacles:
    """The obstacles of a machine file for an arm of so many joints, so many of them not in its
    plane."""
    links = joints - beneath
    radius = (*(keep_out.link_radii or links * (0.0,)), 0.0)
    rows, names = [], []
    for number, (name, (kind, first, *shape)) in enumerate(_described(keep_out, links, beneath)):
        names.append(name)
        last = first if kind == LINK or first == links else links - 1
        for part in range(int(first), int(last) + 1):
            row = np.zeros(ROW_WIDTH)
            row[[KIND, PART, RADIUS, NUMBER]] = kind, part + beneath, radius[part], number
            row[SHAPE:SHAPE + len(shape)] = shape
            if kind == LINK:
                other = int(shape[0])
                row[SHAPE], row[RADIUS] = other + beneath, radius[part] + radius[other]
            rows.append(row)
    all_rows = np.array(rows).reshape(-1, ROW_WIDTH)
    grown = all_rows + keep_out.margin * (np.arange(ROW_WIDTH) == RADIUS)
    return Obstacles(frozen(all_rows), frozen(grown), tuple(names))


def _described(keep_out: KeepOut, links: int, beneath: int) -> list[tuple[str, list[float]]]:
    """Name of each obstacle; its kind, the first part of the arm that it holds for, its shape."""
    found: list[tuple[str, list[float]]] = []
    named = 1 + beneath  # number of the first link in the plane
    zones: list[Zone] = [*keep_out.boxes, *keep_out.circles]
    for zone in [*zones, *keep_out.cylinders, *keep_out.spheres]:
        name, (kind, *shape) = _shape(zone)
        first = 0 if zone.holds_for == "arm" else links
        found.append((f"the keep-out {name}", [kind, first, *shape]))
    if keep_out.ground is not None:
        name = f"the ground at z = {keep_out.ground:g} m"
        found.append((name, [BOX, 0, -FAR, -FAR, FAR, keep_out.ground]))
    if keep_out.base is not None:
        name, (kind, *shape) = _box(keep_out.base)
        found.append((f"the base, a {name}", [kind, 1, *shape]))
    if keep_out.self_collision:
        found += [
            (f"itself, link {later} to link {earlier}", [LINK, later - named, earlier - named])
            for later in range(2 + named, links + named)
            for earlier in range(named, later - 1)
        ]
    return found


def _shape(zone: Zone) -> tuple[str, list[float]]:
    """What a zone is called; its kind and shape."""
    if isinstance(zone, CircleZone):
        name = f"circle of {zone.radius:g} m around ({zone.x:g}, {zone.z:g}) m"
        return name, [CIRCLE, zone.x, zone.z, zone.radius]
    if isinstance(zone, CylinderZone):
        name = (
            f"cylinder of {zone.radius:g} m around ({zone.x:g}, {zone.y:g}) m, "
            f"z = {zone.z_min:g} … {zone.z_max:g} m"
        )
        return name, [CYLINDER, zone.x, zone.y, zone.z_min, zone.z_max, zone.radius]
    if isinstance(zone, SphereZone):
        name = f"sphere of {zone.radius:g} m around ({zone.x:g}, {zone.y:g}, {zone.z:g}) m"
        return name, [SPHERE, zone.x, zone.y, zone.z, zone.radius]
    return _box(zone)


def _box(box: Box) -> tuple[str, list[float]]:
    low, high = [box.x_min, box.z_min], [box.x_max, box.z_max]
    kind = BOX
    if isinstance(box, BoxZone) and box.y_min is not None and box.y_max is not None:
        low.insert(1, box.y_min)
        high.insert(1, box.y_max)
        kind = BOX_IN_SPACE
    corners = (", ".join(f"{value:g}" for value in corner) for corner in (low, high))
    return "box ({}) … ({}) m".format(*corners), [kind, *low, *high]
