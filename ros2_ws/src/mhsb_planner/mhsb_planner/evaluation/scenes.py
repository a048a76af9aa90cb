"""Random scenes with obstacles that have a way, as an independent search of joint space finds.

The postures of an even grid of joint angles that keep a clearance, joined where they touch, form
regions (flood fill); start and one of the goal's postures must lie in the same one.
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
from mhsb_planner.evaluation.moves import Move
from mhsb_planner.planner import Planner

SEED = 11
CLEARANCE = 7.5e-3
"""That the way keeps [m]."""

START_CLEARANCE = 20e-3  # m
STEP = 0.04  # rad
MOST, FEWEST = 4, 2
"""Obstacles in a scene."""

PLACES = ((0.3, 1.0), (-0.7, 0.8))
"""Ranges of x and z in which obstacles are put [m]."""

SIDES, RADII = (0.05, 0.25), (0.03, 0.12)  # m


class Scene(NamedTuple):
    """A machine with obstacles, and a move that it can make among them."""

    machine: Machine
    move: Move


def random_scenes(planner: Planner, count: int) -> Iterator[Scene]:
    """Scenes with moves between nodes of the planner's table."""
    random, base, table = np.random.default_rng(SEED), planner.machine, planner.graph.table
    grid = _Grid(base)
    nodes = np.flatnonzero(table.feasible)
    while count:
        boxes, circles = _obstacles(random)
        here, there = random.choice(nodes, 2, replace=False)
        x, z = table.nodes[there] * table.spacing
        move = Move(table.posture[here, 0], (float(x), float(z)))
        with suppress(MhsbError):
            zones = base.zones.with_more(boxes=boxes, circles=circles)
            scene = Scene(base.changed(zones=zones), move)
            if grid.has_way(scene):
                count -= 1
                yield scene


def _obstacles(
    random: np.random.Generator,
) -> tuple[tuple[tuple[float, ...], ...], tuple[tuple[float, ...], ...]]:
    """Boxes and circles."""
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
    """Postures evenly over the joints' ranges, and which of them have the tip in the workspace."""

    def __init__(self, machine: Machine) -> None:
        m = self._m = machine.arrays
        axes = [np.arange(*ends, STEP) for ends in zip(m.joint_min, m.joint_max, strict=True)]
        postures = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        self._shape = postures.shape[:-1]
        self._postures = frozen(postures.reshape(-1, len(axes)))
        tip = machine.tip_positions(self._postures)
        radius = np.hypot(*tip.T)
        self._inside = (tip[:, 0] >= m.min_x) & (radius >= m.min_radius)
        self._inside &= radius <= m.max_radius

    def has_way(self, scene: Scene) -> bool:
        """Whether start and goal lie in one region of clear postures."""
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
        at = np.rint((posture - self._m.joint_min) / STEP).astype(int)
        return tuple(np.clip(at, 0, np.array(self._shape) - 1).tolist())
