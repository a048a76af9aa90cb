"""The runs: what each of them changes, and that nothing else changes them."""

from dataclasses import replace

import numpy as np
import pytest

from mhsb_model.trajectory import MotionState
from mhsb_planner.cases.paper_cases import load_paper_cases
from mhsb_planner.planner import Planner
from mhsb_tools.reproduction.runs import (
    ENERGY_WEIGHTS,
    PISTON_SPEEDS,
    SWITCH_WEIGHTS,
    TIME_WEIGHTS,
    count_work_units,
    evaluate,
    integrated_run,
    integrated_settings,
    pressure_run,
    settings,
    speed_run,
    switch_run,
    weight_run,
)

REDUCED = ("1-1", "4-2", "c5.vmax 0.03", "c5.ps 2.5e+06", "c5.ps 2.5e+06 kept table")


@pytest.fixture(scope="module")
def reduced(machine):
    """Some of the runs, made once more by one thread, their tables too."""
    every = settings()
    return evaluate(machine, {name: every[name] for name in REDUCED}, jobs=1)


def test_there_is_a_run_for_every_case_and_every_point_of_the_sweeps(runs):
    sweeps = len(ENERGY_WEIGHTS) * len(TIME_WEIGHTS) + len(PISTON_SPEEDS) + len(SWITCH_WEIGHTS)
    assert set(load_paper_cases()) <= set(runs.runs)
    assert len(runs.runs) == 9 + sweeps + 4
    for run in runs.runs.values():
        assert (run.path is None) == bool(run.failure)


def test_a_run_leads_from_its_case_s_start_to_its_goal(runs):
    for run in runs.runs.values():
        if run.path is not None:
            case = run.setting.case
            assert run.path.tip[[0, -1]] == pytest.approx(np.array([case.start, case.goal]))


def test_a_run_is_made_under_its_own_conditions(runs):
    arrays = runs.machine.arrays
    assert runs[speed_run(0.03)].machine.config.motion.max_piston_speed == 0.03
    assert runs[pressure_run(10e6)].machine.arrays.supply_pressure == 10e6
    assert runs[switch_run(20.0)].setting.case.weights.switches == 20.0
    assert runs["1-1"].machine.arrays.supply_pressure == arrays.supply_pressure
    zero = runs[weight_run(0.0, 0.0)].setting
    assert (zero.search, zero.case.weights.switches) == ("published", 0.0)


def test_the_energy_of_a_run_does_not_depend_on_the_threads(runs, reduced):
    for name in REDUCED:
        assert reduced[name].path.posture.tobytes() == runs[name].path.posture.tobytes()
        assert np.array_equal(reduced[name].path.energy, runs[name].path.energy)


def test_cases_come_out_as_the_planner_plans_them(machine, runs):
    planner = Planner(machine, runs.table)
    for name in ("1-1", "1-2", "4-2", "4-3"):
        case = load_paper_cases()[name]
        start = MotionState.at_rest(case.start_posture(machine))
        path = planner.plan(case.goal, start, options=case.options).path
        assert path.cost == pytest.approx(runs[name].path.cost, rel=1e-12)


def test_the_table_is_rebuilt_for_a_pressure_unless_it_is_kept(reduced):
    rebuilt, kept = (reduced[pressure_run(2.5e6, keep_table=keep)] for keep in (False, True))
    assert np.array_equal(kept.path.posture[0], reduced.table.posture[_start_node(reduced), 0])
    assert not np.array_equal(rebuilt.path.posture, kept.path.posture)


def _start_node(runs):
    x, z = runs["1-1"].setting.case.start
    return int(np.argmin(np.hypot(*(runs.table.nodes * runs.table.spacing - (x, z)).T)))


def test_progress_adds_up(told_runs):
    assert sum(told_runs[1]) == count_work_units(settings())


def test_tables_that_are_known_are_not_built_again(machine, runs):
    told, name = [], pressure_run(2.5e6)
    again = evaluate(machine, {name: settings()[name]}, progress=told.append, known=runs)
    assert sum(told) == 1
    assert again.tables[2.5e6] is runs.tables[2.5e6]
    assert again[name].path.posture.tobytes() == runs[name].path.posture.tobytes()


def test_a_run_without_path_is_a_result(machine, runs):
    case = replace(load_paper_cases()["1-1"], goal=(2.0, 0.0))
    every = settings({**load_paper_cases(), "1-1": case})
    run = evaluate(machine, {"1-1": every["1-1"]}, known=runs)["1-1"]
    assert run.path is None
    assert "outside the workspace" in run.failure


def test_the_integrated_planner_s_runs_are_cheaper_than_those_of_the_table(machine, runs):
    found = evaluate(machine, integrated_settings(), known=runs)
    compared = 0
    for name, run in runs.runs.items():
        if integrated_run(name) in found.runs and run.path is not None:
            assert found[integrated_run(name)].path.cost <= 1.001 * run.path.cost
            compared += 1
    assert compared >= 5
