import numpy as np
import pytest

from mhsb_msgs_py.actuator_states import SAMPLE_FIELDS, ActuatorSample
from mhsb_tools.viewer.energy_flow import (
    EnergyCounter,
    compute_powers,
    describe_energies,
    integrate_power,
)


def sample(**values: float) -> ActuatorSample:
    numbers = {name: np.zeros(2) for name in SAMPLE_FIELDS}
    return ActuatorSample(0, **numbers | {name: np.full(2, each) for name, each in values.items()})


def test_energies_are_the_integrals_of_the_powers_but_not_over_gaps():
    time = np.array([0.0, 0.1, 0.2, 5.0, 5.1])
    pressure, flow = np.full((5, 2), 4e6), np.outer(np.arange(5.0), [1e-5, 2e-5])
    power = compute_powers(pressure, flow, np.full((5, 2), 1e3), np.full((5, 2), 0.01))
    np.testing.assert_allclose(power[:, 0], 120.0 * np.arange(5))
    np.testing.assert_allclose(power[:, 1], 20.0)
    energy = integrate_power(time, power)
    steps = [0.0, 0.1 * 60, 0.1 * 180, 0.0, 0.1 * 420]
    np.testing.assert_allclose(energy[:, 0], np.cumsum(steps))
    np.testing.assert_allclose(energy[:, 1], [0.0, 2.0, 4.0, 4.0, 6.0])


def test_energy_is_counted_from_the_first_report_and_anew_when_the_pumps_begin_anew():
    flow = EnergyCounter()
    working = sample(supply_pressure=4e6, supply_flow=1e-5, force=1e3, piston_speed=0.01)
    flow.add_sample(working, 0.0)
    assert np.isnan(flow.energies[:2]).all()
    flow.add_pump_report(100.0, 10.0)
    for time in (0.1, 0.2):
        flow.add_sample(working, time)
    flow.add_pump_report(130.0, 15.0)
    np.testing.assert_allclose(flow.energies, [30.0, 5.0, 16.0, 4.0])
    flow.add_pump_report(1.0, 0.0)
    np.testing.assert_allclose(flow.energies, [0.0, 0.0, 0.0, 0.0])


def test_all_that_the_pumps_deliver_is_told_of():
    told = describe_energies(np.array([80.0, 20.0, 70.0, 30.0]))
    assert told == (
        "of 100 J from the pumps: **30 J work** of the pistons, 40 J lost in valves and return "
        "oil, 30 J in servo pumps, lines and leakage"
    )
    assert "not told" in describe_energies(np.full(4, np.nan))


def test_a_sample_that_comes_twice_counts_once():
    flow = EnergyCounter()
    working = sample(force=1e3, piston_speed=0.01)
    flow.add_sample(working, 0.0)
    flow.add_pump_report(0.0, 0.0)
    for time in (0.1, 0.1, 0.1):
        flow.add_sample(working, time)
    assert flow.energies[3] == pytest.approx(2.0)
