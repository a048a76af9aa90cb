import numpy as np
import pytest

from mhsb_control import read_gains
from mhsb_control.cascade import build_servo_arguments
from mhsb_control.line_estimate import (
    LineEstimates,
    LineSettings,
    build_line_estimates,
    update_line_estimates,
    update_line_filter,
)
from mhsb_model.circuit.quantities import CircuitConstants
from mhsb_model.machine import Machine
from mhsb_model.records import Records, create_record
from mhsb_sim.simulation.simulator import Simulator

STEP = 1e-3
SETTINGS = LineSettings()
RECORD = create_record(SETTINGS)[0]


def leakage_at(constants: Records[CircuitConstants], pressure: float) -> float:
    """Compute the leakage of a valve without overlap from the formulas themselves [m³/s]."""
    drop = pressure - constants["tank_pressure"]
    smooth = (drop**2 + constants["laminar_pressure"] ** 2) ** 0.25
    lands = constants["land_conductance"] * drop
    return float(constants["leakage_coefficient"] * drop / smooth + lands)


def weigh(
    machine: Machine, squeeze: float, share: float, speed: float, join: float
) -> LineEstimates:
    """Lines after a second in which one line is fed alone, its pressure going up and down."""
    signals = Simulator(machine)._signals
    lines = build_line_estimates(machine.joint_count)
    servo = build_servo_arguments(machine, signals, read_gains(machine, "coordinated"))
    constants, cylinder = servo.constants[0], servo.cylinders[0]
    servo.modules["flow"] = servo.modules["to_rail"] = 0.0
    servo.axes["cap_stiffness"] = servo.axes["rod_stiffness"] = np.inf
    servo.serves[0] = 0
    servo.actuators["join"] = join
    area = cylinder["cap_area"] if speed > 0 else cylinder["rod_area"]
    for k in range(1000):
        time = k * STEP
        pressure = 6e6 + 1e6 * np.sin(20.0 * time)
        rate = 20e6 * np.cos(20.0 * time)
        servo.axes["speed"][0] = speed
        servo.sensors["length"][0] += speed * STEP
        servo.sensors["line_pressure"][0] = pressure
        servo.modules["flow"][0] = (
            machine.config.hydraulics.servo_pump.slip_flow / 1e7 * (pressure - 4e6)
            + share * leakage_at(constants, pressure)
            + area * abs(speed)
            + squeeze * constants["line_capacity"] * rate
        )
        update_line_estimates(servo, lines, RECORD)
    return lines


@pytest.mark.parametrize("speed", [0.0, 0.008, -0.008])
@pytest.mark.parametrize(("squeeze", "share"), [(0.7, 0.5), (1.6, 1.4)])
def test_pumps_tell_what_lines_leak_and_what_their_oil_is_compressed_by(
    machine: Machine, squeeze: float, share: float, speed: float
) -> None:
    lines = weigh(machine, squeeze, share, speed, join=0.0)
    deviation = np.sqrt(np.diag(lines.covariance))
    assert abs(lines.estimate[0] - squeeze) < 2.0 * deviation[0]
    assert lines.estimate[1] == pytest.approx(share, rel=0.05)
    assert deviation[0] < 0.5 * SETTINGS.compressibility_deviation
    assert deviation[1] < 0.2 * SETTINGS.leakage_deviation


def test_pumps_tell_what_lines_leak_over_the_lands_of_spools(machine: Machine) -> None:
    lands = machine.with_values({"hydraulics.valve.land_leakage": 0.6})
    lines = weigh(lands, 0.7, 1.4, 0.008, join=0.0)
    assert lines.estimate[1] == pytest.approx(1.4, rel=0.05)


def test_slip_of_the_pumps_is_no_leakage_of_their_lines(machine: Machine) -> None:
    slipping = machine.with_values({"hydraulics.servo_pump.slip_flow": 4e-6})
    lines = weigh(slipping, 0.7, 1.4, 0.008, join=0.0)
    assert lines.estimate[1] == pytest.approx(1.4, rel=0.05)


def test_a_line_that_is_half_joined_tells_nothing(machine: Machine) -> None:
    lines = weigh(machine, 1.5, 0.5, 0.0, join=0.5)
    np.testing.assert_array_equal(lines.estimate, 1.0)


def test_a_line_that_stays_at_the_manifold_leaks_at_least_what_its_pump_delivers(
    machine: Machine,
) -> None:
    signals = Simulator(machine)._signals
    lines = build_line_estimates(machine.joint_count)
    servo = build_servo_arguments(machine, signals, read_gains(machine, "coordinated"))
    servo.modules["flow"] = servo.modules["to_rail"] = 0.0
    servo.actuators["join"] = 0.0
    servo.axes["speed"] = 0.0
    servo.serves[0] = 0
    pressure = machine.arrays.supply_pressure
    servo.sensors["line_pressure"] = pressure
    lines.estimate[1] = 0.4  # wrongly
    lines.covariance[1, 1] = 1e-3
    for flow, least, most in ((0.2, 0.39, 0.41), (0.9, 0.85, 0.91)):
        servo.modules["flow"][0] = flow * leakage_at(servo.constants[0], pressure)
        for _ in range(1500):
            update_line_estimates(servo, lines, RECORD)
        assert least < lines.estimate[1] < most


def test_the_filter_comes_to_what_least_squares_give() -> None:
    random = np.random.default_rng(0)
    rows = random.uniform(0.5e-8, 2e-8, (60, 3))
    noise = 1e-9
    oil = rows @ (0.8, 1.3, 0.6) + noise * random.standard_normal(60)
    lines = build_line_estimates(2)
    for row, each in zip(rows, oil, strict=True):
        update_line_filter(lines, row, each, noise**2, RECORD)
    deviation = np.array(
        [SETTINGS.compressibility_deviation, SETTINGS.leakage_deviation, SETTINGS.leakage_deviation]
    )
    prior = np.diag((noise / deviation) ** 2)
    fitted = np.linalg.solve(rows.T @ rows + prior, rows.T @ oil + prior @ np.ones(3))
    np.testing.assert_allclose(lines.estimate, fitted, atol=0.05)
