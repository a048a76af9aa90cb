"""The command plan, with starts beyond joint limits."""

import json

import pytest

from mhsb_model import command_line
from mhsb_planner.planner import PLANNER_KINDS
from mhsb_tools.commands.plan_command import plan


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
