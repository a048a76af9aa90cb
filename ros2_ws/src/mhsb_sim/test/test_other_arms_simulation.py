"""Simulated arms other than the suite's own: with light last links, and with a telescope."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine, load_machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.simulation.plan_receiver import find_trajectory_problem
from mhsb_sim.simulation.simulator import Simulator

Motion = Callable[..., tuple[Trajectory, ModeSchedule]]

OUT = np.array([0.9, -0.8, 0.22])
RAISED = {"mhsb_arm4.yaml": np.array([1.2, -1.4, -0.3, 0.2]), "telescope_arm.yaml": OUT}


@pytest.fixture(scope="module")
def telescope() -> Machine:
    return load_machine(find_config_file("telescope_arm.yaml"))


@pytest.mark.parametrize("file", RAISED)
def test_the_tip_follows_and_no_joint_chatters_in_a_motion_of_all_joints(
    file: str, motion: Motion
) -> None:
    arm = load_machine(find_config_file(file))
    simulator = Simulator(arm)
    plan = motion(simulator.reference, RAISED[file], of=arm)
    simulator.set_plan(*plan)
    for _ in range(round(plan[0].duration_ns / SECOND_NS / 0.01)):
        simulator.advance(0.01)
        state, reference = simulator.joint_state, simulator.reference
        assert np.abs(state.velocity - reference.velocity).max() < 0.1
        tips = arm.tip_positions(np.array([state.position, reference.position]))
        assert np.hypot(*(tips[0] - tips[1])) < 1e-3
    np.testing.assert_allclose(simulator.joint_state.position, RAISED[file], atol=2e-3)


def test_a_heavier_payload_is_learnt_in_a_motion_of_all_joints(
    telescope: Machine, motion: Motion
) -> None:
    simulator = Simulator(telescope, plant=telescope.changed(payload=9.5))
    for goal in (OUT, telescope.config.simulation.start_posture, OUT):
        plan = motion(simulator.reference, goal, stamp_ns=simulator.time_ns, of=telescope)
        simulator.set_plan(*plan)
        simulator.advance(plan[0].duration_ns / SECOND_NS + 0.3)
    payload = next(each for each in simulator.estimates if each.quantity == "payload")
    assert payload.value == pytest.approx(9.5, abs=0.5)


def test_what_a_telescope_cannot_do_is_told_in_metres(telescope: Machine, motion: Motion) -> None:
    trajectory, _ = motion(Simulator(telescope).reference, OUT, of=telescope)
    too_far = replace(trajectory, position=trajectory.position + [0.0, 0.0, 0.1])
    told = find_trajectory_problem(telescope, too_far)
    assert told is not None
    assert "joint_3 0.07 m beyond its limits [0, 0.25] m" in told
