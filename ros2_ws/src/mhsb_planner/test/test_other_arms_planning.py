"""Plans for arms other than the suite's own: with one more joint, and with a telescope."""

import math

import numpy as np
import pytest
from tests.support.lower_bounds import energy_lower_bound

from mhsb_model.files.config_files import find_config_file
from mhsb_model.inverse_kinematics.tip_postures import (
    transform_tip_to_outer_frame,
    write_inner_angles,
)
from mhsb_model.machine import Machine, load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import MotionState
from mhsb_planner.errors import InfeasibleGoalError
from mhsb_planner.integrated import goal_postures
from mhsb_planner.integrated.lower_bound import MAX_CELLS_WITH_DEADLINE, bound_cost_to_goals
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.posture.s1_global_search import build_posture_table, find_postures_at
from mhsb_planner.posture.s1_psi_intervals_3r import (
    MAX_INTERVALS,
    find_feasible_intervals,
    solve_posture_at_psi,
)
from mhsb_planner.search.lower_bound import ENERGY_ONLY_WEIGHTS
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
    return find_postures_at(arm, *START).posture[0]


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
            sampled = energy_lower_bound(arm, q, np.vstack([dense, goals.posture]))
            assert bound <= sampled * (1 + 1e-9)
            assert bound >= share * sampled
            lengths = arm.cylinder_lengths(q)
            coarse = bound_cost_to_goals(
                arm, circuit, lengths, goals, ENERGY_ONLY_WEIGHTS, MAX_CELLS_WITH_DEADLINE
            )
            assert 0.0 <= coarse <= bound * (1 + 1e-9)


def sample_in_plain_python(arm, x, z, between):
    """Postures, elbows and free angles as `sample_goal_postures` describes them, one by one."""
    n, spacing = arm.joint_count, goal_postures.PSI_SPACING
    one = between is not None and between[0] == between[1]
    apart = spacing ** (1.0 / max(1, n - 3 if one else n - 2))
    fewest = max(2, round(goal_postures.MIN_INTERVAL_SAMPLES ** (1.0 / (n - 2))))
    low, high = arm.arrays.joint_min, arm.arrays.joint_max
    samples = math.ceil(max((high - low)[: n - 3], default=0.0) / apart) + 1
    rows = []
    for number in range(samples ** (n - 3)):
        q = np.zeros(n)
        write_inner_angles(arm.arrays, number, samples, q)
        *tip, heading = transform_tip_to_outer_frame(arm.arrays.link_length, x, z, q)
        interval, ranges = np.empty((MAX_INTERVALS, 3)), []
        found = find_feasible_intervals(arm.arrays, *tip, interval)
        for elbow, least, most in interval[:found]:
            for turn in 2 * np.pi * np.arange(-2, 3) if between else (0.0,):
                first, last = between or (-np.inf, np.inf)
                begin, end = max(least, first - heading + turn), min(most, last - heading + turn)
                if begin <= end:
                    count = max(fewest, math.ceil((end - begin) / apart) + 1)
                    ranges.append((elbow, np.linspace(begin, end, count)))
        if one:
            ranges = [(elbow, np.array([between[0] - heading])) for elbow in (-1, 1)]
        for elbow, angles in ranges:
            for psi in angles:
                if solve_posture_at_psi(arm.arrays, *tip, psi, int(elbow), q):
                    rows.append((*q, elbow, *q[: n - 3], psi + heading))
    return np.array(rows)


@pytest.mark.parametrize("between", [None, (-1.0, -1.0), (-1.2, -0.9)])
@pytest.mark.parametrize("file", ["mhsb_arm3.yaml", "mhsb_arm4.yaml"])
def test_goal_postures_equal_those_of_a_plain_search(file, between):
    arm, found = load_machine(find_config_file(file)), 0
    for tip in ((0.55, 0.60), (0.9, -0.2), (1.02, 0.1), (0.3, -0.3)):
        expected = sample_in_plain_python(arm, *tip, between)
        if len(expected) == 0:
            with pytest.raises(InfeasibleGoalError):
                goal_postures.sample_goal_postures(arm, *tip, between)
            continue
        goals = goal_postures.sample_goal_postures(arm, *tip, between)
        sampled = np.column_stack([goals.posture, goals.elbow, goals.free])
        assert np.array_equal(sampled, expected)
        found += 1
    assert found > 0
