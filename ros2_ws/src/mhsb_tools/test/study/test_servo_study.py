from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from mhsb_model.holding import choose_holding_modes
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_planner.motion.energy import compute_motion_energy
from mhsb_planner.search.s2_search import Weights
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.study.energy_comparison import EnergyPart
from mhsb_tools.study.replay import Replay, replay
from mhsb_tools.study.scenarios import Scenario
from mhsb_tools.study.servo_study import (
    NEED_WINDOW,
    PLANNED_EVERY,
    PRESSURE_ALLOWANCE,
    ScenarioResult,
    StudyRecord,
    as_text,
    compare,
    compute_supply_overshoot,
    evaluate_run,
    plan_scenario,
    study_scenario,
)
from mhsb_tools.study.study_figures import draw_study

RAISED = np.array([0.9, -1.4, -1.5])  # the main pump holds it
LOADED = np.array([-0.3, -0.7, -0.4])  # boost in J1
STEP = 1e-3
KEYS = [
    "scenario",
    "controller",
    "tip_error_rms_mm",
    "tip_error_max_mm",
    "supply_peak_mpa",
    "supply_overshoot_mpa",
    "chamber_peak_mpa",
    "relief_opened",
    "energy_mp_j",
    "energy_sp_j",
    "energy_planned_series_j",
    "mode_switches",
    "held_out",
    "energy_mp_shaft_j",
    "energy_sp_hydraulic_j",
    "interventions",
]


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    goals = ((0.45, 0.30), (9.0, 9.0), (0.55, 0.10))
    return Scenario("short", goals, 1.0, 0.5, Weights(0.0, 15.0, 2.0), 0.02, 10.0, True)


@pytest.fixture(scope="module")
def result(machine: Machine, scenario: Scenario) -> ScenarioResult:
    return study_scenario(machine, scenario)


def still_run(machine: Machine, postures: np.ndarray, line: np.ndarray) -> Replay:
    """A run that stands still in each of its rows, float64[k, 3], with the lines at float64[k]."""
    rows = len(postures)
    reference = np.zeros((rows, 3, 3))
    reference[:, 0] = postures
    pressure = np.zeros((rows, 12))
    pressure[:, 2:-3:3] = line[:, None]
    modes = np.full((rows, 3), Mode.DB, dtype=np.uint8)
    return Replay(STEP, reference, postures.copy(), pressure, modes, {})


def test_overshoot_is_counted_above_supply_pressure_and_reserve(machine: Machine) -> None:
    supply = machine.arrays.supply_pressure
    line = np.full(1000, supply)
    line[500] += 1e6
    assert not choose_holding_modes(machine, machine.piston_forces(RAISED)).any()
    excess = compute_supply_overshoot(machine, still_run(machine, np.tile(RAISED, (1000, 1)), line))
    assert excess[500, 0] == pytest.approx(1e6 - PRESSURE_ALLOWANCE)
    assert excess[499, 0] == pytest.approx(-PRESSURE_ALLOWANCE)


def test_what_is_needed_soon_may_be_there_and_what_was_needed_fades(machine: Machine) -> None:
    postures = np.tile(RAISED, (2000, 1))
    postures[1000:1010] = LOADED
    excess = compute_supply_overshoot(machine, still_run(machine, postures, np.full(2000, 1e7)))[
        :, 0
    ]
    allowed = 1e7 - excess
    ahead = round(NEED_WINDOW / STEP)
    assert allowed[999 - ahead] < allowed[1001 - ahead]
    np.testing.assert_allclose(allowed[1001 - ahead : 1010], allowed[1005])
    oil = machine.config.circuit
    rate = machine.arrays.leakage_flow * oil.bulk_modulus / (oil.line_volume + oil.rail_volume)
    faded = round(0.5 * (allowed[1009] - allowed[0]) / (rate * STEP))
    assert faded > 10
    assert allowed[1009 + faded] == pytest.approx(allowed[1009] - faded * STEP * rate, rel=1e-6)
    assert allowed[-1] == pytest.approx(allowed[0])


def test_a_refused_goal_leaves_the_motion_as_it_is(machine: Machine, scenario: Scenario) -> None:
    script = plan_scenario(machine, scenario)
    assert len(script.commands) == 2
    (reason,) = script.refused
    assert reason.startswith("short: goal (9, 9) m: ")


def test_a_record_has_the_numbers_of_its_run(machine: Machine, scenario: Scenario) -> None:
    script = plan_scenario(machine, scenario)
    simulator = Simulator(script.machine, "coordinated")
    run = replay(simulator, script.commands, scenario.duration)
    planned = compute_motion_energy(script.machine, *run.followed_motion(PLANNED_EVERY))
    record = evaluate_run(script, "coordinated", run, planned)
    error = 1e3 * run.tip_error(machine)
    assert record.tip_error_max_mm == pytest.approx(error.max())
    assert record.tip_error_rms_mm < 1.0
    assert record.energy_mp_j == run.energies["main_pump"]
    assert record.energy_planned_series_j == pytest.approx(
        record.energy_mp_j + record.energy_sp_j, rel=0.15
    )
    assert record.held_out
    assert not record.relief_opened
    assert len(run.position) == round(scenario.duration / STEP)


def test_both_controllers_get_the_same_plans(result: ScenarioResult) -> None:
    records = result.records_by_controller
    assert list(records) == ["coordinated", "independent"]
    coordinated, independent = result.records
    assert coordinated.mode_switches == independent.mode_switches
    assert coordinated.energy_planned_series_j == independent.energy_planned_series_j
    assert coordinated.tip_error_rms_mm < independent.tip_error_rms_mm


def test_records_are_plain_json_with_the_agreed_keys(result: ScenarioResult) -> None:
    records = json.loads(json.dumps([asdict(record) for record in result.records]))
    assert [list(record) for record in records] == [KEYS, KEYS]


def record(controller: str, rms: float, overshoot: float, energy: float) -> StudyRecord:
    numbers = rms, rms, 8.0, overshoot, 8.0, False, energy, 0.0, 900.0, 4, False, 1.2 * energy, 0.0
    return StudyRecord("s", controller, *numbers)


def test_controllers_are_compared_by_the_worst_scenario(scenario: Scenario) -> None:
    results = [
        ScenarioResult(
            scenario,
            (record("coordinated", *a), record("independent", *b)),
            ("no",),
            {},
            {"coordinated": [EnergyPart("delivered", 900.0, a[2])]},
        )
        for a, b in (
            ((0.5, 0.4, 1000.0), (4.0, 2.0, 990.0)),
            ((0.2, -0.3, 1200.0), (8.0, 1.0, 1000.0)),
        )
    ]
    found = compare(results)
    assert found["tracking_ratio"]["least"] == pytest.approx(8.0)
    assert found["overshoot_max_mpa"] == {"coordinated": 0.4, "independent": 2.0}
    assert found["overshoot_mean_mpa"] == pytest.approx({"coordinated": 0.2, "independent": 1.5})
    assert found["overshoot_ratio"]["of_largest"] == pytest.approx(0.2)
    assert found["overshoot_ratio"]["of_mean"] == pytest.approx(0.2 / 1.5)
    assert found["overshoot_ratio"]["worst_scenario"] == pytest.approx(0.2)
    assert found["energy_ratio"] == pytest.approx(1000.0 / 990.0)
    assert found["energy_ratio_scenarios"] == 1
    assert found["goals_refused"] == ["no", "no"]
    assert found["energy_elements_j"][0]["simulated"] == pytest.approx(2200.0)
    assert "0.50" in as_text(results, found)[2]


def test_figures_are_drawn(result: ScenarioResult, tmp_path: Path) -> None:
    draw_study([result], tmp_path)
    files = sorted(tmp_path.iterdir())
    assert [file.name for file in files] == ["overview.png", "short.png"]
    assert all(file.stat().st_size > 5_000 for file in files)
