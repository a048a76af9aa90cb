"""Pricing of the graph's steps: all at once, or posture by posture when a search needs them.

"Pricing" a step means computing its duration and energies. States with the same posture share the
stored steps that leave it. A search expands only a small share of all postures. After a change of
the machine, only the steps that leave the expanded postures need to be priced.
"""

import math
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, closing, nullcontext
from functools import partial
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import moment_arm
from mhsb_model.obstacles.clearance import bound_travel, move_is_clear
from mhsb_model.statics import gravity_torque
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_model.workspace import move_stays_in_workspace
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.executor import Result, yield_results_of_ranges
from mhsb_planner.search.s2_layout import Layout
from mhsb_planner.search.s2_step import (
    STEP_INADMISSIBLE,
    HydraulicCoefficients,
    NodeMoves,
    Postures,
    StepBuffers,
    create_step_buffers,
    describe_postures,
    price_steps_to_node,
)

POSTURES_PER_TASK = 128
"""Number of postures in one task of a thread."""

NOT_PRICED = -1
"""Value of `Edges.first` for a posture whose steps are not priced yet."""


class Edges(NamedTuple):
    """Admissible steps of the graph; posture i is left by steps first[i] to last[i] - 1.

    Attributes:
        first: First step of each posture, shape (postures,); NOT_PRICED if its steps are not
            priced.
        last: Last step of each posture plus 1, shape (postures,).
        used: Number of steps stored, shape (1,). Further rows of the lists are undefined.
        state: State that each step reaches, node · patterns + pattern, shape (room,).
        pattern: Index of the mode combination of each step, shape (room,).
        cost: Cost of each step, shape (room, 3): duration [s], energy by the published model
            (`paper`) [J], energy with the pumps in series (`series`) [J].
    """

    first: IntArray
    last: IntArray
    used: IntArray
    state: IntArray
    pattern: IntArray
    cost: FloatArray


class CylinderForces(NamedTuple):
    """Cylinder forces under gravity as a linear function of the payload.

    The force is bare + payload · for_each_kg.

    Attributes:
        bare: Forces of the arm without payload, shape (postures or moves, n) [N].
        for_each_kg: Additional force per kilogram of payload, shape (postures or moves, n) [N/kg].
    """

    bare: FloatArray
    for_each_kg: FloatArray


class StepCostModel(NamedTuple):
    """Data from which the costs of all steps of a graph are computed.

    Attributes:
        circuit: Hydraulic coefficients of the machine.
        patterns: Mode combinations, shape (patterns, n).
        layout: Numbering of postures, states and moves.
        postures: Postures with their cylinder lengths and forces.
        middle: Cylinder forces at the middle of each move; NaN if the tip leaves the workspace on
            the way.
        machine: Arrays of the machine.
        obstacles: Rows of the obstacles with the margin added, `Obstacles.path_rows`.
        clearance: Clearance of each posture from the nearest obstacle, shape (postures,) [m]. Empty
            if there are no obstacles.
    """

    circuit: HydraulicCoefficients
    patterns: ModeArray
    layout: Layout
    postures: Postures
    middle: CylinderForces
    machine: MachineArrays
    obstacles: FloatArray
    clearance: FloatArray


@kernel(borrows=True)
def price_steps(
    cost_model: StepCostModel,
    i: int,
    buffers: StepBuffers,
    state: IntArray,
    pattern: IntArray,
    cost: FloatArray,
    found: int,
) -> int:
    """Price the steps that leave one posture, and append the admissible ones to three lists.

    Steps lead to all neighbouring workspace nodes in all mode combinations. A step is inadmissible
    if the tip leaves the workspace or the arm comes too near to an obstacle. It is also
    inadmissible if a joint that needs boost is not boosted. Boost of a joint that does not need it
    is admissible only if the neighbour has no combination without such boost.

    Tested against steps computed one by one in plain NumPy.

    Args:
        cost_model: Postures, forces, obstacles and hydraulic numbers of the graph.
        i: Number of the posture that the steps leave.
        buffers: Working memory, overwritten.
        state: Number of the state that each step reaches, node · patterns + pattern. Written in
            place from index `found` on.
        pattern: Index of the mode combination of each step. Written in place from index `found` on.
        cost: Duration [s], energy by the published model (`paper`) [J] and energy with the pumps in
            series (`series`) [J] of each step, shape (room, 3). Written in place from index `found`
            on. All three lists need room for `compute_max_step_count` more steps.
        found: Number of steps in the lists before the call.

    Returns:
        Number of steps in the lists after the call.
    """
    layout, patterns = cost_model.layout, cost_model.patterns
    bare, for_each_kg = cost_model.middle
    middle, payload, crowded = (
        buffers.middle,
        cost_model.machine.payload,
        len(cost_model.obstacles) > 0,
    )
    row = layout.move[i]
    for node in layout.neighbors[layout.node[i]]:
        first = layout.first_posture[node] if node >= 0 else 0
        count = layout.first_posture[node + 1] - first if node >= 0 else 0
        if count == 0:
            continue
        for k in range(count):
            for j in range(patterns.shape[1]):
                middle[k, j] = bare[row + k, j] + payload * for_each_kg[row + k, j]
        if crowded:
            _mark_collisions(cost_model, i, first, count, middle)
        row += count
        owner, postures = layout.posture_of_state[node], cost_model.postures
        moves = NodeMoves(postures, i, postures, first, count, owner, middle)
        status = price_steps_to_node(cost_model.circuit, patterns, moves, buffers)
        if status == STEP_INADMISSIBLE:
            continue
        for p in range(len(patterns)):
            if buffers.status[p] == status:
                state[found] = node * len(patterns) + p
                pattern[found] = p
                for k in range(cost.shape[1]):
                    cost[found, k] = buffers.cost[p, k]
                found += 1
    return found


@kernel(inline="always")
def _mark_collisions(t: StepCostModel, i: int, first: int, count: int, middle: FloatArray) -> None:
    """Mark the moves to a node's postures that bring the arm too near to an obstacle.

    A move between two clear postures is clear if the sum of their clearances is at least the
    distance that the arm travels. A move from a clear posture to a posture too near to an obstacle
    is marked without a check. All other moves are checked along the way, unless they are marked
    already.

    Args:
        t: Postures, clearances and obstacles of the graph. Clearances are negative if a posture is
            too near.
        i: Number of the posture that the moves leave.
        first: Number of the first posture of the node that is reached.
        count: Number of postures of that node.
        middle: Forces at the middle of each move, shape (count or more, n) [N]. If the move to
            posture `first` + k is not clear, middle[k, 0] is set to NaN in place.
    """
    posture, here = t.layout.posture, t.clearance[i]
    for k in range(count):
        if math.isnan(middle[k, 0]):
            continue
        there = t.clearance[first + k]
        clear = False
        if min(here, there) >= 0.0:
            clear = here + there >= bound_travel(t.machine, posture[i], posture[first + k], False)
        possible = here < 0.0 or there >= 0.0
        if not clear and possible:
            clear = move_is_clear(t.machine, t.obstacles, posture[i], posture[first + k], False)
        if not clear:
            middle[k, 0] = math.nan


@kernel
def _price_range(
    t: StepCostModel, missing: IntArray, leaving: IntArray, begin: int, end: int
) -> tuple[IntArray, IntArray, FloatArray]:
    """Price the steps that leave a range of postures, and return them in new arrays.

    Args:
        t: Postures, forces, obstacles and hydraulic numbers of the graph.
        missing: Numbers of the postures whose steps are not priced yet.
        leaving: Number of steps that leave each posture of `missing`, in the same order. Entries
            `begin` to `end` - 1 are written in place.
        begin: First index into `missing` to work on.
        end: Last index into `missing`, plus 1.

    Returns:
        Three arrays of the admissible steps, sorted by posture in the order of `missing`:

        - State that is reached (node · patterns + pattern), shape (steps,).
        - Index of the mode combination, shape (steps,).
        - Cost, shape (steps, 3): duration [s], energy by the published model (`paper`) [J], energy
          with the pumps in series (`series`) [J].
    """
    scratch = create_step_buffers(t.patterns)
    room = (end - begin) * compute_max_step_count(t.layout, t.patterns)
    state = np.empty(room, dtype=np.int64)
    pattern = np.empty(room, dtype=np.int64)
    cost = np.empty((room, 3))
    found = 0
    for k in range(begin, end):
        before = found
        found = price_steps(t, missing[k], scratch, state, pattern, cost, found)
        leaving[k] = found - before
    return state[:found].copy(), pattern[:found].copy(), cost[:found].copy()


@kernel(borrows=True)
def compute_max_step_count(layout: Layout, patterns: ModeArray) -> int:
    """Return an upper bound on the number of steps that leave one posture.

    Args:
        layout: Layout whose nodes have at most 8 neighbours.
        patterns: Mode combinations, shape (patterns, n).

    Returns:
        Number of neighbours that a node can have, times number of mode combinations.
    """
    return layout.neighbors.shape[1] * len(patterns)


@kernel
def _compute_move_forces(
    empty: MachineArrays,
    one_kg: MachineArrays,
    layout: Layout,
    bare: FloatArray,
    for_each_kg: FloatArray,
    begin: int,
    end: int,
) -> None:
    """Compute the cylinder forces at the middle of the moves that leave a range of postures.

    A move leads straight in joint space from a posture to a posture of a neighbouring node. The
    rows of a move become NaN if the tip leaves the workspace on the way. Tested against
    `compute_middle_forces`.

    Args:
        empty: Arrays of the machine without payload.
        one_kg: Arrays of the machine with a payload of 1 kg.
        layout: Numbering of postures and moves.
        bare: Forces without payload, shape (moves, n) [N]. The rows of the computed moves are
            written in place.
        for_each_kg: Additional force per kilogram of payload, shape (moves, n) [N/kg]. The rows of
            the computed moves are written in place.
        begin: Number of the first posture in the range.
        end: Number of the last posture in the range, plus 1.
    """
    n = layout.posture.shape[1]
    middle = np.empty(n)
    for i in range(begin, end):
        start, move = layout.posture[i], layout.move[i]
        for node in layout.neighbors[layout.node[i]]:
            if node < 0:
                continue
            for k in range(layout.first_posture[node], layout.first_posture[node + 1]):
                last = layout.posture[k]
                if move_stays_in_workspace(empty, start, last):
                    for j in range(n):
                        middle[j] = 0.5 * (start[j] + last[j])
                    gravity_torque(empty, middle, bare[move])
                    gravity_torque(one_kg, middle, for_each_kg[move])
                    for j in range(n):
                        arm = moment_arm(empty.linkage[j], middle[j])
                        bare[move, j] /= arm
                        for_each_kg[move, j] = for_each_kg[move, j] / arm - bare[move, j]
                else:
                    bare[move] = for_each_kg[move] = math.nan
                move += 1


def compute_posture_forces(m: MachineArrays, layout: Layout) -> CylinderForces:
    """Compute the cylinder forces under gravity in all postures, as a function of the payload.

    Args:
        m: Arrays of the machine; its payload is ignored.
        layout: Numbering of the distinct postures of a posture table.

    Returns:
        Forces of the arm without payload [N], and additional forces per kilogram of payload [N/kg],
        each of shape (postures, n).
    """
    bare, loaded = (
        describe_postures(m._replace(payload=payload), layout.posture).force
        for payload in (0.0, 1.0)
    )
    return CylinderForces(bare, loaded - bare)


def compute_move_forces(
    m: MachineArrays, layout: Layout, jobs: int | None = None, deadline: Deadline = NO_DEADLINE
) -> CylinderForces:
    """Compute the cylinder forces at the middle of all moves, as a function of the payload.

    Args:
        m: Arrays of the machine; its payload is ignored.
        layout: Numbering of postures and moves. A move leads from a posture to a posture of a
            neighbouring node.
        jobs: Number of threads; None means one per processor.
        deadline: Instant at which the work is given up.

    Returns:
        Forces of the arm without payload [N], and additional forces per kilogram of payload [N/kg],
        each of shape (moves, n), in the order of the move numbers. Rows of moves on which the tip
        leaves the workspace are NaN.

    Raises:
        DeadlineError: The deadline passed.
    """
    empty, one_kg = (m._replace(payload=payload) for payload in (0.0, 1.0))
    bare, for_each_kg = (np.empty((layout.move[-1], layout.posture.shape[1])) for _ in range(2))
    work = partial(_compute_move_forces, empty, one_kg, layout, bare, for_each_kg)
    _run_in_parallel(work, len(layout.posture), jobs, deadline)
    return CylinderForces(bare, for_each_kg)


class PricedSteps:
    """Store of a graph's steps; each is priced when needed, and several threads may use the store.

    Attributes:
        edges: Steps priced so far. Its arrays are replaced by larger ones when they are full; steps
            keep their numbers.
        cost_model: Data from which step costs are computed.
        complete: True if all steps are priced.
    """

    def __init__(self, terms: StepCostModel, jobs: int | None, room: int = 0) -> None:
        """Prepare the store of the graph's steps without pricing a step.

        Args:
            terms: Postures, forces, obstacles and hydraulic numbers from which step costs are
                computed.
            jobs: Number of threads for pricing; None means one per processor.
            room: Number of steps for which memory is reserved at first.
        """
        postures = len(terms.layout.posture)
        self.cost_model = terms
        self._jobs = jobs
        self._lock = threading.Lock()
        self.complete = postures == 0
        self.edges = Edges(
            first=np.full(postures, NOT_PRICED),
            last=np.zeros(postures, dtype=np.int64),
            used=np.zeros(1, dtype=np.int64),
            state=np.empty(room, dtype=np.int64),
            pattern=np.empty(room, dtype=np.int64),
            cost=np.empty((room, 3)),
        )

    def guard(self) -> AbstractContextManager[object]:
        """Return a context manager that stops other threads from adding steps to `edges`.

        Returns:
            The lock of this object; a context manager without effect if all steps are priced.
        """
        return nullcontext() if self.complete else self._lock

    def grow(self, room: int) -> None:
        """Replace the arrays of `edges` by arrays of at least twice their size.

        The caller must hold the lock `guard()`. The steps and their numbers stay.

        Args:
            room: Least number of further steps for which room is needed.
        """
        count = int(self.edges.used[0])
        larger = max(2 * len(self.edges.state), count + room)
        changed = {}
        for name in ("state", "pattern", "cost"):
            old = getattr(self.edges, name)
            changed[name] = np.empty((larger, *old.shape[1:]), dtype=old.dtype)
            changed[name][:count] = old[:count]
        self.edges = self.edges._replace(**changed)

    def price(self, postures: IntArray, deadline: Deadline = NO_DEADLINE) -> None:
        """Price the steps that leave given postures, and add them to `edges`.

        Postures whose steps are already priced are skipped. The call holds the lock `guard()`, and
        prices in parallel threads.

        Args:
            postures: Numbers of the postures.
            deadline: Instant at which the work is given up.

        Raises:
            DeadlineError: The deadline passed; no step is added.
        """
        if self.complete:
            return
        with self.guard():
            missing = postures[self.edges.first[postures] == NOT_PRICED]
            leaving = np.empty(len(missing), dtype=np.int64)
            work = partial(_price_range, self.cost_model, missing, leaving)
            parts = _run_in_parallel(work, len(missing), self._jobs, deadline)
            total, count = int(leaving.sum()), int(self.edges.used[0])
            if count + total > len(self.edges.state):
                self.grow(total)
            last = count + np.cumsum(leaving)
            self.edges.first[missing], self.edges.last[missing] = last - leaving, last
            for state, pattern, cost in parts:
                part = slice(count, count + len(state))
                self.edges.state[part], self.edges.pattern[part] = state, pattern
                self.edges.cost[part] = cost
                count += len(state)
            self.edges.used[0] = count

    def price_all(self, deadline: Deadline = NO_DEADLINE) -> None:
        """Price all steps of the graph that are not priced yet, and set `complete` to True.

        Args:
            deadline: Instant at which the work is given up.

        Raises:
            DeadlineError: The deadline passed; no step is added.
        """
        if not self.complete:
            self.price(np.arange(len(self.edges.first)), deadline)
            self.complete = True


def _run_in_parallel(
    work: Callable[[int, int], Result], total: int, jobs: int | None, deadline: Deadline
) -> list[Result]:
    """Run a function over ranges of indices in threads, and collect its results.

    Args:
        work: Function of (begin, end); end is excluded.
        total: Number of indices. The ranges cover 0 to `total` - 1, with POSTURES_PER_TASK indices
            each, the last one with the rest.
        jobs: Number of threads; None means one per processor.
        deadline: Instant at which the work is given up, checked after each range. Ranges not yet
            begun are dropped.

    Returns:
        Results in the order of the ranges; empty if `total` is 0.

    Raises:
        DeadlineError: The deadline passed.
    """
    results = []
    with closing(yield_results_of_ranges(work, total, POSTURES_PER_TASK, jobs)) as parts:
        for part in parts:
            deadline.check("the pricing of steps")
            results.append(part)
    return results
