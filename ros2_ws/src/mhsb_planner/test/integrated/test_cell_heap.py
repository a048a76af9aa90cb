"""The heap of cells, against Python's heapq."""

import heapq

import numpy as np
import pytest

from mhsb_planner.integrated.cell_heap import pop_cell, push_cell


@pytest.mark.parametrize("seed", range(10))
def test_cells_leave_the_heap_in_the_order_of_heapq(seed):
    random = np.random.default_rng(seed)
    bound = random.integers(0, 20, 200).astype(float)  # many are equal
    heap, size, others = np.empty(200, dtype=np.int64), 0, []
    for cell in range(200):
        push_cell(bound, heap, size, cell)
        heapq.heappush(others, (bound[cell], cell))
        size += 1
        while size and random.random() < 0.4:
            assert pop_cell(bound, heap, size) == heapq.heappop(others)[1]
            size -= 1
    for left in range(size, 0, -1):
        assert pop_cell(bound, heap, left) == heapq.heappop(others)[1]
