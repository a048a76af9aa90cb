"""State records and open list of A* searches.

The open list is a binary heap of numbered states that stores the position of each state. States are
ordered by increasing `estimate`, then `depth`, then number. The field `place` of a state is its
position in the heap; it is NOT_IN_HEAP if the state is not in the heap.

Searches differ in the steps that start in a state: stored steps, or moves that are priced when they
are needed. Each search has its own loop, because numba caches no kernel that receives another
kernel as an argument. The common parts are in this module. They are inlined, because passing a
tuple of arrays takes longer than their work.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.records import Int32, Record, Records, record_dtype
from mhsb_model.types import IntArray

NOT_IN_HEAP = -1
"""Value of `place` for a state that is not in the heap."""


@kernel(borrows=True, forceinline=True)
def _precedes(states: Records[SearchState], a: int, b: int) -> bool:
    """Return whether state a precedes state b in the heap order.

    The order is by least estimated total cost, then by fewest steps, then by least state number.

    Args:
        states: Records of all states.
        a: Number of a state, an index into `states`.
        b: Number of another state.

    Returns:
        True if a comes first.
    """
    one, other = states[a], states[b]
    if one.estimate != other.estimate:
        return one.estimate < other.estimate
    if one.depth != other.depth:
        return one.depth < other.depth
    return a < b


@kernel(borrows=True, forceinline=True)
def sift_up(states: Records[SearchState], heap: IntArray, i: int, state: int) -> None:
    """Insert a state into the heap, or move it up after its estimate has decreased.

    The caller must set the state's estimate before the call, and keep the count of states in the
    heap.

    Args:
        states: Records of all states. The field `place` is written.
        heap: State numbers in heap order. Written in place.
        i: Position in the heap from which the state moves up. For a new state, this is the number
            of states in the heap; for a state whose estimate has decreased, its present position.
        state: Number of the state.
    """
    while i > 0:
        above = (i - 1) // 2
        if not _precedes(states, state, heap[above]):
            break
        moved: int = heap[above]
        heap[i] = moved
        states[moved].place = i
        i = above
    heap[i] = state
    states[state].place = i


@kernel(borrows=True, forceinline=True)
def pop(states: Records[SearchState], heap: IntArray, size: int) -> int:
    """Remove the first state from a heap.

    The caller must decrement its own count of states in the heap.

    Args:
        states: Records of all states. The field `place` is written.
        heap: State numbers in heap order. Written in place.
        size: Number of states in the heap before the call, at least 1.

    Returns:
        Number of the removed state. It has the least estimate; among equal estimates the fewest
        steps, then the least number.
    """
    top: int = heap[0]
    states[top].place = NOT_IN_HEAP
    size -= 1
    if size == 0:
        return top
    state: int = heap[size]
    i = 0
    while True:
        below = 2 * i + 1
        if below >= size:
            break
        if below + 1 < size and _precedes(states, heap[below + 1], heap[below]):
            below += 1
        if not _precedes(states, heap[below], state):
            break
        moved: int = heap[below]
        heap[i] = moved
        states[moved].place = i
        i = below
    heap[i] = state
    states[state].place = i
    return top


SEARCH_PAUSED, GOAL_FOUND, SEARCH_EXHAUSTED, ARRAYS_FULL = 0, 1, 2, 3
"""Reasons why a portion of a search ends.

SEARCH_PAUSED: the limit of expansions is reached. GOAL_FOUND: the goal is the next state to expand.
SEARCH_EXHAUSTED: no state is left to expand. ARRAYS_FULL: the arrays have no room for the steps
that start in the next state."""

NO_STATE = -1
"""Number that stands for no state or no posture."""

WAITING_COUNT, EXPANDED_COUNT, GENERATED_COUNT = 0, 1, 2
"""Indices into `OpenList.counts`: states in the heap, states expanded, steps generated."""


class SearchState(Record):
    """One state of a search. It fits into half a cache line, because accesses are random."""

    cost: float
    """Cost of the best path from the start so far."""
    estimate: float
    """`cost` plus the heuristic, the estimated cost from this state to the goal."""
    depth: Int32
    """Number of steps of the best path from the start so far."""
    parent: Int32
    """Previous state on the best path so far; NO_STATE stands for the start."""
    place: Int32
    """Position in the heap, or NOT_IN_HEAP."""
    step: Int32
    """Number of the last step of the best path so far, if the search numbers its steps."""


class OpenList(NamedTuple):
    """Records of all states, and the heap of the open states, with which a search can be continued.

    The goal is one more state; it has the greatest number.

    Attributes:
        states: Records of SearchState, shape (states + 1,); the last record is the goal.
        heap: Numbers of the open states in heap order, shape (states + 1,). Only the first
            counts[WAITING_COUNT] entries are valid.
        counts: Counters WAITING, EXPANDED and GENERATED, shape (3,).
    """

    states: Records[SearchState]
    heap: IntArray
    counts: IntArray

    @property
    def goal_cost(self) -> float:
        """Cost of the best path to the goal so far; inf if there is none."""
        return float(self.states[-1].cost)


class ExpandedState(NamedTuple):
    """The state that is being expanded.

    Attributes:
        state: Number of the state; NO_STATE for the start.
        pattern: Index of the mode combination of arrival. The number of combinations stands for the
            modes in force at the start.
        cost: Cost from the start.
        next_depth: Number of steps from the start to the successors of this state.
    """

    state: int
    pattern: int
    cost: float
    next_depth: int | np.int64


def create_open_list(states: int) -> OpenList:
    """Create the state records and the open list of a search that has not begun.

    All states have infinite cost and no parent, and none is in the heap.

    Args:
        states: Number of states without the goal.

    Returns:
        An empty open list with states + 1 records; the last record is the goal.
    """
    dtype = record_dtype(SearchState)
    unknown = np.array([(np.inf, 0.0, 0, NO_STATE, NOT_IN_HEAP, 0)], dtype)
    words = np.empty((states + 1, dtype.itemsize // 8), dtype=np.int64)
    words[:] = unknown.view(np.int64)  # NumPy copies words faster than records
    rows = words.view(dtype)[:, 0].view(np.recarray)
    return OpenList(rows, np.empty(states + 1, np.int64), np.zeros(3, np.int64))


def enlarge_open_list(f: OpenList) -> OpenList:
    """Return a copy of an open list with room for twice as many states.

    The goal stays the last state, so its number changes. All other states keep their numbers.

    Args:
        f: Open list with its search under way.

    Returns:
        A new open list with the same content. Additional states have infinite cost. The goal's
        number is twice its old number.
    """
    goal = len(f.states) - 1
    wider, waiting = create_open_list(2 * goal), f.counts[WAITING_COUNT]
    wider.states[:goal], wider.states[-1] = f.states[:goal], f.states[goal]
    wider.heap[: goal + 1], wider.counts[:] = f.heap, f.counts
    wider.heap[:waiting][f.heap[:waiting] == goal] = 2 * goal
    return wider


@kernel(borrows=True, forceinline=True)
def pop_first_state(f: OpenList) -> int:
    """Remove the open state with the least estimate, and update the count of open states.

    Args:
        f: Open list. Its heap, counts and the state's `place` are written in place.

    Returns:
        Number of the state, or NO_STATE if the heap is empty.
    """
    if f.counts[WAITING_COUNT] == 0:
        return NO_STATE
    state = pop(f.states, f.heap, f.counts[WAITING_COUNT])
    f.counts[WAITING_COUNT] -= 1
    return state


@kernel(borrows=True, forceinline=True)
def record_path_to(
    f: OpenList, target: int, state: int, steps: int, cost: float, lower_bound: float
) -> None:
    """Record a new best path to a target state and put the target into the heap.

    If the target is already in the heap, it moves to its new position. A target that was expanded
    before becomes open again. The caller must check that the path is better than the known path.
    The record's field `step` is not written.

    Args:
        f: Open list. The target's record, the heap and the counts are written in place.
        target: Number of the state that is reached.
        state: Number of the state before the target on this path, NO_STATE for the start.
        steps: Number of steps from the start to the target.
        cost: Cost from the start to the target.
        lower_bound: Heuristic: estimated cost from the target to the goal. The heap is ordered by
            `cost` plus this value.
    """
    reached = f.states[target]
    reached.cost = cost
    reached.estimate = cost + lower_bound
    reached.depth = steps
    reached.parent = state
    slot = reached.place
    if slot == NOT_IN_HEAP:
        slot = f.counts[WAITING_COUNT]
        f.counts[WAITING_COUNT] += 1
    sift_up(f.states, f.heap, slot, target)


@kernel
def trace_path_to_goal(f: OpenList) -> IntArray:
    """Return the states along the found path, without the start.

    Args:
        f: Open list of a search that has reached the goal.

    Returns:
        State numbers in path order. The start has no number and is left out; the goal is last.
    """
    states, state = f.states, len(f.states) - 1
    before, count = state, 0
    while before != NO_STATE:
        before = states[before].parent
        count += 1
    way = np.empty(count, dtype=np.int64)
    for k in range(count - 1, -1, -1):
        way[k] = state
        state = states[state].parent
    return way
