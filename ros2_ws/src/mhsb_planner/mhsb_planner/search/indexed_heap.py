"""A binary heap of numbered states that knows where each of them is, for A* in kernels.

The state with the least estimate is first, of equals that with the fewest steps, then the least
number. `place` holds each state's position in `heap`, NOT_IN_HEAP where it is not there. The
functions take plain arrays: handing a tuple of arrays over costs more than they do.
"""

from __future__ import annotations

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray

NOT_IN_HEAP = -1


@kernel(inline="always")
def _before(estimate: FloatArray, depth: IntArray, a: int, b: int) -> bool:
    if estimate[a] != estimate[b]:
        return estimate[a] < estimate[b]
    if depth[a] != depth[b]:
        return depth[a] < depth[b]
    return a < b


@kernel(inline="always")
def sift_up(
    estimate: FloatArray, depth: IntArray, heap: IntArray, place: IntArray, i: int, state: int
) -> None:
    """Put a state into the heap at i or above; i is the heap's size for a new one."""
    while i > 0:
        above = (i - 1) // 2
        if not _before(estimate, depth, state, heap[above]):
            break
        heap[i] = heap[above]
        place[heap[i]] = i
        i = above
    heap[i] = state
    place[state] = i


@kernel(inline="always")
def pop(estimate: FloatArray, depth: IntArray, heap: IntArray, place: IntArray, size: int) -> int:
    """Take the first state out of a heap of `size`."""
    top = heap[0]
    place[top] = NOT_IN_HEAP
    size -= 1
    if size == 0:
        return top
    state = heap[size]
    i = 0
    while True:
        below = 2 * i + 1
        if below >= size:
            break
        if below + 1 < size and _before(estimate, depth, heap[below + 1], heap[below]):
            below += 1
        if not _before(estimate, depth, heap[below], state):
            break
        heap[i] = heap[below]
        place[heap[i]] = i
        i = below
    heap[i] = state
    place[state] = i
    return top
