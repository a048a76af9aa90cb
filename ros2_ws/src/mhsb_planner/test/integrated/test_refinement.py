"""Small changes to a route: kept where they pay, and only there."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mhsb_model.files.config_files import find_config_file
from mhsb_model.holding import choose_holding_modes
from mhsb_model.machine import load_machine
from mhsb_planner.integrated.cylinder_path import (
    compute_costs_to_go,
    cost_model,
    new_path_cost_buffers,
    price_path,
)
from mhsb_planner.integrated.goal_postures import sample_goal_postures
from mhsb_planner.integrated.refinement import (
    Strides,
    SweptPath,
    compute_goal_lengths,
    remove_waypoints,
    sweep_waypoints,
)


def random_route(machine, terms, posture_within, seed, corners=3):
    """A possible route with corners beside the straight line, its start and its goal posture."""
    random = np.random.default_rng(seed)
    low, high = (machine.cylinder_lengths(q) for q in limits(machine))
    while True:
        start, end = posture_within(machine, random), posture_within(machine, random)
        here, there = machine.cylinder_lengths(start), machine.cylinder_lengths(end)
        via = here + np.linspace(0, 1, corners + 2)[:, None] * (there - here)
        via[1:-1] += random.uniform(-3e-3, 3e-3, (corners, 3))
        via = np.clip(via, np.minimum(low, high), np.maximum(low, high))
        cost = price_path(terms, new_path_cost_buffers(terms), via, start, np.inf)
        if np.isfinite(cost):
            return start, via, end, cost


def limits(machine):
    return machine.arrays.joint_min, machine.arrays.joint_max


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_a_sweep_never_makes_a_route_dearer_and_tells_its_cost(
    machine, terms_of, posture_within, seed
):
    t = terms_of(machine)
    start, via, end, cost = random_route(machine, t, posture_within, seed)
    tip = tuple(machine.tip_position(end))
    elbow, free = (1 if end[1] > 0 else -1), end.sum(keepdims=True)
    turn = np.array([0.05])
    path = SweptPath(via, start, tip, elbow, free)
    moved = sweep_waypoints(t, new_path_cost_buffers(t), path, cost, Strides(2e-3, turn))
    assert moved <= cost
    assert moved == pytest.approx(
        price_path(t, new_path_cost_buffers(t), via, start, np.inf), rel=1e-12
    )
    length = np.empty(3)
    assert compute_goal_lengths(t, tip, elbow, free, length)
    assert via[-1] == pytest.approx(length, abs=1e-9)
    ends = np.sort([machine.cylinder_lengths(q) for q in limits(machine)], axis=0)
    assert np.all((via[1:-1] >= ends[0]) & (via[1:-1] <= ends[1]))


def test_what_is_behind_a_corner_and_what_is_ahead_add_up_to_the_whole(
    machine, terms_of, posture_within
):
    t = terms_of(machine)
    w = new_path_cost_buffers(t)
    for seed in range(5):
        start, via, _, cost = random_route(machine, t, posture_within, seed)
        ahead = compute_costs_to_go(t, w, via, start)
        for i in range(1, len(via)):
            price_path(t, w, via[: i + 1], start, np.inf)
            hold = choose_holding_modes(machine, w.points.force[0])
            to_hold = t.weight[2] * np.count_nonzero(machine.patterns != hold, axis=1)
            behind = w.value[0, :-1] - to_hold
            assert np.min(behind + ahead[i]) == pytest.approx(cost, rel=1e-12)


def test_a_route_that_is_not_possible_stays_as_it_is(machine, terms_of, posture_within):
    t = terms_of(machine)
    start, via, end, _ = random_route(machine, t, posture_within, 0)
    tip, elbow = tuple(machine.tip_position(end)), (1 if end[1] > 0 else -1)
    free, turn, before = end.sum(keepdims=True), np.array([0.05]), via.copy()
    path = SweptPath(via, start, tip, elbow, free)
    cost = sweep_waypoints(t, new_path_cost_buffers(t), path, np.inf, Strides(2e-3, turn))
    assert (cost, free[0]) == (np.inf, end.sum())
    assert np.array_equal(via, before)


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_a_shortcut_has_fewer_corners_and_costs_no_more(machine, terms_of, posture_within, seed):
    t = terms_of(machine)
    start, via, _, cost = random_route(machine, t, posture_within, seed)
    shorter, less = remove_waypoints(t, new_path_cost_buffers(t), via, start, cost)
    assert len(shorter) <= len(via)
    assert less <= cost
    price = price_path(t, new_path_cost_buffers(t), shorter, start, np.inf)
    assert price == pytest.approx(less, rel=1e-8)
    assert np.all(shorter[[0, -1]] == via[[0, -1]])


def test_sweeps_lead_a_detour_in_n_back_to_the_lower_bound(machine, terms_of, posture_within):
    t = terms_of(machine, weights=(1.0, 0.0, 0.0))
    for seed in range(100):
        start, via, end, cost = random_route(machine, t, posture_within, seed, corners=1)
        straight = price_path(t, new_path_cost_buffers(t), via[[0, 2]], start, np.inf)
        if straight > 0.99 * cost:
            continue
        tip, elbow = tuple(machine.tip_position(end)), (1 if end[1] > 0 else -1)
        path, stay = SweptPath(via, start, tip, elbow, end.sum(keepdims=True)), np.zeros(1)
        for stroke in np.repeat([1e-3, 3e-4, 1e-4, 3e-5], 6):
            cost = sweep_waypoints(t, new_path_cost_buffers(t), path, cost, Strides(stroke, stay))
        assert cost <= 1.02 * straight
        return
    pytest.fail("no route with a detour was drawn")


def test_sweeps_of_four_joints_end_where_no_goal_posture_around_is_cheaper():
    machine = load_machine(find_config_file("mhsb_arm4.yaml"))
    start, goal = np.array([0.3, -1.4, -1.2, -0.5]), (0.60, 0.25)
    t = cost_model(machine, np.zeros(4, dtype=np.uint8), np.array([0.5, 0.0, 2.0]), 1)
    w, goals, length = new_path_cost_buffers(t), sample_goal_postures(machine, *goal), np.empty(4)
    compared, turn = 0, 0.03
    for end, elbow, free in zip(goals.length, goals.elbow, goals.free.copy(), strict=True):
        via = np.array([machine.cylinder_lengths(start), end])
        before, cost = np.inf, price_path(t, w, via, start, np.inf)
        path = SweptPath(via, start, goal, int(elbow), free)
        while cost < before:
            before, strides = cost, Strides(1e-3, np.full(2, turn))
            cost = sweep_waypoints(t, w, path, cost, strides)
        if cost == np.inf:
            continue
        for change in itertools.product((-turn, 0.0, turn), repeat=2):
            if compute_goal_lengths(t, goal, int(elbow), path.free + change, length):
                line = np.array([via[0], length])
                assert price_path(t, w, line, start, np.inf) >= cost * (1.0 - 1e-9)
                compared += 1
    assert compared > 20
