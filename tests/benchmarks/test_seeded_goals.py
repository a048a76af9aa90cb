"""Random goals: the same for the same seed, in the workspace, in time."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.seeded_goals import draw_reachable_goals

from mhsb_model.errors import MhsbError
from mhsb_model.obstacles.zones import Zones
from mhsb_planner.planner import Planner
from mhsb_planner.posture.s1_global_search import build_posture_table


@pytest.fixture(scope="module")
def planner(machine):
    return Planner(machine, build_posture_table(machine))


def test_goals_are_in_the_workspace_and_the_same_for_the_same_seed(planner):
    goals = draw_reachable_goals(planner, 3, seed=3)
    assert goals == draw_reachable_goals(planner, 3, seed=3)
    assert goals != draw_reachable_goals(planner, 3, seed=4)
    assert sum(goal.pause for goal in goals) == pytest.approx(3 * 1.75)
    for goal in goals:
        planner.machine.check_in_workspace(goal.position)
        assert 0.5 <= goal.pause <= 3.0
    assert len({np.hypot(*goal.position) for goal in goals}) == 3


def test_an_arm_that_no_goal_suits_is_an_error_instead_of_a_search_without_end(planner):
    machine = planner.machine
    planner.change_machine(machine.changed(zones=Zones(tip_boxes=((-2.0, -2.0, 2.0, 2.0),))))
    with pytest.raises(MhsbError, match="keep-out box"):
        draw_reachable_goals(planner, 1, seed=3)
    planner.change_machine(machine)
