"""The heap of states, against sorting."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mhsb_planner.search.indexed_heap import NOT_IN_HEAP, pop, sift_up


@given(keys=st.lists(st.tuples(st.integers(0, 5), st.integers(0, 3)), min_size=1, max_size=40))
def test_states_come_out_in_order_of_estimate_steps_and_number(keys):
    estimate = np.array([key[0] for key in keys], dtype=float)
    depth = np.array([key[1] for key in keys])
    heap, place = np.empty(len(keys), dtype=np.int64), np.full(len(keys), NOT_IN_HEAP)
    for state in range(len(keys)):
        sift_up(estimate, depth, heap, place, state, state)
    out = [pop(estimate, depth, heap, place, size) for size in range(len(keys), 0, -1)]
    assert out == sorted(range(len(keys)), key=lambda state: (*keys[state], state))
    assert np.all(place == NOT_IN_HEAP)


@given(
    first=st.lists(st.floats(0, 10), min_size=2, max_size=20),
    which=st.integers(0, 19),
    less=st.floats(0, 10),
)
def test_a_state_whose_estimate_falls_moves_up(first, which, less):
    estimate = np.array(first)
    depth = np.zeros(len(first), dtype=np.int64)
    heap, place = np.empty(len(first), dtype=np.int64), np.full(len(first), NOT_IN_HEAP)
    for state in range(len(first)):
        sift_up(estimate, depth, heap, place, state, state)
    state = which % len(first)
    estimate[state] -= less
    sift_up(estimate, depth, heap, place, int(place[state]), state)
    out = [pop(estimate, depth, heap, place, size) for size in range(len(first), 0, -1)]
    assert list(estimate[out]) == sorted(estimate)
