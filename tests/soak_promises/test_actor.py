"""What a soak makes of a process's output, and the goals that it spoils."""

from __future__ import annotations

import numpy as np
import pytest
from tests.soak.actor import make_invalid_goal, traceback_in

from mhsb_model.errors import MhsbError
from mhsb_model.files.config_files import find_config_file
from mhsb_model.files.machine_files import MACHINE_FILE
from mhsb_model.machine import load_machine
from mhsb_msgs_py import goal_pose


def test_the_first_traceback_is_told_by_its_last_line():
    lines = [
        "[INFO] ready",
        "Traceback (most recent call last):",
        '  File "node.py", line 1, in <module>',
        "    1 / 0",
        "ZeroDivisionError: division by zero",
        "Traceback (most recent call last):",
        "KeyError: 1",
    ]
    assert traceback_in(lines) == "ZeroDivisionError: division by zero"
    assert traceback_in(lines[:1]) is None
    assert traceback_in(lines[:2]) == lines[1]


@pytest.mark.parametrize("file", [MACHINE_FILE, "excavator.yaml", "forestry_crane.yaml"])
def test_a_spoilt_goal_is_nothing_that_can_be_accepted(file):
    machine = load_machine(find_config_file(file))

    def take(message):
        goal = goal_pose.decode(message, to_base=machine.convert_to_base if machine.slews else None)
        machine.check_in_workspace(goal.position)

    random = np.random.default_rng(0)
    for _ in range(50):
        with pytest.raises(MhsbError):
            take(make_invalid_goal(random, machine))
