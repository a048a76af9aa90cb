"""Keep-out zones as a user gives them, and all obstacles as rows of numbers for the kernels.

The arm keeps clear of zones, the ground, the base and itself. Zones are boxes and circles in the
arm's plane. If joint 1 slews, they are upright boxes, upright cylinders and spheres in space. Each
zone holds for the whole arm or for its tip alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
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

BOX_KIND, CIRCLE_KIND, LINK_KIND, SPACE_BOX_KIND, CYLINDER_KIND, SPHERE_KIND = range(6)
"""Kinds of obstacles; from SPACE_BOX_KIND on they are in `base_link`, else in the arm's plane."""

KIND_COLUMN, LINK_COLUMN, SHAPE_COLUMN, RADIUS_COLUMN, OBSTACLE_COLUMN = 0, 1, 2, 8, 9
"""Columns of an obstacle row.

KIND_COLUMN is the kind of obstacle. LINK_COLUMN is the index of the link that keeps clear of it, n
for the tip alone. RADIUS_COLUMN is the radius of this link [m], or the sum of both radii if the
obstacle is also a link. OBSTACLE_COLUMN holds the number of the obstacle, an index into
`Obstacles.names`.

SHAPE_COLUMN is the first of up to six columns that give the shape [m]:

- BOX_KIND: x_min, z_min, x_max, z_max
- CIRCLE_KIND: x, z, radius
- LINK_KIND: index of an earlier link
- SPACE_BOX_KIND: x_min, y_min, z_min, x_max, y_max, z_max
- CYLINDER_KIND: x, y, z_min, z_max, radius
- SPHERE_KIND: x, y, z, radius"""

ROW_WIDTH = 10
"""Number of columns of an obstacle row."""

GROUND_EXTENT = 1e3
"""Extent of the ground, a box, to both sides and downwards [m]."""

Numbers = tuple[float, ...]
"""Numbers that give a zone [m], in the order of `IN_PLANE` or `IN_SPACE`."""

Zone = BoxZone | CircleZone | CylinderZone | SphereZone
"""Keep-out zone of a machine file."""

IN_PLANE: Mapping[str, tuple[str, ...]] = {
    "boxes": ("x_min", "z_min", "x_max", "z_max"),
    "circles": ("x", "z", "radius"),
}
IN_SPACE: Mapping[str, tuple[str, ...]] = {
    "boxes": ("x_min", "y_min", "z_min", "x_max", "y_max", "z_max"),
    "cylinders": ("x", "y", "z_min", "z_max", "radius"),
    "spheres": ("x", "y", "z", "radius"),
}
"""Kinds of zones of an arm that moves in a plane, and of an arm that slews.

Keys are the names of the lists in a machine file. Values are the fields of each zone in the file,
in the order of its numbers [m]."""


def zone_numbers(slews: bool) -> Mapping[str, tuple[str, ...]]:
    """Return the kinds of zones that an arm can have, and the numbers that describe each kind.

    Args:
        slews: Whether joint 1 of the arm slews.

    Returns:
        Names of the numbers [m] in order, by kind; for instance "circles" gives x, z and radius.
        The result is `IN_SPACE` for an arm that slews, otherwise `IN_PLANE`.
    """
    return IN_SPACE if slews else IN_PLANE


@dataclass(frozen=True)
class Zones:
    """Keep-out zones as plain numbers [m], in the order of `IN_PLANE` or `IN_SPACE`.

    Fields that begin with `tip_` hold for the tip alone, the others for the whole arm.
    """

    boxes: tuple[Numbers, ...] = ()
    """Boxes, each by two opposite corners in any order."""

    circles: tuple[Numbers, ...] = ()
    """Circles in the arm's plane, each by its centre (x, z) and radius."""

    cylinders: tuple[Numbers, ...] = ()
    """Upright cylinders, each by x and y of its axis, two heights and its radius."""

    spheres: tuple[Numbers, ...] = ()
    """Spheres, each by its centre (x, y, z) and radius."""

    tip_boxes: tuple[Numbers, ...] = ()
    """Boxes for the tip alone."""

    tip_circles: tuple[Numbers, ...] = ()
    """Circles for the tip alone."""

    tip_cylinders: tuple[Numbers, ...] = ()
    """Upright cylinders for the tip alone."""

    tip_spheres: tuple[Numbers, ...] = ()
    """Spheres for the tip alone."""

    @classmethod
    def from_keep_out(cls, keep_out: KeepOut) -> Zones:
        """Return the keep-out zones of a machine file as plain numbers.

        Args:
            keep_out: Section `keep_out` of the file. Its ground, base, margin and self-collision
                are not taken.

        Returns:
            Zones, sorted by kind, and by whether they hold for the tip alone.
        """

        def collect_numbers(field: str) -> tuple[Numbers, ...]:
            """Return the zones of the machine file that belong to one field of `Zones`.

            Args:
                field: Name of the field, such as `tip_boxes` or `circles`.

            Returns:
                Numbers of each zone [m], in the order of the file.
            """
            holds_for, kind = _split_field_name(field)
            zones = [zone for zone in getattr(keep_out, kind) if zone.holds_for == holds_for]
            return tuple(
                tuple(getattr(zone, name) for name in _list_number_fields(kind, zone))
                for zone in zones
            )

        return cls(**{field.name: collect_numbers(field.name) for field in fields(cls)})

    def with_added(self, **more: Iterable[Sequence[float]]) -> Zones:
        """Return a copy of these zones with further zones added at the end.

        Args:
            **more: Further zones, each as numbers [m], by the name of a field of this class, such
                as `boxes`. Other names are ignored.

        Returns:
            New zones; in each field the further zones come last.
        """
        own = {field.name: getattr(self, field.name) for field in fields(self)}
        both = {name: (*zones, *map(tuple, more.get(name, ()))) for name, zones in own.items()}
        return Zones(**both)

    def content(self) -> dict[str, list[dict[str, Any]]]:
        """Return the zones in the form in which a machine file lists them.

        The corners of boxes and the heights of cylinders are sorted, so that each `_min` is below
        its `_max`.

        Returns:
            Lists of sections by the keys `boxes`, `circles`, `cylinders` and `spheres`. Each
            section has `holds_for`, "arm" or "tip".
        """
        content: dict[str, list[dict[str, Any]]] = {}
        for field in fields(self):
            holds_for, kind = _split_field_name(field.name)
            zones = [
                _describe_zone_section(kind, zone, holds_for) for zone in getattr(self, field.name)
            ]
            content.setdefault(kind, []).extend(zones)
        return content


def _split_field_name(field: str) -> tuple[HoldsFor, str]:
    """Split the name of a field of `Zones` into the scope of its zones and their kind.

    The scope says whether the zones hold for the whole arm ("arm") or for its tip alone ("tip").

    Args:
        field: For example `tip_boxes` or `boxes`.

    Returns:
        For these examples `("tip", "boxes")` and `("arm", "boxes")`.
    """
    return ("tip", field.removeprefix("tip_")) if field.startswith("tip_") else ("arm", field)


def _list_number_fields(kind: str, zone: Section) -> tuple[str, ...]:
    """Return the fields of a zone in a machine file that describe its shape, in their order.

    Args:
        kind: Kind of the zone, such as `boxes`.
        zone: Section of the machine file. A box whose `y_min` is None is in the arm's plane.

    Returns:
        Names such as `x_min`; for a box four if it is in the plane, six if it is in space.
    """
    planar = kind == "circles" or getattr(zone, "y_min", 0.0) is None
    return zone_numbers(not planar)[kind]


def _describe_zone_section(kind: str, numbers: Numbers, holds_for: HoldsFor) -> dict[str, Any]:
    """Return one zone in the form in which a machine file lists it.

    The corners of a box, or the heights of a cylinder, are sorted, so that each `_min` is below its
    `_max`.

    Args:
        kind: Kind of the zone, such as `boxes`.
        numbers: Numbers of the zone's shape [m]. A box of four numbers is in the arm's plane, a box
            of six in space.
        holds_for: "arm" or "tip".

    Returns:
        Section of the machine file: numbers by key, and `holds_for`.
    """
    planar = kind == "circles" or (kind == "boxes" and len(numbers) == len(IN_PLANE["boxes"]))
    content = dict(zip(zone_numbers(not planar)[kind], numbers, strict=True))
    for axis in ("x", "y", "z"):  # corners and heights may be given in any order
        ends = f"{axis}_min", f"{axis}_max"
        if ends[0] in content:
            values = sorted(content[end] for end in ends)
            content |= dict(zip(ends, values, strict=True))
    return {**content, "holds_for": holds_for}


@dataclass(frozen=True, eq=False)
class Obstacles:
    """All obstacles that an arm of n links keeps clear of."""

    rows: FloatArray
    """One row for each pair of obstacle and link (or tip) that must keep clear of it.

    Shape (rows, ROW_WIDTH); the module describes the columns."""

    path_rows: FloatArray
    """`rows` with the margin of discrete paths added to the radii."""

    names: tuple[str, ...]
    """Names of the obstacles for messages, indexed by column OBSTACLE_COLUMN."""

    def name(self, row: int) -> str:
        """Return the name of the obstacle to which a row belongs; empty for row −1."""
        return self.names[int(self.rows[row, OBSTACLE_COLUMN])] if row >= 0 else ""

    @property
    def is_in_space(self) -> np.ndarray:
        """Whether each row belongs to a zone in space, bool[rows]."""
        return self.rows[:, KIND_COLUMN] >= SPACE_BOX_KIND

    def combined_with(self, others: Obstacles) -> Obstacles:
        """Return these obstacles followed by others of the same arm.

        Args:
            others: Obstacles to append. Column OBSTACLE_COLUMN of their rows has the index of a
                name. It grows by the number of names of these obstacles, so that it points to the
                same name as before.

        Returns:
            New obstacles with all rows and names.
        """
        shift = len(self.names) * (np.arange(ROW_WIDTH) == OBSTACLE_COLUMN)
        return Obstacles(
            frozen(np.vstack([self.rows, others.rows + shift])),
            frozen(np.vstack([self.path_rows, others.path_rows + shift])),
            self.names + others.names,
        )


NO_OBSTACLES = Obstacles(frozen(np.empty((0, ROW_WIDTH))), frozen(np.empty((0, ROW_WIDTH))), ())


def build_obstacles(keep_out: KeepOut, joints: int, joints_before_plane: int = 0) -> Obstacles:
    """Convert the obstacles of a machine file into the obstacle table for the kernels.

    The table has one row for each obstacle and link that must keep clear of each other:

    - An obstacle for the whole arm has a row for each link in the plane.
    - An obstacle for the tip alone has one row.
    - The base has no row for the first link in the plane, which is mounted on it.
    - Self-collision has a row for each pair of links that are not neighbours, with the sum of their
      radii.

    If the file has no radii of links, they are 0.

    Args:
        keep_out: Section `keep_out` of the machine file.
        joints: Number of joints n.
        joints_before_plane: 1 if joint 1 slews, so that its link is not in the plane, else 0.

    Returns:
        Obstacles with rows in the order zones, ground, base, self-collision. Their second array,
        `path_rows`, is for discrete paths: the same rows with the file's margin added to the radii.
    """
    links = joints - joints_before_plane
    radius = (*(keep_out.link_radii or links * (0.0,)), 0.0)
    rows, names = [], []
    for number, (name, (kind, first, *shape)) in enumerate(
        _list_obstacles(keep_out, links, joints_before_plane)
    ):
        names.append(name)
        last = first if kind == LINK_KIND or first == links else links - 1
        for part in range(int(first), int(last) + 1):
            row = np.zeros(ROW_WIDTH)
            row[[KIND_COLUMN, LINK_COLUMN, RADIUS_COLUMN, OBSTACLE_COLUMN]] = (
                kind,
                part + joints_before_plane,
                radius[part],
                number,
            )
            row[SHAPE_COLUMN : SHAPE_COLUMN + len(shape)] = shape
            if kind == LINK_KIND:
                other = int(shape[0])
                row[SHAPE_COLUMN], row[RADIUS_COLUMN] = (
                    other + joints_before_plane,
                    radius[part] + radius[other],
                )
            rows.append(row)
    all_rows = np.array(rows).reshape(-1, ROW_WIDTH)
    grown = all_rows + keep_out.margin * (np.arange(ROW_WIDTH) == RADIUS_COLUMN)
    return Obstacles(frozen(all_rows), frozen(grown), tuple(names))


def _list_obstacles(
    keep_out: KeepOut, links: int, joints_before_plane: int
) -> Iterator[tuple[str, list[float]]]:
    """Yield the obstacles of a machine file with their names and shapes.

    The order is zones, ground, base, self-collision.

    Args:
        keep_out: Section `keep_out` of the machine file.
        links: Number of links in the arm's plane.
        joints_before_plane: 1 if joint 1 slews, so that its link is not in the plane, else 0.

    Yields:
        One pair for each obstacle: its name, and a list of kind, link index and shape [m]. The link
        with this index (from 0) and all later links in the plane must not touch the obstacle. If
        the index equals `links`, only the tip must not touch it. For self-collision, the list is
        the kind and the indices of the two links, the later one first.
    """
    named = 1 + joints_before_plane  # number of the first link in the plane
    zones: list[Zone] = [*keep_out.boxes, *keep_out.circles]
    for zone in [*zones, *keep_out.cylinders, *keep_out.spheres]:
        name, (kind, *shape) = _describe_zone(zone)
        first = 0 if zone.holds_for == "arm" else links
        yield f"the keep-out {name}", [kind, first, *shape]
    if keep_out.ground is not None:
        extent = [-GROUND_EXTENT, -GROUND_EXTENT, GROUND_EXTENT, keep_out.ground]
        yield f"the ground at z = {keep_out.ground:g} m", [BOX_KIND, 0, *extent]
    if keep_out.base is not None:
        name, (kind, *shape) = _describe_box(keep_out.base)
        yield f"the base, a {name}", [kind, 1, *shape]
    if keep_out.self_collision:
        yield from (
            (
                f"itself, link {later} to link {earlier}",
                [float(LINK_KIND), later - named, earlier - named],
            )
            for later in range(2 + named, links + named)
            for earlier in range(named, later - 1)
        )


def _describe_zone(zone: Zone) -> tuple[str, list[float]]:
    """Return the name of a zone for messages, and its kind followed by the numbers of its shape.

    Args:
        zone: Zone of a machine file.

    Returns:
        Name with dimensions in m, and the list of kind and numbers [m].
    """
    if isinstance(zone, CircleZone):
        name = f"circle of {zone.radius:g} m around ({zone.x:g}, {zone.z:g}) m"
        return name, [CIRCLE_KIND, zone.x, zone.z, zone.radius]
    if isinstance(zone, CylinderZone):
        name = (
            f"cylinder of {zone.radius:g} m around ({zone.x:g}, {zone.y:g}) m, "
            f"z = {zone.z_min:g} … {zone.z_max:g} m"
        )
        return name, [CYLINDER_KIND, zone.x, zone.y, zone.z_min, zone.z_max, zone.radius]
    if isinstance(zone, SphereZone):
        name = f"sphere of {zone.radius:g} m around ({zone.x:g}, {zone.y:g}, {zone.z:g}) m"
        return name, [SPHERE_KIND, zone.x, zone.y, zone.z, zone.radius]
    return _describe_box(zone)


def _describe_box(box: Box) -> tuple[str, list[float]]:
    """Return the name of a box for messages, and its kind followed by its two corners.

    Args:
        box: Box of a machine file. A box with limits of y is in space, a box without them in the
            arm's plane.

    Returns:
        Name with the corners in m, and the list of kind, low corner and high corner [m].
    """
    low, high = [box.x_min, box.z_min], [box.x_max, box.z_max]
    kind = BOX_KIND
    if isinstance(box, BoxZone) and box.y_min is not None and box.y_max is not None:
        low.insert(1, box.y_min)
        high.insert(1, box.y_max)
        kind = SPACE_BOX_KIND
    corners = (", ".join(f"{value:g}" for value in corner) for corner in (low, high))
    return "box ({}) … ({}) m".format(*corners), [kind, *low, *high]
