from collections.abc import Callable
from itertools import cycle, pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml

from mhsb_control import REGISTERED_CONTROLLERS
from mhsb_model.command import Command
from mhsb_model.files.config_files import find_config_file
from mhsb_model.files.machine_files import MACHINE_FILE
from mhsb_model.machine import Machine, load_machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.schema import Section
from mhsb_model.trajectory import MotionState, Trajectory
from mhsb_planner.search.s2_search import Weights
from mhsb_tools.errors import TuningError
from mhsb_tools.study.draws import DrawStudy
from mhsb_tools.study.scenarios import Scenario
from mhsb_tools.study.servo_study import PlannedScenario
from mhsb_tools.study.tuning import (
    GAIN_RANGES,
    Training,
    Trial,
    TuningRun,
    check_gain_sections,
    compute_cost,
    get_present_gains,
    is_stable,
    make_draws,
    make_scenario_run,
    tune,
    with_gains,
    write_gains,
)
from mhsb_tools.study.variations import load_variations

LIFTED = np.array([1.0, -1.3, -1.7])


@pytest.fixture
def script(machine: Machine, motion: Callable[..., tuple[Trajectory, ModeSchedule]]) -> TuningRun:
    """One second of a lift."""
    start = MotionState.at_rest(np.array(machine.config.simulation.start_posture))
    scenario = Scenario("lift", ((0.5, 0.5),), 1.0, 0.0, Weights(0.5, 0.0, 2.0), 0.02, 10.0, False)
    plans = (Command(*motion(start, LIFTED)),)
    return make_scenario_run(PlannedScenario(scenario, machine, plans, ()))


def test_every_controller_is_tuned_within_ranges_that_hold_its_present_gains(
    machine: Machine,
) -> None:
    assert {"coordinated", "independent"} <= set(GAIN_RANGES)
    for controller, ranges in GAIN_RANGES.items():
        for name, value in get_present_gains(machine, controller).items():
            lowest, highest = ranges[name]
            off = name == "integral_gain" and value == 0.0
            assert off or lowest <= value <= highest


@pytest.mark.parametrize(
    ("controller", "jobs"), list(zip(sorted(GAIN_RANGES), cycle((1, 2)), strict=False))
)
def test_the_search_only_improves_and_repeats_itself_whatever_the_processes(
    script: TuningRun, controller: str, jobs: int
) -> None:
    seen: list[Trial] = []
    training = Training([script])
    best = tune(script.machine, training, controller, 10, seed=3, jobs=1, progress=seen.append)
    assert len(seen) == 10
    assert all(b.cost <= a.cost for a, b in pairwise(seen))
    assert best == tune(script.machine, training, controller, 10, seed=3, jobs=jobs)
    assert best.cost <= compute_cost(
        script, controller, get_present_gains(script.machine, controller)
    )
    assert best.cost == compute_cost(script, controller, best.gains)


def test_gains_that_diverge_cost_much(script: TuningRun) -> None:
    assert compute_cost(script, "coordinated", {"position_gain": float("nan")}) == 1e3


def test_gains_that_let_the_arm_swing_itself_up_cost_much_without_a_run(
    script: TuningRun,
) -> None:
    machine, payloads = script.machine, {10.0, 13.0}
    assert is_stable(machine, payloads, "independent", {"force_damping": 2.1, "position_gain": 0.5})
    lively = {"force_damping": 0.5, "position_gain": 2.0}
    assert not is_stable(machine, payloads, "independent", lively)
    unstable = with_gains(machine, "independent", lively)
    assert tune(unstable, Training([script]), "independent", 1, jobs=1).cost == 1e3


def test_gains_of_another_law_than_the_cascade_s_need_no_linear_model(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class OtherController:
        class gains_section(Section):
            gain: float = 1.0

    monkeypatch.setitem(REGISTERED_CONTROLLERS, "other", OtherController)
    machine = load_machine().with_values({"servo.other": {"gain": 1.0}})
    assert is_stable(machine, {10.0}, "other", {"gain": 2.0})


def test_what_cannot_be_tuned_is_an_error(script: TuningRun) -> None:
    with pytest.raises(TuningError, match="valid are coordinated, independent"):
        tune(script.machine, Training([script]), "magic", 1)
    with pytest.raises(TuningError, match="neither training scenarios nor draws"):
        tune(script.machine, Training([]), "coordinated", 1)


def test_gains_are_written_into_their_section_alone(tmp_path: Path) -> None:
    own = find_config_file(MACHINE_FILE).read_text(encoding="utf-8")
    file = tmp_path / "arm.yaml"
    file.write_text(own, encoding="utf-8")
    write_gains(file, "independent", {"position_gain": 0.1234, "pressure_gain": 55.0})
    before, after = yaml.safe_load(own), yaml.safe_load(file.read_text(encoding="utf-8"))
    assert after["servo"]["independent"].pop("position_gain") == 0.123
    assert after["servo"]["independent"].pop("pressure_gain") == 55.0
    for name in ("position_gain", "pressure_gain"):
        del before["servo"]["independent"][name]
    assert after == before
    assert load_machine(file).config.servo.coordinated == load_machine().config.servo.coordinated
    assert file.read_text(encoding="utf-8").count("# paper") == own.count("# paper")


def test_a_file_without_the_gain_gets_a_line_and_without_the_section_is_an_error(
    tmp_path: Path,
) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text("servo:\n  coordinated:\n    position_gain: 1.0\nsimulation:\n  step: 1\n")
    write_gains(file, "coordinated", {"pump_response": 1.0, "position_gain": 0.5})
    assert yaml.safe_load(file.read_text(encoding="utf-8")) == {
        "servo": {"coordinated": {"position_gain": 0.5, "pump_response": 1.0}},
        "simulation": {"step": 1},
    }
    with pytest.raises(TuningError, match=r"no section servo\.independent"):
        write_gains(file, "independent", {})
    with pytest.raises(TuningError, match=r"no section servo\.independent"):
        check_gain_sections(file)


@pytest.fixture(scope="module")
def draws(machine: Machine) -> list[TuningRun]:
    return list(make_draws(machine, load_variations(machine), 2, 7))


def test_a_draw_costs_what_its_record_in_the_study_says(
    machine: Machine, draws: list[TuningRun]
) -> None:
    [record, _] = DrawStudy(machine, load_variations(machine), 7).run_draw(1)
    gains = get_present_gains(machine, "coordinated")
    assert record.tip_error_rms_mm is not None
    assert record.supply_overshoot_mpa is not None
    assert not record.relief_opened
    assert compute_cost(draws[1], "coordinated", gains) == pytest.approx(
        record.tip_error_rms_mm + max(0.0, record.supply_overshoot_mpa)
    )
    assert compute_cost(draws[1], "coordinated", {"position_gain": float("nan")}) == 1e3


def test_of_draws_a_high_quantile_counts_of_scenarios_the_mean(
    script: TuningRun, draws: list[TuningRun]
) -> None:
    costs = np.array([1.0, 3.0, 10.0, 20.0])
    assert Training([script, script], draws).cost(costs) == pytest.approx(2.0 + 19.0)
    assert Training([], draws).cost(costs[2:]) == pytest.approx(19.0)
    assert Training([script]).cost(costs[:1]) == 1.0
    plants = {draw.plant.arrays.payload for draw in draws}
    assert Training([script], draws).payloads == plants | {10.0}


def test_with_gains_changes_one_controller(machine: Machine) -> None:
    changed = with_gains(machine, "independent", {"pressure_gain": 33.0}).config.servo
    assert changed.independent.pressure_gain == 33.0
    assert changed.coordinated == machine.config.servo.coordinated
