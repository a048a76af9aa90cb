import numpy as np
import pytest

from mhsb_control.governor.reference_governor import GovernorSettings
from mhsb_control.machine_scales import compute_braking_rate, compute_supply_torques
from mhsb_control.natural_frequency import draw_postures
from mhsb_model.machine import Machine
from mhsb_sim.simulation.simulator import Simulator


def test_no_joint_is_braked_harder_than_by_the_main_pump_in_its_slowest_posture(
    machine: Machine,
) -> None:
    rate, rates = compute_braking_rate(machine), []
    for q in draw_postures(machine):
        arms = np.abs(machine.moment_arms(q))
        torque = machine.arrays.supply_pressure * machine.arrays.rod_area * arms
        acceleration = torque / np.diag(machine.mass_matrix(q))
        rates.append(arms * acceleration / machine.arrays.max_piston_speed)
    assert np.min(rates) == pytest.approx(rate)


def test_the_governor_slows_a_heavier_arm_more_gently(machine: Machine) -> None:
    heavy = machine.changed(payload=3.0 * machine.arrays.payload)
    found = [Simulator(each).guard._state.totals["max_slowing"][0] for each in (machine, heavy)]
    assert found[1] < 0.6 * found[0]
    share = GovernorSettings().scaling.max_slowing
    assert found[0] == pytest.approx(share * compute_braking_rate(machine))


def test_the_supply_torque_is_that_of_the_longest_moment_arm(machine: Machine) -> None:
    arms = [np.abs(machine.moment_arms(q)) for q in draw_postures(machine)]
    force = machine.arrays.supply_pressure * machine.arrays.cap_area
    np.testing.assert_allclose(compute_supply_torques(machine), force * np.max(arms, axis=0))
