"""Leakage over the lands of closed valves and past piston seals, and lock valves against it."""

import numpy as np
import pytest

from mhsb_control.registry import load_machine
from mhsb_model.circuit.elements import (
    compute_land_conductance,
    compute_null_leakage,
    compute_orifice_flow,
)
from mhsb_model.hydraulics import (
    compute_sinking_speed,
    compute_valve_leakage,
    get_shared_hydraulics,
)
from mhsb_model.kernels.bound_kernel import bind_kernel
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_sim.circuit import network
from mhsb_sim.circuit.audit import compute_energy_gap, compute_volume_gap
from mhsb_sim.circuit.network import Circuit, build_circuit, set_rest_pressures
from mhsb_sim.simulation.faults import parse_faults
from mhsb_sim.simulation.simulator import Simulator

START = np.array([0.3, -1.4, -1.5])
LOADS = np.array([1500.0, -600.0, 300.0])
"""Forces that the three pistons carry [N]; positive ones push the piston in."""
DRAG = 2e6
"""Drag of a load [N s/m], so slow that steps of `STEP` follow it."""
STEP = 5e-3
SHARE = 0.02
SEAL = 4e-9


@pytest.fixture(scope="module")
def machine() -> Machine:
    return load_machine()


def leaking(machine: Machine, **values: object) -> Machine:
    return machine.with_values(
        {
            "hydraulics.valve.land_leakage": SHARE,
            "circuit.main_pump_droop": 1e6,  # a soft regulator, which steps of `STEP` follow
            "circuit.valves": {"piston_seal": {"leakage_flow": SEAL}},
            **{name.replace("__", "."): value for name, value in values.items()},
        }
    )


def carry(machine: Machine, *times: float) -> tuple[FloatArray, Circuit]:
    """Let massless loads hang on closed valves for some times [s].

    Returns:
        The strokes until each of the times, float64[times, 3], [m], and the circuit at the end.
    """
    circuit = build_circuit(machine, STEP)
    set_rest_pressures(circuit, machine, START, np.zeros(3, np.uint8))
    m, p = machine.arrays, circuit.pressure
    length, speed = machine.cylinder_lengths(START).copy(), np.zeros(3)
    advance = bind_kernel(network.advance_alone, circuit, length, speed, integer_count=1)
    lengths = [length.copy()]
    for steps in np.diff([0, *np.round(np.array(times) / STEP)]):
        for _ in range(round(steps)):
            speed[:] = (m.cap_area * p[0:9:3] - m.rod_area * p[1:9:3] - LOADS) / DRAG
            advance(1)
            length += speed * STEP
        lengths.append(length.copy())
    return np.array(lengths[1:]) - lengths[0], circuit


def sinking_speeds(machine: Machine, circuit: Circuit, lands: float) -> FloatArray:
    """Solve the balance of both chambers and of the load for each closed cylinder.

    G (p − p_A) − G (p_A − p_T) − G_s (p_A − p_B) =  A v
    G (p − p_B) − G (p_B − p_T) + G_s (p_A − p_B) = −a v
    A p_A − a p_B = F + d v
    """
    m, seal = machine.arrays, SEAL / 1e7
    speeds = []
    for j, load in enumerate(LOADS):
        cap, rod = m.cap_area[j], m.rod_area[j]
        fed = lands * (circuit.pressure[3 * j + 2] + m.tank_pressure)
        matrix = [
            [2 * lands + seal, -seal, cap],
            [-seal, 2 * lands + seal, -rod],
            [cap, -rod, -DRAG],
        ]
        speeds.append(np.linalg.solve(matrix, [fed, fed, load])[2])
    return np.array(speeds)


def land_conductance(machine: Machine) -> float:
    m = machine.arrays
    leakage = machine.config.hydraulics.valve.leakage_flow
    return SHARE * leakage / (m.supply_pressure - m.tank_pressure)


def assert_audited(circuit: Circuit) -> None:
    energies = {name: float(circuit.energy[name][0]) for name in circuit.energy.dtype.names}
    volumes = {name: float(circuit.volume[name][0]) for name in circuit.volume.dtype.names}
    assert abs(compute_energy_gap(energies)) < 1e-9 * energies["main_pump"]
    assert abs(compute_volume_gap(volumes)) < 1e-9 * volumes["main_pump"]


def test_closed_valves_let_loads_sink_for_ten_minutes_as_the_balance_of_oil_says(machine):
    leaky = leaking(machine)
    (before, after), circuit = carry(leaky, 30.0, 630.0)
    expected = 600.0 * sinking_speeds(leaky, circuit, land_conductance(leaky))
    np.testing.assert_allclose(after - before, expected, rtol=1e-3)
    assert np.all(np.abs(expected) > 3e-3)
    assert np.all(np.abs(expected) < 60e-3)  # mm per minute
    assert expected[0] < 0.0 < expected[1]  # with the load
    assert_audited(circuit)


@pytest.mark.parametrize("overlap", [0.0, 0.25])
def test_the_planner_knows_the_speed_of_sinking_without_seals(machine, overlap):
    leaky = leaking(machine, circuit__valves={}, imperfections__valve_overlap=overlap)
    (before, after), circuit = carry(leaky, 60.0, 120.0)
    for j, stroke in enumerate(after - before):
        drag = DRAG * stroke / 60.0
        line = circuit.pressure[3 * j + 2]
        speed = compute_sinking_speed(leaky.arrays, j, LOADS[j] + drag, line)
        assert stroke / 60.0 == pytest.approx(speed, rel=2e-3)


def test_an_overlap_slows_the_sinking(machine):
    overlap, length = 0.1, machine.config.circuit.land_length
    leaky = leaking(machine, imperfections__valve_overlap=overlap)
    [before], circuit = carry(leaky, 30.0)
    [stroke], _ = carry(leaky, 50.0)
    lands = land_conductance(leaky) * length / (length + overlap)
    expected = 20.0 * sinking_speeds(leaky, circuit, lands)
    np.testing.assert_allclose(stroke - before, expected, rtol=5e-3)


def test_behind_lock_valves_only_the_seals_let_loads_sink(machine):
    locked = leaking(machine, circuit__lock_valve_opening=0.01)
    (before, stroke), circuit = carry(locked, 20.0, 120.0)
    np.testing.assert_array_equal(circuit.actuators["isolated"] > 0.999, True)
    unlocked = 100.0 * sinking_speeds(locked, circuit, land_conductance(locked))
    assert np.all(np.abs(stroke - before) < 0.2 * np.abs(unlocked))
    assert np.abs(stroke - before).max() > 1e-4
    tight = locked.with_values({"circuit.valves": {}})
    (early, late), circuit = carry(tight, 20.0, 120.0)
    assert np.abs(late - early).max() < 1e-7
    assert_audited(circuit)


def test_open_lock_valves_pass_what_the_valve_passes(machine):
    flows = []
    for each in (machine, machine.with_values({"circuit.lock_valve_opening": 0.01})):
        circuit = build_circuit(each, 5e-4)
        set_rest_pressures(circuit, each, START, np.zeros(3, np.uint8))
        circuit.actuators["valve_command"] = 0.2
        circuit.advance(each.cylinder_lengths(START), np.full(3, 0.005), 1000)
        flows.append(circuit.actuators["supply_flow"].copy())
    np.testing.assert_allclose(flows[0], flows[1], rtol=1e-3)


@pytest.mark.parametrize(("supply", "opens"), [(1.0e6, False), (1.5e6, True)])
def test_lock_valves_open_only_if_the_line_has_a_third_of_the_locked_pressure(
    machine, supply, opens
):
    fitted = machine.with_values(
        {"circuit.lock_valve_opening": 0.01, "hydraulics.main_pump.pressure": supply}
    )
    circuit = build_circuit(fitted, 5e-4)
    set_rest_pressures(circuit, fitted, START, np.zeros(3, np.uint8))
    circuit.pressure[0] = 3.6e6
    circuit.actuators["isolated"] = 1.0
    circuit.actuators["valve_command"] = -0.2
    circuit.advance(fitted.cylinder_lengths(START), np.zeros(3), 400)
    assert circuit.actuators["isolated"][0] == pytest.approx(0.0 if opens else 1.0, abs=0.01)
    assert (circuit.pressure[0] < 3e6) == opens


def test_the_leakage_of_lands_halves_with_an_overlap_of_their_length():
    assert compute_land_conductance(3.0, 0.0, 0.05) == pytest.approx(3.0)
    assert compute_land_conductance(3.0, 0.05, 0.05) == pytest.approx(1.5)
    assert compute_land_conductance(3.0, -0.5, 0.05) == pytest.approx(3.0)  # an open land


@pytest.mark.parametrize("overlap", [(0.0, 0.0), (0.25, 0.25), (0.1, 0.3)])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_circuit_servo_and_planner_count_the_same_null_leakage(machine, share, overlap):
    leaky = machine.with_values(
        {
            "hydraulics.valve.land_leakage": share,
            "imperfections.valve_overlap": overlap[0],
            "imperfections.valve_overlap_retracting": overlap[1],
        }
    )
    c, m = build_circuit(leaky, 5e-4).constants.view(np.recarray)[0], leaky.arrays
    for supply in (m.supply_pressure, 6e6, m.max_boost_pressure):
        known = compute_null_leakage(c, supply - m.tank_pressure)
        planned = compute_valve_leakage(get_shared_hydraulics(m), supply)
        assert known == pytest.approx(planned, rel=1e-3)
    if share == 0.0:
        drop = 5e6
        orifice = compute_orifice_flow(c.leakage_coefficient, drop, c.laminar_pressure)[0]
        assert compute_null_leakage(c, drop) == orifice


@pytest.mark.parametrize("overlap", [0.0, 0.25])
def test_a_servo_valve_that_holds_a_piston_leaks_as_the_planner_says(machine, overlap):
    """A piston at rest with balanced chambers: supply to tank over all four lands."""
    leaky = machine.with_values(
        {"hydraulics.valve.land_leakage": 1.0, "imperfections.valve_overlap": overlap}
    )
    circuit = build_circuit(leaky, 5e-4)
    set_rest_pressures(circuit, leaky, START, np.zeros(3, np.uint8))
    length = leaky.cylinder_lengths(START)
    circuit.advance(length, np.zeros(3), 20000)
    oil, energy = circuit.volume["main_pump"][0], circuit.energy["leakage"][0]
    circuit.advance(length, np.zeros(3), 2000)
    m = leaky.arrays
    assert circuit.volume["main_pump"][0] - oil == pytest.approx(3 * m.leakage_flow, rel=0.01)
    lost = 3 * m.leakage_flow * (m.supply_pressure - m.tank_pressure)
    assert circuit.energy["leakage"][0] - energy == pytest.approx(lost, rel=0.02)


def test_the_flow_from_the_line_to_the_chambers_contains_that_over_the_lands(machine):
    leaky = machine.with_values({"hydraulics.valve.land_leakage": 1.0})
    circuit = build_circuit(leaky, 5e-4)
    set_rest_pressures(circuit, leaky, START, np.zeros(3, np.uint8))
    circuit.advance(leaky.cylinder_lengths(START), np.zeros(3), 20000)
    flow = circuit.actuators["supply_flow"]
    np.testing.assert_allclose(flow, leaky.arrays.leakage_flow, rtol=0.01)


def test_a_valve_that_a_fault_makes_tight_leaks_nothing(machine):
    leaky = machine.with_values({"hydraulics.valve.land_leakage": 1.0})
    simulator = Simulator(leaky)
    simulator.inject_faults(parse_faults("leakage:actuator_1:0", leaky))
    simulator.advance(0.1)
    tight = Simulator(machine.with_values({"hydraulics.valve.leakage_flow": 0.0}))
    tight.advance(0.1)
    position = simulator.joint_state.position
    np.testing.assert_allclose(position, tight.joint_state.position, atol=1e-4)
    assert simulator.energies["leakage"] > 0.0


@pytest.mark.parametrize("lock", [0.0, 0.01])
def test_a_servo_at_rest_holds_its_load_against_leaking_lands(machine, lock):
    leaky = machine.with_values(
        {"hydraulics.valve.land_leakage": 0.1, "circuit.lock_valve_opening": lock}
    )
    simulator = Simulator(leaky)
    start = leaky.cylinder_lengths(simulator.joint_state.position)
    simulator.advance(8.0)
    sunk = leaky.cylinder_lengths(simulator.joint_state.position) - start
    assert np.abs(sunk).max() < 2e-5
    assert abs(compute_energy_gap(simulator.energies)) < 1e-6 * simulator.energies["main_pump"]


def test_a_boosted_line_is_held_against_the_slip_of_its_pump(machine):
    """The shaft work grows by Q/(Q + c Δp), with the leakage Q of the valve; pressures stay."""
    slip, posture, found = 2e-6, np.zeros(3), {}
    for name, flow in (("tight", 0.0), ("slipping", slip)):
        simulator = Simulator(
            machine.with_values({"hydraulics.servo_pump.slip_flow": flow}), posture=posture
        )
        simulator.advance(3.0)
        before = simulator.energies["servo_pumps"]
        lines = []
        for _ in range(2000):
            simulator.step()
            lines.append(simulator.actuator_states.supply_pressure)
        found[name] = np.mean(lines, axis=0), simulator.energies["servo_pumps"] - before
    (line, work), (slipping, more) = found["tight"], found["slipping"]
    np.testing.assert_allclose(slipping, line, atol=3e4)
    m = machine.arrays
    rise = np.maximum(line - m.supply_pressure, 0.0)
    rise[rise < 1e5] = 0.0
    assert rise.max() > 1e6
    leaked = [compute_valve_leakage(get_shared_hydraulics(m), p) for p in line]
    expected = rise @ (leaked + slip / 1e7 * rise) / (rise @ leaked)
    assert more / work == pytest.approx(expected, rel=0.02)
