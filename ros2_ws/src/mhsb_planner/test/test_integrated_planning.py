"""The integrated planner from goal to motion: limits, certificate, the table's path, replanning."""

import numpy as np
import pytest

from mhsb_model.command import Command
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_planner.errors import NoPathError
from mhsb_planner.integrated.integrated_search import search
from mhsb_planner.integrated.search_problem import SearchLimits
from mhsb_planner.motion.s3_trajectory import FitError, FitRules
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import Planner, PlanOptions, fit_rules
from mhsb_planner.search.s2_search import PathQuery, Weights

INTEGRATED = PlanOptions(planner="integrated")
FOLLOWED = PlanOptions(planner="table", trajectory="followed")


@pytest.fixture(scope="module")
def planner(machine, table) -> Planner:
    return Planner(machine, table)


def pairs(planner, count, seed=0):
    """Postures on nodes of the table and goals on others, between which the table has a path."""
    random = np.random.default_rng(seed)
    table = planner.graph.table
    nodes = np.flatnonzero(table.feasible)
    while count:
        here, there = random.choice(nodes, 2, replace=False)
        start, goal = table.posture[here, 0], tuple(table.nodes[there] * table.spacing)
        try:
            plan = planner.plan(goal, MotionState.at_rest(start), options=FOLLOWED)
        except (NoPathError, FitError):
            continue
        count -= 1
        yield start, goal, plan


def check_limits(measured):
    assert measured["joint"] < 1e-6
    assert measured["tip"] < 1.1e-4
    rest = {k: v for k, v in measured.items() if k not in ("joint", "tip")}
    assert max(rest.values()) < 1e-3, rest


@pytest.mark.parametrize(
    ("options", "excess"),
    [
        (PlanOptions(planner="table"), 0.1),
        (PlanOptions(planner="table", max_speed_excess=0.02), 0.02),
        (PlanOptions(planner="integrated", trajectory="polynomial"), 0.1),
        (INTEGRATED, FitRules.create_following().max_excess),
    ],
)
def test_polynomials_pass_v_max_only_where_they_are_asked_for(options, excess):
    assert fit_rules(options, "polynomial").max_excess == excess


def test_motions_keep_every_limit_and_are_never_worse_than_the_tables(planner, worst):
    for start, goal, other in pairs(planner, 12):
        plan = planner.plan(goal, MotionState.at_rest(start), options=INTEGRATED)
        check_limits(worst(plan.motion.trajectory, plan.motion.schedule))
        assert planner.machine.tip_position(plan.motion.trajectory.position[-1]) == (
            pytest.approx(goal, abs=1e-6)
        )
        assert plan.energy.paper <= 1.001 * other.energy.paper
        assert plan.lower_bound <= plan.energy.paper
        assert plan.lower_bound <= plan.energy.series
        assert plan.lower_bound <= other.energy.paper


def test_no_motion_is_dearer_than_that_along_the_path_where_time_costs_a_little(planner):
    normal, hasty = np.zeros(3, dtype=np.uint8), Weights(0.5, 1.0, 2.0)
    for start, goal, _ in pairs(planner, 4, seed=3):
        plan = planner.plan(goal, MotionState.at_rest(start), options=INTEGRATED)
        effort = SearchLimits(max_expansions=4000)
        path = search(planner.machine, PathQuery(start, normal, goal, hasty), effort=effort)
        hurried = planner.follow(path, options=INTEGRATED)
        assert plan.cost(INTEGRATED) <= (1.0 + 1e-6) * hurried.cost(INTEGRATED)


def test_with_time_weights_motions_are_never_slower_than_the_tables(planner):
    weights = Weights(0.0, 15.0, 2.0)
    for start, goal, _ in pairs(planner, 10, seed=1):
        at_rest = MotionState.at_rest(start)
        durations = [
            planner.plan(
                goal, at_rest, options=PlanOptions(weights, planner=kind, trajectory="followed")
            ).motion.trajectory.duration_ns
            for kind in ("integrated", "table")
        ]
        assert durations[0] <= 1.0001 * durations[1]


def test_replanning_on_the_way_continues_position_velocity_and_acceleration(machine, table, worst):
    replanner = Replanner(machine, table)
    planner = Planner(machine, table)
    moving = 0
    for start, goal, _ in pairs(planner, 6, seed=2):
        command = Command.hold(0, start, np.full(3, Mode.N, dtype=np.uint8))
        first = replanner.replan(command, SECOND_NS, goal, 0.1, INTEGRATED)
        middle_ns = (first.change_ns + first.command.trajectory.end_ns) // 2
        second = replanner.replan(
            first.command, middle_ns, tuple(machine.tip_position(start)), 0.1, INTEGRATED
        )
        before = first.command.trajectory.sample(second.change_ns)
        after = second.command.trajectory.sample(second.change_ns)
        assert after.position == pytest.approx(before.position, abs=1e-9)
        assert after.velocity == pytest.approx(before.velocity, abs=1e-9)
        assert after.acceleration == pytest.approx(before.acceleration, abs=1e-6)
        check_limits(worst(second.plan.motion.trajectory, second.plan.motion.schedule))
        assert second.plan.lower_bound <= second.plan.energy.paper
        moving += bool(before.velocity.any())
    assert moving >= 4


def test_another_payload_or_pressure_is_planned_for_with_the_same_planner(machine, table):
    planner = Planner(machine, table)
    start, goal, _ = next(pairs(planner, 1, seed=4))
    energies = []
    for payload, pressure in ((10.0, 4e6), (2.0, 4e6), (2.0, 6e6), (10.0, 4e6)):
        planner.change_machine(machine.changed(payload=payload, supply_pressure=pressure))
        plan = planner.plan(goal, MotionState.at_rest(start), options=INTEGRATED)
        assert plan.lower_bound <= plan.energy.paper
        energies.append(plan.energy.paper)
    assert energies[0] == energies[-1]
    assert energies[1] <= 1.05 * energies[0]


def test_under_a_weight_on_switches_alone_no_motion_switches_more_than_the_tables(planner):
    weights = Weights(0.0, 0.0, 1.0)
    by_table = PlanOptions(planner="table", trajectory="followed", weights=weights)
    integrated = PlanOptions(planner="integrated", weights=weights)
    for start, goal, _ in pairs(planner, 8, seed=5):
        start = MotionState.at_rest(start)
        other, plan = (planner.plan(goal, start, options=each) for each in (by_table, integrated))
        assert plan.cost(integrated) == plan.motion.schedule.switch_count
        assert plan.motion.schedule.switch_count <= other.motion.schedule.switch_count
        if plan.motion.schedule.switch_count == other.motion.schedule.switch_count:
            assert plan.energy.paper <= other.energy.paper * (1 + 1e-9)
