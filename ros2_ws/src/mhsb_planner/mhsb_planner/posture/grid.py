"""Grid of tip positions: its nodes, their neighbours and the cells between them.

Nodes are integer pairs (i, k) in units of the spacing, so rounding can neither lose nor duplicate a
node. For the paper's machine at 5 cm, these are the 642 pairs with i ≥ 0 and 25 ≤ i² + k² ≤ 423.
"""

import math

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import IntArray, frozen
from mhsb_planner.errors import RequestError

NEIGHBOUR_OFFSETS = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
"""Offsets (Δi, Δk) from a node to its eight neighbours."""
ON_LINE = 1e-6
"""Largest distance of a coordinate from a grid line at which it counts as on the line, in units of
the spacing.
"""


def list_grid_nodes(machine: Machine, spacing: float) -> IntArray:
    """List the grid points that lie in the machine's workspace.

    A node (i, k) lies at x = i · spacing, z = k · spacing, with

        x ≥ min_x,  min_radius ≤ spacing √(i² + k²) ≤ max_radius

    Args:
        machine: Machine whose workspace is used.
        spacing: Grid spacing [m].

    Returns:
        Integer coordinates (i, k) in lexicographic order, int64, shape (nodes, 2).

    Raises:
        RequestError: The spacing is not above 0 or exceeds max_radius.
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
    """Look-up of nodes and their neighbours by integer coordinates.

    Attributes:
        nodes: Integer coordinates (i, k) of the nodes, shape (nodes, 2).
        spacing: Grid spacing [m].
        neighbors: Indices of the neighbours of each node in the order of NEIGHBOUR_OFFSETS, int64,
            shape (nodes, 8); −1 if a neighbour does not exist.
    """

    def __init__(self, nodes: IntArray, spacing: float) -> None:
        """Create the look-up of nodes, and find the neighbours of each node (at most eight).

        Args:
            nodes: Integer coordinates (i, k), shape (nodes, 2).
            spacing: Grid spacing [m].
        """
        self.nodes = nodes
        self.spacing = spacing
        self._index = {(int(i), int(k)): number for number, (i, k) in enumerate(nodes)}
        self.neighbors = frozen(
            np.array(
                [
                    [self._index.get((i + di, k + dk), -1) for di, dk in NEIGHBOUR_OFFSETS]
                    for i, k in nodes
                ],
                dtype=np.int64,
            ).reshape(len(nodes), len(NEIGHBOUR_OFFSETS))
        )

    def node_at(self, x: float, z: float) -> int | None:
        """Return the index of the node at a tip position, if there is one.

        Args:
            x: Tip position forward [m].
            z: Tip position upward [m].

        Returns:
            Index of the node; None if there is no node. x and z may each differ from the node's
            position by ON_LINE times the spacing.
        """
        i, k = round(x / self.spacing), round(z / self.spacing)
        if abs(x / self.spacing - i) > ON_LINE or abs(z / self.spacing - k) > ON_LINE:
            return None
        return self._index.get((i, k))

    def cell_corners(self, x: float, z: float, rings: int = 0) -> IntArray:
        """Return the nodes at the corners of the grid cell in which a tip position lies.

        A position on a grid line belongs to the cells on both sides. A position on a node belongs
        to all four cells around it, and the node itself is not in the result.

        Args:
            x: Tip position forward [m].
            z: Tip position upward [m].
            rings: Number of further rings of nodes to include; 0 means the corners alone.

        Returns:
            Indices of the nodes, int64. Corners outside the workspace are not nodes and are left
            out.
        """
        here = self.node_at(x, z)
        rows, columns = self._bounding_lines(z, rings), self._bounding_lines(x, rings)
        found = [self._index.get((i, k), here) for i in columns for k in rows]
        return np.array([node for node in found if node != here], dtype=np.int64)

    def share_cell(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        """Return whether two tip positions lie in the same grid cell, its edges included.

        Args:
            a: Position (x, z) [m].
            b: Position (x, z) [m].

        Returns:
            True if there is a cell that contains both.
        """
        for p, q in zip(a, b, strict=True):
            one, other = self._bounding_lines(p), self._bounding_lines(q)
            if min(one.stop, other.stop) - max(one.start, other.start) < 2:
                return False
        return True

    def _bounding_lines(self, coordinate: float, rings: int = 0) -> range:
        """Return the grid lines of one axis between which a coordinate lies.

        For a coordinate on a line, this line and the next line on each side are returned.

        Args:
            coordinate: x or z [m].
            rings: Number of further lines on each side.

        Returns:
            Integer coordinates of the lines in ascending order, in units of the spacing.
        """
        value = coordinate / self.spacing
        if abs(value - round(value)) <= ON_LINE:
            return range(round(value) - 1 - rings, round(value) + 2 + rings)
        return range(math.floor(value) - rings, math.floor(value) + 2 + rings)
