"""Goals as users have them: regions, ranges of the end link's angle, points on the way."""

import math

import numpy as np
import pytest

from mhsb_model.trajectory import MotionState
from mhsb_planner.errors import InfeasibleGoalError, RequestError
from mhsb_planner.goal_region import BoxRegion, Disc, Segment, is_goal_met
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.planners.registry import REGISTERED_PLANNERS

START = MotionState.at_rest(np.array([0.3, -1.4, -1.5]))
GOAL = (0.65, 0.45)


@pytest.fixture(scope="module")
def planner(machine, table):
    return Planner(machine, table)


def ending(machine, plan):
    """Tip (x, z) m and end-link angle [rad] at a plan's end, by its trajectory."""
    posture = plan.motion.trajectory.position[-1]
    angle = np.cumsum(posture)
    length = machine.arrays.link_length
    return np.array([np.cos(angle) @ length, np.sin(angle) @ length]), float(angle[-1])


def nearest(machine, plan, point):
    """Distance of the motion's tip from a point [m], and when it is least [s], every 1 ms."""
    motion = plan.motion.trajectory
    at = np.arange(0, motion.duration_ns, 1_000_000)
    angle = np.cumsum(motion.sample_many(at)[0], axis=1)
    length = machine.arrays.link_length
    tip = np.column_stack([np.cos(angle) @ length, np.sin(angle) @ length])
    away = np.hypot(*(tip - point).T)
    return float(away.min()), 1e-3 * int(np.argmin(away))


@pytest.mark.parametrize("kind", REGISTERED_PLANNERS)
@pytest.mark.parametrize("region", [Disc(0.03), Segment(-0.1, 0.05), BoxRegion(0.05, 0.02)])
def test_a_motion_ends_in_the_region_and_is_no_dearer_than_to_the_goal_itself(
    machine, planner, kind, region
):
    exact = PlanOptions(planner=kind)
    options = PlanOptions(planner=kind, goal_region=region)
    point, free = (planner.plan(GOAL, START, options=each) for each in (exact, options))
    tip, angle = ending(machine, free)
    assert region.distance(tuple(tip - GOAL)) <= 1e-6
    assert is_goal_met(GOAL, region, None, tip, angle, 1e-6, 1e-6)
    assert free.cost(options) <= point.cost(exact) * (1 + 1e-9)
    assert free.lower_bound <= free.energy.paper


@pytest.mark.parametrize("kind", REGISTERED_PLANNERS)
def test_the_end_link_ends_in_the_range_asked_for(machine, planner, kind):
    possible = machine.postures(*GOAL, np.linspace(-3.0, 3.0, 601)).sum(axis=1)
    one, other = np.quantile(possible, [0.6, 0.75]).tolist()
    for turn in (0.0, 2 * math.pi):
        low, high = one + turn, other + turn
        options = PlanOptions(planner=kind, goal_psi=(low, high))
        plan = planner.plan(GOAL, START, options=options)
        tip, turned = ending(machine, plan)
        assert tip == pytest.approx(GOAL, abs=1e-6)
        assert (turned - low + 1e-9) % (2 * math.pi) <= high - low + 2e-9
    with pytest.raises(InfeasibleGoalError, match=r"with the end link at 3 to 3\.1 rad"):
        planner.plan(GOAL, START, options=PlanOptions(planner=kind, goal_psi=(3.0, 3.1)))


@pytest.mark.parametrize("kind", REGISTERED_PLANNERS)
def test_a_goal_that_cannot_be_reached_is_answered_by_its_region(machine, planner, kind):
    outside = (1.04, 0.0)
    with pytest.raises(Exception, match="workspace"):
        planner.plan(outside, START, options=PlanOptions(planner=kind))
    options = PlanOptions(planner=kind, goal_region=Disc(0.05))
    tip, _ = ending(machine, planner.plan(outside, START, options=options))
    assert math.dist(tip, outside) <= 0.05


@pytest.mark.parametrize("kind", REGISTERED_PLANNERS)
def test_points_on_the_way_are_passed_in_their_order_without_a_stop(machine, planner, kind):
    via = ((0.6, -0.05), (0.7, 0.2))
    options = PlanOptions(planner=kind, via=via, via_tolerance=0.012)
    plan = planner.plan(GOAL, START, options=options)
    away, at = zip(*(nearest(machine, plan, point) for point in via), strict=True)
    assert max(away) <= 0.012
    assert 0.0 < at[0] < at[1] < plan.duration
    for when in at:
        assert np.abs(plan.motion.trajectory.sample(round(when * 1e9)).velocity).max() > 1e-3
    assert ending(machine, plan)[0] == pytest.approx(GOAL, abs=1e-6)
    assert plan.lower_bound <= plan.energy.paper
    assert plan.path.duration.sum() == pytest.approx(plan.path.time[-1])


def test_an_arm_that_is_in_the_region_stays(machine, planner):
    tip = machine.tip_position(START.position)
    for kind in REGISTERED_PLANNERS:
        options = PlanOptions(planner=kind, goal_region=Disc(0.02))
        plan = planner.plan((tip[0] + 0.01, tip[1]), START, options=options)
        assert plan.path.steps == 0


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"via": ((0.5, math.nan),)}, "via must be finite numbers"),
        ({"via_tolerance": 0.0}, "via_tolerance must be above 0 m"),
        ({"goal_psi": (1.0, 0.0)}, "the least first"),
    ],
)
def test_goals_that_make_no_sense_are_refused_with_a_sentence(options, sentence):
    with pytest.raises(RequestError, match=sentence):
        PlanOptions(**options)


@pytest.mark.parametrize("region", [Disc(20.0), Segment(0.0, -20.0), BoxRegion(12.0, 16.0)])
def test_a_region_beyond_the_workspace_is_refused_and_other_units_are_suggested(planner, region):
    hint = r"in cm or mm\? 20 cm are 0\.2 m, 20 mm are 0\.02 m"
    with pytest.raises(RequestError, match=rf"at most 2\.058 m .* {hint}"):
        planner.plan(GOAL, START, options=PlanOptions(goal_region=region))
