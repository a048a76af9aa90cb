import numpy as np
import pytest

from mhsb_model.machine import Machine
from mhsb_sim.simulation.sensors import LENGTH_CLASSES, PRESSURE_CLASSES, PUMP_SPEED, build_channels
from mhsb_sim.simulation.simulator import Simulator


def with_sensors(machine: Machine, length: str, pressure: str, pump_speed: str) -> Machine:
    return machine.with_values(
        {
            "imperfections.sensors.length": length,
            "imperfections.sensors.pressure": pressure,
            "imperfections.sensors.pump_speed": pump_speed,
        }
    )


def test_every_class_that_a_machine_file_may_name_is_there(machine: Machine) -> None:
    fields = type(machine.config.imperfections.sensors).model_fields
    for name, classes in (
        ("length", LENGTH_CLASSES),
        ("pressure", PRESSURE_CLASSES),
        ("pump_speed", PUMP_SPEED),
    ):
        assert set(fields[name].annotation.__args__) == set(classes)


def test_the_files_sensors_have_its_noise_and_no_other_error(machine: Machine) -> None:
    channels, noise = build_channels(machine, np.random.default_rng(0), 1e-3)
    n, servo = machine.joint_count, machine.config.servo
    assert not any(channels[name].any() for name in channels.dtype.names)
    np.testing.assert_array_equal(noise[:n], servo.length_noise)
    np.testing.assert_array_equal(noise[n : 4 * n + 1], servo.pressure_noise)
    assert not noise[4 * n + 1 :].any()


def test_industrial_sensors_read_multiples_of_their_resolution_about_their_offset(
    machine: Machine,
) -> None:
    plant = with_sensors(machine, "encoder_16_bit", "industrial", "resolver")
    simulator = Simulator(machine, plant=plant)
    kind = PRESSURE_CLASSES["industrial"]
    readings, truths = [], []
    for _ in range(500):
        truths.append(simulator.actuator_states.cap_pressure)
        simulator.step()
        readings.append(simulator._signals.sensors["cap_pressure"].copy())
    errors = np.array(readings) - np.array(truths)
    multiples = np.array(readings) / kind.resolution
    np.testing.assert_allclose(multiples, np.rint(multiples), atol=1e-6)
    own = simulator._channels["offset"][machine.joint_count : 4 * machine.joint_count : 3]
    np.testing.assert_allclose(errors.mean(axis=0), own, atol=4 * kind.noise / np.sqrt(500) + 200)
    spread = np.hypot(kind.noise, kind.resolution / 12**0.5)
    assert errors.std(axis=0) == pytest.approx(spread, rel=0.2)
    assert np.abs(own).max() > 1e3
    angles = simulator._signals.sensors["length"] - machine.cylinder_lengths(
        np.rint(simulator.joint_state.position / LENGTH_CLASSES["encoder_16_bit"].resolution)
        * LENGTH_CLASSES["encoder_16_bit"].resolution
    )
    assert np.abs(angles).max() < 2e-5  # noise of the file, one step of motion


def measure_largest_arms(machine: Machine) -> np.ndarray:
    """Largest moment arm of each actuator, by finite differences over the joint's range."""
    a = machine.arrays
    angles = np.linspace(a.joint_min, a.joint_max, 2001)
    lengths = np.array([machine.cylinder_lengths(q) for q in angles])
    return np.abs(np.diff(lengths, axis=0) / np.diff(angles, axis=0)).max(axis=0)


def test_inertial_sensors_err_by_angles(machine: Machine) -> None:
    plant, n, draws = with_sensors(machine, "imu", "file", "exact"), machine.joint_count, 400
    channels, noise = zip(
        *(build_channels(plant, np.random.default_rng(seed), 0.01) for seed in range(draws)),
        strict=True,
    )
    arms = measure_largest_arms(machine)
    np.testing.assert_allclose(np.degrees(noise[0][:n] / arms), 0.1, rtol=1e-2)
    a_minute = 6000 * np.array([each["drift"][:n] for each in channels])
    np.testing.assert_allclose(np.degrees(a_minute.std(axis=0) / arms), 0.5, rtol=0.15)


def test_a_file_may_name_the_deviations_of_its_angles(machine: Machine) -> None:
    own = {"angle_noise": 2e-3, "angle_offset": 1e-2, "angle_drift": 3e-4}
    plant = with_sensors(machine, "encoder_13_bit", "file", "exact").with_values(
        {f"imperfections.sensors.{key}": value for key, value in own.items()}
    )
    n, draws, period = machine.joint_count, 400, 0.02
    channels, noise = zip(
        *(build_channels(plant, np.random.default_rng(seed), period) for seed in range(draws)),
        strict=True,
    )
    arms = measure_largest_arms(machine)
    np.testing.assert_allclose(noise[0][:n] / arms, 2e-3, rtol=1e-3)
    offsets, drifts = (
        np.array([each[key][:n] for each in channels]).std(axis=0) / arms
        for key in ("offset", "drift")
    )
    np.testing.assert_allclose(offsets, 1e-2, rtol=0.15)
    np.testing.assert_allclose(drifts, 3e-4 * period, rtol=0.15)
    np.testing.assert_allclose(channels[0]["resolution"][:n], 2.0 * np.pi / 2**13)


def test_noise_of_length_sensors_may_be_left_out_of_a_class(machine: Machine) -> None:
    silent = with_sensors(machine, "imu", "file", "exact").with_values(
        {"imperfections.sensors.angle_noise": 0.0}
    )
    channels, noise = build_channels(silent, np.random.default_rng(0), 0.02)
    assert not noise[: machine.joint_count].any()
    assert channels["drift"][: machine.joint_count].all()


def test_a_sensor_keeps_its_offset_with_the_seed(machine: Machine) -> None:
    plant = with_sensors(machine, "file", "industrial", "exact")
    one, same, other = (
        build_channels(plant, np.random.default_rng(seed), 1e-3)[0]["offset"] for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(one, same)
    assert np.any(one != other)


def test_slow_sensors_drift_as_fast_as_others(machine: Machine) -> None:
    grown = []
    for rate in (1000.0, 50.0):
        plant = with_sensors(machine, "file", "industrial", "exact")
        simulator = Simulator(
            machine, plant=plant.with_values({"imperfections.sensors.rate": rate})
        )
        before = simulator._channels["offset"].copy()
        for _ in range(1000):
            simulator.step()
        grown.append(simulator._channels["offset"] - before)
    assert np.abs(grown[0]).max() > 1.0
    np.testing.assert_allclose(grown[1], grown[0], rtol=1e-9)
