"""Plans for arms other than the suite's own: with one more joint, and with a telescope."""

import numpy as np
import pytest

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine, load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import MotionState
from mhsb_planner.integrated import goal_postures
from mhsb_planner.integrated.lower_bound import MAX_CELLS_WITH_DEADLINE, bound_cost_to_goals
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.posture.s1_global_search import build_posture_table, postures_at
from mhsb_planner.search.lower_bound import ENERGY_ONLY_WEIGHTS, energy_lower_bound
from mhsb_planner.search.s2_step import compute_hydraulic_coefficients

START, GOAL = (0.55, -0.05), (0.60, 0.55)
PLANNERS = ("table", "fixed", "integrated")

CLOSE = {"mhsb_arm4": (2000, 0.9), "telescope_arm": (20_000, 0.99)}
"""Angles of the end link at which postures are sampled, and the least share of what is met there
that the certificate may be: two free angles leave cells that are not halved any more."""


@pytest.fixture(scope="module", params=["mhsb_arm4.yaml", "telescope_arm.yaml"])
def arm(request) -> Machine:
    return load_machine(find_config_file(request.param))


@pytest.fixture(scope="module")
def planner(arm: Machine) -> Planner:
    return Planner(arm, build_posture_table(arm, spacing=0.15))


@pytest.fixture(scope="module")
def start(arm: Machine) -> np.ndarray:
    return postures_at(arm, *START).posture[0]


@pytest.mark.parametrize("kind", PLANNERS)
def test_a_plan_of_every_planner_keeps_every_limit(planner, start, worst, kind):
    plan = planner.plan(GOAL, MotionState.at_rest(start), options=PlanOptions(planner=kind))
    trajectory, schedule = plan.motion.trajectory, plan.motion.schedule
    tip = planner.machine.tip_position(trajectory.position[-1])
    assert tip == pytest.approx(GOAL, abs=1e-6)
    excess = worst(trajectory, schedule, machine=planner.machine)
    assert max(excess.values()) < 1e-3, excess
    assert plan.energy.paper > plan.lower_bound > 0.0


@pytest.mark.parametrize("kind", PLANNERS)
def test_a_plan_ends_with_the_end_link_as_asked(planner, arm, start, kind):
    possible = arm.postures(*GOAL, np.linspace(-3.0, 3.0, 601))
    psi = arm.end_link_angle(possible[len(possible) // 2])
    options = PlanOptions(planner=kind, goal_psi=psi)
    plan = planner.plan(GOAL, MotionState.at_rest(start), options=options)
    end = plan.motion.trajectory.position[-1]
    assert arm.tip_position(end) == pytest.approx(GOAL, abs=1e-6)
    assert arm.end_link_angle(end) == pytest.approx(psi, abs=1e-6)


def test_every_planner_leads_the_tip_round_a_zone(planner, arm, start):
    straight = planner.plan(
        GOAL, MotionState.at_rest(start), options=PlanOptions(planner="table")
    ).motion.trajectory
    x, z = arm.tip_position(straight.sample(straight.duration_ns // 2).position)
    guarded = arm.changed(zones=Zones(tip_circles=((x, z, 0.05),)))
    for kind in PLANNERS:
        planner.change_machine(guarded)
        try:
            plan = planner.plan(GOAL, MotionState.at_rest(start), options=PlanOptions(planner=kind))
        finally:
            planner.change_machine(arm)
        trajectory = plan.motion.trajectory
        at = np.arange(0, trajectory.duration_ns + 1, 2_000_000)
        tips = arm.tip_positions(trajectory.sample_many(at)[0])
        assert np.hypot(*(tips - (x, z)).T).min() > 0.05


def test_an_integrated_plan_costs_no_more_than_the_others(planner, start):
    state, cost = MotionState.at_rest(start), {}
    for kind in PLANNERS:
        options = PlanOptions(planner=kind, trajectory="followed")
        cost[kind] = planner.plan(GOAL, state, options=options).energy.paper
    assert cost["integrated"] <= min(cost.values()) * (1 + 1e-9)


def test_the_certificate_is_below_every_posture_at_the_goal_and_close_to_the_least(arm):
    circuit, (angles, share) = (
        compute_hydraulic_coefficients(arm.arrays, arm.patterns),
        CLOSE[arm.name],
    )
    low, high = arm.arrays.joint_min, arm.arrays.joint_max
    for q in np.random.default_rng(9).uniform(low, high, (4, arm.joint_count)):
        for tip in (GOAL, (0.9, -0.2)):
            goals = goal_postures.sample_goal_postures(arm, *tip)
            bound = bound_cost_to_goals(
                arm, circuit, arm.cylinder_lengths(q), goals, ENERGY_ONLY_WEIGHTS
            )
            dense = arm.postures(*tip, np.linspace(-np.pi, np.pi, angles))
            sampled = energy_lower_bound(arm, q, np.vstack([dense, goals.postures.posture]))
            assert bound <= sampled * (1 + 1e-9)
            assert bound >= share * sampled
            lengths = arm.cylinder_lengths(q)
            coarse = bound_cost_to_goals(
                arm, circuit, lengths, goals, ENERGY_ONLY_WEIGHTS, MAX_CELLS_WITH_DEADLINE
            )
            assert 0.0 <= coarse <= bound * (1 + 1e-9)


def test_inner_samples_that_are_left_out_reach_nothing(monkeypatch):
    arm = load_machine(find_config_file("mhsb_arm4.yaml"))

    def all_of_them(m, x, z, samples):
        return np.arange(samples ** (len(m.link_length) - 3))

    tips = ((0.55, 0.60), (0.9, -0.2), (1.1, 0.1), (0.3, -0.3))
    chosen = [goal_postures.sample_goal_postures(arm, *tip).postures.posture for tip in tips]
    monkeypatch.setattr(goal_postures, "_reachable_inner_samples", all_of_them)
    for tip, expected in zip(tips, chosen, strict=True):
        assert np.array_equal(
            goal_postures.sample_goal_postures(arm, *tip).postures.posture, expected
        )
