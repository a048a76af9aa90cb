"""The arm's check of curves refuses no command that the suite's planners send."""

import numpy as np
import pytest
from benchmarks.lock_step import LockStepWorld
from tests.support.zones_ahead import random_zone

from mhsb_model.feasibility.curve_check import describe_curve_problem
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_planner.cases.moves import draw_random_position
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.online.settings import Settings
from mhsb_planner.planner import PlanOptions
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.search.s2_search import Weights

FILES = ("mhsb_arm3", "mhsb_arm4", "telescope_arm", "excavator", "forestry_crane")
PLANNERS = ("table", "fixed", "integrated")
WEIGHTS = Weights(0.5, 0.0, 2.0), Weights(0.0, 15.0, 2.0)
SAMPLE, WHOLE = 12, 10_000


def settings_of(machine, random, kind):
    return Settings(machine, PlanOptions(planner=kind, weights=WEIGHTS[random.integers(2)]))


def check_commands(file, kind, seed, count):
    """Check so many commands to an arm that is sent about, stopped, and gets zones in its way."""
    random, machine = np.random.default_rng(seed), load_machine(find_config_file(f"{file}.yaml"))
    replanner = Replanner(
        machine, build_posture_table(machine.planar_arm, spacing=3 * machine.spacing)
    )
    checked = braking = 0
    while checked < count:
        replanner.change_machine(machine)
        world = LockStepWorld(machine, replanner, settings_of(machine, random, kind))
        for _ in range(8):
            world.send_goal(*draw_random_position(machine, random))
            world.pass_time(random.uniform(0.05, 3.0))
            own, before = world.life.arm_state.own_command, len(world.sent)
            what = random.random()
            if what < 0.2:
                world.life.stop(lambda success, sentence: None)
            elif what < 0.4 and own is not None:
                zones = random_zone(machine, own.trajectory, world.arm.time_ns, random)
                crowded = machine if zones is None else machine.changed(zones=zones)
                world.life.change_settings(settings_of(crowded, random, kind))
                world.pass_time(random.uniform(0.1, 2.0))
                world.life.change_settings(
                    settings_of(machine.changed(zones=Zones()), random, kind)
                )
            braking += len(world.sent) - before
        for command in world.sent:
            problem = describe_curve_problem(machine, command.trajectory)
            assert problem is None, (seed, problem)
        checked += len(world.sent)
    print(f"{checked} commands, {braking} of them while stopping")


@pytest.mark.parametrize("file", ["mhsb_arm3", "excavator"])
def test_no_command_of_an_arm_that_is_sent_about_is_refused(file, fresh_seed):
    check_commands(file, "table", fresh_seed, SAMPLE)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", PLANNERS)
@pytest.mark.parametrize("file", FILES)
def test_no_command_of_many_of_each_machine_and_planner_is_refused(file, kind, fresh_seed):
    check_commands(file, kind, fresh_seed, WHOLE // (len(FILES) * len(PLANNERS)))
