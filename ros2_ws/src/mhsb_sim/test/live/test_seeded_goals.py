"""Random goals: the same for the same seed, in the workspace, in time."""

from __future__ import annotations

import numpy as np
import pytest

from mhsb_planner.planner import Planner
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_sim.live.seeded_goals import seeded_goals


@pytest.fixture(scope="module")
def planner(machine):
    return Planner(machine, build_posture_table(machine))


def test_goals_are_in_the_workspace_and_the_same_for_the_same_seed(planner):
    goals = seeded_goals(planner, 3, seed=3)
    assert goals == seeded_goals(planner, 3, seed=3)
    assert goals != seeded_goals(planner, 3, seed=4)
    assert sum(goal.time for goal in goals) == pytest.approx(3 * 1.75)
    for goal in goals:
        planner.machine.check_in_workspace(goal.position)
        assert 0.5 <= goal.time <= 3.0
    assert len({np.hypot(*goal.position) for goal in goals}) == 3
