"""A machine with proportional valves and without pressure sensors: its plant, and how it moves."""

import numpy as np
import pytest

from mhsb_control import load_machine
from mhsb_control.errors import EstimatesFileError, PressureSensorsError
from mhsb_control.estimates_file import read_estimates_file
from mhsb_model.circuit.elements import compute_valve_opening
from mhsb_model.errors import ArgumentError
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.simulation.fault_detection import SupervisionLimits
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervised_arm import SupervisedArm

WAY = np.array([-0.4, 0.5, 0.4])
DURATION, PASSES = 6.0, 10


@pytest.fixture(scope="module")
def machine() -> Machine:
    return load_machine(find_config_file("excavator_1to14.yaml"))


def hold_commands(simulator: Simulator, command: float, duration: float) -> np.ndarray:
    """Piston speeds after a constant command for a time, the servo being switched off."""
    simulator._control = lambda: None
    simulator._servo_circuit.actuators["valve_command"] = command
    simulator.advance(duration)
    return simulator.actuator_states.piston_speed


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_each_direction_has_its_dead_band_and_a_bent_curve(machine, direction):
    real = machine.config.imperfections
    dead = real.valve_overlap if direction > 0 else real.valve_overlap_retracting
    still = hold_commands(Simulator(machine, "lag_compensated"), direction * (dead - 0.01), 1.5)
    assert np.abs(still).max() < 1e-4
    half, whole = (
        hold_commands(Simulator(machine, "lag_compensated"), direction * (dead + more), 1.2)
        for more in (0.1, 0.2)
    )
    assert np.all(direction * half > 1e-3)
    # twice the opening beyond the dead band gives 2^1.3 times the speed, less what friction takes
    assert np.all(whole / half > 1.05 * 2.0**1.3 * 0.85)
    assert np.all(whole / half < 2.0**1.3 * 1.3)
    opening = compute_valve_opening(direction * (dead + 0.2), dead, 1.3)
    assert opening == pytest.approx(direction * (0.2 / (1.0 - dead)) ** 1.3)


CURVE = ((0.0, 0.0), (0.3, 0.05), (0.6, 0.7), (1.0, 1.0))
RETRACTING = ((0.0, 0.0), (0.5, 0.9), (1.0, 1.0))


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_speed_of_a_piston_follows_the_declared_curve(machine, direction):
    """An edge kept at one drop passes K y S(Δp); the cap side's edge limits both directions.

    The boom's load resists extension. The loads of arm and bucket resist retraction here.
    """
    kept, laminar = 2e5, machine.config.circuit.laminar_pressure
    plant = machine.with_values(
        {
            "imperfections.valve_curve": CURVE,
            "imperfections.valve_curve_retracting": RETRACTING,
            "imperfections.valve_exponent": 1.0,
            "hydraulics.valve.compensated_drop": kept,
            "hydraulics.valve.leakage_flow": 0.0,
        }
    )
    dead = machine.config.imperfections.overlaps[int(direction < 0.0)]
    m, curve = machine.arrays, CURVE if direction > 0.0 else RETRACTING
    flow = m.valve_coefficient * kept / (kept**2 + laminar**2) ** 0.25
    for share in (0.2, 0.45):
        command = direction * (dead + share * (1.0 - dead))
        simulator = Simulator(machine, "lag_compensated", plant=plant)
        speed = hold_commands(simulator, command, 1.0)
        opening = np.interp(share, *zip(*curve, strict=True))
        resists = slice(0, 1) if direction > 0.0 else slice(1, 3)
        expected = direction * flow * opening / m.cap_area
        np.testing.assert_allclose(speed[resists], expected[resists], rtol=0.03)


@pytest.mark.parametrize("payload", [0.1, 0.6])
def test_compensated_valves_move_every_load_at_one_speed(machine, payload):
    kept, laminar = 2e5, machine.config.circuit.laminar_pressure
    plants = [
        machine.with_values({"payload.mass": payload, **own})
        for own in ({"hydraulics.valve.compensated_drop": kept}, {})
    ]
    opening = (0.2 / 0.8) ** 1.3
    compensated, plain = (
        hold_commands(Simulator(machine, "lag_compensated", plant=plant), 0.4, 1.0)
        for plant in plants
    )
    m = machine.arrays
    flow = m.valve_coefficient[0] * kept / (kept**2 + laminar**2) ** 0.25
    assert compensated[0] == pytest.approx(flow * opening / m.cap_area[0], rel=0.03)
    assert plain[0] > 1.5 * compensated[0]


def test_a_straight_curve_and_a_compensator_that_never_throttles_change_nothing(machine):
    own = {
        "imperfections.valve_curve": ((0.0, 0.0), (1.0, 1.0)),
        "hydraulics.valve.compensated_drop": 4e7,
    }
    states = []
    for plant in (machine, machine.with_values(own)):
        simulator = Simulator(machine, plant=plant)
        motion = build_motion(simulator.reference.position, 0)
        simulator.set_plan(motion, ModeSchedule(0, np.array([0]), simulator.modes[None, :]))
        simulator.advance(6.0)
        states.append((simulator.joint_state.position, simulator.actuator_states.cap_pressure))
    np.testing.assert_array_equal(*(np.concatenate(each) for each in states))


def test_a_command_acts_after_the_delay_and_the_lag(machine):
    simulator = Simulator(machine, "lag_compensated")
    simulator._control = lambda: None
    simulator._servo_circuit.actuators["valve_command"] = 1.0
    simulator.advance(0.15)
    assert not simulator.spools.any()
    simulator.advance(0.1)
    # two equal lags of 50 ms after 0.1 s: 1 − 3 e^−2
    assert simulator.spools == pytest.approx(1.0 - 3.0 * np.exp(-2.0), abs=0.02)


def test_slow_sensors_keep_their_readings_and_pressures_are_not_measured(machine):
    slow = machine.with_values({"imperfections.sensors.rate": 20.0})
    simulator = Simulator(slow, "lag_compensated")
    simulator._control = lambda: None
    simulator._servo_circuit.actuators["valve_command"] = 0.6
    simulator.advance(0.5)
    before, changes = simulator.sensed, []
    for step in range(200):
        simulator.step()
        now = simulator.sensed
        assert np.array_equal(now.pressure, before.pressure)
        if not np.array_equal(now.length, before.length):
            changes.append(step)
        before = now
    assert np.all(np.diff(changes) == 50)
    assert len(changes) == 4
    assert not np.allclose(before.pressure[:, 0], simulator.actuator_states.cap_pressure, rtol=0.01)


def test_controllers_that_read_pressures_are_refused(machine):
    with pytest.raises(PressureSensorsError, match="reads pressures, which excavator_1to14 does"):
        Simulator(machine, "coordinated")
    assert Simulator(machine).controller_name == "lag_compensated"
    assert Simulator(load_machine()).controller_name == "coordinated"


def test_what_it_has_learnt_is_kept_in_a_file(machine, tmp_path):
    file = tmp_path / "learnt.yaml"
    first = Simulator(machine, estimates_file=file)
    motion = build_motion(first.reference.position, 0)
    first.set_plan(motion, ModeSchedule(0, np.array([0]), first.modes[None, :]))
    first.advance(15.0)
    first.save_estimates()
    again = Simulator(machine, estimates_file=file)
    assert [(each.quantity, each.known) for each in again.estimates] == [
        (each.quantity, each.known) for each in first.estimates
    ]
    assert any(each.known for each in again.estimates)
    for sim in (first, again):
        known = [(each.quantity, each.known) for each in sim.estimates]
        sim.reset()
        assert [(each.quantity, each.known) for each in sim.estimates] == known
        sim.close_valves()
        sim.set_plan(motion, ModeSchedule(0, np.array([0]), sim.modes[None, :]))
        assert [(each.quantity, each.known) for each in sim.estimates] == known
    first.save_estimates()  # a reset or a fault does not spoil the file
    content = read_estimates_file(file, machine)
    assert content is not None
    assert any(each.extending.known_speed > 0.0 for each in content.values())
    other = machine.with_values({"hydraulics.main_pump.pressure": 2.4e6})
    with pytest.raises(EstimatesFileError, match="it belongs to the machine excavator_1to14"):
        Simulator(other, estimates_file=file)
    with pytest.raises(ArgumentError, match="'coordinated', which keeps no estimates"):
        Simulator(load_machine(), estimates_file=file)


def test_what_it_has_learnt_stays_without_a_file_once_it_is_kept(machine):
    simulator = Simulator(machine)
    motion = build_motion(simulator.reference.position, 0)
    simulator.set_plan(motion, ModeSchedule(0, np.array([0]), simulator.modes[None, :]))
    simulator.advance(15.0)
    assert any(each.known for each in simulator.estimates)
    simulator.save_estimates()
    simulator.reset()
    assert any(each.known for each in simulator.estimates)
    Simulator(load_machine()).save_estimates()  # no effect: that controller keeps nothing


def build_motion(start: np.ndarray, time_ns: int) -> Trajectory:
    """Passes to and fro, minimum-jerk; the last one ends at rest."""
    share = np.linspace(0.0, 1.0, 121)[:-1]
    profile = share**3 * (10 - 15 * share + 6 * share**2)
    rate = 30 * share**2 * (1 - share) ** 2 / DURATION
    change = 60 * share * (1 - share) * (1 - 2 * share) / DURATION**2
    to, signs = np.arange(PASSES)[:, None] % 2, 1 - 2 * (np.arange(PASSES)[:, None] % 2)
    rows = [(to + signs * profile).ravel(), (signs * rate).ravel(), (signs * change).ravel()]
    end = float(PASSES % 2)
    rows = [np.append(row, last) for row, last in zip(rows, (end, 0.0, 0.0), strict=True)]
    offsets = np.round(np.arange(len(rows[0])) * DURATION / 120 * SECOND_NS).astype(np.int64)
    motion = (start + np.outer(rows[0], WAY), np.outer(rows[1], WAY), np.outer(rows[2], WAY))
    return Trajectory(time_ns, offsets, *motion)


def test_supervision_lets_it_learn_with_the_limits_of_its_controller(machine):
    simulator = Simulator(machine)
    arm = SupervisedArm(simulator)
    limits = arm.supervision.limits
    assert limits == SupervisionLimits(following_error=(0.15, 0.5), held=(5, 15))
    motion = build_motion(simulator.reference.position, SECOND_NS // 10)
    arm.add_trajectory(motion, 0.0)
    schedule = ModeSchedule(motion.stamp_ns, np.array([0]), simulator.modes[None, :])
    arm.add_schedule(schedule, 0.0)
    for _ in range(15_000):
        arm.step(0.0)
    assert arm.fault == ""
    assert arm.plan_stamp_ns == motion.stamp_ns


def test_it_learns_to_follow_and_arrives(machine):
    simulator = Simulator(machine, "lag_compensated")
    start = simulator.reference.position
    motion = build_motion(start, 0)
    simulator.set_plan(motion, ModeSchedule(0, np.array([0]), simulator.modes[None, :]))
    errors = []
    while simulator.plan_time_ns < motion.end_ns:
        simulator.advance(0.01)
        q, wanted = simulator.joint_state.position, simulator.reference.position
        apart = machine.tip_in_base(q) - machine.tip_in_base(wanted)
        errors.append(float(np.linalg.norm(apart)))
    last = errors[-round(2 * DURATION / 0.01) :]
    assert np.sqrt(np.mean(np.square(last))) < 6e-3  # measured: 2 mm
    assert np.sqrt(np.mean(np.square(last))) < 0.3 * max(errors)
    simulator.advance(3.0)
    q = simulator.joint_state.position
    tip = machine.tip_in_base(q) - machine.tip_in_base(motion.position[-1])
    assert np.linalg.norm(tip) < 5e-3  # measured: 1 mm; rest_error is 0.3 mm of each cylinder
    found = {(each.quantity, each.actuator): each for each in simulator.estimates}
    for name in machine.actuator_names[:2]:
        assert found["overlap", name].value == pytest.approx(0.25, abs=0.08)
        assert found["delay", name].known
