"""Loads that empty inlet chambers."""

import numpy as np
import pytest

from mhsb_model.feasibility.cavitation import find_cavitating, summarize_cavitation
from mhsb_model.machine import load_machine


@pytest.fixture(scope="module")
def machine():
    return load_machine()


def limits(machine):
    """Beyond which forces [N] the inlet chamber empties: of extension, of retraction."""
    m = machine.arrays
    cap, rod = m.cap_area[0], m.rod_area[0]
    supply, tank = m.supply_pressure, m.tank_pressure
    return -(rod**3) * supply / cap**2 - rod * tank, cap**3 * supply / rod**2 + cap * tank


def test_loads_beyond_the_two_limits_empty_the_inlet_at_any_speed(machine):
    pulled, pushed = limits(machine)
    assert (round(pulled), round(pushed)) == (-933, 3364)  # the tank at 0.1 MPa
    force = np.array([[pulled - 1, pulled + 1, pulled - 1], [pushed + 1, pushed - 1, pushed + 1]])
    for speed in (1e-5, 1e-2):
        found = find_cavitating(machine, force, np.array([[speed] * 3, [-speed] * 3]))
        assert found.tolist() == [[True, False, True], [True, False, True]]
        lifted = find_cavitating(machine, force, np.array([[-speed] * 3, [speed] * 3]))
        assert not lifted.any()
    assert not find_cavitating(machine, force, np.full((2, 3), 1e-4), least_speed=2e-4).any()


def test_compensators_let_a_pulled_chamber_run_empty_and_keep_a_pushed_one_filled(machine):
    kept = 5e5
    plant = machine.with_values({"hydraulics.valve.compensated_drop": kept})
    m = machine.arrays
    cap, rod, tank = m.cap_area[0], m.rod_area[0], m.tank_pressure
    # extending with an empty cap side: (a/A)² of the kept drop over the edge to the tank
    pulled = -rod * (tank + kept * (rod / cap) ** 2)
    force = np.array([[pulled - 1, pulled + 1, 0.0], [1e5, 1e5, 1e5]])
    found = find_cavitating(plant, force, np.array([[0.01] * 3, [-0.01] * 3]))
    assert found.tolist() == [[True, False, False], [False] * 3]
    large = machine.with_values({"hydraulics.valve.compensated_drop": 2.0 * m.supply_pressure})
    same = np.array([[-934.0, -932.0, 0.0], [3365.0, 3363.0, 0.0]])
    speed = np.array([[0.01] * 3, [-0.01] * 3])
    assert np.array_equal(
        find_cavitating(large, same, speed), find_cavitating(machine, same, speed)
    )


def test_it_is_told_of_which_actuator_when_for_how_long_and_by_what_load(machine):
    pulled, _ = limits(machine)
    time = np.array([0.0, 0.5, 1.0, 1.5, 2.0])
    force = np.zeros((5, 3))
    force[1:4, 1] = pulled - np.array([10.0, 200.0, 30.0])
    speed = np.full((5, 3), 0.01)
    speed[3] = 0.0
    (found,) = summarize_cavitation(machine, time, force, speed)
    assert (found.actuator, found.begin, found.duration) == ("actuator_2", 0.5, 1.0)
    assert found.force == pytest.approx(pulled - 200.0)
    assert "drives actuator_2 with up to 1133 N from 0.50 s on, for 1.00 s in all" in str(found)
    assert summarize_cavitation(machine, time, 0 * force, speed) == ()
