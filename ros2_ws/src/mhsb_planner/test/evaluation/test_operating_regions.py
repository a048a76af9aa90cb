"""The regions in which boost is needed, by the formula for one node at a time."""

from __future__ import annotations

import numpy as np

from mhsb_planner.evaluation.operating_regions import operating_regions


def test_a_joint_needs_boost_where_its_load_and_losses_exceed_the_supply(machine, table):
    regions = operating_regions(machine, table)
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
                assert regions.heavy[row]


def test_a_stronger_main_pump_leaves_no_need(machine, table):
    strong = machine.changed(supply_pressure=3e7)
    assert not np.any(operating_regions(strong, table).boosted)
