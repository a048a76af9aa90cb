"""A* over lattice points in the space of cylinder lengths and mode patterns, edges priced lazily.

The lattice covers the joints' whole ranges, the start is among its points, and a step leads to one
of the 3ⁿ − 1 points around; to a goal posture it leads from the points around that. With one
spacing for all cylinders strokes and durations in N add up to those of a straight move, as the
steps run along the axes and all diagonals: the lattice itself then costs nothing where no cylinder
needs boost. Among obstacles it is the joints that turn evenly, the first ones by less, so that the
arm moves about as far with each step: a millimetre of one cylinder may move the tip by 40.

A state is a point and the pattern in which it was reached. The estimate of the cost that remains,
`lower_bound.least_cost` to the nearest goal posture, is consistent.

Only points that are met take memory, each a row of its own, so that a lattice is laid out at once
however many points it has; rows are added as the search asks for them.
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
from mhsb_planner.integrated.route import (
    Memory,
    Terms,
    least_step,
    price_piece,
    switches_to_hold,
)
from mhsb_planner.search.frontier import (
    EXHAUSTED,
    EXPANDED,
    FOUND,
    FULL,
    GENERATED,
    NOWHERE,
    PAUSED,
    Frontier,
    empty_frontier,
    enlarged,
    reach,
    take_first,
    way_to_goal,
)
from mhsb_planner.search.s2_step import DURATION, INADMISSIBLE, Postures

FIRST_PORTION, PORTION = 4, 50
"""States to expand before the first look at the clock, and between two at most."""

ROUNDING = 1e-9  # m

CLOSE = 0.05
"""Share of the spacing by which the last point may miss the end of a joint's range."""

FIRST_ROWS = 1000
"""Points for which there is room before a search asks for more; then twice as many each time."""


class Lattice(NamedTuple):
    """Points at all combinations of some lengths of each cylinder, numbered row by row."""

    shape: IntArray  # [n] points along each cylinder's length
    stride: IntArray  # [n]
    start: int
    length: FloatArray  # [n, longest] m, along each cylinder
    angle: FloatArray  # [n, longest] rad, of its joint
    moves: IntArray  # [3ⁿ − 1, n] −1, 0, 1


def evenly_long(machine: Machine, posture: FloatArray, spacing: float) -> Lattice:
    """Lattice around a posture [rad] with a point every `spacing` m of all cylinders."""
    axes = []
    for j, angle in enumerate(posture):
        linkage, low, high = machine.arrays.linkage[j], *_limits(machine, j)
        one, other = cylinder_length(linkage, low), cylinder_length(linkage, high)
        here = cylinder_length(linkage, angle)
        length, first = _every(here, min(one, other), max(one, other), spacing)
        axes.append((length, _angles(linkage, length, low, high, first, angle), first))
    return _lattice(axes)


def evenly_turned(machine: Machine, posture: FloatArray, reach: float) -> Lattice:
    """Lattice around a posture [rad] whose joints turn by what moves no part farther than reach m.

    Each joint by itself, the arm being stretched out beyond it.
    """
    a = machine.arrays
    longest = a.link_length + np.where(a.slides, a.joint_max, 0.0)
    axes, beyond = [], np.where(a.slides, 1.0, np.cumsum(longest[::-1])[::-1])
    for j, angle in enumerate(posture):
        angles, first = _every(angle, *_limits(machine, j), reach / beyond[j])
        linkage = machine.arrays.linkage[j]
        axes.append((np.array([cylinder_length(linkage, q) for q in angles]), angles, first))
    return _lattice(axes)


def _lattice(axes: list[tuple[FloatArray, FloatArray, int]]) -> Lattice:
    """Of each cylinder's lengths [m], its joint's angles [rad], and which of them is the start."""
    lengths, angles, first = zip(*axes, strict=True)
    shape = np.array([len(length) for length in lengths])
    stride = np.append(np.cumprod(shape[:0:-1])[::-1], 1)
    moves = [move for move in itertools.product((-1, 0, 1), repeat=len(shape)) if any(move)]
    return Lattice(
        frozen(shape),
        frozen(stride),
        int(stride @ np.array(first)),
        _rows(lengths),
        _rows(angles),
        frozen(np.array(moves)),
    )


def _every(here: float, low: float, high: float, spacing: float) -> tuple[FloatArray, int]:
    """Numbers every `spacing` from `here` on to both ends, these included, and where it is."""
    below = max(0, math.floor((here - low) / spacing))
    above = max(0, math.floor((high - here) / spacing))
    numbers: FloatArray = here + spacing * np.arange(-below, above + 1, dtype=np.float64)
    if numbers[0] > low + CLOSE * spacing:
        numbers, below = np.append(low, numbers), below + 1
    if numbers[-1] < high - CLOSE * spacing:
        numbers = np.append(numbers, high)
    return numbers, below


@kernel
def _angles(
    linkage: FloatArray, length: FloatArray, low: float, high: float, first: int, angle: float
) -> FloatArray:
    """Angles [rad] of a joint at its cylinder's lengths [m], that at `first` being known."""
    angles = np.empty(len(length))
    angles[first] = angle
    for i in range(first + 1, len(length)):
        angles[i] = joint_angle(linkage, length[i], low, high, angles[i - 1])
    for i in range(first - 1, -1, -1):
        angles[i] = joint_angle(linkage, length[i], low, high, angles[i + 1])
    return angles


def _limits(machine: Machine, j: int) -> tuple[float, float]:
    return float(machine.arrays.joint_min[j]), float(machine.arrays.joint_max[j])


def _rows(rows: tuple[FloatArray, ...]) -> FloatArray:
    """Rows of different lengths as one array, filled up at their ends."""
    filled = np.zeros((len(rows), max(len(row) for row in rows)))
    for i, row in enumerate(rows):
        filled[i, : len(row)] = row
    return frozen(filled)


class Known(NamedTuple):
    """What this search notes beside its frontier, of the points that it has met, one a row.

    The states of the point in row r are numbers r · patterns and following.
    """

    row: IntArray  # [points] one more than the row of each, 0 where it has not been met
    rows: IntArray  # [1] points met
    point: IntArray  # [rows] which it is
    remaining: FloatArray  # [rows] least cost to the goal
    force: FloatArray  # [rows, n] of the cylinders [N], NaN where not yet computed
    best: IntArray  # [rows] the cheapest state so far, NOWHERE where none
    reached: IntArray  # [1] goal posture at the end of the path to the goal


def nothing_known(lattice: Lattice, rows: int) -> Known:
    """What is noted before a search, with room for so many points."""
    return Known(
        row=np.zeros(int(np.prod(lattice.shape)), dtype=np.int64),
        rows=np.zeros(1, dtype=np.int64),
        point=np.empty(rows, dtype=np.int64),
        remaining=np.empty(rows),
        force=np.full((rows, len(lattice.shape)), np.nan),
        best=np.full(rows, NOWHERE),
        reached=np.full(1, NOWHERE),
    )


def _with_more_rows(known: Known) -> Known:
    """The same with twice as many rows."""
    more = len(known.point)
    return known._replace(
        point=np.append(known.point, np.empty(more, dtype=np.int64)),
        remaining=np.append(known.remaining, np.empty(more)),
        force=np.vstack([known.force, np.full((more, known.force.shape[1]), np.nan)]),
        best=np.append(known.best, np.full(more, NOWHERE)),
    )


@kernel(borrows=True)
def _put(known: Known, lattice: Lattice, row: int, points: Postures, i: int) -> None:
    """Put the lattice point of a row at points[i]; its forces are those of `_load`."""
    rest = known.point[row]
    for j in range(len(lattice.shape)):
        at = rest // lattice.stride[j]
        rest -= at * lattice.stride[j]
        points.length[i, j] = lattice.length[j, at]
        points.posture[i, j] = lattice.angle[j, at]


@kernel
def _load(t: Terms, known: Known, row: int, points: Postures, i: int) -> None:
    """Put the cylinders' forces at the point of a row, computed once, at points[i]."""
    if math.isnan(known.force[row, 0]):
        piston_forces(t.machine, points.posture[i], known.force[row])
    points.force[i] = known.force[row]


@kernel(borrows=True)
def _meet(known: Known, point: int) -> int:
    """A new row for a point that has not been met."""
    row = known.rows[0]
    known.rows[0] += 1
    known.row[point] = row + 1
    known.point[row] = point
    return row


@kernel(borrows=True)
def _remaining(t: Terms, length: FloatArray, goals: FloatArray) -> float:
    least = math.inf
    for k in range(len(goals)):
        least = min(least, least_step(t, length, goals[k]))
    return least


@kernel(borrows=True)
def _is_around(lattice: Lattice, at: IntArray, goal: FloatArray) -> bool:
    """Whether the goal lies between the points next to the one with the indices at[n]."""
    for j in range(len(at)):
        one = lattice.length[j, max(0, at[j] - 1)]
        other = lattice.length[j, min(lattice.shape[j] - 1, at[j] + 1)]
        if not min(one, other) - ROUNDING <= goal[j] <= max(one, other) + ROUNDING:
            return False
    return True


class Origin(NamedTuple):
    """The state that is being expanded, from which steps lead."""

    state: int  # NOWHERE for the start
    pattern: int  # in which it was reached; the modes in force are one more, the last
    cost: float  # so far


@kernel(borrows=True)
def _relax(
    t: Terms, f: Frontier, known: Known, state: int, target: int, cost: float, least: float
) -> bool:
    """Note that the target is reached from a state at this cost, where that is cheaper.

    Not where the cheapest state of the same point, with the switches from its pattern to the
    target's, costs no more: whatever follows can follow that one.
    """
    patterns = len(t.patterns)
    row, p = target // patterns, target % patterns
    if target < len(f.states) - 1:
        best = known.best[row]
        if best == NOWHERE:
            known.best[row] = target
        elif cost >= f.states[best].cost + t.weight[2] * t.switches[best % patterns, p]:
            return False
        elif cost < f.states[best].cost:
            known.best[row] = target
    if cost >= f.states[target].cost:
        return False
    reach(f, target, state, 1 if state == NOWHERE else f.states[state].depth + 1, cost, least)
    return True


@kernel(borrows=True)
def _take(
    t: Terms,
    w: Memory,
    f: Frontier,
    known: Known,
    origin: Origin,
    admitted: int,
    first: int,
    apart: int,
    after: IntArray,
    least: float,
    enough: float,
    haste: float,
) -> bool:
    """Take the step priced in w.scratch in all patterns admitted; whether it gained anything.

    Pattern p leads from the origin to the state first + p · apart, from which `least` is left to
    the goal; after[p] actuators change their mode there.
    """
    cost, gained = w.scratch.cost, False
    for p in range(len(t.patterns)):
        if w.scratch.status[p] == admitted:
            there = origin.cost + t.weight[0] * cost[p, t.column] + t.weight[1] * cost[p, DURATION]
            switches = t.switches[origin.pattern, p] + after[p]
            there += t.weight[2] * switches + w.shortfall[p]
            if there + least < enough:
                target = first + p * apart
                left = haste * least
                gained = _relax(t, f, known, origin.state, target, there, left) or gained
    return gained


@kernel
def expand(
    t: Terms,
    w: Memory,
    f: Frontier,
    known: Known,
    lattice: Lattice,
    goals: Postures,
    enough: float,
    haste: float,
    once: bool,
    limit: int,
) -> int:
    """Expand up to `limit` states; PAUSED, FOUND, EXHAUSTED, or FULL where rows are to be added.

    goals   the postures in which the path may end
    enough  paths that cost as much or more are not wanted
    haste   factor on what is estimated to remain: with 1 the path found is the cheapest, with
            more it costs at most so many times as much and is found sooner
    once    whether a point that has been reached is looked at no more: whether there is a path is
            found out soonest, not the cheapest

    Oracle: scipy.sparse.csgraph.dijkstra on the same points and steps.
    """
    patterns, w_switch = len(t.patterns), t.weight[2]
    sink = len(f.states) - 1
    n = len(lattice.shape)
    at = np.empty(n, dtype=np.int64)
    none, after = np.zeros(patterns, dtype=np.int64), np.empty(patterns, dtype=np.int64)
    for _ in range(limit):
        if known.rows[0] + len(lattice.moves) + 1 > len(known.point):
            return FULL
        if f.counts[EXPANDED] == 0:
            state, own, so_far = NOWHERE, patterns, 0.0
            here = _meet(known, lattice.start)
        else:
            state = take_first(f)
            if state == NOWHERE:
                return EXHAUSTED
            if state == sink:
                return FOUND
            here, own, so_far = state // patterns, state % patterns, f.states[state].cost
            best = known.best[here]
            if so_far > f.states[best].cost + w_switch * t.switches[best % patterns, own]:
                continue
        origin = Origin(state, own, so_far)
        f.counts[EXPANDED] += 1
        _put(known, lattice, here, w.points, 0)
        _load(t, known, here, w.points, 0)
        rest = known.point[here]
        for j in range(n):
            at[j] = rest // lattice.stride[j]
            rest -= at[j] * lattice.stride[j]
        for move in lattice.moves:
            point = known.point[here]
            inside = True
            for j in range(n):
                inside = inside and 0 <= at[j] + move[j] < lattice.shape[j]
                point += move[j] * lattice.stride[j]
            if not inside:
                continue
            target = known.row[point] - 1
            if once and target != NOWHERE and known.best[target] != NOWHERE:
                continue
            if target == NOWHERE:
                target = _meet(known, point)
                _put(known, lattice, target, w.points, 1)
                known.remaining[target] = _remaining(t, w.points.length[1], goals.length)
            else:
                _put(known, lattice, target, w.points, 1)
            least = known.remaining[target]
            there = so_far + least_step(t, w.points.length[0], w.points.length[1])
            if there + least >= enough:
                continue
            best = known.best[target]
            if best != NOWHERE and there >= f.states[best].cost + w_switch * n:
                continue
            _load(t, known, target, w.points, 1)
            f.counts[GENERATED] += 1
            admitted = price_piece(t, w, 0)
            if admitted == INADMISSIBLE:
                continue
            first = target * patterns
            _take(t, w, f, known, origin, admitted, first, 1, none, least, enough, haste)
        for k in range(len(goals.length)):
            if not _is_around(lattice, at, goals.length[k]):
                continue
            for j in range(n):
                w.points.posture[1, j] = goals.posture[k, j]
                w.points.length[1, j] = goals.length[k, j]
                w.points.force[1, j] = goals.force[k, j]
            admitted = price_piece(t, w, 0)
            if admitted == INADMISSIBLE:
                continue
            for p in range(patterns):
                after[p] = switches_to_hold(t.machine, w.points.force[1], t.patterns[p])
            if _take(t, w, f, known, origin, admitted, sink, 0, after, 0.0, enough, haste):
                known.reached[0] = k
    return PAUSED


class LatticeSearch:
    """A search over a lattice from its start to goal postures.

    exhausted  whether it has ended because no route costs less than enough
    """

    exhausted = False

    def __init__(
        self,
        t: Terms,
        memory: Memory,
        lattice: Lattice,
        goals: Postures,
    ) -> None:
        self._terms, self._memory, self._lattice, self._goals = t, memory, lattice, goals
        rows = max(FIRST_ROWS, len(self._lattice.moves) + 1)
        self._frontier = empty_frontier(rows * len(t.patterns))
        self._known = nothing_known(self._lattice, rows)

    @property
    def expanded(self) -> int:
        """States expanded so far."""
        return int(self._frontier.counts[EXPANDED])

    @property
    def met(self) -> int:
        """Points met so far."""
        return int(self._known.rows[0])

    @property
    def priced(self) -> int:
        """Steps priced so far."""
        return int(self._frontier.counts[GENERATED])

    @property
    def cost(self) -> float:
        """Cost of the route found."""
        return self._frontier.goal_cost

    def search(
        self,
        enough: float,
        expansions: int,
        deadline: Deadline = NEVER,
        haste: float = 1.0,
        once: bool = False,
    ) -> tuple[FloatArray, int] | None:
        """Corners of the cheapest route, float64[points, n] m, and the goal it ends in.

        With haste above 1, of one that costs at most so many times as much; once: of any. None
        where no route costs less than `enough`, or none was found with so many expansions or before
        the deadline.
        """
        status = PAUSED
        for portion in deadline.portions(FIRST_PORTION, PORTION):
            status = expand(
                self._terms,
                self._memory,
                self._frontier,
                self._known,
                self._lattice,
                self._goals,
                enough,
                haste,
                once,
                min(portion, expansions - self.expanded),
            )
            if status == FULL:
                self._frontier = enlarged(self._frontier)
                self._known = _with_more_rows(self._known)
            elif status != PAUSED or self.expanded >= expansions:
                break
        self.exhausted = status == EXHAUSTED
        return self._found() if status == FOUND else None

    def _found(self) -> tuple[FloatArray, int]:
        lattice, way = self._lattice, way_to_goal(self._frontier)
        rows = way[:-1] // len(self._terms.patterns)
        points = np.append(lattice.start, self._known.point[rows])
        index = (points[:, None] // lattice.stride) % lattice.shape
        corners = lattice.length[np.arange(len(lattice.shape)), index]
        goal = int(self._known.reached[0])
        return np.vstack([corners, self._goals.length[goal]]), goal
