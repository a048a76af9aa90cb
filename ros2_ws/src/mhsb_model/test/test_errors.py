"""Errors on their way to another process, and questions for the unit of a value."""

import pickle
import re

import pytest

from mhsb_model.command_line import NumberRange, UsageError, _check_ranges
from mhsb_model.errors import (
    MachineFileError,
    OutOfWorkspaceError,
    suggest_name,
    suggest_unit,
    suggest_unit_of_number,
)
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine


def test_an_error_keeps_its_sentence_and_its_data_on_its_way_to_another_process():
    for error in (MachineFileError("arm.yaml", ["a", "b"]), OutOfWorkspaceError((1.0, 2.0), "far")):
        other = pickle.loads(pickle.dumps(error))
        assert type(other) is type(error)
        assert str(other) == str(error)
        assert vars(other) == vars(error)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("--deadline", ""),
        ("--machin", "; did you mean --machine?"),
        ("--gaol", "; did you mean --goal?"),
        ("arm3", "; did you mean mhsb_arm3?"),
    ],
)
def test_a_misspelt_name_is_asked_about_and_another_word_is_not(name, hint):
    assert suggest_name(name, ("--goal", "--machine", "--start", "mhsb_arm3")) == hint


@pytest.mark.parametrize(
    ("value", "unit", "low", "high", "hint"),
    [
        (17.0, "rad", -2.0, 2.0, "; in degrees? 17 degrees are 0.2967 rad"),
        (550.0, "m", 0.0, 1.0, "; in mm? 550 mm are 0.55 m"),
        (6.3, "m", 0.01, 1.0, "; in cm? 6.3 cm are 0.063 m"),
        (63.0, "m", 0.0, 1.0, "; in cm or mm? 63 cm are 0.63 m, 63 mm are 0.063 m"),
        (30.0, "s", 0.0, 0.5, "; in ms? 30 ms are 0.03 s"),
        (12.0, "-", 0.0, 0.5, "; in %? 12 % are 0.12"),
        (12.0, "m/s", 1e-4, 1.0, "; in mm/s? 12 mm/s are 0.012 m/s"),
        (40.0, "Pa", 1e5, 1e7, "; in bar? 40 bar are 4e+06 Pa"),
        (4.0, "Pa", 1e5, 1e7, "; in bar or MPa? 4 bar are 4e+05 Pa, 4 MPa are 4e+06 Pa"),
        (1000.0, "rad", -2.0, 2.0, ""),
        (3.0, "kg", 0.0, 1.0, ""),
        (3.0, "", 0.0, 1.0, ""),
    ],
)
def test_a_number_is_asked_about(value, unit, low, high, hint):
    assert suggest_unit_of_number(value, unit, low, high) == hint


def test_several_values_are_converted_together():
    assert suggest_unit([550.0, -50.0], "m", lambda p: max(p) < 1.0) == (
        "; in mm? (550, -50) mm are (0.55, -0.05) m"
    )


@pytest.mark.parametrize("name", ["mhsb_arm3", "excavator"])
def test_goals_in_mm_are_asked_about_and_goals_far_away_are_not(name):
    arm = load_machine(find_config_file(f"{name}.yaml"))
    inside = (1.2, 1.9, 0.6) if arm.slews else (0.55, 0.6)
    arm.check_in_workspace(inside)
    with pytest.raises(OutOfWorkspaceError, match=r"; in mm\? \(.*\) mm are \(.*\) m$"):
        arm.check_in_workspace([1e3 * value for value in inside])
    with pytest.raises(OutOfWorkspaceError) as refused:
        arm.check_in_workspace([1e6 * value for value in inside])
    assert "mm" not in str(refused.value)


def test_values_of_a_machine_and_options_of_a_command_are_asked_about():
    with pytest.raises(MachineFileError, match=r"100000 Pa \(is 40\); in bar or MPa\?"):
        load_machine().changed(supply_pressure=40)
    with pytest.raises(MachineFileError, match=r"\(is '40'\); in bar or MPa\?"):
        load_machine().with_values({"hydraulics.main_pump.pressure": "40"})
    ranges = {"pressure": NumberRange(1e5, 5e7, "Pa")}
    kinds = {name: type("Kind", (), {"__metadata__": (each,)}) for name, each in ranges.items()}
    with pytest.raises(UsageError, match=re.escape("(is 300.0); in bar? 300 bar are 3e+07 Pa")):
        _check_ranges(kinds, {"pressure": 300.0})
