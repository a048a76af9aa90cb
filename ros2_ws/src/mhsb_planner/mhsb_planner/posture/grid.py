"""The grid of tip positions: its nodes, their neighbours and the cells between them.

Nodes are integers in units of the spacing, so that none is lost or doubled by rounding: for the
paper's machine at 5 cm those with i ≥ 0 and 25 ≤ i² + k² ≤ 423, 642 of them.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import IntArray, frozen
from mhsb_planner.errors import RequestError

MOVES = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
ON_LINE = 1e-6
"""A coordinate this close to a grid line, in units of the spacing, lies on it."""


def grid_nodes(machine: Machine, spacing: float) -> IntArray:
    """Nodes (i, k) of the machine's workspace in lexicographic order, int64[nodes, 2].

    x = i·spacing ≥ min_x, min_radius ≤ spacing √(i² + k²) ≤ max_radius; spacing in m.
    Raises RequestError where the spacing leaves no node.
    """
    area = machine.config.workspace
    if not (math.isfinite(spacing) and 0.0 < spacing <= area.max_radius):
        raise RequestError("spacing", spacing, f"must be above 0 and at most {area.max_radius:g} m")
    extent = int(area.max_radius / spacing) + 1
    axis = np.arange(-extent, extent + 1, dtype=np.int64)
    i, k = (values.ravel() for values in np.meshgrid(axis, axis, indexing="ij"))
    radius = spacing * np.hypot(i, k)
    rounding = 1e-9
    inside = (
        (i * spacing >= area.min_x - rounding)
        & (radius >= area.min_radius - rounding)
        & (radius <= area.max_radius + rounding)
    )
    return np.column_stack([i[inside], k[inside]])


class Grid:
    """Look-up of nodes by their integer coordinates.

    neighbors  int64[nodes, 8], index of the node one move away (`MOVES`), −1 where there is none
    """

    def __init__(self, nodes: IntArray, spacing: float) -> None:
        self.nodes = nodes
        self.spacing = spacing
        self._index = {(int(i), int(k)): number for number, (i, k) in enumerate(nodes)}
        self.neighbors = frozen(
            np.array(
                [[self._index.get((i + di, k + dk), -1) for di, dk in MOVES] for i, k in nodes],
                dtype=np.int64,
            ).reshape(len(nodes), len(MOVES))
        )

    def node_at(self, x: float, z: float) -> int | None:
        """Index of the node at (x, z) m, None where there is none."""
        i, k = round(x / self.spacing), round(z / self.spacing)
        if abs(x / self.spacing - i) > ON_LINE or abs(z / self.spacing - k) > ON_LINE:
            return None
        return self._index.get((i, k))

    def around(self, x: float, z: float, rings: int = 0) -> IntArray:
        """Nodes that a point (x, z) m off the grid is joined to: the corners of its cell.

        A point on a grid line lies in the cells on both sides and is joined to the corners of
        all; one on a node thereby to that node's eight neighbours. The node itself is left out.
        `rings` adds that many rings of nodes around these.
        """
        here = self.node_at(x, z)
        rows, columns = self._lines(z, rings), self._lines(x, rings)
        found = [self._index.get((i, k), here) for i in columns for k in rows]
        return np.array([node for node in found if node != here], dtype=np.int64)

    def share_cell(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        """Whether two points (x, z) m lie in one closed cell."""
        for p, q in zip(a, b, strict=True):
            one, other = self._lines(p), self._lines(q)
            if min(one.stop, other.stop) - max(one.start, other.start) < 2:
                return False
        return True

    def _lines(self, coordinate: float, rings: int = 0) -> range:
        """Grid lines that bound the cells in which a coordinate lies, and so many beyond."""
        value = coordinate / self.spacing
        if abs(value - round(value)) <= ON_LINE:
            return range(round(value) - 1 - rings, round(value) + 2 + rings)
        return range(math.floor(value) - rings, math.floor(value) + 2 + rings)
