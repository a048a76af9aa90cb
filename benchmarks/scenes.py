"""Random scenes with obstacles in which a path exists, as an independent search finds.

The search is in joint space. The postures of a regular grid of joint angles that keep a clearance
are joined with their neighbours into regions (flood fill). Start and some goal posture must lie in
one region.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import clearances
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.cases.moves import Move
from mhsb_planner.planner import Planner

SEED = 11
CLEARANCE = 7.5e-3
"""Clearance that the path keeps [m]."""

START_CLEARANCE = 20e-3
"""Least clearance of the start posture [m]."""
STEP = 0.04
"""Spacing of the grid in each joint [rad]."""
MOST, FEWEST = 4, 2
"""Largest and smallest number of obstacles in a scene."""

PLACES = ((0.3, 1.0), (-0.7, 0.8))
"""Ranges of x and z from which the positions of obstacles are drawn [m]."""

SIDES, RADII = (0.05, 0.25), (0.03, 0.12)
"""Ranges of box sides and circle radii [m]."""


class Scene(NamedTuple):
    """A machine with obstacles, and a move that it can make among them."""

    machine: Machine
    move: Move


def random_scenes(planner: Planner, count: int) -> Iterator[Scene]:
    """Draw scenes with moves between nodes of the planner's table, until enough have a path.

    Args:
        planner: Planner with machine and posture table.
        count: Number of scenes.

    Yields:
        Each scene; equal calls yield equal scenes.
    """
    random, base, table = np.random.default_rng(SEED), planner.machine, planner.graph.table
    grid = _Grid(base)
    nodes = np.flatnonzero(table.feasible)
    while count:
        boxes, circles = _obstacles(random)
        here, there = random.choice(nodes, 2, replace=False)
        x, z = table.nodes[there] * table.spacing
        move = Move(table.posture[here, 0], (float(x), float(z)))
        with suppress(MhsbError):
            zones = base.zones.with_added(boxes=boxes, circles=circles)
            scene = Scene(base.changed(zones=zones), move)
            if grid.has_path(scene):
                count -= 1
                yield scene


def _obstacles(
    random: np.random.Generator,
) -> tuple[tuple[tuple[float, ...], ...], tuple[tuple[float, ...], ...]]:
    """Draw a number of boxes and circles.

    Args:
        random: Generator of random numbers; advanced.

    Returns:
        Boxes (x₁, z₁, x₂, z₂) and circles (x, z, radius) [m].
    """
    boxes, circles = [], []
    for _ in range(random.integers(FEWEST, MOST + 1)):
        x, z = (float(random.uniform(*place)) for place in PLACES)
        if random.random() < 0.5:
            width, height = random.uniform(*SIDES, 2).tolist()
            boxes.append((x, z, x + width, z + height))
        else:
            circles.append((x, z, float(random.uniform(*RADII))))
    return tuple(boxes), tuple(circles)


class _Grid:
    """Regular grid of postures over the joints' ranges, with a flag for tips in the workspace."""

    def __init__(self, machine: Machine) -> None:
        """Sample the joints' ranges every STEP, and find the postures with the tip inside."""
        m = self._m = machine.arrays
        axes = [np.arange(*ends, STEP) for ends in zip(m.joint_min, m.joint_max, strict=True)]
        postures = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        self._shape = postures.shape[:-1]
        self._postures = frozen(postures.reshape(-1, len(axes)))
        tip = machine.tip_positions(self._postures)
        radius = np.hypot(*tip.T)
        self._inside = (tip[:, 0] >= m.min_x) & (radius >= m.min_radius)
        self._inside &= radius <= m.max_radius

    def has_path(self, scene: Scene) -> bool:
        """Return whether start and goal lie in one region of collision-free postures.

        Args:
            scene: Machine with obstacles, and the move.

        Returns:
            False also if the start is closer than 20 mm to an obstacle.
        """
        machine, (start, (x, z)) = scene
        if machine.clearance(start)[0] < START_CLEARANCE:
            return False
        postures = machine.postures(x, z, np.linspace(-np.pi, np.pi, 200))
        ends = [q for q in postures if machine.clearance(q)[0] >= CLEARANCE]
        distance, _ = clearances(machine.arrays, machine.obstacles.rows, self._postures)
        free = ((distance >= CLEARANCE) & self._inside).reshape(self._shape)
        region, _ = ndimage.label(free, np.ones((3,) * len(self._shape)))
        own = region[self._place(start)]
        return bool(own > 0 and any(region[self._place(q)] == own for q in ends))

    def _place(self, posture: FloatArray) -> tuple[int, ...]:
        """Return the grid indices of the posture nearest to a given one."""
        at = np.rint((posture - self._m.joint_min) / STEP).astype(int)
        return tuple(np.clip(at, 0, np.array(self._shape) - 1).tolist())
