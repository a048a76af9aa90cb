"""What an A* search knows of its states, and which of them comes next.

Searches differ in the steps that they expand a state by, stored ones or moves priced on the spot,
so each has a loop of its own: numba keeps no kernel that is handed another one. What is the same
in them is here, inlined: handing a tuple of arrays over costs more than it does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.search.indexed_heap import NOT_IN_HEAP, pop, sift_up

PAUSED, FOUND, EXHAUSTED, FULL = 0, 1, 2, 3
"""What a portion of a search can end with: the limit, the goal, nothing left to expand, or no
room for what the next state leads to."""

NOWHERE = -1
"""Instead of a state or posture: none of those that are numbered."""

WAITING, EXPANDED, GENERATED = 0, 1, 2
"""Counts: states in the heap, states expanded, steps looked at."""


class Frontier(NamedTuple):
    """State of a search that can be taken up again; the goal is one more state, the last."""

    cost: FloatArray  # [states + 1] so far
    estimate: FloatArray  # [states + 1] cost so far plus least cost to the goal
    depth: IntArray  # [states + 1] steps so far
    parent: IntArray  # [states + 1] state before; NOWHERE for the start
    place: IntArray  # [states + 1] in the heap, NOT_IN_HEAP where not there
    heap: IntArray  # [states + 1]
    counts: IntArray  # [3] WAITING, EXPANDED, GENERATED


def empty_frontier(states: int) -> Frontier:
    """A search that has not begun, over so many states and the goal."""
    return Frontier(
        cost=np.full(states + 1, np.inf),
        estimate=np.empty(states + 1),
        depth=np.zeros(states + 1, dtype=np.int64),
        parent=np.empty(states + 1, dtype=np.int64),
        place=np.full(states + 1, NOT_IN_HEAP),
        heap=np.empty(states + 1, dtype=np.int64),
        counts=np.zeros(3, dtype=np.int64),
    )


def enlarged(f: Frontier) -> Frontier:
    """The same search over twice as many states; the goal is the last of them again."""
    goal = len(f.cost) - 1
    wider, waiting = empty_frontier(2 * goal), f.counts[WAITING]
    for old, new in zip(f, wider, strict=True):
        new[: len(old)] = old
    for name in ("cost", "estimate", "depth", "parent", "place"):
        column = getattr(wider, name)
        column[-1] = column[goal]
    wider.cost[goal], wider.place[goal] = np.inf, NOT_IN_HEAP
    wider.heap[:waiting][f.heap[:waiting] == goal] = 2 * goal
    return wider


@kernel(inline="always")
def take_first(f: Frontier) -> int:
    """The waiting state with the least estimate, no longer waiting; NOWHERE where none waits."""
    if f.counts[WAITING] == 0:
        return NOWHERE
    state = pop(f.estimate, f.depth, f.heap, f.place, f.counts[WAITING])
    f.counts[WAITING] -= 1
    return state


@kernel(inline="always")
def reach(f: Frontier, target: int, state: int, steps: int, cost: float, least: float) -> None:
    """Note that a target is reached from a state, in so many steps and at this cost, and wait.

    least: from there to the goal. A target that has been expanded is expanded again.
    """
    f.cost[target] = cost
    f.estimate[target] = cost + least
    f.depth[target] = steps
    f.parent[target] = state
    slot = f.place[target]
    if slot == NOT_IN_HEAP:
        slot = f.counts[WAITING]
        f.counts[WAITING] += 1
    sift_up(f.estimate, f.depth, f.heap, f.place, slot, target)


def way_to_goal(f: Frontier) -> IntArray:
    """The states of the path found, from the first after the start to the goal."""
    return _way_to(len(f.parent) - 1, f.parent)


@kernel
def _way_to(state: int, parent: IntArray) -> IntArray:
    """A state's forebears, the first first, and itself."""
    before, count = state, 0
    while before != NOWHERE:
        before = parent[before]
        count += 1
    way = np.empty(count, dtype=np.int64)
    for k in range(count - 1, -1, -1):
        way[k] = state
        state = parent[state]
    return way
