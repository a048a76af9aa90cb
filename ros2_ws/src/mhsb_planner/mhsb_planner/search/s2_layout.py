"""Numbering of the graph's postures, states and moves; it depends on the posture table alone."""

from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.posture.grid import Grid
from mhsb_planner.posture.s1_posture_table import PostureTable


class Layout(NamedTuple):
    """Numbers of the distinct postures, of the states that share them, and of all moves.

    State number: node · patterns + pattern. Moves are numbered in the order of the posture that
    they leave, then of the neighbouring node, then of the posture that they reach there.

    Attributes:
        posture: Distinct postures, node by node, shape (postures, n) [rad or m].
        node: Node of each posture, shape (postures,).
        first_posture: First posture of each node, shape (nodes + 1,).
        posture_of_state: Posture of each state, shape (nodes, patterns); -1 if the node is
            infeasible.
        neighbors: Neighbours of each node, shape (nodes, 8); -1 if there is none.
        move: Number of the first move that leaves each posture, shape (postures + 1,).
    """

    posture: FloatArray
    node: IntArray
    first_posture: IntArray
    posture_of_state: IntArray
    neighbors: IntArray
    move: IntArray


@kernel
def _number_postures(table: FloatArray, owner: IntArray, first_of: IntArray) -> int:
    """Find the distinct postures of a posture table, and number them.

    A state is a node with a mode combination. Equal postures of one node get one number. The
    numbers ascend by node, then by the first combination that has the posture.

    Args:
        table: Joint positions, shape (nodes, patterns, n) [rad or m]; NaN if infeasible.
        owner: Posture number of each state, shape (nodes, patterns); -1 if infeasible. Written in
            place.
        first_of: First state that has each posture, as node · patterns + pattern. Written in place;
            the array has room for nodes · patterns entries.

    Returns:
        Number of distinct postures. The first entries of `first_of`, this many, are valid.
    """
    nodes, patterns, n = table.shape
    count = 0
    for node in range(nodes):
        for p in range(patterns):
            owner[node, p] = -1
            if np.isnan(table[node, p, 0]):
                continue
            for earlier in range(p):
                same = True
                for j in range(n):
                    same = same and table[node, p, j] == table[node, earlier, j]
                if same:
                    owner[node, p] = owner[node, earlier]
                    break
            if owner[node, p] < 0:
                owner[node, p] = count
                first_of[count] = node * patterns + p
                count += 1
    return count


def create_layout(table: PostureTable, grid: Grid) -> Layout:
    """Create the numbering of all postures, states and moves of a posture table.

    A state is a node with a mode combination. Equal postures of one node become one posture. A move
    leads from a posture to a posture of a neighbouring node.

    Args:
        table: Posture table: a posture for each node and mode combination.
        grid: Grid of the table's nodes, for their neighbours.

    Returns:
        Layout with read-only arrays.
    """
    nodes, patterns, n = table.posture.shape
    owner = np.empty((nodes, patterns), dtype=np.int64)
    first_of = np.empty(nodes * patterns, dtype=np.int64)
    count = _number_postures(table.posture, owner, first_of)
    first_of = first_of[:count].copy()
    node = first_of // patterns
    per_node = np.bincount(node, minlength=nodes)
    reached = np.where(grid.neighbors >= 0, per_node[grid.neighbors], 0).sum(axis=1)
    return Layout(
        posture=frozen(table.posture.reshape(-1, n)[first_of]),
        node=frozen(node),
        first_posture=frozen(np.concatenate([[0], np.cumsum(per_node)])),
        posture_of_state=frozen(owner),
        neighbors=grid.neighbors,
        move=frozen(np.concatenate([[0], np.cumsum(reached[node])])),
    )
