"""Planning for the arm on four-bars, which reaches its whole workspace."""

import numpy as np
import pytest

from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.posture.s1_posture_table import PostureTable


@pytest.fixture(scope="module")
def table(four_bar_machine: Machine) -> PostureTable:
    return build_posture_table(four_bar_machine)


@pytest.fixture(scope="module")
def planner(four_bar_machine: Machine, table: PostureTable) -> Planner:
    return Planner(four_bar_machine, table)


def lightest_posture(machine: Machine, x: float, z: float) -> FloatArray:
    """The posture whose greatest cylinder force is the smallest."""
    choice = machine.postures(x, z, np.linspace(-np.pi, np.pi, 180))
    return min(choice, key=lambda q: np.abs(machine.piston_forces(q)).max())


def test_no_point_of_the_workspace_is_without_a_posture(table: PostureTable) -> None:
    assert len(table.nodes) == 642
    assert np.all(table.feasible)


@pytest.mark.parametrize(
    ("start", "goal"),
    [((0.55, -0.05), (0.55, 0.60)), ((0.55, -0.70), (0.75, 0.55)), ((0.05, 0.85), (0.10, -0.80))],
)
def test_a_plan_keeps_every_limit(planner: Planner, worst, start, goal) -> None:
    machine = planner.machine
    plan = planner.plan(
        goal,
        MotionState.at_rest(lightest_posture(machine, *start)),
        options=PlanOptions(planner="table"),
    )
    trajectory, schedule = plan.motion.trajectory, plan.motion.schedule
    assert machine.tip_position(trajectory.position[-1]) == pytest.approx(goal, abs=1e-6)
    excess = worst(trajectory, schedule, machine=machine)
    assert max(excess.values()) < 1e-3, excess
    assert plan.energy.paper > plan.lower_bound
