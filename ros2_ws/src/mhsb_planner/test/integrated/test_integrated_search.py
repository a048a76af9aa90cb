"""The whole search: what it finds is possible, as cheap as can be, and told honestly."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from tests.support.lower_bounds import energy_lower_bound

from mhsb_model.errors import OutOfWorkspaceError
from mhsb_model.holding import MAX_HELD_SPEED, choose_holding_modes
from mhsb_model.obstacles.zones import Zones
from mhsb_planner.errors import DeadlineError, InfeasibleGoalError, NoPathError
from mhsb_planner.integrated import anytime_search
from mhsb_planner.integrated.integrated_search import search, yield_paths
from mhsb_planner.integrated.lower_bound import bound_energy_to_goal
from mhsb_planner.integrated.search_problem import SearchLimits, SearchProblem
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.s2_search import PathQuery, Weights
from mhsb_planner.search.s2_search import search as table_search
from mhsb_planner.search.s2_step import compute_step_costs

ENERGY, TIME = Weights(0.5, 0.0, 2.0), Weights(0.0, 15.0, 2.0)
NORMAL = np.zeros(3, dtype=np.uint8)
LOOKS_TO_END = 12
"""Looks at the clock that stages may take to see, one after the other, that time is up."""
QUICK = SearchLimits(max_expansions=500)
THOROUGH = SearchLimits(
    psi_spacing=0.01, finest_step_count=40, spacing_ratio=1.4, max_expansions=30_000, max_sweeps=20
)


def tasks(machine, posture_within, count, seed=0):
    """Starts and goal positions between which a path is found."""
    random = np.random.default_rng(seed)
    while count:
        start, end = posture_within(machine, random), posture_within(machine, random)
        goal = tuple(machine.tip_position(end))
        try:
            search(machine, PathQuery(start, NORMAL, goal, ENERGY), effort=QUICK)
        except NoPathError:
            continue
        count -= 1
        yield start, goal


def check_possible(machine, path, start, goal):
    assert np.array_equal(path.posture[0], start)
    assert path.tip[-1] == pytest.approx(goal, abs=1e-7)
    limits = machine.arrays
    assert np.all(path.posture >= limits.joint_min - 1e-9)
    assert np.all(path.posture <= limits.joint_max + 1e-9)
    for k, ends in enumerate(itertools.pairwise(path.posture)):
        step = compute_step_costs(machine, *ends, MAX_HELD_SPEED)
        p = int(np.flatnonzero((machine.patterns == path.modes[k]).all(axis=1))[0])
        assert step.admissible[p]
        assert path.energy[k] == pytest.approx(step.energy[p], rel=1e-9)


@pytest.mark.parametrize("weights", [ENERGY, TIME])
def test_a_path_consists_of_possible_steps_and_costs_what_it_says(arm, posture_within, weights):
    for start, goal in tasks(arm, posture_within, 6):
        path = search(arm, PathQuery(start, NORMAL, goal, weights), effort=QUICK)
        check_possible(arm, path, start, goal)
        cost = weights.energy * path.energy.sum() + weights.time * path.duration.sum()
        hold = choose_holding_modes(arm, arm.piston_forces(path.posture[-1]))
        assert path.holding_switches == np.count_nonzero(path.modes[-1] != hold)
        switches = path.switches + path.holding_switches
        assert path.cost == pytest.approx(cost + weights.switches * switches, rel=1e-9)


def test_no_path_undercuts_its_lower_bound_nor_that_to_its_own_goal(arm, posture_within):
    for reading, energy in (("paper", "energy"), ("series", "energy_series")):
        for start, goal in tasks(arm, posture_within, 5, seed=1):
            path = search(arm, PathQuery(start, NORMAL, goal, ENERGY, reading), effort=QUICK)
            own = energy_lower_bound(arm, start, path.posture[-1:])
            bound = bound_energy_to_goal(arm, start, goal)
            assert bound <= own * (1 + 1e-9)
            assert bound <= getattr(path, energy).sum()


@pytest.mark.parametrize("count", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_a_quick_search_is_close_to_a_thorough_one(machine, posture_within, count):
    ratios = []
    for start, goal in tasks(machine, posture_within, count, seed=2):
        quick = search(machine, PathQuery(start, NORMAL, goal, ENERGY))
        thorough = search(machine, PathQuery(start, NORMAL, goal, ENERGY), effort=THOROUGH)
        ratios.append(quick.cost / thorough.cost)
    assert np.mean(ratios) < 1.1
    assert max(ratios) < 1.25


def test_paths_cost_no_more_than_those_over_the_posture_table(machine, graph):
    random = np.random.default_rng(3)
    table, nodes = graph.table, np.flatnonzero(graph.table.feasible)
    compared = 0
    while compared < 10:
        here, there = random.choice(nodes, 2, replace=False)
        start, goal = table.posture[here, 0], tuple(table.nodes[there] * table.spacing)
        try:
            other = table_search(graph, PathQuery(start, NORMAL, goal, ENERGY))
        except NoPathError:
            continue
        path = search(machine, PathQuery(start, NORMAL, goal, ENERGY))
        assert path.cost <= 1.001 * other.cost
        compared += 1


def test_the_same_question_has_the_same_answer(machine, posture_within):
    start, goal = next(tasks(machine, posture_within, 1, seed=4))
    one, other = (
        search(machine, PathQuery(start, NORMAL, goal, ENERGY), effort=QUICK) for _ in range(2)
    )
    assert np.array_equal(one.posture, other.posture)
    assert np.array_equal(one.modes, other.modes)
    assert one.cost == other.cost


def test_an_angle_of_the_end_link_is_kept_when_asked_for(machine, posture_within):
    random = np.random.default_rng(5)
    start, end = posture_within(machine, random), posture_within(machine, random)
    goal = tuple(machine.tip_position(end))
    path = search(machine, PathQuery(start, NORMAL, goal, ENERGY, goal_psi=float(end.sum())))
    assert np.cos(path.posture[-1].sum() - end.sum()) == pytest.approx(1.0, abs=1e-12)
    assert search(machine, PathQuery(start, NORMAL, goal, ENERGY)).cost <= path.cost * 1.01


def test_paths_come_one_by_one_each_cheaper_than_the_one_before(machine, posture_within):
    several = 0
    for start, goal in tasks(machine, posture_within, 6, seed=6):
        query = PathQuery(start, NORMAL, goal, ENERGY)
        problem = SearchProblem.create(machine, query, limits=QUICK)
        paths = [path for path in yield_paths(problem) if path is not None]
        for path in paths:
            check_possible(machine, path, start, goal)
        assert np.all(np.diff([path.cost for path in paths]) < 0.0)
        several += len(paths) > 1
    assert several > 2


def test_lattices_are_searched_less_or_not_at_all_if_the_loop_would_skip_their_paths(
    machine, posture_within
):
    def find(start, goal, max_path_cost):
        progress = PlanProgress(max_path_cost=max_path_cost)
        query = PathQuery(start, NORMAL, goal, ENERGY)
        problem = SearchProblem.create(machine, query, limits=QUICK, progress=progress)
        found = [path for path in yield_paths(problem) if path is not None]
        costs = [path.cost for path in found]
        return costs, found[-1].statistics.expanded, problem.lower_bound

    several = 0
    for start, goal in tasks(machine, posture_within, 6, seed=6):
        costs, expanded, lower_bound = find(start, goal, math.inf)
        assert find(start, goal, costs[0])[:2] == (costs, expanded)
        less = find(start, goal, 0.5 * (lower_bound + costs[-1]))[1]
        assert less <= anytime_search.TOO_DEAR_EFFORT * QUICK.max_expansions
        assert find(start, goal, 0.999 * lower_bound)[1] == 0
        several += expanded > less
    assert several > 0


def test_a_lattice_is_made_only_where_a_goal_posture_may_be_cheaper(
    machine, posture_within, monkeypatch
):
    made, create = [], anytime_search.create_lattice_search

    def noted(task, priced_by, goal_indices, spacing):
        made.append(len(goal_indices))
        return create(task, priced_by, goal_indices, spacing)

    monkeypatch.setattr(anytime_search, "create_lattice_search", noted)
    for start, goal in tasks(machine, posture_within, 8, seed=11):
        search(machine, PathQuery(start, NORMAL, goal, ENERGY), effort=QUICK)
    assert len(made) > 8
    assert min(made) > 0


def test_where_no_straight_line_is_possible_it_says_so_first(machine):
    barred = machine.changed(zones=Zones(tip_boxes=((0.45, 0.20, 0.90, 0.30),)))
    start = machine.postures(0.55, -0.05, np.linspace(-3.0, 3.0, 50))[0]
    query = PathQuery(start, NORMAL, (0.55, 0.60), ENERGY)
    found = list(yield_paths(SearchProblem.create(barred, query)))
    assert found[0] is None
    best = [path for path in found if path is not None][-1]
    check_possible(barred, best, start, (0.55, 0.60))


@pytest.mark.parametrize("count", [3, pytest.param(6, marks=pytest.mark.slow)])
def test_when_time_is_up_the_best_so_far_is_taken_and_told(machine, posture_within, looks, count):
    told = 0
    for start, goal in tasks(machine, posture_within, count, seed=6):
        never = looks.deadline_after(math.inf)
        free = search(machine, PathQuery(start, NORMAL, goal, ENERGY), deadline=never, effort=QUICK)
        assert not free.statistics.out_of_time
        needed = looks.count
        for after in range(0, needed - 1, max(3, needed // 30)):
            try:
                soon = looks.deadline_after(after)
                hurried = search(
                    machine, PathQuery(start, NORMAL, goal, ENERGY), deadline=soon, effort=QUICK
                )
            except DeadlineError:
                continue
            finally:
                assert looks.count <= after + LOOKS_TO_END
            check_possible(machine, hurried, start, goal)
            assert hurried.cost >= free.cost
            told += hurried.statistics.out_of_time
    assert told > 3 * count


def test_the_modes_in_force_count_as_switches(machine, posture_within):
    start, goal = next(tasks(machine, posture_within, 1, seed=7))
    boosted = np.array([1, 1, 1], dtype=np.uint8)
    path = search(machine, PathQuery(start, boosted, goal, ENERGY))
    first = np.count_nonzero(path.modes[0] != boosted)
    assert path.switches >= first
    assert np.array_equal(path.start_modes, boosted)


def test_another_payload_is_planned_for_at_once(machine, posture_within):
    for start, goal in tasks(machine, posture_within, 3, seed=8):
        light = machine.changed(payload=0.0)
        path = search(light, PathQuery(start, NORMAL, goal, ENERGY))
        check_possible(light, path, start, goal)
        assert path.cost <= search(machine, PathQuery(start, NORMAL, goal, ENERGY)).cost * 1.05


def test_a_start_at_the_goal_has_nothing_to_do(machine, posture_within):
    start = posture_within(machine, np.random.default_rng(9))
    path = search(machine, PathQuery(start, NORMAL, tuple(machine.tip_position(start)), ENERGY))
    assert path.steps == 0
    assert path.cost == 0.0


def test_impossible_goals_are_refused(machine, posture_within):
    start = posture_within(machine, np.random.default_rng(10))
    with pytest.raises(OutOfWorkspaceError):
        search(machine, PathQuery(start, NORMAL, (2.0, 0.0), ENERGY))
    with pytest.raises(InfeasibleGoalError):
        search(machine, PathQuery(start, NORMAL, (0.55, 0.2), ENERGY, goal_psi=3.1))
    heavy = replace(machine, arrays=machine.arrays._replace(max_boost_pressure=1e5))
    above = np.array(machine.tip_position(start)) + [0.0, 0.1]
    if above @ above < 1.0:
        with pytest.raises(NoPathError):
            search(heavy, PathQuery(start, NORMAL, tuple(above), ENERGY))


@pytest.mark.parametrize(
    ("zones", "start", "goal"),
    [
        (
            Zones(boxes=((0.403, 0.506, 0.541, 0.708),), circles=((0.772, 0.28, 0.07),)),
            (0.3301, -2.1685, 0.7313),
            (0.35, 0.75),
        ),
        (
            Zones(boxes=((0.694, 0.743, 0.801, 0.844),), circles=((0.346, 0.151, 0.084),)),
            (1.981, -1.1268, 0.0064),
            (0.30, -0.15),
        ),
    ],
)
def test_ways_between_obstacles_are_found_where_no_straight_line_is_possible(
    machine, zones, start, goal
):
    among = machine.changed(zones=zones)
    query = PathQuery(np.array(start), NORMAL, goal, ENERGY)
    assert next(yield_paths(SearchProblem.create(among, query))) is None
    path = search(among, query)
    check_possible(among, path, np.array(start), goal)
    assert min(among.clearance(q)[0] for q in path.posture) > 0.0
