"""Dead time of a machine, by which plans have to be known ahead."""

import numpy as np
import pytest

from mhsb_model.circuit.dead_time import compute_dead_time, compute_settling_time
from mhsb_model.circuit.elements import compute_spool_transition
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine


def test_machines_with_pressure_sensors_need_no_plan_ahead():
    machine = load_machine().with_values({"imperfections.computing_delay": 0.01})
    assert compute_dead_time(machine) == 0.0
    assert compute_settling_time(machine) == 1.0


def test_it_is_the_delay_and_the_lag_of_the_spool():
    machine = load_machine(find_config_file("excavator_1to14.yaml"))
    oil, step = machine.config.circuit, 1e-4
    a, b, c, d = compute_spool_transition(oil.valve_frequency, oil.valve_damping, step)
    place, speed, time = 0.0, 1.0, 0.0
    for _ in range(50_000):  # the spool follows a ramp of one stroke a second
        time += step
        off = place - time
        place, speed = time + a * off + b * (speed - 1.0), 1.0 + c * off + d * (speed - 1.0)
    assert compute_dead_time(machine) == pytest.approx(0.15 + time - place, abs=2 * step)
    assert compute_dead_time(machine) == pytest.approx(0.2495, abs=1e-3)
    assert np.isfinite(place)


def test_a_longer_delay_that_the_file_expects_counts():
    machine = load_machine(find_config_file("excavator_1to14.yaml"))
    patient = machine.with_values({"servo.lag_compensated.expected_delay": 0.4})
    assert compute_dead_time(patient) == 0.4
