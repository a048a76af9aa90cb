"""Plans for arms that slew: the plane's path, and the turning of the plane in the same time."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine, load_machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import MotionState
from mhsb_planner.errors import RequestError
from mhsb_planner.goal_region import Disc
from mhsb_planner.motion.s3_trajectory import FitMethod
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.posture.s1_global_search import build_posture_table, find_postures_at
from mhsb_planner.slewing.slew_distribution import distribute_stroke

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

PLANNERS = ("table", "fixed", "integrated")
MOVES = {
    "excavator": ((2.6, 0.0, -1.0), (1.3, 1.8, 0.5)),
    "forestry_crane": ((4.5, 0.5, -1.5), (3.5, -3.0, 0.5)),
}
FASTEST, FLOW, AREA = 0.1, 1e-3, 4e-3

steps = st.lists(st.tuples(st.floats(0.01, 2.0), st.floats(0.0, 1.0)), min_size=1, max_size=30)


@pytest.fixture(scope="module", params=["excavator.yaml", "forestry_crane.yaml"])
def arm(request) -> Machine:
    return load_machine(find_config_file(request.param))


@pytest.fixture(scope="module")
def planner(arm: Machine) -> Planner:
    return Planner(arm, build_posture_table(arm.planar_arm, spacing=6.0 * arm.spacing))


@pytest.fixture(scope="module")
def start(arm: Machine) -> np.ndarray:
    place = arm.convert_to_plane(MOVES[arm.name][0], preferred_slew=0.0)
    return np.append(place.slew, find_postures_at(arm.planar_arm, *place.tip).posture[0])


@given(steps, st.floats(1e-4, 1.0))
def test_a_way_is_shared_out_within_the_speed_and_what_is_left_of_the_flow(given_steps, way):
    duration = np.array([step[0] for step in given_steps])
    oil = np.array([share for _, share in given_steps]) * FLOW * duration
    share, longer = distribute_stroke(way, duration, oil, FASTEST, FLOW, AREA)
    assert share.sum() == pytest.approx(way, rel=1e-9)
    assert np.all(share <= FASTEST * longer * (1 + 1e-9))
    assert np.all(AREA * share + oil <= FLOW * longer * (1 + 1e-9))
    assert np.all(longer >= duration * (1 - 1e-12))


@given(steps, st.floats(1e-4, 1.0))
def test_steps_last_no_longer_than_a_way_needs(given_steps, way):
    duration = np.array([step[0] for step in given_steps])
    oil = np.array([share for _, share in given_steps]) * FLOW * duration
    _, longer = distribute_stroke(way, duration, oil, FASTEST, FLOW, AREA)
    factor = longer.sum() / duration.sum()
    if factor > 1.0 + 1e-9:
        shorter = (1.0 - 1e-6) * longer
        room = np.minimum(FASTEST * shorter, np.maximum(FLOW * shorter - oil, 0.0) / AREA)
        assert room.sum() < way


def test_a_plane_that_rests_turns_at_the_speed_that_the_flow_allows():
    share, longer = distribute_stroke(0.5, np.zeros(1), np.zeros(1), FASTEST, 1e-4, AREA)
    assert share.sum() == pytest.approx(0.5)
    assert longer.sum() == pytest.approx(0.5 / (1e-4 / AREA))


@pytest.mark.parametrize("kind", PLANNERS)
def test_a_plan_of_every_planner_gets_there_within_every_limit(planner, arm, start, worst, kind):
    goal = MOVES[arm.name][1]
    plan = planner.plan(goal, MotionState.at_rest(start), options=PlanOptions(planner=kind))
    trajectory, schedule = plan.motion.trajectory, plan.motion.schedule
    assert arm.tip_in_base(trajectory.position[-1]) == pytest.approx(goal, abs=1e-6)
    assert plan.path.tip[-1] == pytest.approx(goal, abs=1e-6)
    excess = worst(trajectory, schedule, machine=arm)
    assert max(excess.values()) < 1e-3, excess
    assert np.all(schedule.modes[:, 0] == Mode.N)
    assert plan.energy.paper > plan.lower_bound > 0.0


def test_an_integrated_plan_costs_no_more_than_the_others(planner, arm, start):
    state, cost = MotionState.at_rest(start), {}
    for kind in PLANNERS:
        options = PlanOptions(planner=kind, trajectory="followed")
        cost[kind] = planner.plan(MOVES[arm.name][1], state, options=options).energy.paper
    assert cost["integrated"] <= min(cost.values()) * (1 + 1e-9)


def test_slewing_alone_moves_nothing_else_and_ends_at_the_nearer_of_two_angles(planner, arm, start):
    x, y, z = arm.tip_in_base(start).tolist()
    radius, angle = math.hypot(x, y), math.atan2(y, x) + 0.5
    goal = (radius * math.cos(angle), radius * math.sin(angle), z)
    plan = planner.plan(goal, MotionState.at_rest(start), options=PlanOptions(planner="table"))
    position = plan.motion.trajectory.position
    assert position[-1, 0] == pytest.approx(start[0] + 0.5, abs=1e-6)
    assert arm.tip_in_base(position[-1]) == pytest.approx(goal, abs=1e-6)


def test_a_plan_from_motion_goes_on_from_where_the_arm_is(planner, arm, start, worst):
    begin, goal = MOVES[arm.name]
    options = PlanOptions(planner="table")
    first = planner.plan(goal, MotionState.at_rest(start), options=options).motion.trajectory
    at = first.duration_ns // 2
    state = first.sample(at)
    assert np.abs(state.velocity[0]) > 0.0
    plan = planner.plan(begin, state, options=options)
    trajectory = plan.motion.trajectory
    now = trajectory.sample(trajectory.stamp_ns)
    assert now.velocity == pytest.approx(state.velocity, abs=1e-9)
    assert arm.tip_in_base(trajectory.position[-1]) == pytest.approx(begin, abs=1e-6)
    assert max(worst(trajectory, plan.motion.schedule, machine=arm).values()) < 1e-3


@pytest.mark.parametrize("kind", ["table", "integrated"])
def test_a_large_arm_passes_a_point_within_10_mm_without_stopping_at_every_step(
    planner, arm, start, kind
):
    begin, goal = MOVES[arm.name]
    point = tuple(0.5 * (a + b) + 0.2 for a, b in zip(begin, goal, strict=True))
    options = PlanOptions(planner=kind, via=(point,))
    motion = planner.plan(goal, MotionState.at_rest(start), options=options).motion
    assert motion.method is FitMethod.RAMPED
    tips = arm.tip_in_base(motion.trajectory.position)
    assert np.linalg.norm(tips - point, axis=1).min() < 0.01 + 1e-3  # between points of 20 ms


def test_a_tolerance_holds_in_the_plane(planner, arm, start):
    goal = MOVES[arm.name][1]
    options = PlanOptions(planner="integrated", goal_region=Disc(0.1))
    plan = planner.plan(goal, MotionState.at_rest(start), options=options)
    end = arm.tip_in_base(plan.motion.trajectory.position[-1])
    assert math.dist(end, goal) <= 0.1 + 1e-6
    assert math.atan2(end[1], end[0]) == pytest.approx(math.atan2(goal[1], goal[0]), abs=1e-6)


def test_what_an_arm_that_slews_does_not_take_is_refused_with_the_rule(planner, start):
    state = MotionState.at_rest(start)
    with pytest.raises(RequestError, match="three finite numbers, x y z"):
        planner.plan((2.0, 0.5), state)
    with pytest.raises(RequestError, match="via must be three numbers, x y z"):
        planner.plan((2.0, 0.0, 0.5), state, options=PlanOptions(via=((1.0, 0.0),)))
