"""Plans that weigh the polytope's area against energy, and what a weight brings."""

import itertools

import numpy as np
import pytest

from mhsb_model.trajectory import MotionState
from mhsb_planner.cases.paper_cases import get_paper_case
from mhsb_planner.planner import Plan, Planner, PlanOptions
from mhsb_planner.search.manipulability_loss import (
    AreaProfile,
    compute_area_along_motion,
    compute_area_along_path,
)
from mhsb_planner.search.manipulability_loss import compute_reference_area as full_area

WEIGHTS = (0.0, 300.0, 1000.0, 3000.0, 10000.0)


@pytest.fixture(scope="module")
def planner(machine, table) -> Planner:
    return Planner(machine, table)


@pytest.fixture(scope="module")
def plans(planner) -> dict[float, Plan]:
    """Case 4 under ever more weight."""
    case = get_paper_case("4-1")
    start = MotionState.at_rest(case.start_posture(planner.machine))
    return {w4: planner.plan(case.goal, start, options=weighing(w4)) for w4 in WEIGHTS}


def weighing(w4: float, **options) -> PlanOptions:
    return PlanOptions(planner="integrated", area_weight=w4, **options)


def of_motion(planner, plan) -> AreaProfile:
    return compute_area_along_motion(planner.machine, plan.motion.trajectory, plan.motion.schedule)


def test_paths_cost_what_their_sums_and_their_shortfall_come_to(planner, plans):
    """Within what pieces of 2 mm leave of the shortfall's integral on a path of 85 steps."""
    full = full_area(planner.graph.table)
    for w4, plan in plans.items():
        path = plan.path
        sums = 0.5 * path.energy.sum() + 2.0 * path.switches
        shortfall = compute_area_along_path(planner.machine, path).compute_area_loss(full)
        assert path.cost == pytest.approx(sums + w4 * shortfall, rel=5e-3)


def test_more_weight_never_gives_less_area_nor_less_energy(planner, plans):
    """Points of a weak Pareto order: each is the cheapest of them all at its own weight."""
    full = full_area(planner.graph.table)
    profiles = {
        w4: compute_area_along_path(planner.machine, plan.path) for w4, plan in plans.items()
    }
    energy = [plan.path.energy.sum() for plan in plans.values()]
    lost = [profile.compute_area_loss(full) for profile in profiles.values()]
    mean = [profile.mean for profile in profiles.values()]
    for before, after in itertools.pairwise(range(len(WEIGHTS))):
        assert energy[after] >= 0.995 * energy[before]
        assert lost[after] <= 1.005 * lost[before]
        assert mean[after] >= 0.995 * mean[before]
    assert mean[-1] > 1.05 * mean[0]
    for (w4, plan), k in itertools.product(plans.items(), range(len(WEIGHTS))):
        assert plan.path.cost <= 1.02 * (0.5 * energy[k] + w4 * lost[k])


def test_the_motions_keep_the_area_of_their_paths(planner, plans):
    for plan in plans.values():
        path = compute_area_along_path(planner.machine, plan.path)
        assert of_motion(planner, plan).mean == pytest.approx(path.mean, rel=0.02)


@pytest.mark.parametrize(("moves", "fewest"), [(4, 1), pytest.param(8, 3, marks=pytest.mark.slow)])
def test_a_plan_costs_no_more_than_the_one_made_without_the_weight(planner, moves, fewest):
    random, table = np.random.default_rng(0), planner.graph.table
    full = full_area(table)
    compared = 0
    for here, there in random.choice(np.flatnonzero(table.feasible), (moves, 2)):
        start = MotionState.at_rest(table.posture[here, 0])
        goal = tuple(table.nodes[there] * table.spacing)
        without, options = planner.plan(goal, start, options=weighing(0.0)), weighing(500.0)
        assert without.area_shortfall == 0.0
        plan = planner.plan(goal, start, options=options)
        known = without.cost(weighing(0.0)) + 500.0 * of_motion(planner, without).compute_area_loss(
            full
        )
        assert plan.cost(options) <= known * (1 + 1e-9)
        assert plan.area_shortfall == of_motion(planner, plan).compute_area_loss(full)
        assert plan.lower_bound <= plan.energy.paper
        compared += plan.cost(options) < 0.999 * known
    assert compared >= fewest


def test_with_hardly_any_time_there_is_a_plan_that_weighs_the_area_all_the_same(planner, looks):
    case, options = get_paper_case("4-1"), weighing(1000.0)
    start = MotionState.at_rest(case.start_posture(planner.machine))
    deadline = looks.deadline_after(40)
    plan = planner.plan(case.goal, start, options=options, deadline=deadline)
    assert plan.path.statistics.out_of_time
    assert plan.area_shortfall > 0.0
    assert plan.cost(options) >= planner.plan(case.goal, start, options=options).cost(options)
