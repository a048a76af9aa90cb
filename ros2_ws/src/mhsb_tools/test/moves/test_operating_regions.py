"""The regions in which boost is needed, by the formula for one node at a time."""

from __future__ import annotations

import numpy as np
import pytest

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_tools.moves.operating_regions import determine_operating_regions


def test_a_joint_needs_boost_where_its_load_and_losses_exceed_the_supply(machine, table):
    regions = determine_operating_regions(machine, table)
    m, oil = machine.arrays, machine.config.hydraulics
    postures = table.posture[table.feasible, 0]
    assert len(regions.nodes) == len(postures) == np.count_nonzero(table.feasible)
    for row in np.random.default_rng(4).choice(len(postures), 60, replace=False):
        for j, force in enumerate(machine.piston_forces(postures[row])):
            area, other = m.cap_area[j], m.rod_area[j]
            inlet, outlet = (area, other) if force > 0 else (other, area)
            load = (abs(force) + outlet * oil.tank_pressure) / inlet
            loss = (m.max_piston_speed[j] / m.valve_coefficient[j]) ** 2
            loss *= (area**3 + other**3) / inlet
            needed = load + loss + oil.boost_margin
            assert regions.boosted[row, j] == (needed > oil.main_pump.pressure)
            if needed > oil.servo_pump.max_boost_pressure:
                assert regions.beyond_highest_boost[row]


def test_a_stronger_main_pump_leaves_no_need(machine, table):
    strong = machine.changed(supply_pressure=3e7)
    assert not np.any(determine_operating_regions(strong, table).boosted)


@pytest.mark.parametrize("name", ["excavator.yaml", "forestry_crane.yaml"])
def test_an_arm_that_slews_needs_boost_where_its_plane_does(name):
    arm = load_machine(find_config_file(name))
    table = build_posture_table(arm, spacing=2 * arm.config.workspace.spacing)
    regions, of_plane = (
        determine_operating_regions(arm, table),
        determine_operating_regions(arm.planar_arm, table),
    )
    assert regions.boosted.shape[1] == arm.joint_count
    assert not regions.boosted[:, 0].any()
    assert np.array_equal(regions.boosted[:, 1:], of_plane.boosted)
    assert of_plane.boosted.any()
    assert not regions.beyond_highest_boost.any()  # as `check` says of both
