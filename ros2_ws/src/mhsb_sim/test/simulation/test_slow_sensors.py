"""Supervision of arms whose length sensors are slow, noisy or without noise."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from mhsb_control import load_machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.simulation.fault_detection import SupervisionLimits
from mhsb_sim.simulation.fault_isolation import FrozenLength
from mhsb_sim.simulation.faults import parse_faults
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervised_arm import SupervisedArm

RATES = [10.0, 20.0, 50.0]  # Hz


def build_arm(name: str = "excavator_1to14", **sensors: object) -> SupervisedArm:
    """An arm at rest; `sensors` are values of imperfections.sensors."""
    values = {f"imperfections.sensors.{key}": value for key, value in sensors.items()}
    return SupervisedArm(Simulator(load_machine(name).with_values(values)))


def set_in_motion(arm: SupervisedArm, passes: int) -> None:
    """Send the arm to and fro, each pass with V_max in its middle."""
    machine, start = arm.simulator.machine, arm.simulator.reference.position
    way = np.array([-0.4, 0.5, 0.4])
    lengths = np.array([machine.cylinder_lengths(start + s * way) for s in np.linspace(0, 1, 101)])
    fastest = np.abs(np.diff(lengths, axis=0)).max() * 100 / machine.arrays.max_piston_speed.max()
    s = np.linspace(0.0, passes, 100 * passes + 1)
    duration = 0.5 * np.pi * fastest  # a cosine is that much faster in its middle than on average
    share = 0.5 - 0.5 * np.cos(np.pi * s)
    rate = 0.5 * np.pi * np.sin(np.pi * s) / duration
    change = 0.5 * np.pi**2 * np.cos(np.pi * s) / duration**2
    rows = (start + np.outer(share, way), np.outer(rate, way), np.outer(change, way))
    offsets = np.round(s * duration * SECOND_NS).astype(np.int64)
    plan = Trajectory(arm.simulator.time_ns, offsets, *rows)
    schedule = ModeSchedule(plan.stamp_ns, np.array([0]), arm.simulator.modes[None, :])
    arm.simulator.set_plan(plan, schedule)


def evaluate_at_highest_speed(rate: float, frozen_at: float = math.inf) -> list[float]:
    """Strokes that the symptom finds every 10 ms while piston 2 moves at V_max for two seconds [m].

    All sensors keep their readings from the time `frozen_at` on [s].
    """
    machine = load_machine("excavator_1to14")
    symptom, random = FrozenLength(machine), np.random.default_rng(1)
    posture = np.array(machine.config.simulation.start_posture)
    noise = np.full(3, 2e-5)
    step = 1e-6
    moment_arm = (machine.cylinder_lengths(posture + step) - machine.cylinder_lengths(posture))[1]
    velocity = np.array([0.0, machine.arrays.max_piston_speed[1] * step / moment_arm, 0.0])
    sensed, found = None, []
    for k in range(200):
        time = 0.01 * k
        position = posture + velocity * (time - 1.0)
        if math.isclose(time * rate, round(time * rate), abs_tol=1e-6):
            length = machine.cylinder_lengths(position) + noise * random.standard_normal(3)
            if sensed is not None and time >= frozen_at:
                length = sensed.length
            sensed = SimpleNamespace(
                reading_ns=round(time * SECOND_NS), length=length, length_noise=noise
            )
        sample = SimpleNamespace(reference=SimpleNamespace(position=position), sensed=sensed)
        found.append(symptom.evaluate(sample).value)
    return found


@pytest.mark.parametrize("rate", RATES)
def test_a_healthy_sensor_is_never_suspected_at_the_highest_speed(rate: float) -> None:
    assert max(evaluate_at_highest_speed(rate)) == 0.0


@pytest.mark.parametrize("rate", RATES)
def test_a_frozen_sensor_is_found_with_the_first_reading_that_it_repeats(rate: float) -> None:
    found = evaluate_at_highest_speed(rate, frozen_at=1.0)
    first = int(np.argmax(np.array(found) > SupervisionLimits().frozen_length[1]))
    assert first == 100
    assert max(found[:100]) == 0.0


def test_supervision_leaves_a_moving_arm_with_slow_sensors_alone_until_one_freezes() -> None:
    arm = build_arm(rate=20.0)
    set_in_motion(arm, 4)
    for _ in range(3000):
        arm.step(0.0)
        assert arm.fault == ""
        assert "sensor" not in arm.warning
    place = "sensor_frozen:actuator_2.length"
    arm.simulator.inject_faults(parse_faults(place, arm.simulator.plant))
    for _ in range(1500):
        arm.step(0.0)
    assert "the length sensor of actuator_2 has repeated its reading" in arm.fault
    assert "at most 0.6 mm is allowed" in arm.fault


def test_sensors_without_noise_that_repeat_their_readings_at_rest_are_not_frozen() -> None:
    arm = build_arm(rate=100.0)
    quiet = arm.simulator.machine.with_values({"servo.length_noise": 0.0})
    arm = SupervisedArm(Simulator(quiet))
    set_in_motion(arm, 10)
    for _ in range(1000):  # dead time and dead bands keep the pistons at rest in the beginning
        arm.step(0.0)
    assert arm.fault == arm.warning == ""


def test_the_noise_of_inertial_sensors_on_a_large_machine_is_no_jump() -> None:
    arm = build_arm("forestry_crane", length="imu", pressure="none", rate=100.0)
    for _ in range(2000):
        arm.step(0.0)
        assert arm.fault == ""
        assert "leapt" not in arm.warning


def test_a_jump_beyond_what_a_piston_goes_between_two_readings_is_found() -> None:
    arm = build_arm(rate=20.0)
    for _ in range(100):
        arm.step(0.0)
    fault = "length_offset:actuator_1.length:0.02"  # m; a piston goes 15 mm in 50 ms at most
    arm.simulator.inject_faults(parse_faults(fault, arm.simulator.plant))
    for _ in range(61):
        arm.step(0.0)
    assert "the length sensor of actuator_1 has leapt by 20" in arm.fault
