"""What a soak does next: zones that the arm can have, of all arms."""

from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.seeded_goals import SeededGoal
from tests.soak.soak_command import Soak

from mhsb_model.files.config_files import find_config_file
from mhsb_model.files.machine_files import MACHINE_FILE
from mhsb_model.machine import load_machine
from mhsb_planner.cases.moves import draw_random_position


@pytest.mark.parametrize(
    ("file", "kinds"),
    [
        (MACHINE_FILE, {"circles", "tip_circles"}),
        ("excavator.yaml", {"spheres", "tip_spheres"}),
        ("forestry_crane.yaml", {"spheres", "tip_spheres"}),
    ],
)
def test_zones_are_around_goals_and_such_as_the_arm_can_have(file, kinds):
    machine, told = load_machine(find_config_file(file)), []
    random = np.random.default_rng(0)
    goals = [SeededGoal(draw_random_position(machine, random), 1.0) for _ in range(20)]
    soak = Soak(SimpleNamespace(set_zones=told.append), goals, machine, 0)
    for _ in range(30):
        soak.set_zones()
    places, used = {goal.position for goal in goals}, set()
    for zones in told:
        for kind, own in vars(zones).items():
            assert {zone[:-1] for zone in own} <= places
            used |= {kind} if own else set()
        machine.changed(zones=zones)  # raises for what it cannot have
    assert used == kinds
