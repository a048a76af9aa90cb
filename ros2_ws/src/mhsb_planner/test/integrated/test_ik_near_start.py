"""Goal postures near the start, against the same found in plain Python, and what they are for."""

import itertools

import numpy as np
import pytest
from tests.support.lower_bounds import energy_lower_bound

from mhsb_model.files.config_files import find_config_file
from mhsb_model.inverse_kinematics.tip_postures import solve_posture
from mhsb_model.machine import Machine, load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_planner.integrated.goal_postures import sample_goal_postures
from mhsb_planner.integrated.ik_near_start import JOINT_SAMPLE_COUNT, add_postures_near_start
from mhsb_planner.integrated.integrated_search import search
from mhsb_planner.integrated.lower_bound import bound_energy_to_goal
from mhsb_planner.planner import ENERGY_OPTIMAL
from mhsb_planner.search.s2_search import PathQuery
from mhsb_planner.search.s2_step import compute_hydraulic_coefficients

WEIGHT = np.array([1.0, 0.0, 0.0])
START, GOAL = np.array([0.3, -1.4, -1.2, -0.5]), (0.60, 0.25)


@pytest.fixture(scope="module")
def arm() -> Machine:
    return load_machine(find_config_file("mhsb_arm4.yaml"))


def near(machine, start, goal):
    """What is added to the samples."""
    goals = sample_goal_postures(machine, *goal)
    circuit = compute_hydraulic_coefficients(machine.arrays, machine.patterns)
    more = add_postures_near_start(machine, goals, start, circuit, WEIGHT)
    count = len(goals.posture)
    np.testing.assert_array_equal(more.posture[:count], goals.posture)
    return more, more.posture[count:]


def bent(machine, start, goal, i, j, k, value):
    """Postures with joint k at a value, in which i and j alone put the tip at the goal.

    What is beyond joint j turns about it, so that joint i has to bring it as far from the goal as
    the tip is from it: the zeros of the difference over a fine grid, by bisection.
    """
    a, length = machine.arrays, machine.arrays.link_length

    def tip(q):
        angle = np.cumsum(q, axis=-1)
        return np.stack([(np.cos(angle) * length).sum(-1), (np.sin(angle) * length).sum(-1)], -1)

    q = np.tile(start, (2001, 1))
    q[:, k] = value
    q[:, i] = np.linspace(a.joint_min[i], a.joint_max[i], len(q))

    def off(rows):
        upto = np.cumsum(rows, axis=-1)[:, :j]
        along, across = np.cos(upto) * length[:j], np.sin(upto) * length[:j]
        at = np.stack([along.sum(-1), across.sum(-1)], -1)
        beyond = np.linalg.norm(tip(rows) - at, axis=-1)
        return np.linalg.norm(np.array(goal) - at, axis=-1) - beyond, at

    found = []
    value_at, _ = off(q)
    for row in np.flatnonzero(value_at[:-1] * value_at[1:] <= 0.0):
        low, high = q[row].copy(), q[row + 1].copy()
        for _ in range(60):
            middle = 0.5 * (low + high)
            same = off(middle[None])[0][0] * off(low[None])[0][0] > 0.0
            low, high = (middle, high) if same else (low, middle)
        (_, at), now = off(low[None]), tip(low)
        turn = np.arctan2(*(np.array(goal) - at[0])[::-1]) - np.arctan2(*(now - at[0])[::-1])
        low[j] = low[j] + turn
        middle = 0.5 * (a.joint_min[j] + a.joint_max[j])
        low[j] -= 2 * np.pi * np.round((low[j] - middle) / (2 * np.pi))
        if a.joint_min[j] - 1e-9 <= low[j] <= a.joint_max[j] + 1e-9:
            found.append(low)
    return found


def test_of_each_curve_the_posture_of_the_least_bound_is_added(arm):
    a = arm.arrays
    _, added = near(arm, START, GOAL)
    curves = list(itertools.combinations(range(4), 2))
    wanted = []
    for (i, j), k in itertools.product(curves, range(4)):
        if k in (i, j):
            continue
        values = [*np.linspace(a.joint_min[k], a.joint_max[k], JOINT_SAMPLE_COUNT), START[k]]
        ways = [q for v in values for q in bent(arm, START, GOAL, i, j, k, v)]
        if ways:
            wanted.append(min(energy_lower_bound(arm, START, q[None]) for q in ways))
    found = [energy_lower_bound(arm, START, q[None]) for q in added]
    assert len(found) == len(wanted) > 5
    assert found == pytest.approx(wanted, rel=1e-6)


def test_they_are_told_as_the_samples_are(arm):
    goals, added = near(arm, START, GOAL)
    q = np.empty(4)
    for row, posture in zip(range(-len(added), 0), added, strict=True):
        assert arm.tip_position(posture) == pytest.approx(GOAL, abs=1e-9)
        assert np.all(posture >= arm.arrays.joint_min)
        assert np.all(posture <= arm.arrays.joint_max)
        inside = np.all(posture > arm.arrays.joint_min + 1e-9)
        if inside and np.all(posture < arm.arrays.joint_max - 1e-9):
            assert solve_posture(arm.arrays, *GOAL, goals.free[row], int(goals.elbow[row]), q)
            assert q == pytest.approx(posture, abs=1e-9)


def test_none_are_added_with_three_joints_or_where_psi_is_asked_for(arm, machine):
    for each, psi in ((machine, None), (arm, -1.0)):
        goals = sample_goal_postures(each, *GOAL, psi)
        start = each.config.simulation.start_posture
        circuit = compute_hydraulic_coefficients(each.arrays, each.patterns)
        assert add_postures_near_start(each, goals, np.array(start), circuit, WEIGHT) is goals


def test_a_short_way_along_a_joints_limit_is_found(arm):
    """Where only postures with joint 4 at its limit are near, between the samples."""
    start = np.array([-1.01679317, -0.1312, -1.90352569, 0.524])
    modes = np.zeros(4, dtype=np.uint8)
    path = search(arm, PathQuery(start, modes, (0.0, -1.05), ENERGY_OPTIMAL))
    bound = bound_energy_to_goal(arm, start, (0.0, -1.05))
    assert path.energy.sum() < 1.02 * bound  # 1.33 times by the samples alone


def test_among_zones_nothing_is_added_if_no_posture_near_the_start_reaches_the_goal(arm):
    machine = arm.changed(zones=Zones(circles=((0.80, 0.25, 0.08),)))
    _, added = near(machine, np.array([-0.827, -0.131, 0.588, 0.524]), (0.0, 0.4))
    assert len(added) == 0
