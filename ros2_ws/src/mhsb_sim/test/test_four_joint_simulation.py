"""The simulated arm with four joints, whose light last links swing fast."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mhsb_model.files.config_files import config_file
from mhsb_model.machine import Machine, load_machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.simulation.simulator import Simulator

Motion = Callable[..., tuple[Trajectory, ModeSchedule]]

RAISED = np.array([1.2, -1.4, -0.3, 0.2])


@pytest.fixture(scope="module")
def arm() -> Machine:
    return load_machine(config_file("mhsb_arm4.yaml"))


def test_no_joint_chatters_in_a_motion_of_all_joints(arm: Machine, motion: Motion) -> None:
    simulator = Simulator(arm)
    plan = motion(simulator.reference, RAISED, of=arm)
    simulator.set_plan(*plan)
    for _ in range(round(plan[0].duration_ns / SECOND_NS / 0.01)):
        simulator.advance(0.01)
        state, reference = simulator.joint_state, simulator.reference
        assert np.abs(state.velocity - reference.velocity).max() < 0.1
        tips = [arm.tip_position(each.position) for each in (state, reference)]
        assert np.hypot(*(tips[0] - tips[1])) < 1e-3
    np.testing.assert_allclose(simulator.joint_state.position, RAISED, atol=2e-3)
