"""The conventional method: joint 3 stays, and is changed by 1° at a time where it must be."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mhsb_model.command import Command
from mhsb_model.inverse_kinematics.closed_form_3r import is_within_limits
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_planner.cases.paper_cases import get_paper_case
from mhsb_planner.errors import DeadlineError, InfeasibleGoalError, RequestError
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.search.fixed_j3 import (
    ELBOW_DOWN,
    ELBOW_UP,
    build_fixed_j3_graph,
    compute_fixed_j3_posture,
    find_elbow_side,
)
from mhsb_planner.search.s2_search import PathQuery, Weights, search

DEGREE = math.radians(1.0)
NORMAL = np.zeros(3, dtype=np.uint8)
WEIGHTS = Weights(0.5, 0.0, 2.0)


def solutions(machine, x, z, j3):
    """Postures with that J3 by scanning J2: where the tip is as far from the base as (x, z)."""
    low, high = machine.arrays.joint_min, machine.arrays.joint_max
    j2 = np.linspace(low[1], high[1], 20_001)
    l1, l2, l3 = machine.arrays.link_length
    across = l2 * np.sin(j2) + l3 * np.sin(j2 + j3)
    ahead = l1 + l2 * np.cos(j2) + l3 * np.cos(j2 + j3)
    gap = np.hypot(ahead, across) - math.hypot(x, z)
    found = []
    for k in np.flatnonzero(np.sign(gap[:-1]) != np.sign(gap[1:])):
        j1 = math.atan2(z, x) - math.atan2(across[k], ahead[k])
        if low[0] < j1 < high[0]:
            found.append(np.array([j1, j2[k], j3]))
    return found


def random_postures(machine, count, seed):
    rng = np.random.default_rng(seed)
    low, high = machine.arrays.joint_min, machine.arrays.joint_max
    return rng.uniform(low, high, (count, 3))


def test_where_joint_3_can_stay_it_stays(machine):
    for q in random_postures(machine, 300, seed=41):
        x, z = machine.tip_position(q)
        found = compute_fixed_j3_posture(machine, x, z, q[2], find_elbow_side(machine, q))
        assert found == pytest.approx(q, abs=1e-7)
        assert found[2] == q[2]


def test_it_is_changed_by_the_fewest_steps_that_give_a_solution(machine):
    rng = np.random.default_rng(42)
    low, high = machine.arrays.joint_min[2], machine.arrays.joint_max[2]
    changed = 0
    for q in random_postures(machine, 60, seed=43):
        x, z = machine.tip_position(q)
        j3 = rng.uniform(low, high)
        found = compute_fixed_j3_posture(machine, x, z, j3)
        assert is_within_limits(machine.arrays, found)
        assert machine.tip_position(found) == pytest.approx((x, z), abs=1e-9)
        steps = (found[2] - j3) / DEGREE
        assert steps == pytest.approx(round(steps), abs=1e-9)
        for nearer in range(1 - abs(round(steps)), abs(round(steps))):
            angle = j3 + nearer * DEGREE
            assert not (low <= angle <= high and solutions(machine, x, z, angle))
        changed += round(steps) != 0
    assert 0 < changed < 60


def test_the_side_of_the_elbow_is_kept_where_both_will_do(machine):
    both = 0
    for q in random_postures(machine, 500, seed=44):
        x, z = machine.tip_position(q)
        up, down = (
            compute_fixed_j3_posture(machine, x, z, q[2], e) for e in (ELBOW_UP, ELBOW_DOWN)
        )
        if not np.array_equal(up, down):
            both += 1
            assert find_elbow_side(machine, up) == ELBOW_UP
            assert find_elbow_side(machine, down) == ELBOW_DOWN
    assert both > 0


def test_a_node_has_one_posture_for_all_modes(machine, table):
    graph = build_fixed_j3_graph(machine, table, -1.0, ELBOW_UP)
    assert len(graph.layout.posture) == np.count_nonzero(graph.table.feasible)
    for node in np.flatnonzero(graph.table.feasible)[::40]:
        x, z = table.nodes[node] * table.spacing
        expected = compute_fixed_j3_posture(machine, x, z, -1.0)
        assert np.array_equal(graph.table.posture[node], np.tile(expected, (23, 1)))


def test_a_graph_for_which_there_is_no_time_is_given_up(machine, table, looks):
    build_fixed_j3_graph(machine, table, -1.0, ELBOW_UP, deadline=looks.deadline_after(math.inf))
    needed = looks.count
    assert needed > 10
    for after in range(needed):
        with pytest.raises(DeadlineError):
            build_fixed_j3_graph(
                machine, table, -1.0, ELBOW_UP, deadline=looks.deadline_after(after)
            )
        assert looks.count == after + 1


def test_its_polytopes_are_smaller_than_those_of_the_posture_table(machine, table):
    graph = build_fixed_j3_graph(machine, table, -1.0, ELBOW_UP)
    reached = graph.table.feasible
    assert np.all(graph.table.area[reached] <= table.area[reached] * (1 + 1e-9))


def test_a_path_keeps_joint_3_wherever_it_can(machine, table):
    start = compute_fixed_j3_posture(machine, 0.50, -0.15, -1.0)
    graph = build_fixed_j3_graph(machine, table, -1.0, find_elbow_side(machine, start))
    path = search(graph, PathQuery(start, NORMAL, (0.65, 0.45), WEIGHTS))
    for tip, q in zip(path.tip, path.posture, strict=True):
        if solutions(machine, *tip, -1.0):
            assert q[2] == -1.0


def test_a_goal_off_the_grid_is_reached_in_the_same_way(machine, table):
    start = compute_fixed_j3_posture(machine, 0.50, -0.15, -1.0)
    graph = build_fixed_j3_graph(machine, table, -1.0, find_elbow_side(machine, start))
    path = search(graph, PathQuery(start, NORMAL, (0.673, 0.281), WEIGHTS))
    expected = compute_fixed_j3_posture(
        machine, 0.673, 0.281, -1.0, find_elbow_side(machine, start)
    )
    assert np.array_equal(path.posture[-1], expected)


def test_the_planner_keeps_joint_3_as_it_is_at_the_start(machine, table):
    planner = Planner(machine, table)
    start = compute_fixed_j3_posture(machine, 0.50, -0.15, -1.1)
    plan = planner.plan(
        (0.65, 0.45), MotionState.at_rest(start), options=PlanOptions(planner="fixed")
    )
    assert plan.path.posture[:, 2] == pytest.approx(-1.1)
    by_table = planner.plan(
        (0.65, 0.45), MotionState.at_rest(start), options=PlanOptions(planner="table")
    )
    assert np.ptp(by_table.path.posture[:, 2]) > 0.1


@pytest.mark.parametrize("name", ["4-2", "4-3"])
def test_the_cases_of_the_paper_start_at_their_initial_angle(machine, name):
    case = get_paper_case(name)
    assert (case.planner, case.options.planner) == ("fixed", "fixed")
    start = case.start_posture(machine)
    assert np.array_equal(start, compute_fixed_j3_posture(machine, *case.start, case.initial_j3))
    without = replace(case, initial_j3=None)
    assert machine.tip_position(without.start_posture(machine)) == pytest.approx(case.start)


def test_an_angle_out_of_its_limits_is_refused(machine, table):
    high = machine.arrays.joint_max[2]
    with pytest.raises(RequestError, match="initial J3 must be within"):
        compute_fixed_j3_posture(machine, 0.5, 0.1, high + 0.1)
    with pytest.raises(RequestError, match="initial J3 must be within"):
        build_fixed_j3_graph(machine, table, float("nan"), ELBOW_UP)


def test_a_point_out_of_reach_has_no_posture(machine):
    with pytest.raises(InfeasibleGoalError):
        compute_fixed_j3_posture(machine, 1.1, 0.0, -1.0)


def test_it_replans_from_a_moving_start_and_keeps_joint_3_from_there(machine, table):
    replanner = Replanner(machine, table)
    options = PlanOptions(planner="fixed")
    start = compute_fixed_j3_posture(machine, 0.50, -0.15, -1.1)
    hold = Command.hold(0, start, NORMAL)
    first = replanner.replan(hold, SECOND_NS, (0.65, 0.45), 0.1, options)
    second = replanner.replan(first.command, 2 * SECOND_NS, (0.60, 0.0), 0.1, options)
    end = second.command.trajectory.position[-1]
    assert machine.tip_position(end) == pytest.approx((0.60, 0.0), abs=1e-6)
    assert end[2] == pytest.approx(second.plan.path.posture[0, 2])
