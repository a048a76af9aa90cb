"""The explicit graph of the search: every step between neighbouring nodes, with its cost.

A state is a node and the pattern in which it was reached; its posture is the table's. Of the
patterns of a node many share a posture, and a step depends on where it starts only through the
posture, so steps are stored once per distinct posture. Weights and the choice of the energy
reading enter in the search and leave the graph as it is; for another payload, supply pressure,
V_max or zones, with the table kept, steps are priced anew where a search comes by.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import clearances
from mhsb_model.types import FloatArray, IntArray, ModeArray, frozen
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.posture.grid import Grid
from mhsb_planner.posture.s1_global_search import postures_at
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.s2_layout import Layout, layout_of
from mhsb_planner.search.s2_pricing import (
    Edges,
    Loads,
    PricedSteps,
    Terms,
    middle_loads,
    posture_loads,
)
from mhsb_planner.search.s2_step import Postures, circuit_of, describe

PostureRule = Callable[[Machine, float, float, Deadline], FloatArray]
"""Posture for each pattern at a tip position (x, z) m, float64[patterns, n] [rad]; raises
InfeasibleGoalError where there is none, DeadlineError where there is not the time."""


def largest_polytope(machine: Machine, x: float, z: float, deadline: Deadline) -> FloatArray:
    """The rule of the posture table."""
    return postures_at(machine, x, z, deadline).posture


class StepGraph:
    """All steps of a machine on its posture table.

    The machine may differ from the table's in what `Machine.changed` changes.

    machine, table, grid
    layout    distinct postures and the states that share them
    postures  these postures with cylinder lengths and forces
    steps     the steps: priced at once, with `like` only where they are asked for
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
        grid: Grid | None = None,
        deadline: Deadline = NEVER,
    ) -> None:
        """Graph of a machine; `like`, a graph on the same table, saves what they share.

        grid: of the table's nodes, where it is known. Raises DeadlineError.
        """
        self.machine = machine
        self.table = table
        self.jobs = jobs
        self.resolve: PostureRule = like.resolve if like else resolve
        self.grid: Grid = like.grid if like else grid or Grid(table.nodes, table.spacing)
        self.layout: Layout = like.layout if like else layout_of(table, self.grid)
        self.switches: IntArray = like.switches if like else self._switches()
        arrays = machine.arrays
        self._loads: Loads = like._loads if like else posture_loads(arrays, self.layout)
        deadline.check("the graph of all steps")
        self._middle: Loads = (
            like._middle if like else middle_loads(arrays, self.layout, jobs, deadline)
        )
        self.circuit = circuit_of(arrays, table.patterns)
        self.postures: Postures = like.postures if like else describe(arrays, self.layout.posture)
        force = self._loads.bare + arrays.payload * self._loads.for_each_kg
        self.postures = self.postures._replace(force=frozen(force))
        obstacles = machine.obstacles.path_rows
        terms = Terms(
            self.circuit,
            table.patterns,
            self.layout,
            self.postures,
            self._middle,
            arrays,
            obstacles,
            frozen(self._clearance(obstacles)),
        )
        room = len(like.steps.edges.state) if like else 0
        self.steps: PricedSteps = PricedSteps(terms, jobs, room)
        if like is None:
            self.steps.price_all(deadline)

    @property
    def edges(self) -> Edges:
        """All steps, read-only."""
        self.steps.price_all()
        edges = self.steps.edges
        used = slice(int(edges.used[0]))
        views = edges._replace(
            first=edges.first[:],
            last=edges.last[:],
            used=edges.used[:],
            state=edges.state[used],
            pattern=edges.pattern[used],
            cost=edges.cost[used],
        )
        for view in views:
            view.setflags(write=False)
        return views

    def switches_from(self, modes: ModeArray) -> IntArray:
        """How many actuators change their mode from `modes` to each pattern, int64[patterns]."""
        return (self.table.patterns != modes).sum(axis=1)

    def changed(self, machine: Machine) -> StepGraph:
        """The graph for another payload, supply pressure, V_max or zones, on the same table."""
        return StepGraph(machine, self.table, self.jobs, like=self)

    def _clearance(self, obstacles: FloatArray) -> FloatArray:
        if len(obstacles) == 0:
            return np.empty(0)
        return clearances(self.machine.arrays, obstacles, self.layout.posture)[0]

    def _switches(self) -> IntArray:
        rows = [self.switches_from(pattern) for pattern in self.table.patterns]
        return frozen(np.array(rows))
