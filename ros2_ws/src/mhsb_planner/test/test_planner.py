"""Plans from starts that are not quite where they should be."""

import numpy as np
import pytest

from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.s3_limits import joint_excess
from mhsb_planner.s3_trajectory import START_NOISE, FitError

GOAL = (0.55, 0.20)


@pytest.fixture(scope="module")
def planner(machine, table):
    return Planner(machine, table)


@pytest.mark.parametrize("kind", ["table", "fixed"])
@pytest.mark.parametrize("joint", [0, 1, 2])
def test_a_start_beyond_a_joint_limit_by_noise_is_led_back_inside(planner, kind, joint):
    machine = planner.machine
    start = np.array([0.5, -1.2, -0.9])
    start[joint] = machine.arrays.joint_max[joint] + 1e-3
    plan = planner.plan(GOAL, MotionState.at_rest(start), options=PlanOptions(planner=kind))
    excess = joint_excess(machine.arrays, plan.motion.trajectory.position)
    assert excess[0] == pytest.approx(1e-3)
    back = int(np.argmax(excess <= 1e-6))
    assert np.all(np.diff(excess[:back]) <= 1e-9)
    assert np.all(excess[back:] <= 1e-6)
    assert plan.motion.trajectory.offset_ns[back] < 3 * SECOND_NS


def test_a_start_far_beyond_a_joint_limit_is_refused(planner):
    start = np.array([0.5, -1.2, planner.machine.arrays.joint_max[2] + 2 * START_NOISE])
    with pytest.raises(FitError, match="joint limit"):
        planner.plan(GOAL, MotionState.at_rest(start))
