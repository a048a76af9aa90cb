"""What an A* search knows of its states, and which of them comes next.

Searches differ in the steps that they expand a state by, stored ones or moves priced on the spot,
so each has a loop of its own: numba keeps no kernel that is handed another one. What is the same
in them is here, inlined: handing a tuple of arrays over costs more than it does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import IntArray, Records
from mhsb_planner.search.indexed_heap import NOT_IN_HEAP, pop, sift_up

PAUSED, FOUND, EXHAUSTED, FULL = 0, 1, 2, 3
"""What a portion of a search can end with: the limit, the goal, nothing left to expand, or no
room for what the next state leads to."""

NOWHERE = -1
"""Instead of a state or posture: none of those that are numbered."""

WAITING, EXPANDED, GENERATED = 0, 1, 2
"""Counts: states in the heap, states expanded, steps looked at."""


STATE = np.dtype([
    ("cost", np.float64),  # so far
    ("estimate", np.float64),  # cost so far plus least cost to the goal
    ("depth", np.int32),  # steps so far
    ("parent", np.int32),  # state before; NOWHERE for the start
    ("place", np.int32),  # in the heap, NOT_IN_HEAP where not there
    ("step", np.int32),  # by which it was reached, where the search numbers steps
])
"""What is known of a state: half a line of a processor's cache, as a search jumps to and fro."""


class Frontier(NamedTuple):
    """State of a search that can be taken up again; the goal is one more state, the last."""

    states: Records  # [states + 1] of STATE
    heap: IntArray  # [states + 1]
    counts: IntArray  # [3] WAITING, EXPANDED, GENERATED

    @property
    def goal_cost(self) -> float:
        """Cost of the path to the goal."""
        return float(self.states[-1].cost)


def empty_frontier(states: int) -> Frontier:
    """A search that has not begun, over so many states and the goal."""
    unknown = np.array([(np.inf, 0.0, 0, NOWHERE, NOT_IN_HEAP, 0)], dtype=STATE)
    words = np.empty((states + 1, STATE.itemsize // 8), dtype=np.int64)
    words[:] = unknown.view(np.int64)  # NumPy copies records one by one, words many at once
    rows = words.view(STATE)[:, 0].view(np.recarray)
    return Frontier(rows, np.empty(states + 1, np.int64), np.zeros(3, np.int64))


def enlarged(f: Frontier) -> Frontier:
    """The same search over twice as many states; the goal is the last of them again."""
    goal = len(f.states) - 1
    wider, waiting = empty_frontier(2 * goal), f.counts[WAITING]
    wider.states[:goal], wider.states[-1] = f.states[:goal], f.states[goal]
    wider.heap[: goal + 1], wider.counts[:] = f.heap, f.counts
    wider.heap[:waiting][f.heap[:waiting] == goal] = 2 * goal
    return wider


@kernel(inline="always")
def take_first(f: Frontier) -> int:
    """The waiting state with the least estimate, no longer waiting; NOWHERE where none waits."""
    if f.counts[WAITING] == 0:
        return NOWHERE
    state = pop(f.states, f.heap, f.counts[WAITING])
    f.counts[WAITING] -= 1
    return state


@kernel(inline="always")
def reach(f: Frontier, target: int, state: int, steps: int, cost: float, least: float) -> None:
    """Note that a target is reached from a state, in so many steps and at this cost, and wait.

    least: from there to the goal. A target that has been expanded is expanded again.
    """
    reached = f.states[target]
    reached.cost = cost
    reached.estimate = cost + least
    reached.depth = steps
    reached.parent = state
    slot = reached.place
    if slot == NOT_IN_HEAP:
        slot = f.counts[WAITING]
        f.counts[WAITING] += 1
    sift_up(f.states, f.heap, slot, target)


def way_to_goal(f: Frontier) -> IntArray:
    """The states of the path found, from the first after the start to the goal."""
    return _way_to(f.states, len(f.states) - 1)


@kernel
def _way_to(states: Records, state: int) -> IntArray:
    """A state's forebears, the first first, and itself."""
    before, count = state, 0
    while before != NOWHERE:
        before = states[before].parent
        count += 1
    way = np.empty(count, dtype=np.int64)
    for k in range(count - 1, -1, -1):
        way[k] = state
        state = states[state].parent
    return way
