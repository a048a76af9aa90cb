"""A frontier on a small graph: order, reopening, and the way found."""

import numpy as np

from mhsb_planner.search.frontier import (
    NOWHERE,
    WAITING,
    empty_frontier,
    reach,
    take_first,
    way_to_goal,
)


def test_the_waiting_state_with_the_least_estimate_is_taken_first_and_then_none():
    frontier = empty_frontier(3)
    reach(frontier, 0, NOWHERE, 1, 1.0, 5.0)
    reach(frontier, 1, NOWHERE, 1, 3.0, 1.0)
    assert frontier.counts[WAITING] == 2
    assert [take_first(frontier) for _ in range(3)] == [1, 0, NOWHERE]
    assert frontier.states.cost[:2].tolist() == [1.0, 3.0]
    assert np.isinf(frontier.states.cost[2])


def test_a_state_reached_more_cheaply_moves_up_and_one_that_was_expanded_waits_again():
    frontier = empty_frontier(2)
    reach(frontier, 0, NOWHERE, 1, 4.0, 0.0)
    reach(frontier, 1, NOWHERE, 1, 3.0, 0.0)
    reach(frontier, 0, 1, 2, 2.0, 0.0)
    assert frontier.counts[WAITING] == 2
    assert take_first(frontier) == 0
    reach(frontier, 0, 1, 2, 1.0, 0.0)
    assert [take_first(frontier), take_first(frontier)] == [0, 1]


def test_the_way_to_the_goal_leads_back_over_the_parents():
    frontier = empty_frontier(4)
    reach(frontier, 2, NOWHERE, 1, 1.0, 0.0)
    reach(frontier, 0, 2, 2, 2.0, 0.0)
    reach(frontier, 4, 0, 3, 3.0, 0.0)
    assert way_to_goal(frontier).tolist() == [2, 0, 4]
