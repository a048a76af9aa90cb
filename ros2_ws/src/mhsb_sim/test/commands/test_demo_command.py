"""The demo's goals and what it makes of its summary; whole runs are `scripts/demo`."""

from __future__ import annotations

import pytest

from mhsb_model.errors import MhsbError
from mhsb_model.files.config_files import config_file
from mhsb_sim.commands.demo_command import GOALS_FILE, TimedGoal, read_goals, shortfall

GOOD = {"goals_sent": 11, "goals_refused": 0, "lost": []}


def test_goals_are_read_with_the_time_to_the_next_one():
    goals = read_goals(config_file(GOALS_FILE))
    assert goals[0] == TimedGoal(0.55, 0.60, 5.0)
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
    assert shortfall(GOOD) is None
    lost = {"x_m": 0.55, "z_m": -0.6, "reason": "it got no verdict"}
    assert shortfall(GOOD | {"lost": [lost, lost]}) == (
        "2 of 11 goals were lost, the first at (0.55, -0.6) m: it got no verdict"
    )
    assert "1 of 11 goals were refused" in shortfall(GOOD | {"goals_refused": 1})
