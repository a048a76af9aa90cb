"""The machines on which deadlines are measured."""

import numpy as np
import pytest
from benchmarks.deadline_benchmark import ZONES, machines

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine


def test_an_arm_in_a_plane_has_thick_links_among_zones_in_it(machine):
    crowded = machines(machine)["obstacles"]
    assert crowded.zones == ZONES
    assert crowded.config.keep_out.link_radii == (0.03, 0.03, 0.02)


@pytest.mark.parametrize("file", ["excavator.yaml", "forestry_crane.yaml"])
def test_an_arm_that_slews_meets_a_pole_in_space_where_it_stands_alone(file):
    machine = load_machine(find_config_file(file))
    crowded = machines(machine)["obstacles"]
    assert len(crowded.config.keep_out.link_radii) == machine.joint_count - 1
    [(x, y, low, high, radius)] = crowded.zones.cylinders
    assert low < 0.0 < high
    postures = machine.planar_arm.postures(
        np.hypot(x, y) - machine.arrays.slew_offset, 0.0, np.linspace(-np.pi, np.pi, 100)
    )
    turned = np.column_stack([np.full(len(postures), np.arctan2(y, x)), postures])
    assert len(turned) > 0
    assert all(crowded.clearance(q)[0] <= -radius for q in turned)  # the tip is on its axis
    turned[:, 0] = 0.0
    assert any(crowded.clearance(q)[0] > 0.0 for q in turned)
    start = np.array(machine.config.simulation.start_posture)
    assert crowded.clearance(start)[0] > 0.0
