"""Planner and simulator in lock-step: what goals that come again, and again, make of a motion."""

import numpy as np
import pytest

from mhsb_model.machine import load_machine
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import PLANNER_KINDS, PlanOptions
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.study.energy_comparison import EnergyPart
from mhsb_tools.study.headless import HeadlessRun, Samples, TimedGoal, convert_to_move

GOAL = (0.55, 0.60)
AGAIN = 0.1
"""Time between two goals [s]."""


@pytest.fixture(scope="module")
def replanner():
    arm = load_machine()
    return Replanner(arm, load_or_build_table(arm))


@pytest.mark.parametrize("planner", PLANNER_KINDS)
def test_a_goal_that_comes_again_ten_times_a_second_is_reached_as_if_it_came_once(
    machine, replanner, planner
):
    def samples(goals):
        run = HeadlessRun(Simulator(machine), replanner, PlanOptions(planner=planner))
        results = list(run.run(goals))
        return run.samples(), results

    times = 170
    often, results = samples([TimedGoal(GOAL, AGAIN)] * times)
    once, _ = samples([TimedGoal(GOAL, times * AGAIN)])
    assert [result.replan is not None for result in results] == [True] + [False] * (times - 1)
    assert results[-1].goal_distance < 1e-3
    np.testing.assert_array_equal(often.reference, once.reference)
    np.testing.assert_array_equal(often.position, once.position)


def test_the_page_of_a_run_names_energy_and_saving(machine):
    m, count = machine.arrays, 201
    q = np.tile(machine.config.simulation.start_posture, (count, 1))
    zero, time = np.zeros((count, 3)), np.arange(count) / 100.0
    modes, scalar = zero.astype(np.uint8), np.zeros(count)
    held = Samples(time, q, q, zero, zero, scalar, modes, zero, zero, zero, zero, zero)
    names = {"delivered": 9.0, "by the main pump": 7.0, "by the servo pumps": 2.0}
    parts = [EnergyPart(name, 0.0, value) for name, value in names.items()]
    page = convert_to_move(machine, held, [TimedGoal(GOAL, 2.0)], parts)
    force = machine.piston_forces(q[0])
    load = np.where(force > 0.0, force + m.rod_area * m.tank_pressure,
                    m.cap_area * m.tank_pressure - force)  # fmt: skip
    pressure = (load / np.where(force > 0.0, m.cap_area, m.rod_area)).max() + m.boost_margin
    ratio = (pressure - m.tank_pressure) / (m.supply_pressure - m.tank_pressure)
    other = 2.0 * 3 * pressure * m.leakage_flow * np.sqrt(ratio)
    assert page.energy_title == (
        f"energy as simulated:\n9.0 J, saves {100 * (1.0 - 9.0 / other):.0f} % against one pump "
        f"at constant {pressure / 1e6:.1f} MPa for this motion ({other:.1f} J)"
    )
    assert page.heading.endswith("2.00 s, the last 2.0 s at rest")


def test_a_goal_that_comes_again_after_another_is_planned_for_again(machine, replanner):
    run = HeadlessRun(Simulator(machine), replanner, PlanOptions(planner="integrated"))
    other = (0.60, 0.10)
    goals = [TimedGoal(GOAL, 0.5), TimedGoal(other, 0.5), TimedGoal(GOAL, 8.0)]
    results = list(run.run(goals))
    assert all(result.replan is not None for result in results)
    assert results[-1].goal_distance < 1e-3
