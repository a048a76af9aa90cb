"""Energy of a motion with its modes, and of charging lines, against sums done by hand."""

import numpy as np
import pytest
from tests.support.motions import inverse_dynamics

from mhsb_model.hydraulics import compute_required_pressure, load_pressure
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, Trajectory, standstill
from mhsb_planner.motion.energy import CHARGED_AHEAD, compute_charging, compute_motion_energy
from mhsb_planner.search.s2_step import compute_step_costs

STRETCHED = np.array([0.0, 0.0, 0.0])


def constant_speed(machine, start, speeds, duration):
    """Constant piston speeds [m/s] over a short time, from the posture `start`."""
    offset = np.arange(0, int(duration * SECOND_NS) + 1, 20_000_000)
    qd = speeds / machine.moment_arms(start)
    q = start + qd * (offset / SECOND_NS)[:, None]
    return Trajectory(0, offset, q, np.broadcast_to(qd, q.shape), np.zeros_like(q))


def modes(*pattern):
    return ModeSchedule(0, [0], [pattern])


def test_an_arm_at_rest_takes_leakage_at_the_price_of_each_mode(machine):
    rest = np.array([0.0, 0.0, 0.0])
    still = np.zeros((2, 3))
    motion = Trajectory(0, [0, 3 * SECOND_NS], np.array([rest, rest]), still, still)
    m, force = machine.arrays, machine.piston_forces(rest)
    normal = compute_motion_energy(machine, motion, modes(0, 0, 0))
    assert normal.paper == pytest.approx(3 * 3 * m.supply_pressure * m.leakage_flow)
    assert normal.series == pytest.approx(normal.paper)

    boosted = compute_motion_energy(machine, motion, modes(1, 0, 0))
    load = load_pressure(m.cap_area[0], m.rod_area[0], m.tank_pressure, force[0], 1.0)
    supply = compute_required_pressure(m, 0, force[0], 0.0)
    oil = 3 * m.leakage_flow
    two_normal = 2 * m.supply_pressure * oil
    eta = m.servo_pump_efficiency
    assert boosted.paper == pytest.approx(two_normal + load / eta * oil)
    series = m.supply_pressure + (supply - m.supply_pressure) / eta
    assert boosted.series == pytest.approx(two_normal + series * oil * more_leakage(m, supply))


def more_leakage(m, supply):
    """Factor on the leakage of an orifice by its supply pressure."""
    return np.sqrt((supply - m.tank_pressure) / (m.supply_pressure - m.tank_pressure))


def test_slip_lowers_the_overall_efficiency_of_pumps_as_iso_4409_defines_it(machine):
    """η = η_m Q/(Q + n c Δp) for n pumps at the rise Δp."""
    slip = 4e-6 / 1e7
    leaky = machine.with_values({"hydraulics.servo_pump.slip_flow": 4e-6})
    rest, still = np.zeros(3), np.zeros((2, 3))
    motion = Trajectory(0, [0, 2 * SECOND_NS], np.array([rest, rest]), still, still)
    m, force = machine.arrays, machine.piston_forces(rest)
    supply = compute_required_pressure(m, 0, force[0], 0.0)
    rise, flow = supply - m.supply_pressure, m.leakage_flow * more_leakage(m, supply)
    for mode, pumps in ((1, 1), (2, 2)):
        tight = compute_motion_energy(machine, motion, modes(mode, 0, 0))
        found = compute_motion_energy(leaky, motion, modes(mode, 0, 0))
        eta = m.servo_pump_efficiency * flow / (flow + pumps * slip * rise)
        assert found.servo_pumps == pytest.approx(2 * rise * flow / eta)
        assert found.servo_pump_losses == pytest.approx((1 - eta) * found.servo_pumps)
        assert found.main_pump == tight.main_pump
        assert found.paper == tight.paper
        assert found.servo_valves == pytest.approx(tight.servo_valves, abs=1e-9)


def test_energy_is_delivered_where_it_is_used(machine):
    start, speeds = np.array([0.05, -0.1, -0.1]), np.array([0.008, -0.006, 0.002])
    motion = constant_speed(machine, start, speeds, 0.02)
    energy = compute_motion_energy(machine, motion, modes(2, 1, 0))
    middle = motion.sample(motion.duration_ns // 2).position
    m, force = machine.arrays, machine.piston_forces(middle)
    assert energy.series == pytest.approx(energy.main_pump + energy.servo_pumps)
    assert energy.piston_work == pytest.approx(0.02 * float(force @ speeds), rel=1e-2)
    assert energy.servo_pump_losses == pytest.approx(
        (1 - m.servo_pump_efficiency) * energy.servo_pumps
    )
    # The edges of the servo valves take what lies between the supply's and the load's pressures.
    supply = np.array(
        [
            max(compute_required_pressure(m, j, force[j], v) for v in (0.0, speeds[j]))
            for j in range(3)
        ]
    )
    supply = np.where([1, 1, 0], supply, m.supply_pressure)
    inlet = np.where(speeds > 0, m.cap_area, m.rod_area)
    outlet = np.where(speeds > 0, m.rod_area, m.cap_area)
    flow = np.abs(speeds)
    lost = supply * inlet * flow - force * speeds - m.tank_pressure * outlet * flow
    assert energy.servo_valves == pytest.approx(0.02 * float(lost.sum()), rel=1e-2)


def test_a_boosted_load_is_carried_while_it_is_held_and_lowered(machine):
    """Whatever the sign of a speed too small to matter, and of one that is not."""
    start = np.array([0.0, 0.0, 0.0])
    motions = (constant_speed(machine, start, np.array([v, 0, 0]), 0.1) for v in (1e-9, -1e-9))
    held, creeping = (compute_motion_energy(machine, motion, modes(1, 0, 0)) for motion in motions)
    assert creeping.series == pytest.approx(held.series, rel=1e-6)
    assert creeping.paper == pytest.approx(held.paper, rel=1e-6)
    m = machine.arrays
    supply = compute_required_pressure(m, 0, machine.piston_forces(start)[0], 0.0)
    lowered = constant_speed(machine, start, np.array([-0.005, 0, 0]), 0.02)
    oil = 0.02 * (m.rod_area[0] * 0.005 + m.leakage_flow * more_leakage(m, supply))
    shaft = compute_motion_energy(machine, lowered, modes(1, 0, 0)).servo_pumps
    price = (supply - m.supply_pressure) / m.servo_pump_efficiency
    assert shaft == pytest.approx(price * oil, rel=1e-2)


@pytest.mark.parametrize("pattern", [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 2, 0), (1, 1, 1)])
def test_a_short_step_at_constant_speed_costs_what_the_search_says(machine, pattern):
    start = np.array([0.05, -0.1, -0.1])
    speeds = np.array([0.008, 0.006, 0.002])
    motion = constant_speed(machine, start, speeds, 0.1)
    m, q = machine.arrays, motion.position
    middle = 0.5 * (q[0] + q[-1])
    force = machine.piston_forces(middle)
    stroke = machine.cylinder_lengths(q[-1]) - machine.cylinder_lengths(q[0])
    needed = np.array([compute_required_pressure(m, j, force[j], speeds[j]) for j in range(3)])
    shared = np.array(pattern) == 2
    supply = np.where(shared, needed[shared].max(initial=0.0), needed)
    load = (force + m.rod_area * m.tank_pressure) / m.cap_area
    boosted = np.array(pattern) > 0
    eta, normal = m.servo_pump_efficiency, m.supply_pressure
    paper = np.where(boosted, np.maximum(normal, load / eta), normal)
    series = np.where(boosted, normal + np.maximum(0.0, supply - normal) / eta, normal)
    energy = compute_motion_energy(machine, motion, modes(*pattern))
    leakage = np.full(3, m.leakage_flow * 0.1)
    assert energy.paper == pytest.approx(float(paper @ (m.cap_area * stroke + leakage)), rel=2e-3)
    leakage *= more_leakage(m, np.where(boosted, np.maximum(supply, normal), normal))
    assert energy.series == pytest.approx(float(series @ (m.cap_area * stroke + leakage)), rel=2e-3)


@pytest.mark.parametrize("slip", [0.0, 3e-6])
def test_a_step_of_the_search_driven_at_its_own_speed_has_its_own_energy(
    slider_crank_machine, slip
):
    machine = slider_crank_machine.with_values({"hydraulics.servo_pump.slip_flow": slip})
    start = np.array([0.05, -0.1, -0.1])
    end = start + [0.02, 0.01, 0.01]
    costs = compute_step_costs(machine, start, end)
    best = int(np.nanargmin(costs.energy))
    duration = costs.duration[best]
    stroke = machine.cylinder_lengths(end) - machine.cylinder_lengths(start)
    motion = constant_speed(machine, 0.5 * (start + end), stroke / duration, duration)
    # Moved back by half of it, so that the motion lies around the middle of the step.
    shifted = motion.position + start - 0.5 * (start + end)
    motion = Trajectory(0, motion.offset_ns, shifted, motion.velocity, motion.acceleration)
    share = motion.duration_ns / SECOND_NS / duration
    energy = compute_motion_energy(machine, motion, modes(*machine.patterns[best]))
    assert energy.paper == pytest.approx(share * costs.energy[best], rel=0.01)
    assert energy.series == pytest.approx(share * costs.energy_series[best], rel=0.01)


def test_a_mode_change_between_two_points_is_priced_where_it_happens(machine):
    start = np.array([0.0, 0.0, 0.0])
    still = np.zeros((2, 3))
    motion = Trajectory(0, [0, 20_000_000], np.array([start, start]), still, still)
    whole = compute_motion_energy(machine, motion, modes(1, 0, 0)).paper
    none = compute_motion_energy(machine, motion, modes(0, 0, 0)).paper
    quarter = ModeSchedule(0, [0, 5_000_000], [[1, 0, 0], [0, 0, 0]])
    mixed = compute_motion_energy(machine, motion, quarter).paper
    assert mixed == pytest.approx(0.25 * whole + 0.75 * none)


def test_a_motion_without_duration_takes_no_energy(machine):
    nothing = compute_motion_energy(machine, standstill(np.zeros(3)), modes(0, 0, 0))
    assert (nothing.paper, nothing.series) == (0.0, 0.0)


def stretched_out(machine, rows):
    """Speeds and forces of an arm that is held stretched out."""
    return np.zeros((rows, 3)), np.tile(machine.piston_forces(STRETCHED), (rows, 1))


def charging_by_hand(machine, j, volume):
    """Charging the line of a held load [J]: compression, and leakage while it waits."""
    m, oil = machine.arrays, machine.config.circuit
    needed = compute_required_pressure(m, j, machine.piston_forces(STRETCHED)[j], 0.0)
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
    work = compute_charging(machine, *stretched_out(machine, 3), modes)[0]
    assert work == pytest.approx(charging_by_hand(machine, 0, volume))
    slipping = machine.with_values({"hydraulics.servo_pump.slip_flow": 4e-6})
    assert compute_charging(slipping, *stretched_out(machine, 3), modes)[0] > 1.01 * work
    assert compute_charging(machine, *stretched_out(machine, 2), modes[1:])[0] == 0.0
    assert compute_charging(machine, *stretched_out(machine, 3), modes[::-1])[0] == 0.0


def test_the_rail_is_charged_by_the_first_that_draws_on_it(machine):
    modes = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0]], dtype=np.uint8)
    volumes = machine.config.circuit
    first = charging_by_hand(machine, 0, volumes.line_volume + volumes.rail_volume)
    second = charging_by_hand(machine, 1, volumes.line_volume)
    work = compute_charging(machine, *stretched_out(machine, 3), modes)[0]
    assert work == pytest.approx(first + second)


def test_motions_pay_for_it_with_pumps_in_series_alone(machine):
    still = np.zeros((3, 3))
    offset = np.array([0, SECOND_NS // 2, SECOND_NS])
    motion = Trajectory(0, offset, np.tile(STRETCHED, (3, 1)), still, still)
    late, always = (
        compute_motion_energy(machine, motion, ModeSchedule(0, begin, rows))
        for begin, rows in (
            ([0, SECOND_NS // 2], [[0, 0, 0], [1, 0, 0]]),
            ([0], [[1, 0, 0]]),
        )
    )
    charging = charging_by_hand(machine, 0, machine.config.circuit.line_volume)
    assert late.servo_pumps == pytest.approx(always.servo_pumps / 2 + charging)
    none = compute_motion_energy(machine, motion, ModeSchedule(0, [0], [[0, 0, 0]]))
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
    energy = compute_motion_energy(machine, motion, ModeSchedule(0, [0], [[1, 0, 0]]))
    arm = machine.moment_arms(start)
    inertia = inverse_dynamics(machine, start, slow, push) - machine.gravity_torque(start)
    speed = arm[0] * slow[0]
    area = m.cap_area[0] if speed > 0 else m.rod_area[0]
    direct = machine.piston_forces(start)[0]
    lift = compute_required_pressure(m, 0, direct + inertia[0] / arm[0], speed)
    needed = lift - machine.config.hydraulics.boost_margin / 2
    supply = max(
        compute_required_pressure(m, 0, direct, 0.0), compute_required_pressure(m, 0, direct, speed)
    )
    assert m.supply_pressure < supply < needed < m.max_boost_pressure
    more_leakage = np.sqrt((needed - m.tank_pressure) / (m.supply_pressure - m.tank_pressure))
    per_second = abs(speed) * area + m.leakage_flow * more_leakage
    per_second += abs(arm[0]) * push[0] * duration / 2 * area  # it gets faster
    work = duration * per_second * (needed - m.supply_pressure) / m.servo_pump_efficiency
    assert energy.servo_pumps == pytest.approx(work, rel=0.02)
