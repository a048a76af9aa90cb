import json
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from mhsb_control import REGISTERED_CONTROLLERS
from mhsb_control.errors import UnknownControllerError
from mhsb_model import command_line
from mhsb_model.command_line import UsageError
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine
from mhsb_planner.cluster import WorkArguments
from mhsb_tools.commands.simulate_command import build_plant
from mhsb_tools.study import study_command
from mhsb_tools.study.draws import DrawRecord
from mhsb_tools.study.study_command import DrawArguments, KindArguments, study
from mhsb_tools.study.tune_command import TrainingArguments, tune_servo

PRESSURE_READING = [
    name for name, kind in REGISTERED_CONTROLLERS.items() if getattr(kind, "reads_pressures", True)
]
"""Controllers for a machine with pressure sensors, in the order of the registry."""


def run_study(output: Path, json_: bool = False, **options: Any) -> None:
    """Run the command with options by name, each put into its group."""
    groups = {"kind": KindArguments, "draws": DrawArguments, "work": WorkArguments}
    given = {
        group: kind(**{f.name: options.pop(f.name) for f in fields(kind) if f.name in options})
        for group, kind in groups.items()
    }
    study(output=output, json_=json_, **given, **options)


def test_draws_are_written_and_printed_as_a_list_of_records(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_study(output=tmp_path, draws=1, seed=7, goals=1, jobs=1, json_=True)
    printed = json.loads(capsys.readouterr().out)
    records = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert [record["controller"] for record in records] == PRESSURE_READING
    named = {"draw", "varied", "tip_error_rms_mm", "tip_error_max_mm", "supply_overshoot_mpa"}
    assert printed == records
    for record in records:
        assert {*named, "relief_opened", "time_lost", "failure"} <= set(record)


def test_scenarios_of_a_machine_without_pressure_sensors_are_refused(tmp_path: Path) -> None:
    mobile = find_config_file("excavator_1to14.yaml")
    with pytest.raises(UsageError, match="excavator_1to14 does not measure; --draws studies lag_c"):
        run_study(output=tmp_path / "study", machine=mobile)
    assert not (tmp_path / "study").exists()
    with pytest.raises(UsageError, match="lag_compensated, which suits excavator_1to14, has"):
        tune_servo(machine=mobile, training=TrainingArguments(), work=WorkArguments())


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"draws": 3, "scenarios": Path("x.yaml")}, "draws make their own goals"),
        ({"controllers": ["coordinated"]}, "--controllers: goes with --draws"),
        ({"plant": Path("x.yaml")}, "--plant: goes with --draws"),
        ({"seed": 3}, "--seed: goes with --draws"),
        ({"faults": [], "draws": 3, "seed": 1}, "the same lift; leave out --draws, --seed"),
        ({"faults": [], "scenarios": Path("x.yaml")}, "the same lift; leave out --scenarios"),
        ({"benchmark": True, "goals": 3}, "its file is the protocol; leave out --goals"),
        ({"benchmark": True, "controllers": ["coordinated"]}, "leave out --controllers"),
        ({"benchmark": True, "seed": 3}, "--benchmark: its file is the protocol"),
        ({"benchmark": True, "faults": []}, "its file is the protocol; leave out --faults"),
    ],
)
def test_what_makes_no_sense_is_refused_in_a_sentence(
    tmp_path: Path, options: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(UsageError, match=sentence):
        run_study(output=tmp_path, **options)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--draws", "0"], "--draws must be from 1 to 1e+06 (is 0)"),
        (["--draws", "3", "--seed", "-1"], "--seed must be from 0 to "),
        (["--draws", "3", "--goals", "0"], "--goals must be from 1 to 1e+06 (is 0)"),
        (["--jobs", "0"], "--jobs must be from 1 to 4096 (is 0)"),
        (["--benchmark", "--draws", "0"], "--draws must be from 1 to 1e+06 (is 0)"),
    ],
)
def test_a_number_out_of_its_range_is_refused_by_the_range(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], sentence: str
) -> None:
    assert command_line.run(study, ["--output", str(tmp_path / "study"), *options]) == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "study").exists()


def test_draws_that_were_run_are_kept_when_the_study_is_interrupted(
    machine: Machine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> Iterator[list[DrawRecord]]:
        yield [DrawRecord("coordinated", 0, {})]
        raise KeyboardInterrupt

    monkeypatch.setattr(study_command, "run_draws", interrupted)
    with pytest.raises(KeyboardInterrupt):
        study_command.study_draws(machine, DrawArguments(draws=5, seed=7), 1, tmp_path)
    [record] = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert record["draw"] == 0


def test_draws_are_given_to_the_controllers_that_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_study(output=tmp_path, draws=1, seed=7, goals=1, jobs=1, controllers=["independent"])
    [record] = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert record["controller"] == "independent"
    assert "coordinated" not in capsys.readouterr().out
    with pytest.raises(UnknownControllerError, match="there is no controller 'magic'"):
        run_study(output=tmp_path, draws=1, controllers=["magic"])


def test_a_plant_is_a_file_times_factors(machine: Machine) -> None:
    assert build_plant(machine, None, ()) is machine
    plant = build_plant(machine, None, ("payload=1.2", "circuit.bulk_modulus=0.5"))
    assert plant.arrays.payload == pytest.approx(1.2 * machine.arrays.payload)
    assert plant.config.circuit.bulk_modulus == 0.5 * machine.config.circuit.bulk_modulus
    for text in ("payload", "payload=much", "=2"):
        with pytest.raises(Exception, match=r"KEY=FACTOR|there is no ''"):
            build_plant(machine, None, (text,))
