from pathlib import Path

import pytest

from mhsb_model.files.config_files import find_config_file
from mhsb_model.files.yaml_files import YamlFileError
from mhsb_model.machine import Machine, load_machine
from mhsb_tools.errors import ScenarioError
from mhsb_tools.study.scenarios import load_scenarios

FILE = """
pump_lags: [0.02, 0.08]
payloads: [0.0, 10.0]
tail: 1.0
sequences:
  flips: {interval: 2.0, weights: [0.5, 0.0, 2.0], goals: [[0.6, 0.1], [0.6, -0.1]]}
training: [flips-80ms-10kg]
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "scenarios.yaml"
    path.write_text(FILE)
    return path


def test_every_sequence_is_run_with_every_lag_and_payload(file: Path) -> None:
    scenarios = load_scenarios(file)
    assert [each.name for each in scenarios] == [
        "flips-20ms-0kg",
        "flips-20ms-10kg",
        "flips-80ms-0kg",
        "flips-80ms-10kg",
    ]
    assert [each.held_out for each in scenarios] == [True, True, True, False]
    assert scenarios[0].duration == 5.0


def test_the_suites_own_scenarios_cover_lags_payloads_and_intervals() -> None:
    scenarios = load_scenarios()
    assert {each.pump_lag for each in scenarios} == {0.02, 0.08}
    assert {each.payload for each in scenarios} == {0.0, 10.0, 13.0}
    assert {each.interval for each in scenarios} == {5.0, 3.0, 2.0}
    assert 0 < sum(not each.held_out for each in scenarios) < len(scenarios) / 2


@pytest.mark.parametrize(
    ("name", "payloads"),
    [("mhsb_arm4", {0.0, 8.0, 10.0}), ("telescope_arm", {0.0, 8.0, 9.0})],
)
def test_a_machine_has_scenarios_of_its_own_by_its_name(name: str, payloads: set[float]) -> None:
    arm = load_machine(find_config_file(f"{name}.yaml"))
    own = load_scenarios(machine=arm)
    assert {each.payload for each in own} == payloads
    assert 0 < sum(not each.held_out for each in own) < len(own) / 2
    assert load_scenarios(machine=_renamed(arm)) == load_scenarios()


def _renamed(arm: Machine) -> Machine:
    return Machine.from_config(arm.config.model_copy(update={"name": "another_arm"}))


def test_scenarios_whose_goals_are_another_machines_are_refused_with_what_to_do() -> None:
    loader = _renamed(load_machine(find_config_file("excavator.yaml")))
    sentence = r"\(0\.55, 0\.6\) m is no goal of another_arm, which takes x y z; .* --scenarios"
    with pytest.raises(ScenarioError, match=sentence):
        load_scenarios(machine=loader)


def test_a_scenarios_machine_has_its_payload_and_lag(file: Path, machine: Machine) -> None:
    changed = load_scenarios(file)[2].apply_to(machine)
    assert changed.arrays.payload == 0.0
    assert changed.config.circuit.servo_pump_lag == 0.08


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ("interval: 2.0", "interval: -2.0", ScenarioError, "sequences.flips.interval"),
        ("tail: 1.0", "tail: .nan", ScenarioError, "tail"),
        ("flips-80ms-10kg", "flips-8ms-10kg", ScenarioError, "there is no scenario flips-8ms-10kg"),
        ("pump_lags: [0.02, 0.08]", "pump_lags: [", YamlFileError, "is not YAML"),
        ("tail: 1.0", "tail: 1.0\nspeed: 2", ScenarioError, "speed"),
    ],
)
def test_what_cannot_be_used_is_named(
    file: Path, old: str, new: str, error: type, words: str
) -> None:
    file.write_text(FILE.replace(old, new))
    with pytest.raises(error, match=words):
        load_scenarios(file)
