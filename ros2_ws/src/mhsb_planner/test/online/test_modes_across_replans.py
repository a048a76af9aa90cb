"""Modes as they are executed over chains of replans and stops in motion, judged without S4."""

import random
from itertools import pairwise

import numpy as np
import pytest

from mhsb_model.command import Command
from mhsb_model.holding import choose_holding_modes
from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.deadline import Deadline
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import PlanOptions
from mhsb_planner.search.s2_search import Weights

WEIGHTS = Weights(0.5, 0.0, 2.0), Weights(0.0, 15.0, 2.0), Weights(0.0, 0.0, 1.0)
CHAINS, REPLANS = 3, 7
LONGEST_PLANNING = 1.0  # s
LOW_PRESSURE, HEAVY = {"supply_pressure": 2.5e6}, {"payload": 16.0}
FAST = {"supply_pressure": 3.3e6, "max_piston_speed": 0.03}


def chain(replanner, machine, table, planner, rng):
    """Commands one after the other, each in motion of the one before."""
    start = np.array(machine.config.simulation.start_posture)
    now = SECOND_NS
    commands = [Command.hold(0, start, choose_holding_modes(machine, machine.piston_forces(start)))]
    for _ in range(REPLANS):
        goal = table.nodes[rng.choice(np.flatnonzero(table.feasible))] * table.spacing
        options = PlanOptions(planner=planner, weights=rng.choice(WEIGHTS))
        lead = rng.choice((0.03, 0.1, 0.3))
        deadline = Deadline.after(LONGEST_PLANNING)
        made = replanner.replan(commands[-1], now, tuple(goal), lead, options, deadline)
        if made is not None:
            commands.append(made.command)
        now = commands[-1].stamp_ns + int(rng.choice((0.05, 0.2, 0.5, 2.0)) * SECOND_NS)
        if rng.random() < 0.2:
            commands.append(replanner.make_braking_command(commands[-1], now, 0.03)[0])
            now = commands[-1].stamp_ns + SECOND_NS // 20
    return commands


def executed(commands):
    """Times [ns] and modes of the schedule that was in force in the end."""
    ends = [command.stamp_ns for command in commands[1:]] + [commands[-1].schedule.end_ns + 1]
    rows = [
        (command.schedule.stamp_ns + offset, modes)
        for command, end in zip(commands, ends, strict=True)
        for offset, modes in zip(command.schedule.offset_ns, command.schedule.modes, strict=True)
        if command.schedule.stamp_ns + offset < end
    ]
    return [time for time, _ in rows], np.array([modes for _, modes in rows])


@pytest.mark.parametrize(
    ("planner", "change"),
    [
        ("table", LOW_PRESSURE),
        ("table", FAST),
        ("table", HEAVY),
        pytest.param("integrated", LOW_PRESSURE, marks=pytest.mark.slow),
        pytest.param("integrated", FAST, marks=pytest.mark.slow),
        pytest.param("integrated", HEAVY, marks=pytest.mark.slow),
    ],
)
def test_no_actuator_is_switched_twice_within_the_least_dwell(machine, table, planner, change):
    changed, rng = machine.changed(**change), random.Random(5)
    replanner = Replanner(changed, table)
    m = changed.arrays
    for _ in range(CHAINS):
        times, modes = executed(chain(replanner, changed, table, planner, rng))
        assert m.modules_per_mode[modes].sum(axis=1).max() <= m.module_count
        for j in range(machine.joint_count):
            at = [times[i] for i in range(1, len(times)) if modes[i, j] != modes[i - 1, j]]
            assert all(later - earlier >= 300_000_000 - 1000 for earlier, later in pairwise(at))
