"""What charging lines takes, against sums done by hand."""

import numpy as np
import pytest

from mhsb_model.hydraulics import required_pressure
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_planner.motion.charging import CHARGED_AHEAD, charging_energy
from mhsb_planner.motion.energy import motion_energy

STRETCHED = np.array([0.0, 0.0, 0.0])


def at_rest(machine, rows):
    """Speeds and forces of an arm that is held stretched out."""
    return np.zeros((rows, 3)), np.tile(machine.piston_forces(STRETCHED), (rows, 1))


def by_hand(machine, j, volume):
    """Charging the line of a held load [J]: compression, and leakage while it waits."""
    m, oil = machine.arrays, machine.config.circuit
    needed = required_pressure(m, j, machine.piston_forces(STRETCHED)[j], 0.0)
    supply = max(needed, m.supply_pressure)
    rise = supply - m.supply_pressure
    share = (supply - m.tank_pressure) / (m.supply_pressure - m.tank_pressure)
    leakage = m.leakage_flow * np.sqrt(share)
    waits = CHARGED_AHEAD * machine.servo_preview
    compressed = volume * rise / oil.bulk_modulus  # m³ that the line takes, at half the rise
    return (compressed * rise / 2 + leakage * rise * waits) / m.servo_pump_efficiency


@pytest.mark.parametrize(
    ("mode", "parts"), [(Mode.DB, ("line",)), (Mode.SB, ("line", "rail"))], ids=["DB", "SB"]
)
def test_a_line_is_charged_once_when_its_boost_begins(machine, mode, parts):
    modes = np.array([[0, 0, 0], [mode, 0, 0], [mode, 0, 0]], dtype=np.uint8)
    volume = sum(getattr(machine.config.circuit, f"{part}_volume") for part in parts)
    work = charging_energy(machine, *at_rest(machine, 3), modes)
    assert work == pytest.approx(by_hand(machine, 0, volume))
    assert charging_energy(machine, *at_rest(machine, 2), modes[1:]) == 0.0
    assert charging_energy(machine, *at_rest(machine, 3), modes[::-1]) == 0.0


def test_the_rail_is_charged_by_the_first_that_draws_on_it(machine):
    modes = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0]], dtype=np.uint8)
    volumes = machine.config.circuit
    first = by_hand(machine, 0, volumes.line_volume + volumes.rail_volume)
    second = by_hand(machine, 1, volumes.line_volume)
    work = charging_energy(machine, *at_rest(machine, 3), modes)
    assert work == pytest.approx(first + second)


def test_motions_pay_for_it_with_pumps_in_series_alone(machine):
    still = np.zeros((3, 3))
    offset = np.array([0, SECOND_NS // 2, SECOND_NS])
    motion = Trajectory(0, offset, np.tile(STRETCHED, (3, 1)), still, still)
    late, always = (
        motion_energy(machine, motion, ModeSchedule(0, begin, rows))
        for begin, rows in (
            ([0, SECOND_NS // 2], [[0, 0, 0], [1, 0, 0]]),
            ([0], [[1, 0, 0]]),
        )
    )
    charging = by_hand(machine, 0, machine.config.circuit.line_volume)
    assert late.servo_pumps == pytest.approx(always.servo_pumps / 2 + charging)
    none = motion_energy(machine, motion, ModeSchedule(0, [0], [[0, 0, 0]]))
    assert late.paper == pytest.approx((always.paper + none.paper) / 2)
    lost = (1 - machine.arrays.servo_pump_efficiency) * late.servo_pumps
    assert late.servo_pump_losses == pytest.approx(lost)


def test_a_boosted_load_that_is_accelerated_takes_pressure_for_its_inertia(machine):
    """Half the margin is left to inertia, as the plan's check of pressures has it."""
    m, duration = machine.arrays, 0.02
    start = np.array([0.0, -0.2, -0.2])
    push = np.array([1.0, 0.0, 0.0])  # rad/s²: enough to take more than half the margin
    slow = np.array([0.1, 0.0, 0.0])  # rad/s
    offset = np.array([0, round(duration * SECOND_NS)])
    t = offset[:, None] / SECOND_NS
    motion = Trajectory(
        0,
        offset,
        start + slow * t + push * t**2 / 2,
        slow + push * t,
        np.tile(push, (2, 1)),
    )
    energy = motion_energy(machine, motion, ModeSchedule(0, [0], [[1, 0, 0]]))
    arm = machine.moment_arms(start)
    inertia = machine.inverse_dynamics(start, slow, push) - machine.gravity_torque(start)
    speed = arm[0] * slow[0]
    area = m.cap_area[0] if speed > 0 else m.rod_area[0]
    direct = machine.piston_forces(start)[0]
    lift = required_pressure(m, 0, direct + inertia[0] / arm[0], speed)
    needed = lift - machine.config.hydraulics.boost_margin / 2
    supply = max(required_pressure(m, 0, direct, 0.0), required_pressure(m, 0, direct, speed))
    assert m.supply_pressure < supply < needed < m.max_boost_pressure
    more_leakage = np.sqrt((needed - m.tank_pressure) / (m.supply_pressure - m.tank_pressure))
    per_second = abs(speed) * area + m.leakage_flow * more_leakage
    per_second += abs(arm[0]) * push[0] * duration / 2 * area  # it gets faster
    work = duration * per_second * (needed - m.supply_pressure) / m.servo_pump_efficiency
    assert energy.servo_pumps == pytest.approx(work, rel=0.02)
