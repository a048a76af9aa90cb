"""Keep-out zones as a user gives them, and everything to keep clear of as rows for the kernels.

The arm keeps clear of zones (boxes and circles), the ground, the base and itself. A box or circle
holds for the whole arm or for its tip alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mhsb_model.schema import Box, HoldsFor, KeepOut
from mhsb_model.types import FloatArray, frozen

BOX, CIRCLE, LINK = 0.0, 1.0, 2.0
"""Kinds of obstacles."""

KIND, PART, SHAPE, RADIUS, NUMBER = 0, 1, 2, 6, 7
"""Columns of a row: what an obstacle is; the link that keeps clear of it, n for the tip alone; four
numbers: x_min, z_min, x_max, z_max of a box, x, z, radius of a circle, an earlier link; the link's
radius, of both where the obstacle is a link; which obstacle it is."""

ROW_WIDTH = 8

FAR = 1e3
"""The ground is a box that extends so far to all sides and down [m]."""

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class Zones:
    """Keep-out zones as plain numbers.

    boxes        two opposite corners (x, z, x, z) m each, for the whole arm
    circles      (x, z, radius) m each, for the whole arm
    tip_boxes    for the tip alone
    tip_circles  for the tip alone
    """

    boxes: tuple[Numbers, ...] = ()
    circles: tuple[Numbers, ...] = ()
    tip_boxes: tuple[Numbers, ...] = ()
    tip_circles: tuple[Numbers, ...] = ()

    @classmethod
    def of(cls, keep_out: KeepOut) -> Zones:
        """Those of a machine file."""

        def boxes(holds_for: HoldsFor) -> tuple[Numbers, ...]:
            kept = [box for box in keep_out.boxes if box.holds_for == holds_for]
            return tuple((box.x_min, box.z_min, box.x_max, box.z_max) for box in kept)

        def circles(holds_for: HoldsFor) -> tuple[Numbers, ...]:
            kept = [circle for circle in keep_out.circles if circle.holds_for == holds_for]
            return tuple((circle.x, circle.z, circle.radius) for circle in kept)

        return cls(boxes("arm"), circles("arm"), boxes("tip"), circles("tip"))

    def with_more(
        self, boxes: Iterable[Sequence[float]] = (), circles: Iterable[Sequence[float]] = ()
    ) -> Zones:
        """These and others for the whole arm."""
        return Zones(
            (*self.boxes, *map(tuple, boxes)),
            (*self.circles, *map(tuple, circles)),
            self.tip_boxes,
            self.tip_circles,
        )

    def content(self) -> dict[str, list[dict[str, Any]]]:
        """As they stand in a machine file."""
        return {
            "boxes": [
                *(_box_content(box, "arm") for box in self.boxes),
                *(_box_content(box, "tip") for box in self.tip_boxes),
            ],
            "circles": [
                *(_circle_content(circle, "arm") for circle in self.circles),
                *(_circle_content(circle, "tip") for circle in self.tip_circles),
            ],
        }


def _box_content(corners: Numbers, holds_for: HoldsFor) -> dict[str, Any]:
    x, z = sorted(corners[0::2]), sorted(corners[1::2])
    return {
        "x_min": x[0], "z_min": z[0], "x_max": x[1], "z_max": z[1], "holds_for": holds_for
    }  # fmt: skip


def _circle_content(numbers: Numbers, holds_for: HoldsFor) -> dict[str, Any]:
    x, z, radius = numbers
    return {"x": x, "z": z, "radius": radius, "holds_for": holds_for}


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
            if kind == LINK:
                other = int(shape[0])
                both = radius[part] + radius[other]
                rows.append([kind, part + beneath, other + beneath, *shape[1:], both, number])
            else:
                rows.append([kind, part + beneath, *shape, radius[part], number])
    all_rows = np.array(rows, dtype=np.float64).reshape(-1, ROW_WIDTH)
    grown = all_rows + keep_out.margin * (np.arange(ROW_WIDTH) == RADIUS)
    return Obstacles(frozen(all_rows), frozen(grown), tuple(names))


def _described(keep_out: KeepOut, links: int, beneath: int) -> list[tuple[str, list[float]]]:
    """Name of each obstacle; its kind, the first part of the arm that it holds for, its shape."""
    found: list[tuple[str, list[float]]] = []
    named = 1 + beneath  # number of the first link in the plane
    for box in keep_out.boxes:
        first = 0 if box.holds_for == "arm" else links
        found.append((f"the keep-out {_box_name(box)}", [BOX, first, *_bounds(box)]))
    for circle in keep_out.circles:
        first = 0 if circle.holds_for == "arm" else links
        found.append((
            f"the keep-out circle of {circle.radius:g} m around ({circle.x:g}, {circle.z:g}) m",
            [CIRCLE, first, circle.x, circle.z, circle.radius, 0.0],
        ))
    if keep_out.ground is not None:
        name = f"the ground at z = {keep_out.ground:g} m"
        found.append((name, [BOX, 0, -FAR, -FAR, FAR, keep_out.ground]))
    if keep_out.base is not None:
        found.append((f"the base, a {_box_name(keep_out.base)}", [BOX, 1, *_bounds(keep_out.base)]))
    if keep_out.self_collision:
        found += [
            (
                f"itself, link {later} to link {earlier}",
                [LINK, later - named, earlier - named, 0, 0, 0],
            )
            for later in range(2 + named, links + named)
            for earlier in range(named, later - 1)
        ]
    return found


def _bounds(box: Box) -> list[float]:
    return [box.x_min, box.z_min, box.x_max, box.z_max]


def _box_name(box: Box) -> str:
    return f"box ({box.x_min:g}, {box.z_min:g}) … ({box.x_max:g}, {box.z_max:g}) m"
