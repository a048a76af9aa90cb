"""Which postures and states the graph has, and which moves between them: of the table alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.posture.grid import Grid
from mhsb_planner.posture.s1_posture_table import PostureTable


class Layout(NamedTuple):
    """Distinct postures, the states that share them, and the moves between neighbours."""

    posture: FloatArray  # [postures, n] distinct ones, node by node [rad]
    node: IntArray  # [postures] node that a posture belongs to
    first: IntArray  # [nodes + 1] first posture of a node
    owner: IntArray  # [nodes, patterns] posture of a state; −1 where the node is infeasible
    neighbors: IntArray  # [nodes, 8] −1 where there is none
    move: IntArray  # [postures + 1] first move of a posture; moves run over neighbours' postures


@kernel
def _number_postures(table: FloatArray, owner: IntArray, first_of: IntArray) -> int:
    """Number the distinct postures of table[nodes, patterns, n] node by node.

    Written: owner[nodes, patterns]; first_of[postures] = node · patterns + first pattern.
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


def layout_of(table: PostureTable, grid: Grid) -> Layout:
    """Layout of a table; equal postures of a node become one."""
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
        first=frozen(np.concatenate([[0], np.cumsum(per_node)])),
        owner=frozen(owner),
        neighbors=grid.neighbors,
        move=frozen(np.concatenate([[0], np.cumsum(reached[node])])),
    )
