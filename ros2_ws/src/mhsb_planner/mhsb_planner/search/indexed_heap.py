"""A binary heap of numbered states that knows where each of them is, for A* in kernels.

The state with the least `estimate` is first, of equals that with the least `depth`, then the least
number. Each state's `place` is its position in the heap, NOT_IN_HEAP where it is not there. States
are records with these fields: all of one lie side by side in memory.
"""

from __future__ import annotations

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import IntArray, Records

NOT_IN_HEAP = -1


@kernel(inline="always")
def _before(states: Records, a: int, b: int) -> bool:
    one, other = states[a], states[b]
    if one.estimate != other.estimate:
        return one.estimate < other.estimate
    if one.depth != other.depth:
        return one.depth < other.depth
    return a < b


@kernel(inline="always")
def sift_up(states: Records, heap: IntArray, i: int, state: int) -> None:
    """Put a state into the heap at i or above; i is the heap's size for a new one."""
    while i > 0:
        above = (i - 1) // 2
        if not _before(states, state, heap[above]):
            break
        heap[i] = heap[above]
        states[heap[i]].place = i
        i = above
    heap[i] = state
    states[state].place = i


@kernel(inline="always")
def pop(states: Records, heap: IntArray, size: int) -> int:
    """Take the first state out of a heap of `size`."""
    top = heap[0]
    states[top].place = NOT_IN_HEAP
    size -= 1
    if size == 0:
        return top
    state = heap[size]
    i = 0
    while True:
        below = 2 * i + 1
        if below >= size:
            break
        if below + 1 < size and _before(states, heap[below + 1], heap[below]):
            below += 1
        if not _before(states, heap[below], state):
            break
        heap[i] = heap[below]
        states[heap[i]].place = i
        i = below
    heap[i] = state
    states[state].place = i
    return top
