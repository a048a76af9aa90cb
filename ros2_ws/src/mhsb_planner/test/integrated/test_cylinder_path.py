"""Costs of routes, against all sequences of patterns with the costs of their steps."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from tests.support.lower_bounds import energy_lower_bound

from mhsb_model.holding import MAX_HELD_SPEED, choose_holding_modes
from mhsb_model.hydraulics import compute_required_pressure
from mhsb_model.modes import Mode
from mhsb_planner.integrated.cylinder_path import (
    BOOST_RESERVE,
    PathPieces,
    compute_pieces,
    cost_model,
    new_path_cost_buffers,
    price_path,
    to_discrete_path,
    without_leakage_cost,
)
from mhsb_planner.posture.s1_polytope import compute_polytope_area
from mhsb_planner.search.discrete_path import SearchStatistics
from mhsb_planner.search.manipulability_loss import AreaTerm
from mhsb_planner.search.s2_step import ENERGY_SERIES_COLUMN, compute_step_costs

NOTHING = SearchStatistics(0, 0, 0.0)


def path_along(machine, t, via, start):
    pieces = PathPieces(*compute_pieces(t, new_path_cost_buffers(t), via, start))
    assert pieces.cost == price_path(t, new_path_cost_buffers(t), via, start, np.inf)
    assert pieces.tip == pytest.approx(machine.tip_positions(pieces.posture), abs=1e-12)
    modes = np.zeros(machine.joint_count, dtype=np.uint8)
    return to_discrete_path(t, pieces, pieces.cost, modes, NOTHING)


def possible_routes(machine, terms, posture_within, count, stroke):
    """Routes of one corner with a stroke of so many metres, on which there is a way."""
    random = np.random.default_rng(0)
    while count:
        start = posture_within(machine, random)
        here = machine.cylinder_lengths(start)
        via = np.array([here, here, here])
        via[1:] += random.uniform(-stroke, stroke, (2, machine.joint_count))
        ends = np.array([machine.cylinder_lengths(q) for q in joint_limits(machine)])
        via = np.clip(via, ends.min(axis=0), ends.max(axis=0))
        if np.isfinite(price_path(terms, new_path_cost_buffers(terms), via, start, np.inf)):
            count -= 1
            yield start, via


def switches_at_end(machine, path):
    """To the modes that hold the arm."""
    hold = choose_holding_modes(machine, machine.piston_forces(path.posture[-1]))
    return int(np.count_nonzero(path.modes[-1] != hold))


def joint_limits(machine):
    return machine.arrays.joint_min, machine.arrays.joint_max


def test_the_modes_along_a_route_are_the_best_of_all_sequences(arm, terms_of, posture_within):
    t = terms_of(arm)
    for start, via in possible_routes(arm, t, posture_within, 12, stroke=3e-3):
        path = path_along(arm, t, via, start)
        steps = [
            compute_step_costs(arm, *ends, MAX_HELD_SPEED)
            for ends in itertools.pairwise(path.posture)
        ]
        hold = choose_holding_modes(arm, arm.piston_forces(path.posture[-1]))
        usable = [np.flatnonzero(step.admissible) for step in steps]
        best = np.inf
        for sequence in itertools.product(*usable):
            modes = np.vstack([[0, 0, 0], arm.patterns[list(sequence)], hold]).astype(int)
            cost = 2.0 * np.count_nonzero(np.diff(modes, axis=0))
            for p, step in zip(sequence, steps, strict=True):
                cost += 0.5 * step.energy[p] + step.duration[p]
            best = min(best, cost)
        assert path.cost == pytest.approx(best, rel=1e-9)


def test_the_path_of_a_route_consists_of_steps_with_their_costs(arm, terms_of, posture_within):
    t = terms_of(arm)
    for start, via in possible_routes(arm, t, posture_within, 10, stroke=15e-3):
        path = path_along(arm, t, via, start)
        for k, ends in enumerate(itertools.pairwise(path.posture)):
            p = int(np.flatnonzero((arm.patterns == path.modes[k]).all(axis=1))[0])
            step = compute_step_costs(arm, *ends, MAX_HELD_SPEED)
            assert step.admissible[p]
            assert path.energy[k] == pytest.approx(step.energy[p], rel=1e-9)
            assert path.energy_series[k] == pytest.approx(step.energy_series[p], rel=1e-9)
            assert path.duration[k] == pytest.approx(step.duration[p], rel=1e-9)
        total = 0.5 * path.energy.sum() + path.duration.sum() + 2.0 * path.switches
        total += 2.0 * switches_at_end(arm, path)
        assert path.cost == pytest.approx(total, rel=1e-9)


def test_loads_that_are_held_cost_boost_as_in_the_motion(arm, terms_of, posture_within):
    """Two cylinders rest: on loads above P_S they are boosted, and pay p_L/η for what leaks."""
    t, m, boosted = terms_of(arm), arm.arrays, 0
    for start, via in possible_routes(arm, t, posture_within, 60, stroke=4e-3):
        via[1:, 1:] = via[0, 1:]
        if not np.isfinite(price_path(t, new_path_cost_buffers(t), via[:2], start, np.inf)):
            continue
        path = path_along(arm, t, via[:2], start)
        for k, ends in enumerate(itertools.pairwise(path.posture)):
            forces = [arm.piston_forces(q) for q in (ends[0], np.mean(ends, axis=0), ends[1])]
            for j in (1, 2):
                needed = max(compute_required_pressure(m, j, force[j], 0.0) for force in forces)
                wanted = m.supply_pressure < needed <= m.max_boost_pressure
                assert wanted <= (path.modes[k, j] != Mode.N)
                boosted += wanted
    assert boosted > 10


def test_a_route_that_never_turns_back_in_n_costs_the_lower_bound(arm, terms_of, posture_within):
    t = terms_of(arm, weights=(1.0, 0.0, 0.0))
    found = 0
    for start, via in possible_routes(arm, t, posture_within, 100, stroke=10e-3):
        straight = via[[0, 2]]
        if not np.isfinite(price_path(t, new_path_cost_buffers(t), straight, start, np.inf)):
            continue
        path = path_along(arm, t, straight, start)
        if not path.modes.any():
            bound = energy_lower_bound(arm, start, path.posture[-1:])
            assert path.energy.sum() == pytest.approx(bound, rel=1e-9)
            found += 1
    assert found > 10


def test_a_route_out_of_the_workspace_is_none(arm, terms_of, posture_within):
    t = terms_of(arm)
    refused = 0
    for start, via in possible_routes(arm, t, posture_within, 10, stroke=10e-3):
        radius = np.hypot(*path_along(arm, t, via, start).tip.T)
        if radius[1:-1].max() > radius[0] + 1e-3:
            smaller = arm.arrays._replace(max_radius=0.5 * (radius[0] + radius.max()))
            narrow = t._replace(machine=smaller)
            assert price_path(narrow, new_path_cost_buffers(narrow), via, start, np.inf) == np.inf
            assert compute_pieces(narrow, new_path_cost_buffers(narrow), via, start)[0] == np.inf
            refused += 1
    assert refused > 0


def test_a_limit_that_the_cost_reaches_ends_the_pricing(arm, terms_of, posture_within):
    t = terms_of(arm)
    for start, via in possible_routes(arm, t, posture_within, 5, stroke=10e-3):
        cost = price_path(t, new_path_cost_buffers(t), via, start, np.inf)
        assert price_path(t, new_path_cost_buffers(t), via, start, 1.001 * cost) == cost
        assert price_path(t, new_path_cost_buffers(t), via, start, 0.999 * cost) == np.inf


def test_with_a_weight_the_area_lost_in_the_middle_of_each_piece_counts_in_its_modes(
    arm, terms_of, posture_within
):
    term = AreaTerm(400.0, 0.25)
    t = terms_of(arm, area=term)
    margin = arm.arrays.boost_margin + BOOST_RESERVE
    careful = replace(arm, arrays=arm.arrays._replace(boost_margin=margin))
    for start, via in possible_routes(arm, t, posture_within, 8, stroke=3e-3):
        path = path_along(arm, t, via, start)
        best = np.inf
        pairs = list(itertools.pairwise(path.posture))
        steps = [compute_step_costs(careful, *ends, MAX_HELD_SPEED) for ends in pairs]
        hold = choose_holding_modes(arm, arm.piston_forces(path.posture[-1]))
        lost = [lost_areas(arm, term, *ends) for ends in pairs]
        for sequence in itertools.product(*(np.flatnonzero(step.admissible) for step in steps)):
            modes = np.vstack([[0, 0, 0], arm.patterns[list(sequence)], hold]).astype(int)
            cost = 2.0 * np.count_nonzero(np.diff(modes, axis=0))
            for p, step, area in zip(sequence, steps, lost, strict=True):
                cost += 0.5 * step.energy[p] + step.duration[p] + area[p]
            best = min(best, cost)
        assert path.cost == pytest.approx(best, rel=1e-9)


def lost_areas(arm, term, start, end):
    """w₄ M of a short step in every pattern."""
    way = np.linalg.norm(arm.tip_position(end) - arm.tip_position(start))
    middle = 0.5 * (start + end)
    areas = np.array([compute_polytope_area(arm, middle, pattern) for pattern in arm.patterns])
    return term.weight * way * np.maximum(0.0, 1.0 - areas / term.reference)


def test_without_a_weight_nothing_looks_at_the_area(arm, terms_of, posture_within):
    t, blind = terms_of(arm), terms_of(arm, area=AreaTerm(0.0, np.nan))
    for start, via in possible_routes(arm, t, posture_within, 5, stroke=10e-3):
        cost = price_path(t, new_path_cost_buffers(t), via, start, np.inf)
        assert price_path(blind, new_path_cost_buffers(blind), via, start, np.inf) == cost


def test_without_the_cost_of_leakage_the_slip_of_servo_pumps_costs_nothing(machine):
    slipping = machine.with_values({"hydraulics.servo_pump.slip_flow": 5e-6})
    start = np.array(machine.config.simulation.start_posture)
    costs = []
    for each in (machine, slipping):
        weight, modes = np.array([1.0, 0.0, 0.0]), np.full(3, Mode.DB, np.uint8)
        t = cost_model(each, modes, weight, ENERGY_SERIES_COLUMN)
        route = machine.cylinder_lengths(start) + [[0.0] * 3, [0.02, 0.02, 0.02]]
        costs.append(
            [
                price_path(terms, new_path_cost_buffers(terms), route, start, np.inf)
                for terms in (t, without_leakage_cost(t))
            ]
        )
    (counted, free), (more, free_too) = costs
    assert more > counted > free
    assert free_too == free
