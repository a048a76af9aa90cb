"""Counts of grid points in the workspace, against regions and against distances of the tip."""

import numpy as np

from mhsb_model.obstacles.zones import Zones
from mhsb_tools.moves.workspace_points import (
    count_points_left,
    count_workspace_points,
    find_hold_regions,
    list_end_link_angles,
    list_workspace_points,
)


def test_the_regions_have_as_many_points_as_are_counted(machine):
    heavy = machine.changed(payload=40.0)
    for arm in (machine, heavy, heavy.changed(module_count=0)):
        regions, counts = find_hold_regions(arm), count_workspace_points(arm)
        boosted = regions.boosted[~regions.beyond_highest_boost]
        assert len(regions.nodes) == counts["points"] - counts["no_posture"]
        assert regions.beyond_highest_boost.sum() == counts["too_heavy"]
        assert boosted.any(axis=1).sum() == counts["boosted"]
        assert boosted.sum(axis=0).tolist() == counts["boosted_by_joint"]


def test_what_a_pole_leaves_is_counted_at_many_angles_of_the_slew(slewing_machine):
    x, y, low, high, radius = 0.3, 0.4, -0.2, 0.3, 0.15
    margin = slewing_machine.config.keep_out.margin
    pole = slewing_machine.changed(zones=Zones(tip_cylinders=((x, y, low, high, radius),)))
    plane = slewing_machine.planar_arm
    psi = list_end_link_angles(plane)
    angles = np.linspace(-2.0, 2.0, 72)  # of the machine's range
    reached = left = 0
    for ahead, z in list_workspace_points(plane):
        if len(plane.postures(ahead, z, psi)) == 0:
            continue
        distance = slewing_machine.arrays.slew_offset + ahead
        tip = distance * np.cos(angles), distance * np.sin(angles)
        aside, above = np.hypot(tip[0] - x, tip[1] - y) - radius, max(low - z, z - high)
        outside = np.hypot(np.maximum(aside, 0.0), max(above, 0.0))
        apart = np.where(outside > 0.0, outside, np.maximum(aside, above))
        reached += len(angles)
        left += int(np.sum(apart >= margin))
    found = count_points_left(pole)
    assert (found["left"], found["reached"], found["slew_angles"]) == (left, reached, 72)
    assert left < reached
