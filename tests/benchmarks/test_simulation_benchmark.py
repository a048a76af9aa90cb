import numpy as np
import pytest
from benchmarks.simulation_benchmark import TIMES, arm_of, boosted_swing, most_boosted

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine, load_machine
from mhsb_model.modes import Mode
from mhsb_sim.simulation.simulator import Simulator


@pytest.mark.parametrize("file", ["mhsb_arm4.yaml", "telescope_arm.yaml", "excavator.yaml"])
def test_as_many_actuators_are_boosted_as_there_are_modules_for(file: str) -> None:
    machine = load_machine(find_config_file(file))
    modes = most_boosted(machine)
    used = machine.arrays.modules_per_mode[modes].sum()
    assert used == min(machine.arrays.module_count, machine.planar_arm.joint_count + 1)
    assert modes[int(machine.slews)] == Mode.SB
    assert not (machine.slews and modes[0])


@pytest.mark.parametrize("times", TIMES)
def test_arms_with_more_actuators_swing_in_boost(machine: Machine, times: int) -> None:
    joints = times * machine.joint_count
    arm = arm_of(machine, joints)
    assert arm.joint_count == joints
    assert arm.arrays.link_mass.sum() == pytest.approx(machine.arrays.link_mass.sum())
    simulator = Simulator(arm)
    command = boosted_swing(arm)
    simulator.set_plan(command.trajectory, command.schedule)
    simulator.advance(1.0)
    assert np.abs(simulator.joint_state.velocity).max() > 1e-3
    assert simulator.energies["servo_pumps"] > 0.0
    assert simulator.energies["relief_valves"] == 0.0


def test_the_swing_begins_and_ends_at_rest_and_is_smooth(machine: Machine) -> None:
    trajectory = boosted_swing(machine).trajectory
    for values in (trajectory.velocity, trajectory.acceleration):
        np.testing.assert_allclose(values[[0, -1]], 0.0, atol=1e-12)
    time = trajectory.offset_ns / 1e9
    slope = np.gradient(trajectory.position, time, axis=0)
    np.testing.assert_allclose(slope[1:-1], trajectory.velocity[1:-1], atol=1e-3)
