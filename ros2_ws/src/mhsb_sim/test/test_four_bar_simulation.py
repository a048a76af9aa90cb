"""The simulated arm on four-bars: it holds, follows, and its energies add up."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mhsb_control import REGISTERED_CONTROLLERS
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.circuit.audit import compute_energy_gap
from mhsb_sim.simulation.simulator import Simulator

Motion = Callable[..., tuple[Trajectory, ModeSchedule]]

RAISED = np.array([1.9, -1.5, -1.2])  # joint 1 beyond what its slider-crank spans
FOLDED = np.array([0.8, -2.5, -0.4])


@pytest.mark.parametrize("controller", sorted(REGISTERED_CONTROLLERS))
def test_it_holds_and_its_cylinders_carry_the_load(
    four_bar_machine: Machine, controller: str
) -> None:
    simulator = Simulator(four_bar_machine, controller=controller)
    start = np.array(four_bar_machine.config.simulation.start_posture)
    simulator.advance(1.0)
    np.testing.assert_allclose(simulator.joint_state.position, start, atol=1e-4)
    expected = four_bar_machine.piston_forces(start)
    np.testing.assert_allclose(simulator.actuator_states.force, expected, atol=15.0)


def test_it_follows_a_motion_of_all_joints_within_a_fifth_of_a_millimetre(
    four_bar_machine: Machine, motion: Motion
) -> None:
    simulator = Simulator(four_bar_machine)
    for goal in (RAISED, FOLDED):
        plan = motion(simulator.reference, goal, simulator.time_ns, of=four_bar_machine)
        simulator.set_plan(*plan)
        for _ in range(round(plan[0].duration_ns / SECOND_NS / 0.1)):
            simulator.advance(0.1)
            tip = four_bar_machine.tip_position(simulator.joint_state.position)
            wanted = four_bar_machine.tip_position(simulator.reference.position)
            assert np.hypot(*(tip - wanted)) < 0.2e-3
    np.testing.assert_allclose(simulator.joint_state.position, FOLDED, atol=1e-3)
    assert abs(compute_energy_gap(simulator.energies)) < 1e-3 * simulator.energies["main_pump"]


def test_piston_speeds_are_the_change_of_the_cylinders_lengths(
    four_bar_machine: Machine, motion: Motion
) -> None:
    simulator = Simulator(four_bar_machine)
    simulator.set_plan(*motion(simulator.reference, RAISED, of=four_bar_machine))
    simulator.advance(3.0)
    step = simulator.step_ns / SECOND_NS
    lengths, speeds = [], []
    for _ in range(3):
        simulator.step()
        lengths.append(four_bar_machine.cylinder_lengths(simulator.joint_state.position))
        speeds.append(simulator.actuator_states.piston_speed)
    seen = speeds[1]
    np.testing.assert_allclose(seen, (lengths[2] - lengths[0]) / (2 * step), rtol=2e-2, atol=1e-5)
    assert np.abs(seen).max() > 2e-3
