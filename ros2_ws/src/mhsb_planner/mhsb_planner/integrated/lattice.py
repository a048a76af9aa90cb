"""A* over lattice points in the space of cylinder lengths and mode patterns, edges priced lazily.

The lattice has one spacing for all cylinders and the start among its points; a step leads to one
of the 3ⁿ − 1 points around. As the steps run along the axes and all diagonals, strokes and
durations in N add up to those of a straight move, so that the lattice itself costs nothing where
no cylinder needs boost. From points within one spacing of a goal posture a step leads there.

A state is a point and the pattern in which it was reached. The estimate of the cost that remains,
`lower_bound.least_cost` to the nearest goal posture, is consistent.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length, joint_angle
from mhsb_model.machine import Machine
from mhsb_model.statics import piston_forces
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.integrated.route import Memory, Terms, least_step, price_piece
from mhsb_planner.search.indexed_heap import NOT_IN_HEAP, pop, sift_up
from mhsb_planner.search.s2_joining import NOWHERE
from mhsb_planner.search.s2_query import EXHAUSTED, FOUND, PAUSED
from mhsb_planner.search.s2_step import DURATION, INADMISSIBLE, Postures

FIRST_PORTION, PORTION = 4, 50
"""States to expand before the first look at the clock, and between two at most."""


class Lattice(NamedTuple):
    """Points L = L_start + h (i − i_start) within the limits, numbered row by row."""

    spacing: float  # h [m]
    shape: IntArray  # [n] points along each cylinder's length
    stride: IntArray  # [n]
    start: int
    length: FloatArray  # [n, longest] m, along each cylinder
    angle: FloatArray  # [n, longest] rad, of its joint
    moves: IntArray  # [3ⁿ − 1, n] −1, 0, 1


def lattice_around(
    machine: Machine, posture: FloatArray, goals: FloatArray, spacing: float, margin: int
) -> Lattice:
    """Lattice with the posture [rad] among its points.

    It covers the cylinder lengths goals[goals, n] [m] and `margin` points more on all sides, as
    far as the joint limits allow.
    """
    lengths, angles, below = [], [], []
    for j in range(machine.joint_count):
        reach = goals[:, j].min() - margin * spacing, goals[:, j].max() + margin * spacing
        length, angle, start = _along_cylinder(machine, j, posture[j], spacing, reach)
        lengths.append(length)
        angles.append(angle)
        below.append(start)
    shape = np.array([len(length) for length in lengths])
    stride = np.append(np.cumprod(shape[:0:-1])[::-1], 1)
    moves = [move for move in itertools.product((-1, 0, 1), repeat=len(shape)) if any(move)]
    return Lattice(
        spacing,
        frozen(shape),
        frozen(stride),
        int(stride @ np.array(below)),
        _rows(lengths),
        _rows(angles),
        frozen(np.array(moves)),
    )


def _along_cylinder(
    machine: Machine, j: int, angle: float, spacing: float, reach: tuple[float, float]
) -> tuple[FloatArray, FloatArray, int]:
    """Lengths [m] of cylinder j every `spacing`, angles [rad] of its joint, and the start's place.

    Within the joint's limits, and within `reach` [m] or at the start.
    """
    linkage, low, high = machine.arrays.linkage[j], *_limits(machine, j)
    here = cylinder_length(linkage, angle)
    ends = sorted((cylinder_length(linkage, low), cylinder_length(linkage, high)))
    below = max(0, math.floor((here - max(ends[0], reach[0])) / spacing))
    above = max(0, math.floor((min(ends[1], reach[1]) - here) / spacing))
    length = here + spacing * np.arange(-below, above + 1)
    angles = np.array([joint_angle(linkage, at, low, high, angle) for at in length])
    angles[below] = angle
    return length, angles, below


def _limits(machine: Machine, j: int) -> tuple[float, float]:
    return float(machine.arrays.joint_min[j]), float(machine.arrays.joint_max[j])


def _rows(rows: list[FloatArray]) -> FloatArray:
    """Rows of different lengths as one array, filled up at their ends."""
    filled = np.zeros((len(rows), max(len(row) for row in rows)))
    for i, row in enumerate(rows):
        filled[i, : len(row)] = row
    return frozen(filled)


class Frontier(NamedTuple):
    """State of a search that can be taken up again; the goal is one more state, the last."""

    cost: FloatArray  # [states + 1] so far
    estimate: FloatArray  # [states + 1] cost so far plus least cost to the goal
    depth: IntArray  # [states + 1] steps so far
    parent: IntArray  # [states + 1] state before; NOWHERE for the start
    place: IntArray  # [states + 1] in the heap, NOT_IN_HEAP where not there
    heap: IntArray  # [states + 1]
    remaining: FloatArray  # [points] least cost to the goal, NaN where not yet computed
    force: FloatArray  # [points, n] of the cylinders [N], NaN where not yet computed
    best: IntArray  # [points + 1] the cheapest state of each point so far, NOWHERE where none
    reached: IntArray  # [1] goal posture at the end of the path to the goal
    counts: IntArray  # [3] size of the heap, states expanded, steps priced


def empty_frontier(lattice: Lattice, patterns: int) -> Frontier:
    """A search that has not begun."""
    points = int(np.prod(lattice.shape))
    states = points * patterns + 1
    return Frontier(
        cost=np.full(states, np.inf),
        estimate=np.empty(states),
        depth=np.zeros(states, dtype=np.int64),
        parent=np.empty(states, dtype=np.int64),
        place=np.full(states, NOT_IN_HEAP),
        heap=np.empty(states, dtype=np.int64),
        remaining=np.full(points, np.nan),
        force=np.full((points, len(lattice.shape)), np.nan),
        best=np.full(points + 1, NOWHERE),
        reached=np.full(1, NOWHERE),
        counts=np.zeros(3, dtype=np.int64),
    )


@kernel
def _place(
    t: Terms, f: Frontier, lattice: Lattice, point: int, points: Postures, i: int
) -> None:
    """Put a lattice point at points[i], its forces computed once."""
    rest = point
    for j in range(len(lattice.shape)):
        at = rest // lattice.stride[j]
        rest -= at * lattice.stride[j]
        points.length[i, j] = lattice.length[j, at]
        points.posture[i, j] = lattice.angle[j, at]
    if math.isnan(f.force[point, 0]):
        piston_forces(t.machine, points.posture[i], f.force[point])
    points.force[i] = f.force[point]


@kernel
def _remaining(t: Terms, length: FloatArray, goals: FloatArray) -> float:
    least = math.inf
    for k in range(len(goals)):
        least = min(least, least_step(t, length, goals[k]))
    return least


@kernel
def _within_a_step(length: FloatArray, goal: FloatArray, spacing: float) -> bool:
    farthest = 0.0
    for j in range(len(length)):
        farthest = max(farthest, abs(goal[j] - length[j]))
    return farthest <= spacing


@kernel
def _relax(t: Terms, f: Frontier, state: int, target: int, cost: float, least: float) -> bool:
    """Note that the target is reached from a state at this cost, where that is cheaper.

    Not where the cheapest state of the same point, with the switches from its pattern to the
    target's, costs no more: whatever follows can follow that one.
    """
    patterns = len(t.patterns)
    point, p = target // patterns, target % patterns
    best = f.best[point]
    if best != NOWHERE:
        if cost >= f.cost[best] + t.weight[2] * t.switches[best % patterns, p]:
            return False
        if cost < f.cost[best]:
            f.best[point] = target
    else:
        f.best[point] = target
    if cost >= f.cost[target]:
        return False
    f.cost[target] = cost
    f.estimate[target] = cost + least
    f.depth[target] = 1 if state == NOWHERE else f.depth[state] + 1
    f.parent[target] = state
    slot = f.place[target]
    if slot == NOT_IN_HEAP:
        slot = f.counts[0]
        f.counts[0] += 1
    sift_up(f.estimate, f.depth, f.heap, f.place, slot, target)
    return True


@kernel
def _take(
    t: Terms,
    w: Memory,
    f: Frontier,
    state: int,
    own: int,
    so_far: float,
    admitted: int,
    first: int,
    apart: int,
    least: float,
    enough: float,
) -> bool:
    """Take the step priced in w.scratch in all patterns admitted; whether it gained anything.

    Pattern p leads from `state`, reached in the pattern `own`, to the state first + p · apart,
    from which `least` is left to the goal.
    """
    cost, gained = w.scratch.cost, False
    for p in range(len(t.patterns)):
        if w.scratch.status[p] == admitted:
            there = so_far + t.weight[0] * cost[p, t.column] + t.weight[1] * cost[p, DURATION]
            there += t.weight[2] * t.switches[own, p] + w.shortfall[p]
            if there + least < enough:
                gained = _relax(t, f, state, first + p * apart, there, least) or gained
    return gained


@kernel
def expand(
    t: Terms, w: Memory, f: Frontier, lattice: Lattice, goals: Postures, enough: float, limit: int
) -> int:
    """Expand up to `limit` states; PAUSED, FOUND or EXHAUSTED.

    goals   the postures in which the path may end
    enough  paths that cost as much or more are not wanted

    Oracle: scipy.sparse.csgraph.dijkstra on the same points and steps.
    """
    patterns, w_switch = len(t.patterns), t.weight[2]
    sink = len(f.cost) - 1
    n = len(lattice.shape)
    at = np.empty(n, dtype=np.int64)
    for _ in range(limit):
        if f.counts[1] == 0:
            state, point, own, so_far = NOWHERE, lattice.start, patterns, 0.0
        else:
            if f.counts[0] == 0:
                return EXHAUSTED
            state = pop(f.estimate, f.depth, f.heap, f.place, f.counts[0])
            f.counts[0] -= 1
            if state == sink:
                return FOUND
            point, own, so_far = state // patterns, state % patterns, f.cost[state]
            best = f.best[point]
            if so_far > f.cost[best] + w_switch * t.switches[best % patterns, own]:
                continue
        f.counts[1] += 1
        _place(t, f, lattice, point, w.points, 0)
        rest = point
        for j in range(n):
            at[j] = rest // lattice.stride[j]
            rest -= at[j] * lattice.stride[j]
        for move in lattice.moves:
            target = point
            inside = True
            for j in range(n):
                inside = inside and 0 <= at[j] + move[j] < lattice.shape[j]
                target += move[j] * lattice.stride[j]
            if not inside:
                continue
            _place(t, f, lattice, target, w.points, 1)
            if math.isnan(f.remaining[target]):
                f.remaining[target] = _remaining(t, w.points.length[1], goals.length)
            least = f.remaining[target]
            there = so_far + least_step(t, w.points.length[0], w.points.length[1])
            if there + least >= enough:
                continue
            best = f.best[target]
            if best != NOWHERE and there >= f.cost[best] + w_switch * n:
                continue
            f.counts[2] += 1
            admitted = price_piece(t, w, 0)
            if admitted == INADMISSIBLE:
                continue
            _take(t, w, f, state, own, so_far, admitted, target * patterns, 1, least, enough)
        for k in range(len(goals.length)):
            if not _within_a_step(w.points.length[0], goals.length[k], lattice.spacing):
                continue
            for j in range(n):
                w.points.posture[1, j] = goals.posture[k, j]
                w.points.length[1, j] = goals.length[k, j]
                w.points.force[1, j] = goals.force[k, j]
            admitted = price_piece(t, w, 0)
            if admitted == INADMISSIBLE:
                continue
            if _take(t, w, f, state, own, so_far, admitted, sink, 0, 0.0, enough):
                f.reached[0] = k
    return PAUSED


class LatticeSearch:
    """A search over the lattice from a start posture [rad] to goal postures."""

    def __init__(
        self,
        t: Terms,
        memory: Memory,
        machine: Machine,
        start: FloatArray,
        goals: Postures,
        spacing: float,
        margin: int,
    ) -> None:
        self._terms, self._memory, self._goals = t, memory, goals
        lengths = np.vstack([machine.cylinder_lengths(start), goals.length])
        self._lattice = lattice_around(machine, start, lengths, spacing, margin)
        self._frontier = empty_frontier(self._lattice, len(t.patterns))

    @property
    def expanded(self) -> int:
        """States expanded so far."""
        return int(self._frontier.counts[1])

    @property
    def priced(self) -> int:
        """Steps priced so far."""
        return int(self._frontier.counts[2])

    @property
    def cost(self) -> float:
        """Cost of the route found."""
        return float(self._frontier.cost[-1])

    def search(
        self, enough: float, expansions: int, deadline: Deadline = NEVER
    ) -> tuple[FloatArray, int] | None:
        """Corners of the cheapest route, float64[points, n] m, and the goal it ends in.

        None where no route costs less than `enough`, or none was found with so many expansions
        or before the deadline.
        """
        status = PAUSED
        for portion in deadline.portions(FIRST_PORTION, PORTION):
            status = expand(
                self._terms,
                self._memory,
                self._frontier,
                self._lattice,
                self._goals,
                enough,
                min(portion, expansions - self.expanded),
            )
            if status != PAUSED or self.expanded >= expansions:
                break
        return self._found() if status == FOUND else None

    def _found(self) -> tuple[FloatArray, int]:
        lattice, parent = self._lattice, self._frontier.parent
        points = []
        state = int(parent[-1])
        while state != NOWHERE:
            points.append(state // len(self._terms.patterns))
            state = int(parent[state])
        points.append(lattice.start)
        index = (np.array(points[::-1])[:, None] // lattice.stride) % lattice.shape
        corners = lattice.length[np.arange(len(lattice.shape)), index]
        goal = int(self._frontier.reached[0])
        return np.vstack([corners, self._goals.length[goal]]), goal
