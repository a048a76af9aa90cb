"""Plans made anew on the way to the same goal: whether the rest of the one in force stays."""

import numpy as np
import pytest

from mhsb_model.braking import brake_along, extract_remainder
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_planner.motion.s3_trajectory import FitMethod
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.search.s2_search import Weights

START, GOAL = (0.55, -0.05), (0.55, 0.60)
TIME = Weights(0.0, 15.0, 2.0)


@pytest.fixture(scope="module")
def only_planner(machine, table):
    return Planner(machine, table)


@pytest.fixture
def planner(only_planner, machine):
    """A planner whose machine is free to be changed."""
    only_planner.change_machine(machine)
    return only_planner


def under_way(planner, options, share=0.3):
    """A plan from START to GOAL, and when it is left [ns]."""
    x, z = START
    q = planner.graph.table.posture[planner.graph.grid.node_at(x, z), 0]
    plan = planner.plan(GOAL, MotionState.at_rest(q), options=options)
    return plan, round(share * plan.motion.trajectory.duration_ns)


def anew(planner, plan, at_ns, options, goal=GOAL):
    trajectory = plan.motion.trajectory
    return planner.plan(
        goal,
        trajectory.sample(at_ns),
        modes=StartModes.read_from(plan.motion.schedule, at_ns),
        brake=brake_along(planner.machine, trajectory, at_ns),
        options=options,
        remainder=extract_remainder(trajectory, at_ns),
    )


@pytest.mark.parametrize("kind", ["table", "fixed", "integrated"])
def test_with_a_little_less_payload_the_rest_of_the_plan_stays_with_new_prices(planner, kind):
    options = PlanOptions(planner=kind)
    plan, at_ns = under_way(planner, options)
    payload = planner.machine.arrays.payload
    planner.change_machine(planner.machine.changed(payload=0.99 * payload))
    again = anew(planner, plan, at_ns, options)
    left = plan.motion.trajectory.duration_ns - at_ns
    assert again.motion.method is FitMethod.CONTINUED
    assert again.motion.trajectory.duration_ns == left
    times = np.arange(0, left, SECOND_NS // 20)
    for old, new in zip(
        plan.motion.trajectory.sample_many(at_ns + times),
        again.motion.trajectory.sample_many(times),
        strict=True,
    ):
        np.testing.assert_allclose(new, old, atol=1e-5)
    assert 0.0 < again.lower_bound <= again.energy.paper < plan.energy.paper


def test_a_rest_that_is_too_fast_for_the_v_max_of_now_is_left(planner):
    options = PlanOptions(planner="integrated", weights=TIME)
    plan, at_ns = under_way(planner, options)
    planner.change_machine(planner.machine.changed(max_piston_speed=0.006))
    again = anew(planner, plan, at_ns, options)
    assert again.motion.method is not FitMethod.CONTINUED
    assert again.duration > 1.5 * (plan.duration - at_ns / SECOND_NS)


def test_a_rest_is_left_where_another_planner_has_a_much_cheaper_motion(planner):
    plan, at_ns = under_way(planner, PlanOptions(planner="fixed"), share=0.05)
    options = PlanOptions(planner="integrated")
    again = anew(planner, plan, at_ns, options)
    assert again.motion.method is not FitMethod.CONTINUED
    assert again.energy.paper < 0.98 * plan.energy.paper


def test_a_goal_close_to_where_the_plan_in_force_ends_is_steered_to(planner):
    options = PlanOptions(planner="integrated")
    plan, _ = under_way(planner, options)
    at_ns = plan.motion.trajectory.duration_ns - SECOND_NS // 5
    near = GOAL[0], GOAL[1] + 2e-3
    again = anew(planner, plan, at_ns, options, near)
    assert again.motion.method is FitMethod.STEERED
    tip = planner.machine.tip_position(again.motion.trajectory.position[-1])
    np.testing.assert_allclose(tip, near, atol=1e-6)
    assert again.duration < 0.5
