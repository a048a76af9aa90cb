"""Worlds in which a test lets time pass."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from benchmarks.lock_step import LockStepWorld

from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Verdict
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.online.settings import Settings
from mhsb_planner.planner import PlanOptions
from mhsb_planner.posture.s1_posture_table import PostureTable

FASTEST = 3.0
"""No joint of the suite's arm is ever planned to turn as fast [rad/s]."""


class CheckedWorld(LockStepWorld):
    """A world that can be asked whether all went well."""

    def check_that_nothing_sent_jumps(self) -> None:
        """Neither where the arm takes a command over, nor within one."""
        assert max(self.arm.jumps, default=0.0) <= 1e-6
        for command in self.sent:
            way = command.trajectory
            speed = np.diff(way.position, axis=0) / (np.diff(way.offset_ns)[:, None] / SECOND_NS)
            assert np.abs(speed).max() < FASTEST, command

    def check_that_each_goal_was_answered_once(self) -> None:
        """One verdict each, and one ending of each that is in motion no more."""
        for stamp in range(1, self.goals + 1):
            [verdict] = self.verdicts(stamp)
            wanted = 1 if verdict.code is Verdict.OK else 0
            assert len(self.execution_reports(stamp)) == wanted, (
                verdict,
                self.execution_reports(stamp),
            )


@pytest.fixture(scope="session")
def new_world(machine: Machine, table: PostureTable) -> Callable[..., CheckedWorld]:
    """Function (lead_min=…, …) that makes a world with a planner at rest in it."""
    replanner = Replanner(machine, table)

    def make(planner: str = "table", **settings: float) -> CheckedWorld:
        replanner.change_machine(machine)
        options = PlanOptions(planner=planner)
        return CheckedWorld(machine, replanner, Settings(machine, options, **settings))

    return make


@pytest.fixture
def world(new_world: Callable[..., CheckedWorld]) -> CheckedWorld:
    return new_world()
