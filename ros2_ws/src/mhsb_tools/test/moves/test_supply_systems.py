"""Energy models of other supplies, against closed forms, SciPy and the balance of energy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory
from mhsb_planner.errors import RequestError
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.moves.supply_systems import (
    MotionLoads,
    PumpMap,
    SingleSupply,
    baselines,
    compute_constant_pressure_energy,
    compute_loads,
    compute_mhsb_energy,
    compute_needed_pressure_energy,
    compute_needed_supply,
    compute_pump_control_energy,
    compute_single_supply,
    load_sensing,
    remove_leakage,
)
from mhsb_tools.study.replay import replay

TANK = 1e5


@pytest.fixture(scope="module")
def lift(motion) -> tuple:
    """A motion up and outwards, some of it boosted: trajectory and schedule."""
    return motion(MotionState.at_rest(np.array([-0.2, -1.2, -0.3])), [0.4, -0.7, -0.1])


def steady(speeds, forces, seconds: float = 3.0) -> MotionLoads:
    """Constant speeds [m/s] and forces [N], inertia and friction left out."""
    shape = (4, len(speeds))
    force = np.broadcast_to(np.array(forces, dtype=float), shape)
    return MotionLoads(np.linspace(0.0, seconds, 4), np.broadcast_to(speeds, shape), force, force)


def test_a_steady_lift_takes_what_a_hand_calculation_says(machine: Machine) -> None:
    m, oil = machine.arrays, machine.config.circuit
    loads = steady((0.01, -0.005, 0.0), (2000.0, 500.0, -300.0))
    stroke = 3.0 * (m.cap_area[0] * 0.01 + m.rod_area[1] * 0.005)
    # Twice the pressure over the orifice that leaks: √2 times the oil.
    supply = TANK + 2.0 * (m.supply_pressure - TANK)
    leaked = 3.0 * 3 * m.leakage_flow * np.sqrt(2.0)
    found = compute_constant_pressure_energy(machine, loads, supply)
    assert found.hydraulic_j == pytest.approx(supply * (stroke + leaked))
    assert found.shaft_j == pytest.approx(
        found.hydraulic_j / oil.main_pump_efficiency + 3.0 * oil.main_pump_drag_power
    )
    sealed = remove_leakage(machine)
    assert compute_constant_pressure_energy(sealed, loads, supply).hydraulic_j == pytest.approx(
        supply * stroke
    )
    # Joint 1 has the highest load; joint 3 is held, and signals nothing.
    load = (2000.0 + m.rod_area[0] * TANK) / m.cap_area[0]
    sensed = load_sensing(sealed, loads, 1e6)
    assert sensed.hydraulic_j == pytest.approx((load + 1e6) * stroke)


def test_a_supply_at_the_need_of_a_motion_lets_every_piston_move(machine: Machine, lift) -> None:
    """By the planner's law at every instant; and no less does."""
    loads = compute_loads(machine, lift[0])
    supply = compute_needed_supply(machine, loads)
    m, oil = machine.arrays, machine.config.hydraulics
    k = oil.valve.rated_flow / np.sqrt(oil.valve.rated_pressure_drop_per_land)
    highest = 0.0
    for speed, force in zip(loads.speed.ravel(), loads.static.ravel(), strict=True):
        way = np.sign(speed if speed != 0.0 else force)
        area, other = (m.cap_area[0], m.rod_area[0])[:: int(way)]
        load = (way * force + other * TANK) / area
        drop = speed**2 * (area**3 + other**3) / (k**2 * area)
        highest = max(highest, load + drop + oil.boost_margin)
    assert supply == pytest.approx(highest)
    own = compute_needed_pressure_energy(machine, loads).hydraulic_j
    assert own == pytest.approx(
        compute_constant_pressure_energy(machine, loads, supply).hydraulic_j
    )


def test_a_constant_pressure_takes_what_the_simulator_takes_with_such_a_pump(
    machine: Machine, motion
) -> None:
    """Motion in N alone at 8 MPa, friction, compression and check valves included."""
    supply = 8e6
    leaked = machine.arrays.leakage_flow * np.sqrt((supply - TANK) / (4e6 - TANK))
    strong = machine.with_values(
        {"hydraulics.main_pump.pressure": supply, "hydraulics.valve.leakage_flow": leaked}
    )
    start = np.array([-0.2, -1.2, -0.3])
    trajectory, schedule = motion(MotionState.at_rest(start), [0.4, -0.7, -0.1], of=strong)
    assert not schedule.modes.any()
    simulator = Simulator(strong, posture=start)
    command = Command(trajectory, schedule)
    run = replay(simulator, [command], trajectory.duration_ns / SECOND_NS)
    assert run.tip_error(strong).max() < 2e-3
    found = compute_constant_pressure_energy(machine, compute_loads(machine, trajectory), supply)
    assert found.hydraulic_j == pytest.approx(run.energies["main_pump"], rel=0.01)
    assert found.shaft_j == pytest.approx(run.energies["main_pump_shaft"], rel=0.01)


def test_a_single_supply_fills_all_strokes_and_leaks_at_the_highest_needed_pressure(
    machine: Machine, lift
) -> None:
    trajectory, m = lift[0], machine.arrays
    position = trajectory.sample_many(np.linspace(0, trajectory.duration_ns, 20001).astype(int))[0]
    strokes = np.diff([machine.cylinder_lengths(q) for q in position], axis=0)
    oil = (np.where(strokes > 0.0, m.cap_area, m.rod_area) * np.abs(strokes)).sum()
    found = compute_single_supply(machine, trajectory)
    ratio = (found.pressure - TANK) / (m.supply_pressure - TANK)
    leaked = 3 * m.leakage_flow * np.sqrt(ratio) * trajectory.duration_ns / 1e9
    assert found.energy_j == pytest.approx(found.pressure * (oil + leaked), rel=1e-3)
    assert found.pressure > m.supply_pressure


def test_a_plan_instead_of_its_trajectory_is_refused_with_a_sentence(machine: Machine) -> None:
    with pytest.raises(RequestError, match=r"such as plan\.motion\.trajectory"):
        compute_single_supply(machine, object())


def test_the_saving_is_in_per_cent_of_the_energy_of_one_pump() -> None:
    one_pump = SingleSupply(7.06e6, 800.0)
    assert one_pump.describe_saving(576.0) == (
        "576.0 J, saves 28 % against one pump at constant 7.1 MPa for this motion (800.0 J)"
    )
    assert one_pump.describe_saving(840.0) == (
        "840.0 J, costs 5 % more than one pump at constant 7.1 MPa for this motion (800.0 J)"
    )
    assert "saves 0 % against" in SingleSupply(4e6, 0.0).describe_saving(0.0)


def test_load_sensing_agrees_with_quadrature_over_the_motion(machine: Machine, lift) -> None:
    trajectory = lift[0]
    m, oil = machine.arrays, machine.config.circuit
    sealed, margin = remove_leakage(machine), 1.5e6

    def power(time: float) -> float:
        offset = np.array([round(time * SECOND_NS)])
        q, qd, qdd = (each[0] for each in trajectory.sample_offsets(offset))
        arm = machine.moment_arms(q)
        torque = machine.gravity_torque(q) + _inertia(machine, q, qd, qdd)
        v = arm * qd
        force = torque / arm + oil.coulomb_friction * np.tanh(v / oil.friction_speed)
        force = force + oil.viscous_friction * v
        up = v > 0.0
        inlet, outlet = np.where(up, m.cap_area, m.rod_area), np.where(up, m.rod_area, m.cap_area)
        load = (np.where(up, force, -force) + outlet * TANK) / inlet
        supply = max(TANK, load[np.abs(v) > 1e-5].max(initial=0.0)) + margin
        return float(supply * (inlet * np.abs(v)).sum())

    duration = trajectory.duration_ns / SECOND_NS
    expected, _ = quad(power, 0.0, duration, limit=400, epsrel=1e-4)
    found = load_sensing(sealed, compute_loads(machine, trajectory), margin)
    assert found.hydraulic_j == pytest.approx(expected, rel=2e-3)


def _inertia(machine: Machine, q, qd, qdd):
    """d/dt ∂T/∂q̇ − ∂T/∂q by central differences of the kinetic energy T(q, q̇)."""
    h = 1e-4
    steps = h * np.eye(len(q))

    def difference(higher, lower):
        return (higher - lower) / (2.0 * h)

    def momentum(q, qd):
        return difference(
            *(np.array([_kinetic(machine, q, qd + way * s) for s in steps]) for way in (1, -1))
        )

    along = difference(*(momentum(q + way * h * qd, qd + way * h * qdd) for way in (1, -1)))
    slope = difference(
        *(np.array([_kinetic(machine, q + way * s, qd) for s in steps]) for way in (1, -1))
    )
    return along - slope


def _kinetic(machine: Machine, q, qd) -> float:
    """½ Σ m |v|² + ½ Σ I ω² of the links and the payload [J]."""
    angle, rate = np.cumsum(q), np.cumsum(qd)
    velocity, energy = np.zeros(2), 0.0
    for joint, a, w in zip(machine.config.joints, angle, rate, strict=True):
        across = w * np.array([-np.sin(a), np.cos(a)])
        at = velocity + joint.link.center_of_mass * across
        energy += 0.5 * joint.link.mass * at @ at + 0.5 * joint.link.inertia * w * w
        velocity = velocity + joint.link.length * across
    return float(energy + 0.5 * machine.config.payload.mass * velocity @ velocity)


def _potential(machine: Machine, q) -> float:
    angle = np.cumsum(q)
    height, energy = 0.0, 0.0
    for joint, a in zip(machine.config.joints, angle, strict=True):
        energy += joint.link.mass * (height + joint.link.center_of_mass * np.sin(a))
        height += joint.link.length * np.sin(a)
    return machine.config.gravity * (energy + machine.config.payload.mass * height)


def test_pumps_without_losses_take_what_the_arm_gains(machine: Machine, lift) -> None:
    """Potential energy, friction, and what the rods push back to the reservoir."""
    trajectory: Trajectory = lift[0]
    loads, m = compute_loads(machine, trajectory), machine.arrays
    start, end = trajectory.position[0], trajectory.position[-1]
    rods = (m.cap_area - m.rod_area) * TANK
    stroke = machine.cylinder_lengths(end) - machine.cylinder_lengths(start)
    oil = machine.config.circuit
    speed = loads.speed
    friction = oil.coulomb_friction * np.tanh(speed / oil.friction_speed) * speed
    friction += oil.viscous_friction * speed**2
    gained = _potential(machine, end) - _potential(machine, start)
    expected = gained + loads.integral(friction.sum(axis=1)) - rods @ stroke
    found = compute_pump_control_energy(machine, loads, PumpMap(1.0, 0.0), True)
    assert found.hydraulic_j == pytest.approx(expected, rel=1e-3)
    assert found.shaft_j == pytest.approx(found.hydraulic_j)


@pytest.mark.parametrize("speed", [0.01, -0.01])
@pytest.mark.parametrize("force", [1500.0, -1500.0])
def test_pump_power_is_that_of_both_chambers_in_all_four_quadrants(
    machine: Machine, speed: float, force: float
) -> None:
    m = machine.arrays
    cap, rod = m.cap_area[0], m.rod_area[0]
    if force > (cap - rod) * TANK:  # the pump's flow is that of the loaded side
        power = ((force + rod * TANK) / cap - TANK) * cap * speed
    else:
        power = (TANK - (cap * TANK - force) / rod) * rod * speed
    loads = steady((speed, 0.0, 0.0), (force, 0.0, 0.0))
    found = compute_pump_control_energy(machine, loads, PumpMap(0.8, 5.0), True)
    assert found.hydraulic_j == pytest.approx(3.0 * power)
    assert found.shaft_j == pytest.approx(
        3.0 * ((power / 0.8 if power > 0.0 else power * 0.8) + 5.0)
    )
    braked = compute_pump_control_energy(machine, loads, PumpMap(0.8, 5.0), False)
    assert braked.hydraulic_j == pytest.approx(3.0 * max(0.0, power))


def test_without_leakage_every_system_with_valves_takes_less(machine: Machine, lift) -> None:
    trajectory, schedule = lift
    loads, sealed = compute_loads(machine, trajectory), remove_leakage(machine)
    assert (
        compute_mhsb_energy(sealed, trajectory, schedule).shaft_j
        < compute_mhsb_energy(*(machine, *lift)).shaft_j
    )
    for name, system in baselines(machine).items():
        leaking, closed = system(machine, loads), system(sealed, loads)
        if name.startswith("pump control"):
            assert closed == leaking
        else:
            assert 0.0 < closed.hydraulic_j < leaking.hydraulic_j


def test_a_motion_without_boost_takes_what_one_pump_at_the_machines_pressure_takes(
    machine: Machine, lift
) -> None:
    trajectory, _ = lift
    no_boost = ModeSchedule(0, np.zeros(1, dtype=np.int64), np.zeros((1, 3), dtype=np.uint8))
    supply = machine.arrays.supply_pressure
    alone = compute_constant_pressure_energy(machine, compute_loads(machine, trajectory), supply)
    own = compute_mhsb_energy(machine, trajectory, no_boost)
    assert own.hydraulic_j == pytest.approx(alone.hydraulic_j, rel=1e-3)
    assert own.shaft_j == pytest.approx(alone.shaft_j, rel=1e-3)
