"""Plans from starts that are not quite where they should be, and along paths found elsewhere."""

import numpy as np
import pytest

from mhsb_model.errors import MhsbError
from mhsb_model.modes import count_modules
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import MotionState
from mhsb_model.workspace import compute_joint_excess
from mhsb_planner import planner as planning
from mhsb_planner.cases.moves import yield_random_moves
from mhsb_planner.errors import NoPathError, RequestError
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.planning import motion_rules
from mhsb_planner.search.s2_search import Weights

BEYOND = 1e-3  # rad
LOWERED = np.array([-0.1, -1.9, -0.7])
RAISED = 0.95, 0.3
"""Where the arm is stretched, so that joint 1 is boosted."""


@pytest.fixture(scope="module")
def planner(machine, table):
    return Planner(machine, table)


def cases_beyond(planner, options, beyond, count):
    """Starts at a joint limit moved `beyond` it [rad], with a goal that can be reached from it."""
    table, limits = planner.graph.table, planner.machine.arrays
    random = np.random.default_rng(20)
    nodes = np.flatnonzero(table.feasible)
    while count:
        here, there = random.choice(nodes, 2, replace=False)
        start, goal = table.posture[here, 0], tuple(table.nodes[there] * table.spacing)
        at_max = (limits.joint_max - start < 1e-9).astype(float)
        at_min = (start - limits.joint_min < 1e-9).astype(float)
        if not (at_max + at_min).any():
            continue
        try:
            planner.plan(goal, MotionState.at_rest(start), options=options)
        except MhsbError:
            continue
        count -= 1
        yield MotionState.at_rest(start + beyond * (at_max - at_min)), goal


@pytest.mark.parametrize("kind", ["table", "fixed"])
def test_a_start_beyond_a_joint_limit_by_noise_is_led_back_inside(planner, kind):
    options = PlanOptions(planner=kind)
    for start, goal in cases_beyond(planner, options, BEYOND, 10):
        trajectory = planner.plan(goal, start, options=options).motion.trajectory
        excess = compute_joint_excess(planner.machine.arrays, trajectory.position)
        assert excess[0] == pytest.approx(BEYOND)
        back = int(np.argmax(excess <= 1e-6))
        assert np.all(np.diff(excess[:back]) <= 1e-9)
        assert np.all(excess[back:] <= 1e-6)
        assert trajectory.offset_ns[back] < trajectory.duration_ns


def test_a_path_found_elsewhere_is_followed_as_if_it_had_been_searched(planner):
    table = planner.graph.table
    nodes = np.flatnonzero(table.feasible)
    start, goal = table.posture[nodes[0], 0], tuple(table.nodes[nodes[40]] * table.spacing)
    options = PlanOptions(planner="table")
    plan = planner.plan(goal, MotionState.at_rest(start), options=options)
    again = planner.follow(plan.path, options=options)
    np.testing.assert_array_equal(again.motion.trajectory.position, plan.motion.trajectory.position)
    assert again.energy == plan.energy


def test_plans_do_without_modules_that_are_lost_and_with_them_again(machine, table):
    planner, start = Planner(machine, table), MotionState.at_rest(LOWERED)
    options = [PlanOptions(planner=kind) for kind in ("table", "fixed", "integrated")]
    used = {4: [], 2: [], 0: []}
    for count, plans in used.items():
        planner.change_machine(machine.changed(module_count=count))
        for each in options:
            try:
                plans.append(planner.plan(RAISED, start, options=each))
            except NoPathError:
                plans.append(None)
    most = [
        max(
            (count_modules(row, machine.config.hydraulics.modules.per_mode))
            for plan in plans
            if plan is not None
            for row in plan.motion.schedule.modes
        )
        for plans in (used[4], used[2])
    ]
    assert most[0] > 0
    assert most[1] <= 2
    assert used[0] == [None] * 3  # nobody lifts this in N
    planner.change_machine(machine)
    for plan, each in zip(used[4], options, strict=True):
        assert planner.plan(RAISED, start, options=each).cost(each) == plan.cost(each)


@pytest.mark.parametrize("weights", [Weights(0.5, 0.0, 2.0), Weights(0.0, 15.0, 2.0)])
def test_ramps_are_faster_where_nothing_else_needs_their_half_of_the_limits(
    planner, monkeypatch, weights
):
    options = PlanOptions(weights, planner="table")
    moves = [(move.start, move.goal) for move in yield_random_moves(planner, 8)]

    def costs():
        plans = [planner.plan(goal, MotionState.at_rest(q), options=options) for q, goal in moves]
        return np.array([plan.cost(options) for plan in plans])

    with_faster = costs()
    monkeypatch.setattr(motion_rules, "FASTER_RAMP_FACTORS", ())
    without = costs()
    assert np.all(with_faster <= without)
    assert with_faster.sum() < 0.9995 * without.sum()


def test_a_machine_of_more_modules_than_the_posture_table_is_refused(machine, table):
    few = machine.changed(module_count=1)
    planner = Planner(few, table.with_patterns(few.patterns))
    with pytest.raises(RequestError, match=r"must be at most 1, .*; build another \(is 4\)"):
        planner.change_machine(machine)
    assert planner.machine is few


def test_zones_that_are_added_later_are_compiled_for_ahead_of_the_next_plan(
    machine, table, monkeypatch
):
    compiled = []
    monkeypatch.setattr(planning, "_compiled", set())
    monkeypatch.setattr(planning, "compile_planner", lambda parts: compiled.append(set(parts)))
    planner, options = Planner(machine, table), PlanOptions(planner="table")
    start = MotionState.at_rest(machine.config.simulation.start_posture)
    for _ in range(2):
        planner.plan((0.55, 0.60), start, options=options)
    planner.change_machine(machine.changed(zones=Zones(circles=((-0.5, 0.5, 0.05),))))
    for _ in range(2):
        planner.plan((0.55, 0.60), start, options=options)
    free, among_zones = compiled
    assert among_zones - free == {"mhsb_planner.kernel_parts:compile_clearance"}
