import numpy as np
import pytest

from mhsb_control import load_machine, read_gains
from mhsb_control.cascade import ControlAxis, build_axis_records
from mhsb_control.coordinated import (
    CoordinatedController,
    CoordinatedSettings,
    compute_feedforward_share,
    limit_axis_gains,
    limit_gains_by_delay,
)
from mhsb_control.natural_frequency import find_joint_frequency_ranges
from mhsb_model.files.config_files import find_config_file
from mhsb_model.hydraulics import compute_required_pressure
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.records import create_record
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray
from mhsb_sim.simulation.simulator import Simulator

RAMP, CRUISE = 0.4, 0.8  # s
SETTINGS = CoordinatedSettings()
RECORD = create_record(SETTINGS.coordination)[0]


def cruise(onset: FloatArray, velocity: FloatArray) -> Trajectory:
    """From rest to a steady velocity, through the posture `onset` half-way, and to rest again."""
    time = np.arange(0.0, 2 * RAMP + CRUISE + 1e-9, 0.02)
    up, down = np.clip(time / RAMP, 0, 1), np.clip((time - RAMP - CRUISE) / RAMP, 0, 1)
    way = RAMP * (up**3 - up**4 / 2) + np.clip(time - RAMP, 0, CRUISE)
    way += RAMP * (down - down**3 + down**4 / 2)
    speed = 3 * up**2 - 2 * up**3 - (3 * down**2 - 2 * down**3)
    rise = (6 * up * (1 - up) - 6 * down * (1 - down)) / RAMP
    start = onset - velocity * (RAMP + CRUISE) / 2
    offset = np.rint(time * SECOND_NS).astype(np.int64)
    return Trajectory(
        0, offset, start + np.outer(way, velocity), np.outer(speed, velocity),
        np.outer(rise, velocity),
    )  # fmt: skip


def test_lines_are_charged_with_what_the_main_pump_can_spare(machine: Machine) -> None:
    """Where a boost begins while strokes and leakage take nine tenths of the main pump's flow."""
    m, onset = machine.arrays, np.array([-0.032, -0.794, -1.029])
    velocity = 1.08 * np.array([-0.260, 0.182, 0.183])
    speed = machine.moment_arms(onset) * velocity
    flow = np.where(speed > 0, m.cap_area, m.rod_area) @ np.abs(speed)
    assert 0.9 < (flow + 3 * m.leakage_flow) / m.main_pump_flow < 0.95
    motion = cruise(onset, velocity)
    switched = (RAMP + CRUISE / 2, RAMP + CRUISE / 2 + 0.1)
    simulator = Simulator(machine, posture=motion.position[0])
    simulator.set_plan(
        motion, ModeSchedule(0, [0, round(switched[0] * SECOND_NS)], [[0, 0, 0], [2, 0, 0]])
    )
    manifold, line = [], []
    while simulator.time_ns < (RAMP + CRUISE) * SECOND_NS:
        simulator.step()
        state = simulator.actuator_states
        manifold.append(state.manifold_pressure)
        line.append(state.supply_pressure[0])
    assert min(manifold[200:]) > 0.9 * m.supply_pressure
    held = compute_required_pressure(m, 0, machine.piston_forces(onset)[0], 0.0)
    assert held > 1.4 * m.supply_pressure
    assert line[round(1000 * switched[1])] > held - m.boost_margin


def test_a_slow_pump_charges_its_line_though_its_leakage_is_not_known(machine: Machine) -> None:
    """As long as the manifold feeds the line of a moving piston, too, leakage cannot be learnt."""
    slow = machine.with_values({"circuit.servo_pump_lag": 0.08, "payload.mass": 5.0})
    onset, velocity = np.array([-0.032, -0.794, -1.029]), np.array([0.1, -0.06, 0.06])
    motion = cruise(onset, velocity)
    simulator = Simulator(slow, posture=motion.position[0])
    simulator.set_plan(motion, ModeSchedule(0, [0, SECOND_NS // 5], [[0, 0, 0], [1, 0, 0]]))
    simulator.advance(RAMP + CRUISE / 2)
    force = slow.piston_forces(onset)[0]
    speed = (slow.moment_arms(onset) * velocity)[0]
    needed = compute_required_pressure(slow.arrays, 0, force, speed)
    assert needed > 1.2 * slow.arrays.supply_pressure
    assert simulator.actuator_states.supply_pressure[0] > needed - slow.arrays.boost_margin


def test_a_force_that_rises_when_a_command_acts_is_built_up_by_compressed_oil(
    machine: Machine,
) -> None:
    signals = Simulator(machine)._signals
    controller = CoordinatedController(machine, signals, read_gains(machine, "coordinated"))
    axes = controller._control.args[0].axes
    signals.reference[:, 1] = 1e-3  # it moves: at rest, all is slow
    for _ in range(3):
        controller.update()
    before, force = axes["demand"].copy(), axes["force_to_command"].copy()
    signals.command_reference[0, 2] = 0.5
    controller.update()
    rise = axes["force_to_command"] - force
    assert np.all(abs(rise) > 0.5)
    step = machine.config.simulation.step
    expected = rise / step / axes["stiffness"]
    np.testing.assert_allclose(axes["demand"] - before, expected, rtol=0.05)
    signals.command_reference[0, 2] = 0.5
    controller.update()
    np.testing.assert_allclose(axes["demand"], before, atol=0.05 * abs(expected).max())


def test_a_piston_in_boost_is_told_no_speed_that_its_pump_cannot_keep_up_with(
    machine: Machine,
) -> None:
    """An arm that is far behind its reference asks for more than the pump delivers."""
    m = machine.arrays
    signals = Simulator(machine)._signals
    controller = CoordinatedController(machine, signals, read_gains(machine, "coordinated"))
    axes = controller._control.args[0].axes
    signals.modes[:] = [1, 0, 0]
    signals.serves[:] = [0, -1, -1, -1]
    controller.update()
    signals.reference[:, 1, 0] = 2e-3 / axes["arm"][0]  # it moves: at rest, all is slow
    signals.sensors["length"][0] -= 0.01
    for _ in range(20):
        controller.update()
    constants = signals.circuit.constants[0]
    left = constants["servo_pump_flow"] - axes["leakage"][0]
    assert axes["demand"][0] == pytest.approx(left / m.cap_area[0], rel=0.02)
    signals.modes[:] = 0
    signals.serves[:] = -1
    for _ in range(2):
        controller.update()
    assert axes["demand"][0] > 1.5 * left / m.cap_area[0]


def test_the_integral_of_an_axis_goes_up_to_its_share_of_the_actuators_own_v_max(
    machine: Machine,
) -> None:
    slower = machine.with_values({"joints.1.actuator.max_piston_speed": 0.006})
    signals = Simulator(slower)._signals
    controller = CoordinatedController(slower, signals, read_gains(slower, "coordinated"))
    axes = controller._control.args[0].axes
    axes["max_integral_gain"] = 1e6
    controller.update()
    signals.reference[:, 1] = 1e-3 / axes["arm"]
    signals.sensors["length"] -= 1e-3
    highest = np.zeros(3)
    for _ in range(200):
        controller.update()
        highest = np.maximum(highest, axes["integral"])
    np.testing.assert_allclose(
        highest, np.array([0.012, 0.006, 0.012]) / SETTINGS.cascade.integral_limit_ratio
    )


@pytest.mark.parametrize(("late", "softness"), [(0, 1.0), (2, 1.0), (5, 1.0), (5, 0.6), (5, 1.5)])
def test_a_force_loop_that_is_late_keeps_a_phase_margin_of_38_degrees(
    machine: Machine, late: int, softness: float
) -> None:
    """Of ω_F/(c s) with the spool's lag, a step and the delay as dead time, at its crossing."""
    signals, gains = Simulator(machine)._signals, read_gains(machine, "coordinated")
    controller = CoordinatedController(machine, signals, gains)
    servo, _, _, pumps, _ = controller._control.args
    pumps.drives.record["delay"], pumps.lines.estimate[0] = late, softness
    usual = servo.axes["force_bandwidth"].copy()
    limit_gains_by_delay(servo, pumps, RECORD)
    bandwidth, oil = servo.axes["force_bandwidth"], machine.config.circuit
    crossing = bandwidth / min(softness, 1.0)
    spool = oil.valve_damping / (np.pi * oil.valve_frequency)
    dead = spool + (1 + late) * machine.config.simulation.step
    assert np.all(np.degrees(np.pi / 2 - crossing * dead) >= 38.0)
    assert np.all(bandwidth <= usual)
    ratio = SETTINGS.cascade.max_position_gain_ratio
    assert np.all(servo.axes["position_gain"] <= ratio * bandwidth)
    if late == 0:
        np.testing.assert_array_equal(bandwidth, usual)


def compute_margin(axis: ControlAxis, omega: float, late: float, decay: float) -> float:
    """Return the least |1 + G| of the loop opened at the valve's command; 0 if it is not stable.

    A joint swings at ω with the damping ratio 0.1, and the valve damps its force at the rate κ. All
    but the share w of that damping is taken away by the valve's inverse, T late:

        G = e^(−sT) [ω_F τ s²/(τ s + 1) + (k_p + k_i/s) ω²/s − κ (1 − w) s]
            / (s² + (0.2 ω + κ) s + ω²)
    """
    s = 1j * np.geomspace(0.02, 50.0, 2000) * omega
    force, position = axis["force_bandwidth"], axis["position_gain"]
    time, share = axis["bias_time"], compute_feedforward_share(axis, late)
    fed_back = force * time * s**2 / (time * s + 1.0) - decay * (1.0 - share) * s
    fed_back += (position + axis["integral_gain"] / s) * omega**2 / s
    loop = np.exp(-s * late) * fed_back / (s**2 + (0.2 * omega + decay) * s + omega**2)
    above, left = loop.imag > 0.0, loop.real[1:] < -1.0
    upwards = np.count_nonzero(left & ~above[:-1] & above[1:])
    downwards = np.count_nonzero(left & above[:-1] & ~above[1:])
    return float(abs(1.0 + loop).min()) if upwards == downwards else 0.0


@pytest.mark.parametrize("name", ["mhsb_arm3", "excavator", "forestry_crane"])
def test_every_joint_is_stable_with_every_delay_that_can_be_learnt(name: str) -> None:
    machine = load_machine(find_config_file(f"{name}.yaml"))
    oil, gains = machine.config.circuit, read_gains(machine, "coordinated")
    spool = oil.valve_damping / (np.pi * oil.valve_frequency)
    lowest, highest = find_joint_frequency_ranges(machine)
    fresh = build_axis_records(machine, gains)
    for delay in (0.002, 0.005, 0.01, 0.02, 0.04, 0.06):
        late = machine.config.simulation.step + spool + delay
        for decay in (0.0, 20.0, 60.0, 150.0):
            axes = fresh.copy()
            axes["flow_damping"] = decay
            for j in range(machine.joint_count):
                limit_axis_gains(axes[j], late, 1.0, 2.0 / 3.0, RECORD)
                for omega in np.geomspace(lowest[j], highest[j], 8):
                    assert compute_margin(axes[j], omega, late, decay) > 0.1, (delay, decay, j)


def test_a_shortfall_takes_no_more_from_a_lines_flow_than_the_commanded_flow_in_it(
    machine: Machine,
) -> None:
    """Behind a slow valve, the commanded flow in a line's flow begins at 0."""
    slow = machine.with_values({"circuit.valve_frequency": 12.7})
    signals = Simulator(slow)._signals
    controller = CoordinatedController(slow, signals, read_gains(slow, "coordinated"))
    servo, _, _, pumps, _ = controller._control.args
    signals.modes[:] = [1, 0, 0]
    signals.serves[:] = [0, -1, -1, -1]
    controller.update()
    signals.sensors["line_pressure"][0] = slow.arrays.max_boost_pressure
    signals.reference[:, 1, 0] = 2e-3 / servo.axes["arm"][0]
    for _ in range(5):
        pumps.draws["excess_flow"][0] = -1.0
        controller.update()
        lost = pumps.lines.estimate[1] * servo.axes["leakage"][0] + pumps.lines.fed[0, 2]
        assert lost > 0.0
        assert servo.axes["line_flow"][0] >= 0.999 * lost


def test_slip_of_a_joined_lines_own_pump_is_missing_for_its_piston(machine: Machine) -> None:
    leaky = machine.with_values({"hydraulics.servo_pump.slip_flow": 4e-6})
    signals = Simulator(leaky)._signals
    controller = CoordinatedController(leaky, signals, read_gains(leaky, "coordinated"))
    servo, _, _, pumps, _ = controller._control.args
    signals.modes[:] = [2, 0, 0]
    signals.serves[:] = [0, -1, -1, -1]
    servo.axes["joined"] = [1.0, 0.0, 0.0]
    signals.sensors["line_pressure"][0] = leaky.arrays.max_boost_pressure
    controller.update()
    axis, full = servo.axes[0], signals.circuit.constants["servo_pump_flow"][0]
    slip = pumps.lines.fed[0, 2]
    assert slip > 1e-6
    area = leaky.arrays.cap_area[0] if axis["demand"] > 0.0 else leaky.arrays.rod_area[0]
    left = full - pumps.lines.estimate[1] * axis["leakage"] - slip - pumps.lines.fed[3, 2]
    assert axis["deliverable_speed"] == pytest.approx(left / area, rel=1e-9)
