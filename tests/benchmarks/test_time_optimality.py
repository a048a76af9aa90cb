"""The collocation: against the shortest time that is known in closed form, and what it keeps."""

import numpy as np
import pytest
from benchmarks.time_optimality import TIME_OPTIMAL, shortest_duration

from mhsb_model.trajectory import MotionState
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.planning.motion_rules import FASTER_RAMP_FACTORS


@pytest.fixture(scope="module")
def planner(machine, table):
    return Planner(machine, table)


def test_a_move_of_known_shortest_time_is_found_within_a_hundredth(machine, planner):
    """One piston at V_max all the way: T = ΔL/V_max + T₁ + T₂, with the fastest ramps."""
    start = np.array([0.3, -1.4, -1.0])
    goal = tuple(machine.tip_position(start + [0.25, 0.0, 0.0]))
    options = PlanOptions(TIME_OPTIMAL, planner="integrated")
    plan = planner.plan(goal, MotionState.at_rest(start), options=options)
    shortest = shortest_duration(machine, plan)
    end = plan.motion.trajectory.position[-1]
    stroke = np.abs(machine.cylinder_lengths(end) - machine.cylinder_lengths(start))
    known = (stroke / machine.arrays.max_piston_speed).max() + FASTER_RAMP_FACTORS[0] * 0.17
    assert shortest <= 1.01 * known
    assert plan.duration == pytest.approx(known, abs=0.01)


def test_one_slower_piston_makes_the_shortest_motion_longer_but_not_as_all_of_them_do(
    machine, table
):
    start, found = np.array([0.3, -1.4, -1.0]), []
    goal = tuple(machine.tip_position(start + [0.25, 0.0, 0.0]))
    slower = machine.with_values({"joints.0.actuator.max_piston_speed": 0.006})
    for arm in (machine, slower, machine.changed(max_piston_speed=0.006)):
        options = PlanOptions(TIME_OPTIMAL, planner="integrated")
        plan = Planner(arm, table).plan(goal, MotionState.at_rest(start), options=options)
        found.append(shortest_duration(arm, plan))
        assert found[-1] <= 1.01 * plan.duration
    assert 1.2 * found[0] < found[1] < found[2]


def test_no_plan_is_far_from_the_shortest(machine, planner):
    random, ratios = np.random.default_rng(0), []
    nodes = np.flatnonzero(planner.graph.table.feasible)
    while len(ratios) < 4:
        here, there = random.choice(nodes, 2, replace=False)
        x, z = planner.graph.table.nodes[there] * planner.graph.table.spacing
        start = MotionState.at_rest(planner.graph.table.posture[here, 0])
        options = PlanOptions(TIME_OPTIMAL, planner="integrated")
        plan = planner.plan((float(x), float(z)), start, options=options)
        shortest = shortest_duration(machine, plan)
        if shortest is not None:
            ratios.append(plan.duration / shortest)
    assert np.median(ratios) < 1.05
    assert max(ratios) < 1.1
