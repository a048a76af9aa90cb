import numpy as np
import pytest

from mhsb_model import statics
from mhsb_model.machine import load_machine
from mhsb_model.modes import Mode
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_tools.viewer.ability_scene import (
    UNMOVABLE_REGION,
    compute_boost_regions,
    find_needed_mode,
)


@pytest.fixture(scope="module")
def machine():
    return load_machine()


def test_n_will_do_exactly_where_no_load_is_above_the_supply_pressure(machine):
    rng = np.random.default_rng(4)
    arrays = machine.arrays
    seen = set()
    for _ in range(60):
        posture = rng.uniform(arrays.joint_min, arrays.joint_max)
        force = np.empty(machine.joint_count)
        statics.piston_forces(arrays, posture, force)
        cap, rod, tank = arrays.cap_area, arrays.rod_area, arrays.tank_pressure
        # p A − p_T a > F extends, p a − p_T A > −F retracts; above which p both hold
        lowest = np.maximum((force + tank * rod) / cap, (tank * cap - force) / rod).max()
        needed = find_needed_mode(machine, posture)
        assert (needed == Mode.N) == (lowest < arrays.supply_pressure)
        assert (needed == UNMOVABLE_REGION) == (lowest >= arrays.max_boost_pressure)
        seen.add(needed)
    assert len(seen) > 1


def test_a_heavier_load_needs_boost_at_more_points(machine):
    table = build_posture_table(machine, 0.25)
    light, heavy = (
        compute_boost_regions(machine.changed(payload=payload), table) for payload in (2.0, 20.0)
    )
    assert len(light) == len(table.nodes)
    assert (heavy >= light).all()
    assert (heavy == Mode.N).sum() < (light == Mode.N).sum()
