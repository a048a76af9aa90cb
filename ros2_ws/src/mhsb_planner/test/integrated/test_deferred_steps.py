"""Deferred steps, against a list of all of them."""

import math

import numpy as np
import pytest

from mhsb_planner.integrated.deferred_steps import (
    BUCKETS_PER_START_BOUND,
    NO_STEP,
    create_deferred_steps,
    defer_step,
    take_due_step,
)


@pytest.mark.parametrize("start_bound", [50.0, 0.0])
def test_each_step_is_taken_once_and_before_a_state_with_a_higher_estimate(start_bound):
    random, deferred, waiting = np.random.default_rng(7), create_deferred_steps(400), {}
    deferred.start_bound[0] = start_bound
    width = start_bound / BUCKETS_PER_START_BOUND
    for k, estimate in enumerate([*random.uniform(40.0, 180.0, 40), math.inf]):
        for number in range(10 * k, min(10 * k + 10, 400)):
            cost, lower_bound = random.uniform(0.0, 100.0, 2)
            defer_step(deferred, number, 2 * number, cost, lower_bound)
            waiting[number] = cost, cost + lower_bound
        while (number := take_due_step(deferred, estimate)) != NO_STEP:
            step, (cost, own) = deferred.records[number], waiting.pop(number)
            assert (step["origin"], step["row"], step["cost"]) == (number, 2 * number, cost)
            assert start_bound == 0.0 or own <= max(estimate, start_bound) + width
        assert all(own > estimate for _, own in waiting.values())
    assert not waiting
