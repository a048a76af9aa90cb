"""Binary heap of numbered cells, ordered by least bound, then by least number.

Numba would compile `heapq`, with lists and their error messages, again for each kernel that calls
it.
"""

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray


@kernel(borrows=True, forceinline=True)
def _precedes(bound: FloatArray, a: int, b: int) -> bool:
    """Return whether cell a precedes cell b in the heap order.

    Args:
        bound: Bound of each cell.
        a: Number of a cell.
        b: Number of another cell.

    Returns:
        True if cell a has the smaller bound, or an equal bound and the smaller number.
    """
    return bound[a] < bound[b] or (bound[a] == bound[b] and a < b)


@kernel(borrows=True, forceinline=True)
def push_cell(bound: FloatArray, heap: IntArray, size: int, cell: int) -> None:
    """Insert a cell into the heap. The caller must increase its count of cells by 1.

    Args:
        bound: Bound of each cell, not NaN.
        heap: Cell numbers in heap order, with room for one more cell. Written in place.
        size: Number of cells in the heap before the call.
        cell: Number of the cell.
    """
    i = size
    while i > 0:
        above = (i - 1) // 2
        if not _precedes(bound, cell, heap[above]):
            break
        heap[i] = heap[above]
        i = above
    heap[i] = cell


@kernel(borrows=True, forceinline=True)
def pop_cell(bound: FloatArray, heap: IntArray, size: int) -> int:
    """Remove the cell of least bound from the heap.

    Among cells of equal bound, the cell of least number is removed. The caller must reduce its
    count of cells by 1.

    Args:
        bound: Bound of each cell, not NaN.
        heap: Cell numbers in heap order. Written in place.
        size: Number of cells in the heap before the call, at least 1.

    Returns:
        Number of the removed cell.
    """
    first: int = heap[0]
    last: int = heap[size - 1]
    i, below = 0, 1
    while below < size - 1:
        if below + 1 < size - 1 and _precedes(bound, heap[below + 1], heap[below]):
            below += 1
        if not _precedes(bound, heap[below], last):
            break
        heap[i] = heap[below]
        i, below = below, 2 * below + 1
    heap[i] = last
    return first
