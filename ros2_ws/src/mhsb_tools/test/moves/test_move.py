"""A planned move has the plan's pressures, forces and energy."""

from dataclasses import replace

import numpy as np
import pytest

from mhsb_model.modes import Mode
from mhsb_model.trajectory import MotionState
from mhsb_planner.cases.paper_cases import get_paper_case
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_tools.moves.move import move_of_plan

LOAD, NEEDED = "the load's, $p_L$", "needed: $p_L$, valve, margin"


@pytest.fixture(scope="module")
def plan(machine, table):
    case = get_paper_case("3-2")
    start = MotionState.at_rest(case.start_posture(machine))
    return Planner(machine, table).plan(case.goal, start, options=PlanOptions(planner="table"))


@pytest.fixture(scope="module")
def move(machine, plan):
    return move_of_plan(machine, plan, get_paper_case("3-2").goal, "Case 3-2")


def test_the_picture_and_the_text_name_the_same_energy(plan, move):
    paper, series = f"{plan.energy.paper:.1f} J", f"{plan.energy.series:.1f} J"
    assert paper != series
    assert f"{paper} by the paper's formula, {series} with the pumps in series" in str(plan)
    assert f"with the pumps in series:\n{series}, saves " in move.energy_title
    pumps = -move.energy["main pump"] - move.energy["servo pumps"]
    assert f"{pumps:.1f} J" == series


def test_the_picture_names_the_saving_against_the_highest_pressure_that_the_motion_needs(
    plan, move
):
    m = move.machine.arrays
    strokes = np.diff([move.machine.cylinder_lengths(q) for q in move.position], axis=0)
    oil = (np.where(strokes > 0.0, m.cap_area, m.rod_area) * np.abs(strokes)).sum()
    pressure = move.chambers[NEEDED].max()
    ratio = (pressure - m.tank_pressure) / (m.supply_pressure - m.tank_pressure)
    leaked = 3 * m.leakage_flow * np.sqrt(ratio) * move.duration
    share = 1.0 - plan.energy.series / (pressure * (oil + leaked))
    assert share > 0.1
    assert f"saves {100 * share:.0f} % against one pump at constant" in move.energy_title
    assert f" {pressure / 1e6:.1f} MPa for this motion (" in move.energy_title


def test_the_heading_names_a_rest_at_the_end_and_no_other(move):
    assert move.heading == f"Case 3-2: {move.duration:.2f} s"
    later = move.time[-1] + np.arange(1, 51) / 100.0
    held = np.repeat(move.position[-1:], 50, axis=0)
    rested = replace(
        move,
        time=np.concatenate([move.time, later]),
        position=np.vstack([move.position, held + 1e-3]),
        reference=np.vstack([move.position, held]),
    )
    assert rested.heading == f"Case 3-2: {move.duration + 0.5:.2f} s, the last 0.5 s at rest"


def test_it_begins_and_ends_where_the_case_does(move):
    case = get_paper_case("3-2")
    np.testing.assert_allclose(move.tip[0], case.start, atol=1e-6)
    np.testing.assert_allclose(move.tip[-1], case.goal, atol=1e-6)
    assert move.duration == move.time[-1] > 1.0


def test_all_energy_goes_somewhere(move):
    given = -sum(value for value in move.energy.values() if value < 0.0)
    assert given > 100.0
    assert abs(sum(move.energy.values())) < 1e-6 * given


def test_the_needed_pressure_adds_the_drop_of_the_fully_open_valve_and_the_boost_margin(move):
    m = move.machine.arrays
    needed, load = move.chambers[NEEDED], move.chambers[LOAD]
    for k, j in ((50, 0), (200, 1), (400, 2)):
        speed, cap, rod = move.speed[k, j], m.cap_area[j], m.rod_area[j]
        drop = speed**2 * (cap**3 + rod**3) / m.valve_coefficient[j] ** 2
        drop /= cap if speed > 0 else rod
        assert needed[k, j] == pytest.approx(load[k, j] + drop + m.boost_margin)


def test_forces_balance_gravity(move):
    for k in (0, 100, 300, -1):
        np.testing.assert_allclose(move.force[k], move.machine.piston_forces(move.position[k]))


def test_lines_in_normal_mode_are_at_the_main_pumps_pressure_and_boosted_ones_carry_the_load(move):
    normal = move.machine.arrays.supply_pressure
    boosted = move.modes != Mode.N
    assert np.any(boosted)
    np.testing.assert_array_equal(move.supply[~boosted], normal)
    assert np.all(move.supply[boosted] >= normal)
    load = move.chambers[LOAD]
    assert np.all(move.supply[boosted] > load[boosted])


def test_the_loads_pressure_is_that_of_a_balance_of_forces(move):
    m = move.machine.arrays
    load = move.chambers[LOAD]
    for k, j in ((50, 0), (200, 1), (400, 2)):
        force, cap, rod = move.force[k, j], m.cap_area[j], m.rod_area[j]
        out = (force + rod * m.tank_pressure) / cap
        back = (cap * m.tank_pressure - force) / rod
        extends = move.speed[k, j] > 0 if abs(move.speed[k, j]) > 1e-3 else force > 0
        assert load[k, j] == pytest.approx(out if extends else back)
