"""Pricing of the graph's steps: all at once, or posture by posture as a search comes by.

Steps are stored once per distinct posture that they leave. A search expands a small share of all
postures, so that after a change of the machine it is cheaper to price those alone.
"""

from __future__ import annotations

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
from mhsb_model.obstacles.clearance import move_is_clear, travel
from mhsb_model.statics import gravity_torque
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_model.workspace import stays_inside
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.search.s2_layout import Layout
from mhsb_planner.search.s2_step import (
    INADMISSIBLE,
    Circuit,
    Postures,
    Scratch,
    describe,
    new_scratch,
    steps_to_node,
)
from mhsb_planner.workers import Result, over_ranges

POSTURES_PER_TASK = 128

NOT_PRICED = -1


class Edges(NamedTuple):
    """Admissible steps; those that leave posture i from first[i] to last[i]."""

    first: IntArray  # [postures] NOT_PRICED where the steps are not known yet
    last: IntArray  # [postures]
    used: IntArray  # [1] steps there are
    state: IntArray  # [room] state that is reached: node · patterns + pattern
    pattern: IntArray  # [room]
    cost: FloatArray  # [room, 3] T [s], E paper [J], E series [J]


class Loads(NamedTuple):
    """Cylinder forces of the arm alone, and for each kg of payload in addition."""

    bare: FloatArray  # [postures or moves, n] N
    for_each_kg: FloatArray  # [postures or moves, n] N/kg


class Terms(NamedTuple):
    """What steps are priced by."""

    circuit: Circuit
    patterns: ModeArray
    layout: Layout
    postures: Postures
    middle: Loads  # half-way along moves; not a number where the tip leaves the workspace
    machine: MachineArrays
    obstacles: FloatArray  # `Obstacles.path_rows`
    clearance: FloatArray  # [postures] m, from the nearest of them; empty where there are none


@kernel(borrows=True)
def price(
    t: Terms, i: int, s: Scratch, state: IntArray, pattern: IntArray, cost: FloatArray, found: int
) -> int:
    """Append the steps that leave posture i to state, pattern and cost, which hold `found`.

    Returns how many these hold then. Oracle: steps worked out one by one in plain NumPy.
    """
    layout, patterns = t.layout, t.patterns
    bare, for_each_kg = t.middle
    middle, payload, crowded = s.middle, t.machine.payload, len(t.obstacles) > 0
    row = layout.move[i]
    for node in layout.neighbors[layout.node[i]]:
        first = layout.first[node] if node >= 0 else 0
        count = layout.first[node + 1] - first if node >= 0 else 0
        if count == 0:
            continue
        for k in range(count):
            for j in range(patterns.shape[1]):
                middle[k, j] = bare[row + k, j] + payload * for_each_kg[row + k, j]
        if crowded:
            _bar_collisions(t, i, first, count, middle)
        row += count
        owner = layout.owner[node]
        status = steps_to_node(
            t.circuit, patterns, t.postures, i, t.postures, first, count, owner, middle, s
        )
        if status == INADMISSIBLE:
            continue
        for p in range(len(patterns)):
            if s.status[p] == status:
                state[found] = node * len(patterns) + p
                pattern[found] = p
                for k in range(cost.shape[1]):
                    cost[found, k] = s.cost[p, k]
                found += 1
    return found


@kernel(borrows=True)
def _bar_collisions(t: Terms, i: int, first: int, count: int, middle: FloatArray) -> None:
    """Make middle[k] not a number where the move from posture i to first + k is not clear.

    Most moves are settled by the clearances at their ends, which are known.
    """
    posture, here = t.layout.posture, t.clearance[i]
    for k in range(count):
        if math.isnan(middle[k, 0]):
            continue
        there = t.clearance[first + k]
        clear = False
        if min(here, there) >= 0.0:
            clear = here + there >= travel(t.machine, posture[i], posture[first + k], False)
        possible = here < 0.0 or there >= 0.0
        if not clear and possible:
            clear = move_is_clear(t.machine, t.obstacles, posture[i], posture[first + k], False)
        if not clear:
            middle[k, 0] = math.nan


@kernel
def _price_range(
    t: Terms, missing: IntArray, leaving: IntArray, begin: int, end: int
) -> tuple[IntArray, IntArray, FloatArray]:
    """Steps of the postures missing[begin : end]; their numbers are written to leaving[missing]."""
    scratch = new_scratch(t.patterns)
    room = (end - begin) * largest_number(t.layout, t.patterns)
    state = np.empty(room, dtype=np.int64)
    pattern = np.empty(room, dtype=np.int64)
    cost = np.empty((room, 3))
    found = 0
    for k in range(begin, end):
        before = found
        found = price(t, missing[k], scratch, state, pattern, cost, found)
        leaving[k] = found - before
    return state[:found].copy(), pattern[:found].copy(), cost[:found].copy()


@kernel(borrows=True)
def largest_number(layout: Layout, patterns: ModeArray) -> int:
    """More steps than these leave no posture."""
    return layout.neighbors.shape[1] * len(patterns)


@kernel
def _middle_loads(
    empty: MachineArrays,
    one_kg: MachineArrays,
    layout: Layout,
    bare: FloatArray,
    for_each_kg: FloatArray,
    begin: int,
    end: int,
) -> None:
    """Loads half-way along the moves from postures begin … end, to bare, for_each_kg[moves, n].

    empty, one_kg: the machine with such a payload; not a number as in `middle_forces`, the oracle.
    """
    n = layout.posture.shape[1]
    middle = np.empty(n)
    for i in range(begin, end):
        start, move = layout.posture[i], layout.move[i]
        for node in layout.neighbors[layout.node[i]]:
            if node < 0:
                continue
            for k in range(layout.first[node], layout.first[node + 1]):
                last = layout.posture[k]
                if stays_inside(empty, start, last):
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


def posture_loads(m: MachineArrays, layout: Layout) -> Loads:
    """Forces in all postures."""
    bare, loaded = (
        describe(m._replace(payload=payload), layout.posture).force for payload in (0.0, 1.0)
    )
    return Loads(bare, loaded - bare)


def middle_loads(
    m: MachineArrays, layout: Layout, jobs: int | None = None, deadline: Deadline = NEVER
) -> Loads:
    """Forces at the middle of all moves, in the order of `Layout.move`."""
    empty, one_kg = (m._replace(payload=payload) for payload in (0.0, 1.0))
    bare, for_each_kg = (np.empty((layout.move[-1], layout.posture.shape[1])) for _ in range(2))
    work = partial(_middle_loads, empty, one_kg, layout, bare, for_each_kg)
    _in_parallel(work, len(layout.posture), jobs, deadline)
    return Loads(bare, for_each_kg)


class PricedSteps:
    """The steps of a graph, priced as they are asked for.

    edges  those that are there; its arrays are replaced where they grow, numbers of steps stay
    terms  what they are priced by
    """

    def __init__(self, terms: Terms, jobs: int | None, room: int = 0) -> None:
        """None is priced yet; `room` for so many, more is made when it is needed."""
        postures = len(terms.layout.posture)
        self.terms = terms
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
        """To be held while somebody else's kernel may price steps."""
        return nullcontext() if self.complete else self._lock

    def grow(self, room: int) -> None:
        """Make room for at least so many more steps; the guard is held."""
        count = int(self.edges.used[0])
        larger = max(2 * len(self.edges.state), count + room)
        changed = {}
        for name in ("state", "pattern", "cost"):
            old = getattr(self.edges, name)
            changed[name] = np.empty((larger, *old.shape[1:]), dtype=old.dtype)
            changed[name][:count] = old[:count]
        self.edges = self.edges._replace(**changed)

    def price(self, postures: IntArray, deadline: Deadline = NEVER) -> None:
        """Price the steps that leave some postures, those that are not priced yet.

        None of them where the deadline passes: DeadlineError.
        """
        if self.complete:
            return
        with self.guard():
            missing = postures[self.edges.first[postures] == NOT_PRICED]
            leaving = np.empty(len(missing), dtype=np.int64)
            work = partial(_price_range, self.terms, missing, leaving)
            parts = _in_parallel(work, len(missing), self._jobs, deadline)
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

    def price_all(self, deadline: Deadline = NEVER) -> None:
        """Price every step there is."""
        if not self.complete:
            self.price(np.arange(len(self.edges.first)), deadline)
            self.complete = True


def _in_parallel(
    work: Callable[[int, int], Result], total: int, jobs: int | None, deadline: Deadline
) -> list[Result]:
    """Results of work(begin, end) over ranges of so many postures, in order."""
    results = []
    with closing(over_ranges(work, total, POSTURES_PER_TASK, jobs)) as parts:
        for part in parts:
            deadline.check("the pricing of steps")
            results.append(part)
    return results
