"""Worlds in which a test lets time pass."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from mhsb_model.machine import Machine
from mhsb_model.verdict import Verdict
from mhsb_planner.evaluation.lock_step import World
from mhsb_planner.online.plan_request import Settings
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import PlanOptions
from mhsb_planner.posture.s1_posture_table import PostureTable


class CheckedWorld(World):
    """A world that can be asked whether all goals were answered."""

    def check_that_each_goal_was_answered_once(self) -> None:
        """One verdict each, and one ending of each that is in motion no more."""
        for stamp in range(1, self.goals + 1):
            [verdict] = self.verdicts(stamp)
            wanted = 1 if verdict.code is Verdict.OK else 0
            assert len(self.endings(stamp)) == wanted, (verdict, self.endings(stamp))


@pytest.fixture(scope="session")
def new_world(machine: Machine, table: PostureTable) -> Callable[..., CheckedWorld]:
    """Function (lead_min=…, …) that makes a world with a planner at rest in it."""
    replanner = Replanner(machine, table)

    def make(planner: str = "table", **settings: float) -> CheckedWorld:
        replanner.change(machine)
        options = PlanOptions(planner=planner)
        return CheckedWorld(machine, replanner, Settings(machine, options, **settings))

    return make


@pytest.fixture
def world(new_world: Callable[..., CheckedWorld]) -> CheckedWorld:
    return new_world()
