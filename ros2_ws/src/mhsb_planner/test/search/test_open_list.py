"""A frontier on a small graph: order, reopening, and the way found."""

import heapq

import numpy as np
import pytest

from mhsb_planner.search.open_list import (
    NO_STATE,
    WAITING_COUNT,
    create_open_list,
    pop_first_state,
    record_path_to,
    trace_path_to_goal,
)


def test_the_waiting_state_with_the_least_estimate_is_taken_first_and_then_none():
    frontier = create_open_list(3)
    record_path_to(frontier, 0, NO_STATE, 1, 1.0, 5.0)
    record_path_to(frontier, 1, NO_STATE, 1, 3.0, 1.0)
    assert frontier.counts[WAITING_COUNT] == 2
    assert [pop_first_state(frontier) for _ in range(3)] == [1, 0, NO_STATE]
    assert frontier.states.cost[:2].tolist() == [1.0, 3.0]
    assert np.isinf(frontier.states.cost[2])


def test_a_state_reached_more_cheaply_moves_up_and_one_that_was_expanded_waits_again():
    frontier = create_open_list(2)
    record_path_to(frontier, 0, NO_STATE, 1, 4.0, 0.0)
    record_path_to(frontier, 1, NO_STATE, 1, 3.0, 0.0)
    record_path_to(frontier, 0, 1, 2, 2.0, 0.0)
    assert frontier.counts[WAITING_COUNT] == 2
    assert pop_first_state(frontier) == 0
    record_path_to(frontier, 0, 1, 2, 1.0, 0.0)
    assert [pop_first_state(frontier), pop_first_state(frontier)] == [0, 1]


def test_the_way_to_the_goal_leads_back_over_the_parents():
    frontier = create_open_list(4)
    record_path_to(frontier, 2, NO_STATE, 1, 1.0, 0.0)
    record_path_to(frontier, 0, 2, 2, 2.0, 0.0)
    record_path_to(frontier, 4, 0, 3, 3.0, 0.0)
    assert trace_path_to_goal(frontier).tolist() == [2, 0, 4]


@pytest.mark.parametrize("seed", range(10))
def test_states_are_taken_in_the_order_of_heapq(seed):
    random = np.random.default_rng(seed)
    cost = random.integers(0, 20, 200).astype(float).tolist()  # many are equal
    frontier, others = create_open_list(200), []
    for state in range(200):
        record_path_to(frontier, state, NO_STATE, 1, cost[state], 0.0)
        heapq.heappush(others, (cost[state], state))
        while others and random.random() < 0.4:
            assert pop_first_state(frontier) == heapq.heappop(others)[1]
    while others:
        assert pop_first_state(frontier) == heapq.heappop(others)[1]
    assert pop_first_state(frontier) == NO_STATE
