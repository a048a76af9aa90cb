"""The explicit graph of the search: every step between neighbouring nodes, with its cost.

A state is a node and the mode combination in which it was reached; the table gives its posture.
Many combinations of a node share a posture. The steps that leave a state depend only on its
posture, so they are stored once for each distinct posture. The graph does not depend on cost
weights and energy reading; the search applies them. For another payload, supply pressure, V_max or
set of zones the table is kept. Each step is then priced again when a search needs it.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import clearances
from mhsb_model.types import FloatArray, IntArray, ModeArray, frozen
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.posture.grid import Grid
from mhsb_planner.posture.s1_global_search import find_postures_at
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.s2_edge_costs import (
    Edges,
    PricedSteps,
    StepCostModel,
    compute_move_forces,
    compute_posture_forces,
)
from mhsb_planner.search.s2_layout import create_layout
from mhsb_planner.search.s2_step import Postures, compute_hydraulic_coefficients, describe_postures

PostureRule = Callable[[Machine, float, float, Deadline], FloatArray]
"""Function (machine, x, z, deadline) that returns the posture for each combination at a tip
position.

x and z in m; the result has the shape (patterns, n) [rad or m]. It raises InfeasibleGoalError if
there is no posture, and DeadlineError after the deadline.
"""


def find_largest_polytope_postures(
    machine: Machine, x: float, z: float, deadline: Deadline
) -> FloatArray:
    """Compute the posture with the fastest tip for each mode combination at a tip position.

    It is the posture with the largest area of the velocity polytope (all velocities of the tip
    within the pistons' limits). The posture table is built by the same rule.

    Args:
        machine: Machine whose postures are wanted.
        x: Tip position forward [m].
        z: Tip position upward [m].
        deadline: Instant at which the work is given up.

    Returns:
        Joint positions, shape (patterns, n) [rad or m]; one mode combination per row.

    Raises:
        InfeasibleGoalError: No posture within joint limits reaches the point.
        DeadlineError: The deadline passed.
    """
    return find_postures_at(machine, x, z, deadline).posture


class StepGraph:
    """All steps between neighbouring nodes of a machine's posture table.

    The machine may differ from the table's machine in the quantities that `Machine.changed`
    changes: payload, supply pressure, V_max, zones and number of booster modules. The graph has the
    mode combinations of the table. If the machine has fewer modules, the table must be reduced to
    the combinations that they allow (`PostureTable.with_patterns`).

    Attributes:
        machine: Machine that moves.
        table: Posture table.
        jobs: Number of threads for pricing steps; None means one per processor.
        posture_rule: Rule by which the table's postures were chosen; it also gives postures between
            the nodes.
        grid: Grid of the table's nodes.
        layout: Distinct postures and the states that share them.
        switches: Number of actuators that change between two combinations, shape (patterns,
            patterns).
        circuit: Hydraulic coefficients of the machine.
        postures: The layout's postures, with cylinder lengths, and with forces under the machine's
            payload.
        steps: Store of the steps and their costs; steps may be unpriced.
    """

    def __init__(
        self,
        machine: Machine,
        table: PostureTable,
        jobs: int | None = None,
        posture_rule: PostureRule = find_largest_polytope_postures,
        grid: Grid | None = None,
        deadline: Deadline = NO_DEADLINE,
    ) -> None:
        """Build the graph and price all steps.

        Pricing a step means computing its duration and energies.

        Args:
            machine: Machine that moves.
            table: Posture table of this machine, or of a machine that differs only in payload,
                supply pressure, V_max, zones and number of booster modules.
            jobs: Number of threads; None means one per processor.
            posture_rule: Rule by which the table's postures were chosen; it also gives postures
                between the nodes.
            grid: Grid of the table's nodes if it exists already; None builds it.
            deadline: Instant at which the work is given up.

        Raises:
            DeadlineError: The deadline passed.
        """
        self.table = table
        self.jobs = jobs
        self.posture_rule = posture_rule
        self.grid: Grid = grid or Grid(table.nodes, table.spacing)
        self.layout = create_layout(table, self.grid)
        self.switches: IntArray = self._count_switches()
        self._loads = compute_posture_forces(machine.arrays, self.layout)
        deadline.check("the graph of all steps")
        self._middle = compute_move_forces(machine.arrays, self.layout, jobs, deadline)
        self.postures: Postures = describe_postures(machine.arrays, self.layout.posture)
        self._set_machine(machine, 0)
        self.steps.price_all(deadline)

    def _set_machine(self, machine: Machine, room: int) -> None:
        """Set the machine, and update all data that depend on it.

        Args:
            machine: Machine that moves.
            room: Number of steps for which memory is reserved. No step is priced.
        """
        arrays, obstacles = machine.arrays, machine.obstacles.path_rows
        self.machine = machine
        self.circuit = compute_hydraulic_coefficients(arrays, self.table.patterns)
        force = self._loads.bare + arrays.payload * self._loads.for_each_kg
        self.postures = self.postures._replace(force=frozen(force))
        terms = StepCostModel(
            self.circuit,
            self.table.patterns,
            self.layout,
            self.postures,
            self._middle,
            arrays,
            obstacles,
            frozen(self._clearance(obstacles)),
        )
        self.steps = PricedSteps(terms, self.jobs, room)

    @property
    def edges(self) -> Edges:
        """All steps with their costs, as read-only views.

        Each access first prices the steps that are not priced yet.
        """
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

    def count_switches_from(self, modes: ModeArray) -> IntArray:
        """Count the actuators that change their mode from given modes to each combination.

        Args:
            modes: Mode codes, shape (n,).

        Returns:
            Number of actuators, shape (patterns,).
        """
        return (self.table.patterns != modes).sum(axis=1)

    def create_for(self, machine: Machine) -> StepGraph:
        """Create the graph of a changed machine on the same posture table, without pricing steps.

        Args:
            machine: Machine with another payload, supply pressure, V_max or other zones.

        Returns:
            New graph; it shares all unchanged data with this graph. Its steps are priced when
            needed.
        """
        changed = copy(self)
        changed._set_machine(machine, len(self.steps.edges.state))
        return changed

    def _clearance(self, obstacles: FloatArray) -> FloatArray:
        """Compute the clearance of each posture of the graph from the nearest obstacle.

        Args:
            obstacles: Rows of the obstacles with the margin added, `Obstacles.path_rows`.

        Returns:
            Clearance beyond the margin, shape (postures,) [m]; negative if the arm is too near.
            Empty if there are no obstacles.
        """
        if len(obstacles) == 0:
            return np.empty(0)
        return clearances(self.machine.arrays, obstacles, self.layout.posture)[0]

    def _count_switches(self) -> IntArray:
        """Count the actuators that change their mode, for each pair of mode combinations.

        Returns:
            Number of actuators, shape (patterns, patterns), read-only.
        """
        rows = [self.count_switches_from(pattern) for pattern in self.table.patterns]
        return frozen(np.array(rows))
