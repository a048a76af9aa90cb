"""The demo's goals and what it makes of its summary; whole runs are `scripts/demo`."""

from __future__ import annotations

import pytest

from mhsb_model.errors import MhsbError
from mhsb_model.files.config_files import find_config_file, find_machine_config_file
from mhsb_model.machine import load_machine
from mhsb_tools.commands.demo_command import (
    GOALS_FILE,
    DemoGoal,
    describe_failed_goals,
    prepare_output_folder,
    read_goals,
    replace_earlier_results,
)

GOOD = {"goals_sent": 11, "goals_refused": 0, "lost": []}


def test_goals_are_read_with_the_time_to_the_next_one():
    goals = read_goals(find_config_file(GOALS_FILE))
    assert goals[0] == DemoGoal(0.55, 0.60, 5.0)
    assert goals[-1].time is None


@pytest.mark.parametrize("name", ["mhsb_arm4", "telescope_arm", "excavator", "forestry_crane"])
def test_a_machine_s_own_goals_are_within_reach_and_may_all_be_reached(name):
    """A goal that may be replaced on the way comes again."""
    machine = load_machine(find_config_file(f"{name}.yaml"))
    goals = read_goals(find_machine_config_file(GOALS_FILE, machine.name))
    places = [goal.position for goal in goals]
    for place in places:
        machine.check_in_workspace(place)
    again = {place for place in places if places.count(place) > 1}
    assert len(again) >= 2
    assert goals[-1].time is None


@pytest.mark.parametrize(
    "text", ["[]", "{x: 1}", "- {x: 0.5}", "- {x: 0.5, z: up}", "- [1, 2", "3"]
)
def test_a_file_that_is_no_list_of_goals_is_refused_by_its_name(tmp_path, text):
    file = tmp_path / "goals.yaml"
    file.write_text(text)
    with pytest.raises(MhsbError, match=r"goals\.yaml"):
        read_goals(file)


def test_a_run_falls_short_where_goals_were_lost_or_refused_and_says_why():
    assert describe_failed_goals(GOOD) is None
    lost = {"x_m": 0.55, "z_m": -0.6, "reason": "it got no verdict"}
    assert describe_failed_goals(GOOD | {"lost": [lost, lost]}) == (
        "2 of 11 goals were lost, the first at (0.55, -0.6) m: it got no verdict"
    )
    assert "1 of 11 goals were refused" in describe_failed_goals(GOOD | {"goals_refused": 1})


def test_what_an_earlier_demo_made_stays_until_all_of_it_is_there_anew(tmp_path):
    for name in ("bag", "report"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "old").touch()
    (tmp_path / "summary.json").write_text("old")
    (tmp_path / "notes.txt").touch()
    unfinished = prepare_output_folder(tmp_path)
    (unfinished / "half").touch()  # and here it was interrupted
    assert (tmp_path / "report" / "old").exists()
    assert (tmp_path / "summary.json").read_text() == "old"

    assert prepare_output_folder(tmp_path) == unfinished
    assert list(unfinished.iterdir()) == []
    for name in ("bag", "report"):
        (unfinished / name).mkdir()
        (unfinished / name / "new").touch()
    (unfinished / "summary.json").write_text("new")
    replace_earlier_results(tmp_path)
    assert sorted(path.name for path in tmp_path.rglob("*")) == sorted(
        ["bag", "new", "report", "new", "summary.json", "notes.txt"]
    )
    assert (tmp_path / "summary.json").read_text() == "new"
