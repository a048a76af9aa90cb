"""What is lost of the polytope's area along a way, against hulls at many places of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from mhsb_model.trajectory import MotionState
from mhsb_planner.cases.paper_cases import get_paper_case
from mhsb_planner.errors import RequestError
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.posture.s1_polytope import list_piston_speed_corners
from mhsb_planner.search.manipulability_loss import (
    AreaProfile,
    AreaTerm,
    compute_area_along_motion,
    compute_area_along_path,
    compute_reference_area,
    compute_step_area_loss,
    create_area_cost,
)

FULL = 0.25


def hull_area(machine, q, modes):
    columns = machine.jacobian(q) / machine.moment_arms(q)
    return ConvexHull(list_piston_speed_corners(machine, q, modes) @ columns.T).volume


def lost(machine, postures, modes):
    """M by the trapezoidal rule over postures [k + 1, n], all of them in their modes [k + 1, n]."""
    tips = np.array([machine.tip_position(q) for q in postures])
    areas = np.array([hull_area(machine, *at) for at in zip(postures, modes, strict=True)])
    shares = np.maximum(0.0, 1.0 - areas / FULL)
    return float(np.hypot(*np.diff(tips, axis=0).T) @ (0.5 * (shares[1:] + shares[:-1])))


def test_a_path_loses_what_hulls_along_it_lose(machine, walk):
    for seed in range(2):
        path = walk(np.random.default_rng(seed), 3)
        along = 0.0
        for start, end, modes in zip(path.posture, path.posture[1:], path.modes, strict=False):
            way = start + np.linspace(0.0, 1.0, 60)[:, None] * (end - start)
            along += lost(machine, way, np.tile(modes, (60, 1)))
        assert compute_area_along_path(machine, path).compute_area_loss(FULL) == pytest.approx(
            along, rel=5e-3
        )


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), parts=st.integers(2, 9))
def test_a_path_loses_as_much_however_it_is_cut(machine, walk, seed, parts):
    path = walk(np.random.default_rng(seed), 3)
    places = np.arange(path.steps * parts + 1) / parts
    whole = np.arange(path.steps + 1)
    finer = replace(
        path,
        posture=np.array([np.interp(places, whole, angle) for angle in path.posture.T]).T,
        modes=np.repeat(path.modes, parts, axis=0),
        duration=np.repeat(path.duration / parts, parts),
    )
    one, other = (compute_area_along_path(machine, each) for each in (path, finer))
    # The area may jump on the way, and cuts move the place of the jump by half a part at most.
    jump = 0.5 * one.span.max() * np.abs(np.diff(one.area)).max(initial=0.0)
    lost_with_it = 1e-5 + jump / FULL
    assert other.compute_area_loss(FULL) == pytest.approx(
        one.compute_area_loss(FULL), rel=2e-3, abs=lost_with_it
    )
    of_mean = jump / one.span.sum()
    assert other.mean == pytest.approx(one.mean, rel=2e-3, abs=of_mean)


def test_short_steps_are_priced_at_what_they_lose(machine):
    random = np.random.default_rng(4)
    patterns, low, high = machine.patterns, machine.arrays.joint_min, machine.arrays.joint_max
    term, status, cost = AreaTerm(300.0, FULL), np.zeros(len(patterns), dtype=np.int64), None
    for _ in range(5):
        start = random.uniform(low, high)
        end = np.clip(start + random.uniform(-5e-3, 5e-3, 3), low, high)
        status[:], cost = 1, np.full(len(patterns), np.nan)
        status[7] = 0
        compute_step_area_loss(machine.arrays, term, start, end, patterns, status, 1, cost)
        assert np.flatnonzero(np.isnan(cost)).tolist() == [7]
        way = start + np.linspace(0.0, 1.0, 9)[:, None] * (end - start)
        for p in (0, 5, 22):
            expected = 300.0 * lost(machine, way, np.tile(patterns[p], (9, 1)))
            assert cost[p] == pytest.approx(expected, rel=3e-2, abs=3e-3)


def test_a_motion_loses_what_hulls_along_it_lose_in_the_modes_in_force(machine, table):
    case = get_paper_case("4-1")
    start = MotionState.at_rest(case.start_posture(machine))
    motion = Planner(machine, table).plan(case.goal, start, options=case.options).motion
    trajectory, schedule = motion.trajectory, motion.schedule
    at = trajectory.stamp_ns + np.linspace(0, trajectory.duration_ns, 200).astype(int)
    along = lost(machine, trajectory.sample_many(at)[0], schedule.modes_at_many(at))
    profile = compute_area_along_motion(machine, trajectory, schedule)
    assert profile.compute_area_loss(FULL) == pytest.approx(along, rel=1e-2)


def test_nothing_is_lost_where_the_area_is_full_and_all_where_there_is_none():
    profile = AreaProfile(np.array([0.1, 0.3]), np.array([0.5, 0.0]))
    assert profile.compute_area_loss(0.5) == pytest.approx(0.3)
    assert profile.compute_area_loss(0.25) == pytest.approx(0.3)
    assert profile.compute_area_loss(1.0) == pytest.approx(0.35)
    assert profile.mean == pytest.approx(0.125)
    assert AreaProfile(np.zeros(2), np.ones(2)).mean is None


def test_half_of_the_nodes_offer_more_than_the_area_that_counts_as_full(table):
    best = np.nanmax(table.area[table.feasible], axis=1)
    assert abs(np.mean(best > compute_reference_area(table)) - 0.5) < 0.01
    assert create_area_cost(3.0, table) == (3.0, compute_reference_area(table))
    assert create_area_cost(0.0, table).weight == 0.0


@pytest.mark.parametrize("kind", ["table", "fixed"])
def test_planners_that_cannot_weigh_the_area_say_so(machine, table, kind):
    case = get_paper_case("4-1")
    start = MotionState.at_rest(case.start_posture(machine))
    options = PlanOptions(planner=kind, area_weight=10.0)
    sentence = (
        f"area weight must be 0 for the planner '{kind}'; 'integrated' can weigh the area "
        r"\(is 10.0\)"
    )
    with pytest.raises(RequestError, match=sentence):
        Planner(machine, table).plan(case.goal, start, options=options)


@pytest.mark.parametrize("weight", [-1.0, np.nan, np.inf])
def test_a_weight_of_the_area_is_finite_and_not_negative(weight):
    with pytest.raises(RequestError, match=r"area weight must be from 0 to 1e\+06"):
        PlanOptions(area_weight=weight)
