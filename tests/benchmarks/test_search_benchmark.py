"""What the figures of the search are made of: mirrored arms, scenes, and a truth by other means."""

import itertools
import math

import numpy as np
import pytest
from benchmarks.scenes import CLEARANCE, random_scenes
from benchmarks.search_benchmark import mirror_linkages

from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_planner.integrated.integrated_search import search
from mhsb_planner.planner import Planner
from mhsb_planner.search.s2_search import PathQuery, Weights
from mhsb_planner.search.s2_step import compute_step_costs
from mhsb_tools.comparison.least_cost import _Pricing as Pricing
from mhsb_tools.comparison.least_cost import search_least_cost

WEIGHTS = Weights(0.5, 1.0, 2.0)
NORMAL = np.zeros(3, dtype=np.uint8)
OWN = {
    "joints.0.actuator.rated_flow": 5e-5,
    "joints.1.actuator.max_piston_speed": 0.005,
    "joints.2.actuator": {"rated_flow": 3e-5, "max_piston_speed": 0.008},
}


def test_a_mirrored_arm_has_the_same_arms_with_the_other_sign(
    machine, four_bar_machine, slider_crank_machine
):
    for arm in (machine, four_bar_machine, slider_crank_machine):
        mirrored, m = mirror_linkages(arm), arm.arrays
        for share in np.linspace(0.0, 1.0, 7):
            q = m.joint_min + share * (m.joint_max - m.joint_min)
            seen = m.joint_min + m.joint_max - q
            assert mirrored.moment_arms(seen) == pytest.approx(-arm.moment_arms(q), abs=1e-9)
            assert mirrored.cylinder_lengths(seen) == pytest.approx(arm.cylinder_lengths(q))


@pytest.mark.parametrize("rest_speed", [0.0, MAX_HELD_SPEED])
@pytest.mark.parametrize("own", [{}, OWN], ids=["common", "own"])
def test_prices_are_the_planner_s(machine, own, rest_speed):
    machine = machine.with_values(own)
    random, pricing = np.random.default_rng(0), Pricing(machine, WEIGHTS, rest_speed)
    low, high = machine.arrays.joint_min, machine.arrays.joint_max
    compared = 0
    for _ in range(200):
        start = random.uniform(low, high)
        turns = random.uniform(-0.1, 0.1, 3) * (random.random(3) < 0.7)
        ends = np.array([start, np.clip(start + turns, low, high)])
        postures = np.array([ends[0], ends.mean(axis=0), ends[1]])
        if not turns.any() or pricing.workspace_violation(postures).max() > -0.01:
            continue
        step = compute_step_costs(machine, *ends, rest_speed)
        expected = np.where(step.admissible, 0.5 * step.energy + step.duration, np.inf)
        forces = tuple(pricing.forces(postures, pricing.arms(postures))[:, None, :])
        lengths = pricing.lengths(ends)
        cost = pricing.price_steps(lengths[1:] - lengths[:1], forces)[0]
        assert cost == pytest.approx(expected, rel=1e-9)
        compared += 1
    assert compared > 50


@pytest.mark.slow
def test_another_way_to_the_least_cost_comes_to_the_same(machine):
    """In N both meet the lower bound; a little more where the lattice makes cylinders rest."""
    light = machine.changed(payload=0.0)
    start = np.array([0.3, -1.4, -0.5])
    goal = tuple(light.tip_position(start + [0.15, 0.1, -0.1]))
    path = search(light, PathQuery(start, NORMAL, goal, WEIGHTS))
    cost, via = search_least_cost(light, start, goal, WEIGHTS, 1.2 * path.cost)
    assert cost == pytest.approx(path.cost, rel=0.03)
    assert via[0] == pytest.approx(light.cylinder_lengths(start))
    assert np.abs(np.diff(via, axis=0)).max() < 2.6e-3
    assert search_least_cost(light, start, goal, WEIGHTS, 0.9 * path.cost) == (math.inf, None)


def test_scenes_are_clear_at_their_starts_and_the_same_every_time(machine, table):
    planner = Planner(machine, table)
    one, other = (list(random_scenes(planner, 2)) for _ in range(2))
    for scene, again in zip(one, other, strict=True):
        assert scene.machine.zones == again.machine.zones
        assert scene.move.goal == again.move.goal
        assert scene.machine.clearance(scene.move.start)[0] > CLEARANCE
    assert all(a.move.goal != b.move.goal for a, b in itertools.pairwise(one))
