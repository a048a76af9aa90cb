"""The explicit graph of the search: every step between neighbouring nodes, with its cost.

A state is a node and the pattern in which it was reached; its posture is the table's. Of the
patterns of a node many share a posture, and a step depends on where it starts only through the
posture, so steps are stored once per distinct posture. Weights and the choice of the energy
reading enter in the search and leave the graph as it is; another payload, supply pressure or
V_max needs new costs, a matter of milliseconds, with the table kept.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numba import njit

from mhsb_model.arrays import MachineArrays
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, IntArray, ModeArray, frozen
from mhsb_planner.grid import Grid
from mhsb_planner.s1_global_search import postures_at
from mhsb_planner.s1_posture_table import PostureTable
from mhsb_planner.s2_step import (
    INADMISSIBLE,
    Circuit,
    Postures,
    circuit_of,
    describe,
    middle_forces,
    new_scratch,
    steps_to_node,
)
from mhsb_planner.threads import Result, over_ranges

POSTURES_PER_TASK = 128

PostureRule = Callable[[Machine, float, float], FloatArray]
"""Posture for each pattern at a tip position (x, z) m, float64[patterns, n] [rad]; raises
InfeasibleGoalError where there is none."""


def largest_polytope(machine: Machine, x: float, z: float) -> FloatArray:
    """The rule of the posture table."""
    return postures_at(machine, x, z).posture


class Layout(NamedTuple):
    """Which postures and states there are, and which moves between them: of the table alone."""

    posture: FloatArray  # [postures, n] distinct ones, node by node [rad]
    node: IntArray  # [postures] node that a posture belongs to
    first: IntArray  # [nodes + 1] first posture of a node
    owner: IntArray  # [nodes, patterns] posture of a state; −1 where the node is infeasible
    neighbors: IntArray  # [nodes, 8] −1 where there is none
    move: IntArray  # [postures + 1] first move of a posture; moves run over neighbours' postures


class Edges(NamedTuple):
    """All admissible steps, those that leave posture i from first[i] to first[i + 1]."""

    first: IntArray  # [postures + 1]
    state: IntArray  # [edges] state that is reached: node · patterns + pattern
    pattern: IntArray  # [edges]
    cost: FloatArray  # [edges, 3] T [s], E paper [J], E series [J]


@njit(cache=True, nogil=True)
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


def _layout(table: PostureTable, grid: Grid) -> Layout:
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


@njit(cache=True, nogil=True)
def _middle_forces(
    m: MachineArrays, layout: Layout, force: FloatArray, begin: int, end: int
) -> None:
    """Cylinder forces half-way along the moves from postures begin … end, to force[moves, n]."""
    for i in range(begin, end):
        row = layout.move[i]
        for node in layout.neighbors[layout.node[i]]:
            if node >= 0:
                first = layout.first[node]
                count = layout.first[node + 1] - first
                middle_forces(m, layout.posture[i], layout.posture, first, force[row : row + count])
                row += count


@njit(cache=True, nogil=True)
def _steps_from(
    c: Circuit,
    patterns: ModeArray,
    layout: Layout,
    postures: Postures,
    middle: FloatArray,
    leaving: IntArray,
    begin: int,
    end: int,
) -> tuple[IntArray, FloatArray]:
    """Steps that leave the postures begin … end: reached states and costs.

    Their number for each posture is written to leaving[postures].
    """
    scratch = new_scratch(patterns)
    capacity = (end - begin) * layout.neighbors.shape[1] * len(patterns)
    state = np.empty(capacity, dtype=np.int64)
    cost = np.empty((capacity, 3))
    found = 0
    for i in range(begin, end):
        before = found
        row = layout.move[i]
        for node in layout.neighbors[layout.node[i]]:
            if node < 0:
                continue
            first = layout.first[node]
            count = layout.first[node + 1] - first
            if count == 0:
                continue
            status = steps_to_node(
                c,
                patterns,
                postures,
                i,
                postures,
                first,
                count,
                layout.owner[node],
                middle[row : row + count],
                scratch,
            )
            row += count
            if status == INADMISSIBLE:
                continue
            for p in range(len(patterns)):
                if scratch.status[p] == status:
                    state[found] = node * len(patterns) + p
                    cost[found] = scratch.cost[p]
                    found += 1
        leaving[i] = found - before
    return state[:found].copy(), cost[:found].copy()


class StepGraph:
    """All steps of a machine on its posture table; nothing in it changes once it is made.

    The machine may differ from the table's in what `Machine.changed` changes.

    machine, table, grid
    layout    distinct postures and the states that share them
    postures  these postures with cylinder lengths and forces
    edges     the steps
    switches  int64[patterns, patterns], actuators that change their mode between two patterns
    resolve   the rule by which the table's postures were chosen, for points off the grid
    """

    def __init__(
        self,
        machine: Machine,
        table: PostureTable,
        jobs: int | None = None,
        like: StepGraph | None = None,
        resolve: PostureRule = largest_polytope,
    ) -> None:
        """Graph of a machine; `like`, a graph on the same table, saves what they share."""
        self.machine = machine
        self.table = table
        self.jobs = jobs
        self.resolve: PostureRule = like.resolve if like else resolve
        self.grid: Grid = like.grid if like else Grid(table.nodes, table.spacing)
        self.layout: Layout = like.layout if like else _layout(table, self.grid)
        self._loads: tuple[FloatArray, FloatArray] = like._loads if like else self._middle_loads()
        self.switches: IntArray = like.switches if like else self._switches()
        self.circuit = circuit_of(machine.arrays, table.patterns)
        self.postures = describe(machine.arrays, self.layout.posture)
        self.edges = self._edges()

    def switches_from(self, modes: ModeArray) -> IntArray:
        """How many actuators change their mode from `modes` to each pattern, int64[patterns]."""
        return np.count_nonzero(self.table.patterns != modes, axis=1)

    def changed(self, machine: Machine) -> StepGraph:
        """The graph for another payload, supply pressure or V_max, on the same table."""
        return StepGraph(machine, self.table, self.jobs, like=self)

    def _switches(self) -> IntArray:
        rows = [self.switches_from(pattern) for pattern in self.table.patterns]
        return frozen(np.array(rows))

    def _middle_loads(self) -> tuple[FloatArray, FloatArray]:
        """Forces at the middle of all moves, of the bare arm and for each kg of payload."""
        layout = self.layout
        bare, loaded = (np.empty((layout.move[-1], layout.posture.shape[1])) for _ in range(2))
        for payload, force in ((0.0, bare), (1.0, loaded)):
            arrays = self.machine.arrays._replace(payload=payload)
            self._in_parallel(partial(_middle_forces, arrays, layout, force))
        return bare, loaded - bare

    def _edges(self) -> Edges:
        bare, for_each_kg = self._loads
        middle = bare + self.machine.arrays.payload * for_each_kg
        leaving = np.empty(len(self.layout.posture), dtype=np.int64)
        patterns, layout = self.table.patterns, self.layout
        parts = self._in_parallel(
            partial(_steps_from, self.circuit, patterns, layout, self.postures, middle, leaving)
        )
        state = np.concatenate([np.empty(0, dtype=np.int64), *(state for state, _ in parts)])
        return Edges(
            first=frozen(np.concatenate([[0], np.cumsum(leaving)])),
            state=frozen(state),
            pattern=frozen(state % len(patterns)),
            cost=frozen(np.concatenate([np.empty((0, 3)), *(cost for _, cost in parts)])),
        )

    def _in_parallel(self, work: Callable[[int, int], Result]) -> list[Result]:
        """Results of work(begin, end) over ranges of all postures, in order."""
        return list(over_ranges(work, len(self.layout.posture), POSTURES_PER_TASK, self.jobs))
