"""The best supply pressure and V_max, against dense sweeps."""

import math

import numpy as np
import pytest

from mhsb_model.errors import MachineFileError
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_planner.cases.paper_cases import get_paper_case
from mhsb_planner.errors import RequestError
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.search.s2_search import Weights
from mhsb_tools.moves.operating_point import (
    NoOperatingPointError,
    Range,
    find_best_operating_point,
)

TABLE = PlanOptions(planner="table")
PRESSURES, SPEEDS = Range(2e6, 10e6), Range(6e-3, 30e-3)


@pytest.fixture(scope="module")
def only_planner(machine, table) -> Planner:
    return Planner(machine, table)


@pytest.fixture
def planner(only_planner, machine) -> Planner:
    """A planner whose machine is free to be changed."""
    only_planner.change_machine(machine)
    return only_planner


def move(machine):
    case = get_paper_case("1-1")
    return case.goal, MotionState.at_rest(case.start_posture(machine))


def cost_at(planner, pressure, goal, start, options):
    """By hand: w₁ E + w₂ T + w₃ switches of the motion with this supply pressure."""
    planner.change_machine(planner.machine.changed(supply_pressure=pressure))
    plan = planner.plan(goal, start, options=options)
    duration = plan.motion.trajectory.duration_ns / SECOND_NS
    weights = options.weights
    return (
        weights.energy * plan.energy.paper
        + weights.time * duration
        + weights.switches * plan.motion.schedule.switch_count
    )


def check_told(found):
    """The best of the points looked at, and they are in order."""
    points = [(each.supply_pressure, each.v_max) for each in found.curve]
    assert points == sorted(set(points))
    assert found.best.cost == min(each.cost for each in found.curve)
    assert found.machine.arrays.supply_pressure == found.best.supply_pressure
    assert found.machine.config.motion.max_piston_speed == found.best.v_max
    assert found.plan.energy.paper == found.best.energy


@pytest.mark.parametrize("kind", ["table", pytest.param("integrated", marks=pytest.mark.slow)])
def test_the_best_pressure_is_as_good_as_that_of_a_dense_sweep(machine, table, planner, kind):
    goal_and_start, options = move(machine), PlanOptions(planner=kind)
    found = find_best_operating_point(planner, *goal_and_start, options, PRESSURES)
    check_told(found)
    other = Planner(machine, table)
    best, *dense = (
        cost_at(other, pressure, *goal_and_start, options)
        for pressure in (found.best.supply_pressure, *np.linspace(2e6, 10e6, 60))
    )
    assert found.best.cost == pytest.approx(best, rel=1e-9)
    assert best <= 1.002 * min(dense)


@pytest.mark.slow
def test_pressure_and_speed_together_are_no_worse_than_either_alone(machine, planner):
    options, goal_and_start = (
        PlanOptions(planner="table", weights=Weights(0.5, 5.0, 2.0)),
        move(machine),
    )
    alone = []
    for ranges in ((PRESSURES, None), (None, SPEEDS)):
        found = find_best_operating_point(planner, *goal_and_start, options, *ranges)
        check_told(found)
        alone.append(found.best.cost)
        planner.change_machine(machine)
    both = find_best_operating_point(planner, *goal_and_start, options, PRESSURES, SPEEDS)
    check_told(both)
    assert both.best.cost <= min(alone)
    assert len({each.v_max for each in both.curve}) >= 9


def test_samples_are_told_once_the_machine_s_own_point_and_the_ends_among_them(machine, planner):
    told = []
    found = find_best_operating_point(
        planner, *move(machine), TABLE, Range(3e6, 5.3e6), on_sample=told.append
    )
    assert sorted(told, key=lambda each: each.supply_pressure) == list(found.curve)
    looked_at = {each.supply_pressure for each in found.curve}
    assert {3e6, 5.3e6, machine.arrays.supply_pressure} <= looked_at
    assert {each.v_max for each in found.curve} == {machine.config.motion.max_piston_speed}


def test_points_without_plan_say_why_and_the_others_are_chosen_from(machine, planner):
    planner.change_machine(machine.changed(payload=38.5))
    goal, start = move(machine)
    found = find_best_operating_point(planner, goal, start, TABLE, Range(1e6, 10e6))
    without = [each for each in found.curve if each.failure]
    assert without
    assert found.best not in without
    assert all("no sequence of admissible steps" in each.failure for each in without)
    assert all(each.cost == math.inf for each in without)


def test_a_move_that_has_no_plan_anywhere_is_refused_with_the_ranges(machine, planner):
    planner.change_machine(machine.changed(payload=80.0))
    goal, start = move(machine)
    with pytest.raises(NoOperatingPointError, match=r"supply pressure in 2e\+06 … 3e\+06 Pa"):
        find_best_operating_point(planner, goal, start, TABLE, Range(2e6, 3e6))


@pytest.mark.parametrize(
    "ends", [(3e6, 2e6), (0.0, 2e6), (-1.0, 2e6), (math.nan, 2e6), (2e6, math.nan), (2e6, math.inf)]
)
def test_a_range_has_two_finite_ends_above_0_in_order(ends):
    with pytest.raises(RequestError, match="two finite numbers above 0, the lower one first"):
        Range(*ends)


def test_ranges_that_no_machine_may_have_and_none_at_all_are_refused(machine, planner):
    goal, start = move(machine)
    with pytest.raises(MachineFileError, match=r"main_pump\.pressure"):
        find_best_operating_point(planner, goal, start, None, Range(2e6, 100e6))
    with pytest.raises(MachineFileError, match="max_piston_speed"):
        find_best_operating_point(planner, goal, start, None, None, Range(6e-3, 3.0))
    with pytest.raises(RequestError, match="must be given"):
        find_best_operating_point(planner, goal, start)
