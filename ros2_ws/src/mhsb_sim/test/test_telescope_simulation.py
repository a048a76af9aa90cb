"""The simulated arm whose second boom extends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mhsb_model.files.config_files import config_file
from mhsb_model.machine import Machine, load_machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.simulation.plan_receiver import trajectory_problem
from mhsb_sim.simulation.simulator import Simulator

Motion = Callable[..., tuple[Trajectory, ModeSchedule]]

OUT = np.array([0.9, -0.8, 0.22])


@pytest.fixture(scope="module")
def arm() -> Machine:
    return load_machine(config_file("telescope_arm.yaml"))


def test_the_tip_follows_while_all_joints_move_and_the_telescope_extends(
    arm: Machine, motion: Motion
) -> None:
    simulator = Simulator(arm)
    plan = motion(simulator.reference, OUT, of=arm)
    simulator.set_plan(*plan)
    for _ in range(round(plan[0].duration_ns / SECOND_NS / 0.01)):
        simulator.advance(0.01)
        state, reference = simulator.joint_state, simulator.reference
        tips = arm.tip_positions(np.array([state.position, reference.position]))
        assert np.hypot(*(tips[0] - tips[1])) < 1e-3
    simulator.advance(0.5)
    np.testing.assert_allclose(simulator.joint_state.position, OUT, atol=5e-4)


def test_a_heavier_payload_is_learnt_in_a_motion_of_all_joints(
    arm: Machine, motion: Motion
) -> None:
    simulator = Simulator(arm, plant=arm.changed(payload=9.5))
    for goal in (OUT, arm.config.simulation.start_posture, OUT):
        plan = motion(simulator.reference, goal, stamp_ns=simulator.time_ns, of=arm)
        simulator.set_plan(*plan)
        simulator.advance(plan[0].duration_ns / SECOND_NS + 0.3)
    payload = next(each for each in simulator.estimates if each.quantity == "payload")
    assert payload.value == pytest.approx(9.5, abs=0.5)


def test_what_a_telescope_cannot_do_is_told_in_metres(arm: Machine, motion: Motion) -> None:
    trajectory, _ = motion(Simulator(arm).reference, OUT, of=arm)
    too_far = replace(trajectory, position=trajectory.position + [0.0, 0.0, 0.1])
    told = trajectory_problem(arm, too_far)
    assert told is not None
    assert "joint_3 0.07 m beyond its limits [0, 0.25] m" in told
