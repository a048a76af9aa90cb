"""The heap of states, against sorting."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mhsb_planner.search.open_list import NOT_IN_HEAP, create_open_list, pop, sift_up


@given(keys=st.lists(st.tuples(st.integers(0, 5), st.integers(0, 3)), min_size=1, max_size=40))
def test_states_come_out_in_order_of_estimate_steps_and_number(keys):
    states, heap = create_open_list(len(keys))[:2]
    for state, (estimate, depth) in enumerate(keys):
        states[state].estimate, states[state].depth = estimate, depth
        sift_up(states, heap, state, state)
    out = [pop(states, heap, size) for size in range(len(keys), 0, -1)]
    assert out == sorted(range(len(keys)), key=lambda state: (*keys[state], state))
    assert np.all(states.place == NOT_IN_HEAP)


@given(
    first=st.lists(st.floats(0, 10), min_size=2, max_size=20),
    which=st.integers(0, 19),
    less=st.floats(0, 10),
)
def test_a_state_whose_estimate_falls_moves_up(first, which, less):
    states, heap = create_open_list(len(first))[:2]
    for state, estimate in enumerate(first):
        states[state].estimate = estimate
        sift_up(states, heap, state, state)
    state = which % len(first)
    states[state].estimate -= less
    sift_up(states, heap, int(states[state].place), state)
    out = [pop(states, heap, size) for size in range(len(first), 0, -1)]
    found = states.estimate[out].tolist()
    assert found == sorted(states.estimate[: len(first)].tolist())
