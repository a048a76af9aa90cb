"""The sentences of the simulate command."""

import json
import math
from dataclasses import fields
from pathlib import Path

import pytest

from mhsb_control.estimates_file import EstimatesFileError
from mhsb_model.command_line import run
from mhsb_model.kernels import pool
from mhsb_model.schema import Sensors
from mhsb_planner import kernel_parts as planner_kernels
from mhsb_sim.simulation import kernel_parts as simulator_kernels
from mhsb_tools.commands import simulate_command
from mhsb_tools.commands.simulate_command import (
    MethodArguments,
    SimulatedArmArguments,
    ZoneArguments,
    as_text,
    compose_missed_sentence,
    describe_possible_causes,
)
from mhsb_tools.study.headless import GoalRun, Samples, TimedGoal

OTHER_ARM = (
    "; the arm that is simulated may ask more than plans and servo know of, --plant and --vary "
    "say what"
)


@pytest.mark.parametrize(
    ("arm", "file", "sensors", "is_learning", "causes"),
    [
        (SimulatedArmArguments(), None, {"length": "file"}, False, ""),
        (SimulatedArmArguments(vary=("payload=2",)), None, {"length": "file"}, False, OTHER_ARM),
        (SimulatedArmArguments(plant=Path("old.yaml")), None, {"length": "file"}, False, OTHER_ARM),
        (
            SimulatedArmArguments(),
            None,
            {"length": "file"},
            True,
            "; the servo is still learning its valves: run again with --estimates-file FILE, twice",
        ),
        (
            SimulatedArmArguments(vary=("payload=2",)),
            Path("learnt.yaml"),
            {"length": "file"},
            True,
            "; the servo is still learning its valves: run again with the same --estimates-file "
            f"learnt.yaml{OTHER_ARM}",
        ),
        (
            SimulatedArmArguments(),
            Path("learnt.yaml"),
            {"length": "imu"},
            False,
            "; its length sensors 'imu' drift by some 0.5° a minute, which the servo cannot see: "
            "fit others, such as encoder_13_bit",
        ),
        (
            SimulatedArmArguments(),
            Path("learnt.yaml"),
            {"length": "imu", "angle_drift": math.radians(2.0) / 60.0},
            False,
            "; its length sensors 'imu' drift by some 2° a minute, which the servo cannot see: "
            "fit others, with a smaller angle_drift",
        ),
    ],
)
def test_the_causes_of_a_missed_goal_are_those_that_the_run_can_have(
    arm, file, sensors, is_learning, causes
):
    fitted = Sensors.model_validate(sensors)
    assert describe_possible_causes(arm, file, fitted, is_learning) == causes


@pytest.mark.parametrize(("count", "times"), [(0, "0 times"), (1, "once"), (2, "2 times")])
def test_a_missed_goal_is_told_with_distance_time_and_interventions(count, times):
    result = GoalRun(TimedGoal((0.55, 0.6), 3.0), None, 0.0123, 0.0, 1.5)
    assert compose_missed_sentence(result, count, "; why") == (
        "the goal (0.55, 0.6) m is missed: the tip is 12 mm from it 1.5 s after its motion should "
        f"have ended; the guard intervened {times}; why"
    )


@pytest.mark.parametrize(
    ("interventions", "reference"), [(1, ", from the reference that the guard slows"), (0, "")]
)
def test_tip_errors_are_named_as_those_from_the_slowed_reference(interventions, reference):
    zeros = ("max_supply_pressure_mpa", "max_chamber_pressure_mpa", "mode_switches")
    others = ("simulated_s", "real_time_factor")
    goal = {"x": 0.55, "z": 0.6, "time_s": 3.0, "goal_distance_mm": 1.0}
    pumps = {name: {"hydraulic": 0.0, "shaft": 0.0} for name in ("main_pump", "servo_pumps")}
    summary = dict.fromkeys((*zeros, *others), 0) | {
        "goals": [goal],
        "guard_interventions": interventions,
        "energy_by_source_j": pumps,
        "tip_error_rms_mm": 1.0,
        "tip_error_max_mm": 2.5,
    }
    assert f"tip error 1.00 mm RMS, 2.50 mm at most{reference}" in as_text(summary)


def test_a_run_is_not_lost_if_its_estimates_can_no_longer_be_written(tmp_path, monkeypatch):
    folder, write = tmp_path / "estimates", simulate_command.write
    folder.mkdir()

    def write_and_remove_folder(*content):
        write(*content)
        folder.rmdir()

    monkeypatch.setattr(simulate_command, "write", write_and_remove_folder)
    with pytest.raises(EstimatesFileError, match="cannot be written"):
        simulate_command.simulate(
            goal=((0.5, 0.1, 1.0),),
            arm=SimulatedArmArguments(machine="excavator_1to14"),
            method=MethodArguments(estimates_file=folder / "learnt.yaml"),
            zones=ZoneArguments(),
            output=tmp_path / "run",
        )
    assert len(json.loads((tmp_path / "run" / "summary.json").read_text())["goals"]) == 1


def test_one_line_says_that_kernels_of_planner_and_simulator_are_compiled(
    tmp_path, monkeypatch, capsys
):
    def find_marker_files(parts):
        return {part: tmp_path / part.replace(":", " ") for part in parts}

    monkeypatch.setattr(pool, "_find_marker_files", find_marker_files)
    monkeypatch.setattr(pool, "_call_in_workers", lambda parts: ((part, "") for part in parts))
    words = ["--goal", "0.55", "0.6", "0.1"]
    assert run(simulate_command.simulate, words, name="simulate") == 0
    assert capsys.readouterr().err.count("compiling kernels") == 1
    marked = {path.name.replace(" ", ":") for path in tmp_path.iterdir()}
    assert marked == {*planner_kernels.KERNEL_PARTS, *simulator_kernels.KERNEL_PARTS}


def test_the_help_names_the_columns_of_the_samples_with_their_units(capsys):
    with pytest.raises(SystemExit):
        run(simulate_command.simulate, ["--help"], name="simulate")
    words = " ".join(capsys.readouterr().out.replace("│", " ").split())
    columns = words.partition("Columns of samples.csv")[2]
    unitless = {"modes", "valve_opening"}
    for column in fields(Samples):
        after = columns.partition(f"{column.name}")[2]
        assert after.partition("[" if column.name not in unitless else "(")[1], column.name
