"""The paper's solver, beside the global search."""

import numpy as np
import pytest

from mhsb_model.inverse_kinematics.closed_form_3r import is_within_limits
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.posture.s1_polytope import compute_polytope_area
from mhsb_planner.posture.s1_slsqp import find_largest_polytope_by_slsqp, search_by_slsqp


def assert_global_search_is_as_good(machine, table, nodes, patterns_of):
    for node in nodes:
        x, z = table.nodes[node] * table.spacing
        for p in patterns_of(node):
            q, area = find_largest_polytope_by_slsqp(machine, x, z, table.patterns[p], seed=int(p))
            assert is_within_limits(machine.arrays, q)
            assert machine.tip_position(q) == pytest.approx((x, z), abs=1e-12)
            assert area == compute_polytope_area(machine, q, table.patterns[p])
            assert table.area[node, p] >= area * (1 - 1e-6)


def test_the_global_search_is_at_least_as_good_on_a_sample(machine, table):
    rng = np.random.default_rng(21)
    nodes = rng.choice(np.flatnonzero(table.feasible), 25, replace=False)
    assert_global_search_is_as_good(machine, table, nodes, lambda node: [rng.integers(23)])


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_global_search_is_at_least_as_good_in_every_entry(machine, table):
    nodes = np.flatnonzero(table.feasible)
    assert_global_search_is_as_good(machine, table, nodes, lambda node: range(23))


def test_the_same_seed_gives_the_same_posture(machine, table):
    pattern = table.patterns[3]
    first, again = (
        find_largest_polytope_by_slsqp(machine, 0.6, 0.2, pattern, seed=7) for _ in range(2)
    )
    assert np.array_equal(first[0], again[0])
    assert first[1] == again[1]


def test_where_there_is_no_posture_it_finds_none(machine, table):
    x, z = table.nodes[~table.feasible][0] * table.spacing
    assert find_largest_polytope_by_slsqp(machine, x, z, table.patterns[0], seed=0) is None


def test_it_can_build_a_table(machine):
    table = build_posture_table(machine, spacing=0.5, solver=search_by_slsqp)
    best = build_posture_table(machine, spacing=0.5)
    assert np.array_equal(table.feasible, best.feasible)
    assert np.all(best.area[best.feasible] >= table.area[best.feasible] * (1 - 1e-6))
