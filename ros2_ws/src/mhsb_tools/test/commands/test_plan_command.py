"""The command plan: what it prints and writes, and starts beyond joint limits."""

import json
import re

import pytest

from mhsb_model import command_line
from mhsb_planner.planner import PLANNER_KINDS
from mhsb_tools.commands import plan_command
from mhsb_tools.commands.plan_command import SHOWN_INSTANTS, plan


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_the_command_plan_leads_back_into_the_limits_as_well(machine, capsys, kind):
    start = [float(machine.arrays.joint_max[0]) + 0.02, -1.4, -0.6]
    words = ["--start-posture", *map(str, start), "--goal", "0.55", "0.4", "--planner", kind]
    assert command_line.run(plan, [*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["joint_path"][0] == start
    assert told["joint_path"][1] == [float(machine.arrays.joint_max[0]), *start[1:]]
    assert "joint_1 at" in told["warnings"][0]
    assert "0.02 rad beyond its upper limit" in told["warnings"][0]
    assert command_line.run(plan, [*words[:4], "0.1", *words[4:]]) == command_line.EXIT_USAGE
    assert "takes 3 joint positions, joint_1, joint_2, joint_3" in capsys.readouterr().err
    assert command_line.run(plan, [*words, "--start", "0.5", "0"]) == command_line.EXIT_USAGE
    assert "give --start-posture or --start, not both" in capsys.readouterr().err


MOVE = ["--start", "0.55", "-0.05", "--goal", "0.55", "0.60"]


@pytest.mark.parametrize(
    ("start", "goal"), [("0.55 -0.05", "3 0"), ("0.55 -0.05", "0.0 0.26"), ("3 0", "0.55 0.6")]
)
def test_places_out_of_reach_are_refused_before_anything_is_compiled(
    monkeypatch, capsys, start, goal
):
    monkeypatch.delattr(plan_command, "compile_planner")
    words = ["--start", *start.split(), "--goal", *goal.split()]
    assert command_line.run(plan, words) == command_line.EXIT_FAILED
    assert "the nearest grid point in reach is (" in capsys.readouterr().err


def test_the_text_has_the_driven_modes_and_the_motion(capsys):
    assert command_line.run(plan, MOVE) == 0
    words = capsys.readouterr().out
    assert "actuator_1: N throughout" in words
    assert "N-N-N" not in words
    assert "above the lower bound of" in words
    (compared,) = (line for line in words.splitlines() if line.startswith("compare:"))
    own, percent, _, other = map(float, re.findall(r"[\d.]+", compared))
    assert f"{own:.1f} J with the pumps in series" in words or f"energy:   {own:.1f} J\n" in words
    assert percent == round(100 * abs(1.0 - own / other))
    assert ("saves" in compared) is (own <= other)
    first, *rows = words.splitlines()[-SHOWN_INSTANTS - 1 :]
    assert first.split()[:4] == ["time", "[s]", "x", "[m]"]
    assert [float(value) for value in rows[0].split()[:3]] == [0.0, 0.55, -0.05]
    assert [float(value) for value in rows[-1].split()[1:3]] == [0.55, 0.60]


def test_with_explain_the_discrete_path_and_the_log_follow(capsys):
    assert command_line.run(plan, [*MOVE, "--planner", "table", "--explain"]) == 0
    words = capsys.readouterr().out
    for each in ("N-N-N", "discrete path of the search", "fit: ", "planned in", "polytope: "):
        assert each in words
    assert "motion cost  outcome   proposer" in words


def test_json_has_the_motion_over_time(capsys, tmp_path):
    table = tmp_path / "motion.csv"
    assert command_line.run(plan, [*MOVE, "--json", "--csv", str(table)]) == 0
    found = json.loads(capsys.readouterr().out)
    motion = found["trajectory"]
    times = motion["time_s"]
    assert times[0] == 0.0
    assert times[-1] == found["duration_s"]
    for name in ("position", "velocity", "acceleration", "modes"):
        assert len(motion[name]) == len(times)
        assert {len(row) for row in motion[name]} == {3}
    assert motion["position"][0] == found["joint_path"][0]
    assert len(table.read_text().splitlines()) == 1 + len(times)
    assert command_line.run(plan, [*MOVE, "--csv", "motion.txt"]) == command_line.EXIT_USAGE
