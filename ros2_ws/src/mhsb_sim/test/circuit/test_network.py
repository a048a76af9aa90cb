"""The circuit against SciPy's Radau on the same equations, written anew here."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_sim.circuit.audit import compute_energy_gap, compute_volume_gap, sum_energy_by_source
from mhsb_sim.circuit.network import Circuit, build_circuit, set_rest_pressures

START = np.array([0.3, -1.4, -1.5])
MODES_N = np.zeros(3, np.uint8)
SPEED = np.array([0.006, -0.004, 0.002])

# time [s], flows of the valves' edges at their rated drop [m³/s], join commands, pump flows [m³/s]
# (the first one's on top of its line's leakage, where it runs), modules lent
PROGRAM = [
    (0.00, (10e-6, -7e-6, 3e-6), (0, 0, 0), (0, 0, 0, 0), (0, 0, 0, 0)),
    (0.05, (10e-6, -7e-6, 3e-6), (0, 0, 0), (4e-6, 0, 0, 2e-6), (0, 0, 0, 0)),
    (0.10, (7e-6, -7e-6, 3e-6), (1, 0, 0), (4e-6, 0, 2e-6, 4e-6), (0, 0, 1, 0)),
    (0.18, (8e-6, 7e-6, -7e-6), (0, 0, 0), (0, 0, 0, 0), (0, 0, 0, 0)),
]
END = 0.25


def commands(machine: Machine) -> list[tuple]:
    """The program in commands to this machine: valves' openings, pumps' flows [m³/s]."""
    valve = machine.config.hydraulics.valve
    return [
        (
            time,
            tuple(
                flow / (joint.actuator.rated_flow or valve.rated_flow)
                for flow, joint in zip(edges, machine.config.joints, strict=True)
            ),
            joins,
            (first + valve.leakage_flow if first > 0.0 else 0.0, *others),
            lent,
        )
        for time, edges, joins, (first, *others), lent in PROGRAM
    ]


def command(circuit: Circuit, row: tuple) -> None:
    _, valves, joins, flows, lent = row
    circuit.actuators["valve_command"] = valves
    circuit.actuators["join_command"] = joins
    circuit.modules["flow_command"] = flows
    circuit.modules["to_rail_command"] = lent


def run(machine: Machine, substep: float) -> tuple[FloatArray, Circuit]:
    """Pressures every millisecond, float64[times, nodes], and the circuit at the end."""
    circuit = build_circuit(machine, substep)
    set_rest_pressures(circuit, machine, START, MODES_N)
    length = machine.cylinder_lengths(START)
    substeps = round(1e-3 / substep)
    rows = commands(machine)
    pressures = []
    for k in range(round(END * 1e3)):
        command(circuit, [row for row in rows if row[0] <= k * 1e-3 + 1e-9][-1])
        for i in range(substeps):
            circuit.advance(length + SPEED * (k * 1e-3 + i * substep), SPEED, 1)
        pressures.append(circuit.pressure.copy())
    return np.array(pressures), circuit


class Oracle:
    """State: 11 pressures, then per actuator spool, its speed, join; per module flow, share."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.oil = machine.config.circuit
        self.length = machine.cylinder_lengths(START)
        ends = [
            machine.cylinder_lengths(q)
            for q in (machine.arrays.joint_min, machine.arrays.joint_max)
        ]
        self.shortest, self.longest = np.minimum(*ends), np.maximum(*ends)

    def orifice(self, k: float, drop: float) -> float:
        return k * drop / (drop**2 + self.oil.laminar_pressure**2) ** 0.25

    def air(self, pressure: FloatArray | float) -> FloatArray | float:
        """β (−dV/dp)/V of oil and air, by differences of V = (1 − α)(1 − p/β) + α (p₀/p)^(1/n)."""
        beta, air, pressure = self.oil.bulk_modulus, self.oil.free_air, np.maximum(pressure, 1.0)
        h = 1e-5 * pressure

        def volume(p):
            return 1.0 - p / beta + air / (1 - air) * (1.013e5 / p) ** (1 / 1.4)

        grown = volume(pressure - h) - volume(pressure + h)
        return beta * grown / (2 * h) / (volume(pressure) + pressure / beta)

    def rates(self, time: float, state: FloatArray, row: tuple) -> FloatArray:
        m, oil = self.machine.arrays, self.oil
        chambers, (rail, manifold) = state[:9].reshape(3, 3), state[9:11]
        spool, spool_speed, join = state[11:20].reshape(3, 3)
        flow, share = state[20:28].reshape(2, 4)
        _, valves, joins, flows, lent = row
        tank = m.tank_pressure
        k_check = oil.check_valve_flow / math.sqrt(oil.check_valve_pressure_drop)
        k_switch = oil.switching_valve_flow / math.sqrt(oil.switching_valve_pressure_drop)
        fill = oil.anti_cavitation_flow / oil.anti_cavitation_pressure_drop
        share_of_lands = self.machine.config.hydraulics.valve.land_leakage
        k_leak = (1 - share_of_lands) * m.leakage_flow / math.sqrt(m.supply_pressure - tank)
        land = share_of_lands * m.leakage_flow / (m.supply_pressure - tank)
        seal = oil.valves.get("piston_seal", {"leakage_flow": 0.0})["leakage_flow"] / 1e7
        q_chamber = np.zeros((3, 3))
        q_rail = -oil.rail_bleed_flow / 1e7 * (rail - tank)
        q_manifold = m.main_pump_flow * np.clip(
            (m.supply_pressure - manifold) / oil.main_pump_droop, 0.0, 1.0
        )
        q = self.orifice(k_check, max(0.0, manifold - rail))
        q_rail, q_manifold = q_rail + q, q_manifold - q
        for j, (a, b, line) in enumerate(chambers):
            config = self.machine.config
            valve, own = config.hydraulics.valve, config.joints[j].actuator
            k = (own.rated_flow or valve.rated_flow) * abs(spool[j])
            k /= math.sqrt(valve.rated_pressure_drop_per_land)
            if spool[j] >= 0:
                into_a, from_b = self.orifice(k, line - a), self.orifice(k, b - tank)
                q_chamber[j] += (into_a, -from_b, -into_a)
            else:
                into_b, from_a = self.orifice(k, line - b), self.orifice(k, a - tank)
                q_chamber[j] += (-from_a, into_b, -into_b)
            lap = self.machine.config.imperfections.valve_overlap
            one, other = (
                land * oil.land_length / (oil.land_length + max(0.0, lap + sign * spool[j]))
                for sign in (-1, 1)
            )
            q_chamber[j, 0] += one * (line - a) - other * (a - tank) - seal * (a - b)
            q_chamber[j, 1] += other * (line - b) - one * (b - tank) + seal * (a - b)
            q_chamber[j, 2] -= one * (line - a) + other * (line - b)
            q_chamber[j, 0] += fill * max(0.0, tank - a)
            q_chamber[j, 1] += fill * max(0.0, tank - b)
            q_chamber[j, 2] -= self.orifice(k_leak, line - tank)
            q = self.orifice(k_check, max(0.0, manifold - line))
            q_chamber[j, 2] += q
            q_manifold -= q
            q = self.orifice(k_switch * join[j], rail - line)
            q_chamber[j, 2] += q
            q_rail -= q
            q_chamber[j, 0] -= m.cap_area[j] * SPEED[j]
            q_chamber[j, 1] += m.rod_area[j] * SPEED[j]
        slip = self.machine.config.hydraulics.servo_pump.slip_flow / 1e7
        for k in range(4):
            to_rail = (flow[k] - slip * (rail - manifold)) * share[k]
            q_rail += to_rail
            q_manifold -= to_rail
            if k < 3:
                own = (flow[k] - slip * (chambers[k, 2] - manifold)) * (1 - share[k])
                q_chamber[k, 2] += own
                q_manifold -= own
        stroke = self.length + SPEED * time
        beta, dead = oil.bulk_modulus, oil.chamber_dead_volume
        volumes = np.stack(
            [
                dead + m.cap_area * (stroke - self.shortest),
                dead + m.rod_area * (self.longest - stroke),
                np.full(3, oil.line_volume),
            ],
            axis=1,
        )
        omega = 2 * math.pi * oil.valve_frequency
        q_chamber, q_rail, q_manifold = (
            flow / self.air(pressure)
            for flow, pressure in (
                (q_chamber, chambers),
                (q_rail, rail),
                (q_manifold, manifold),
            )
        )
        to_rail = np.array([*lent[:3], 1.0])
        wanted = (np.array(flows) - flow) / oil.servo_pump_lag
        return np.concatenate(
            [
                (q_chamber / volumes * beta).ravel(),
                [q_rail / oil.rail_volume * beta, q_manifold / oil.manifold_volume * beta],
                spool_speed,
                omega**2 * (np.array(valves) - spool) - 2 * oil.valve_damping * omega * spool_speed,
                (np.array(joins) - join) / oil.switching_valve_time,
                np.clip(wanted, -oil.servo_pump_slew, oil.servo_pump_slew),
                (to_rail - share) / oil.switching_valve_time,
            ]
        )


def oracle_run(machine: Machine) -> FloatArray:
    oracle = Oracle(machine)
    circuit = build_circuit(machine, 1e-3)
    set_rest_pressures(circuit, machine, START, MODES_N)
    state = np.zeros(28)
    state[:11] = circuit.pressure[:11]
    state[27] = 1.0
    times = (np.arange(round(END * 1e3)) + 1) * 1e-3
    pressures = []
    rows = commands(machine)
    ends = [row[0] for row in rows[1:]] + [END]
    scale = np.concatenate(
        [np.full(11, 1e6), np.ones(3), np.full(3, 100.0), np.ones(3), np.full(4, 1e-6), np.ones(4)]
    )
    for row, end in zip(rows, ends, strict=True):
        at = times[(times > row[0] + 1e-9) & (times <= end + 1e-9)]
        solution = solve_ivp(
            oracle.rates,
            (row[0], end),
            state,
            "Radau",
            at,
            args=(row,),
            rtol=1e-6,
            atol=1e-6 * scale,
        )
        assert solution.success
        pressures.append(solution.y[:11].T)
        state = solution.y[:, -1]
    return np.vstack(pressures)


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_pressures_agree_with_radau_with_valves_of_their_own(machine: Machine) -> None:
    own = machine.with_values(
        {"joints.0.actuator.rated_flow": 6e-5, "joints.2.actuator.rated_flow": 2e-4}
    )
    substep = own.config.simulation.step / own.config.simulation.circuit_substeps
    found, _ = run(own, substep)
    assert rms(found[:, :11] - oracle_run(own)) < 20e3


def test_pressures_agree_with_radau_and_converge_with_the_step(machine: Machine) -> None:
    exact = oracle_run(machine)
    substep = machine.config.simulation.step / machine.config.simulation.circuit_substeps
    coarse, _ = run(machine, substep)
    fine, _ = run(machine, substep / 4)
    assert exact[:, 2].max() > machine.arrays.supply_pressure + 1e6  # the run boosts
    assert rms(coarse[:, :11] - exact) < 20e3
    assert rms(fine[:, :11] - exact) < 0.4 * rms(coarse[:, :11] - exact)


def test_pressures_agree_with_radau_with_leaking_lands_and_seals(machine: Machine) -> None:
    leaky = machine.with_values(
        {
            "hydraulics.valve.land_leakage": 0.6,
            "circuit.valves": {"piston_seal": {"leakage_flow": 2e-6}},
        }
    )
    found, circuit = run(leaky, 2.5e-4)
    tight, _ = run(machine, 2.5e-4)
    exact = oracle_run(leaky)
    assert rms(found[:, :11] - exact) < 10e3
    assert rms(tight[:, :11] - exact) > 100e3
    assert circuit.energy["piston_seal"][0] > 0.0
    energy, oil = audited(circuit)
    assert abs(energy) < 1e-9 * circuit.energy["main_pump"][0]
    assert abs(oil) < 1e-9 * circuit.volume["main_pump"][0]


def test_pressures_agree_with_radau_with_slipping_pumps(machine: Machine) -> None:
    leaky = machine.with_values({"hydraulics.servo_pump.slip_flow": 4e-6})
    found, circuit = run(leaky, 2.5e-4)
    tight, _ = run(machine, 2.5e-4)
    exact = oracle_run(leaky)
    assert rms(found[:, :11] - exact) < 10e3
    assert rms(tight[:, :11] - exact) > 30e3
    energy, oil = audited(circuit)
    assert abs(energy) < 1e-9 * circuit.energy["main_pump"][0]
    assert abs(oil) < 1e-9 * circuit.volume["main_pump"][0]


def test_a_pump_against_a_shut_line_raises_it_until_all_its_oil_slips_back(
    machine: Machine,
) -> None:
    """Δp = (Q_t − q)/c and P = Δp Q_t/η_m, with the leakage q of the line's valve."""
    slip_flow, pumped = 2e-5, 6e-6
    slipping = machine.with_values({"hydraulics.servo_pump.slip_flow": slip_flow})
    circuit = build_circuit(slipping, 5e-4)
    length, m = slipping.cylinder_lengths(START), slipping.arrays
    circuit.modules["flow_command"][0] = pumped
    circuit.advance(length, np.zeros(3), 4000)
    before = circuit.energy[0].copy()
    circuit.advance(length, np.zeros(3), 2000)
    after, line = circuit.energy[0], circuit.pressure[2]
    leaked = m.leakage_flow * math.sqrt((line - m.tank_pressure) / (4e6 - m.tank_pressure))
    rise = (pumped - leaked) / (slip_flow / 1e7)
    assert line - circuit.manifold_pressure == pytest.approx(rise, rel=1e-3)
    assert circuit.modules["delivered"][0] == pytest.approx(leaked, rel=1e-3)
    shaft = after["servo_pumps"] - before["servo_pumps"]
    assert shaft == pytest.approx(rise * pumped / m.servo_pump_efficiency, rel=2e-2)
    lost = after["servo_pump_losses"] - before["servo_pump_losses"]
    assert shaft - lost == pytest.approx(rise * leaked, rel=2e-2)  # what the oil got
    energy, _ = audited(circuit)
    assert abs(energy) < 1e-9 * circuit.energy["main_pump"][0]


def test_a_pump_with_slip_gives_its_largest_flow_at_the_highest_boost_pressure(
    machine: Machine,
) -> None:
    slipping = machine.with_values({"hydraulics.servo_pump.slip_flow": 4e-6})
    c, m = build_circuit(slipping, 5e-4).constants[0], slipping.arrays
    slip = c["servo_pump_slip"] * (m.max_boost_pressure - m.supply_pressure)
    usual = m.servo_pump_flow + machine.config.circuit.servo_pump_flow_reserve
    assert c["servo_pump_flow"] - slip == pytest.approx(usual)


@pytest.mark.parametrize("step", [1e-4, 5e-4])
def test_the_swash_plate_follows_its_regulator_as_radau_says(machine: Machine, step: float) -> None:
    """C ṗ = Q − q, τ Q̇ = Q_max (p_set − p)/droop − Q: closed check valves, manifold alone."""
    lag, droop = 0.03, 4e5
    slow = machine.with_values(
        {
            "circuit.main_pump_time": lag,
            "circuit.main_pump_droop": droop,
            "hydraulics.valve.leakage_flow": 0.0,
        }
    )
    circuit, m, oil = build_circuit(slow, step), slow.arrays, slow.config.circuit
    set_rest_pressures(circuit, slow, START, MODES_N)
    circuit.pressure[:-2] = 6e6  # check valves stay shut
    circuit.pressure[-2], circuit.main_pump[0] = m.supply_pressure - 0.5 * droop, 0.0
    capacity = oil.manifold_volume / oil.bulk_modulus

    def rates(_: float, state: FloatArray) -> list[float]:
        flow, pressure = state
        goal = m.main_pump_flow * min(max((m.supply_pressure - pressure) / droop, 0.0), 1.0)
        return [(goal - flow) / lag, flow / capacity]

    times = np.arange(1, 41) * 5e-4
    start = (0.0, circuit.manifold_pressure)
    exact = solve_ivp(rates, (0.0, 0.02), start, "Radau", times, rtol=1e-8, atol=(1e-12, 1.0))
    found = []
    for _ in times:
        circuit.advance(slow.cylinder_lengths(START), np.zeros(3), round(5e-4 / step))
        found.append((circuit.main_pump[0], circuit.manifold_pressure))
    flow, pressure = np.array(found).T
    assert np.abs(flow - exact.y[0]).max() < 0.3 * step / 5e-4 * 1e-6
    assert np.abs(pressure - exact.y[1]).max() < 2e4 * step / 5e-4
    energy, volume = audited(circuit)
    assert abs(energy) < 1e-9 * circuit.energy["main_pump"][0]
    assert abs(volume) < 1e-9 * circuit.volume["main_pump"][0]


def test_a_swash_plate_without_inertia_delivers_what_its_regulator_demands(machine) -> None:
    """Off is the limit of a small time constant."""
    pressures = [
        run(machine.with_values({"circuit.main_pump_time": time}), 5e-4)[0] for time in (0.0, 1e-7)
    ]
    np.testing.assert_allclose(*pressures, rtol=2e-4)


def test_pressures_agree_with_radau_with_air_in_the_oil(machine: Machine) -> None:
    airy = machine.with_values({"circuit.free_air": 0.02})
    found, circuit = run(airy, 2.5e-4)
    clear, _ = run(machine, 2.5e-4)
    exact = oracle_run(airy)
    assert rms(found[:, :11] - exact) < 10e3
    assert rms(clear[:, :11] - exact) > 50e3
    energy, oil = audited(circuit)
    assert abs(energy) < 1e-9 * circuit.energy["main_pump"][0]
    assert abs(oil) < 1e-9 * circuit.volume["main_pump"][0]


def test_air_in_a_closed_chamber_is_squeezed_as_a_gas_with_its_oil(machine: Machine) -> None:
    """V(p) = V₀ [(1 − α)(1 − (p − p₀)/β) + α (p₀/p)^(1/n)] of oil and air, first order in p/β."""
    air, beta = 0.05, machine.config.circuit.bulk_modulus
    tight = {
        "circuit.free_air": air,
        "hydraulics.valve.leakage_flow": 0.0,
        "circuit.anti_cavitation_flow": 1e-10,
    }
    airy = machine.with_values(tight)
    circuit, length = build_circuit(airy, 1e-4), airy.cylinder_lengths(START)
    circuit.pressure[:-1] = 2e5
    cap, rod = machine.arrays.cap_area[0], circuit.cylinders["dead_volume"][0]
    stroke = length[0] - circuit.cylinders["min_length"][0]
    volume = rod + cap * stroke

    def mixed(p: float) -> float:
        return (1 - air) * (1 - (p - 1.013e5) / beta) + air * (1.013e5 / p) ** (1 / 1.4)

    speed = np.array([-0.01, 0.0, 0.0])
    for _ in range(1500):
        circuit.advance(length, speed, 1)
        length = length + speed * 1e-4
    squeezed = (volume - cap * 0.01 * 0.15) / volume
    assert mixed(circuit.pressure[0]) / mixed(2e5) == pytest.approx(squeezed, rel=2e-4)
    assert circuit.pressure[0] > 3e5


def test_energy_is_accounted_for_to_rounding(machine: Machine) -> None:
    _, circuit = run(machine, 5e-4)
    record = circuit.energy[0]
    energies = {name: float(record[name]) for name in record.dtype.names}
    assert energies["main_pump"] > 1.0
    assert energies["servo_pumps"] > 1.0
    assert abs(compute_energy_gap(energies)) < 1e-9 * energies["main_pump"]


def test_oil_is_accounted_for_to_rounding(machine: Machine) -> None:
    _, circuit = run(machine, 5e-4)
    record = circuit.volume[0]
    volumes = {name: float(record[name]) for name in record.dtype.names}
    assert volumes["main_pump"] > 1e-7
    made = (machine.arrays.cap_area - machine.arrays.rod_area) @ SPEED * END
    assert volumes["pistons"] == pytest.approx(made, rel=1e-9)
    assert abs(compute_volume_gap(volumes)) < 1e-9 * volumes["main_pump"]


def audited(circuit: Circuit) -> tuple[float, float]:
    """Energy [J] and oil [m³] that are unaccounted for, of what all pumps delivered."""
    energy, volume = circuit.energy[0], circuit.volume[0]
    energies = {name: float(energy[name]) for name in energy.dtype.names}
    volumes = {name: float(volume[name]) for name in volume.dtype.names}
    return compute_energy_gap(energies), compute_volume_gap(volumes)


def test_servo_pumps_with_a_dead_main_pump_run_dry_and_nothing_is_below_vapour_pressure(
    machine: Machine,
) -> None:
    circuit = build_circuit(machine, 5e-4)
    set_rest_pressures(circuit, machine, START, MODES_N)
    circuit.constants["main_pump_flow"] = 0.0
    circuit.modules["flow_command"] = 8e-6
    length, vapour = machine.cylinder_lengths(START), machine.config.circuit.vapour_pressure
    lowest = np.inf
    for _ in range(4000):
        circuit.advance(length, np.zeros(3), 1)
        lowest = min(lowest, circuit.pressure.min())
    assert lowest >= vapour
    assert circuit.manifold_pressure < machine.arrays.tank_pressure
    assert circuit.modules["flow"].min() > 7e-6  # they turn,
    assert circuit.modules["delivered"].max() < 0.01 * circuit.modules["flow"].max()  # dry
    energy, oil = audited(circuit)
    assert abs(energy) < 1e-9 * circuit.energy["servo_pumps"][0]
    assert abs(oil) < 1e-9 * abs(circuit.volume["compression"][0])


def test_a_chamber_that_is_torn_open_parts_and_closes_again_with_the_oil_that_came_back(
    machine: Machine,
) -> None:
    """Oracle: ∫ (anti-cavitation flow − A v) dt of one chamber by SciPy, its valve shut."""
    circuit = build_circuit(machine, 1e-4)
    set_rest_pressures(circuit, machine, START, MODES_N)
    m, oil = machine.arrays, machine.config.circuit
    length, speed = machine.cylinder_lengths(START), np.array([1.5, 0.0, 0.0])
    fill = oil.anti_cavitation_flow / oil.anti_cavitation_pressure_drop
    largest = fill * (m.tank_pressure - oil.vapour_pressure)
    assert m.cap_area[0] * speed[0] > 3.0 * largest  # more than can flow in
    circuit.pressure[1] = m.tank_pressure  # so that relief of the other side stays out of it
    circuit.advance(length, speed, 300)
    expected = (m.cap_area[0] * speed[0] - largest) * 0.03
    assert circuit.pressure[0] == oil.vapour_pressure
    assert circuit.cavity[0] == pytest.approx(expected, rel=0.02)
    lost = -circuit.cavity.sum()
    assert circuit.volume["cavities"][0] == pytest.approx(lost, rel=1e-9)
    circuit.advance(length, np.zeros(3), round(1.2 * expected / largest / 1e-4))
    assert circuit.cavity[0] == 0.0
    assert oil.vapour_pressure < circuit.pressure[0] <= m.tank_pressure
    energy, volume = audited(circuit)
    assert abs(energy) < 1e-9 * circuit.energy["relief_valves"][0]
    assert abs(volume) < 1e-9 * expected


def test_a_manifold_that_is_pressed_up_is_relieved(machine: Machine) -> None:
    circuit = build_circuit(machine, 5e-4)
    set_rest_pressures(circuit, machine, START, MODES_N)
    circuit.pressure[-2] = 8e6
    circuit.advance(machine.cylinder_lengths(START), np.zeros(3), 10)
    margin = machine.config.circuit.manifold_relief_margin
    opens = machine.arrays.supply_pressure + margin + machine.arrays.tank_pressure
    assert machine.arrays.supply_pressure < circuit.manifold_pressure < opens + 1e5
    assert circuit.energy["relief_valves"][0] > 0.0


def test_a_valve_hard_over_on_a_thrown_cylinder_stays_near_the_relief_setting(
    machine: Machine,
) -> None:
    circuit = build_circuit(machine, 5e-4)
    set_rest_pressures(circuit, machine, START, MODES_N)
    circuit.actuators["valve_command"][0] = 1.0
    setting = machine.config.circuit.chamber_relief_pressure
    rated = machine.config.hydraulics.valve.rated_flow
    speed = np.array([-rated / machine.arrays.cap_area[0], 0.0, 0.0])
    highest = 0.0
    for _ in range(200):  # the load drives the piston in against the pump
        circuit.advance(machine.cylinder_lengths(START), speed, 1)
        highest = max(highest, circuit.pressure[0])
    assert highest < 1.1 * setting


def test_an_actuator_has_friction_and_relief_of_its_own(machine: Machine) -> None:
    own = machine.with_values(
        {"joints.1.actuator.friction": 3.0, "joints.0.actuator.relief_pressure": 1.2e7}
    )
    speed, force = np.array([4e-3, 4e-3, -4e-3]), {}
    for name, each in (("usual", machine), ("own", own)):
        circuit = build_circuit(each, 5e-4)
        set_rest_pressures(circuit, each, START, MODES_N)
        circuit.advance(each.cylinder_lengths(START), speed, 1)
        force[name] = circuit.actuators["friction"].copy()
    assert force["own"] == pytest.approx([1.0, 3.0, 1.0] * force["usual"])
    usual = machine.config.circuit.chamber_relief_pressure
    assert circuit.actuators["relief"].tolist() == [1.2e7, usual, usual]


def test_a_valve_of_its_own_passes_what_it_is_rated_for_at_its_drop(machine: Machine) -> None:
    """Q = x Q_r √(Δp/Δp_r) over the inlet's edge as the spool opens to x, before pressures move."""
    own, dt = {"rated_flow": 2e-5, "rated_pressure_drop_per_land": 1e6}, 1e-5
    smaller = machine.with_values({"joints.1.actuator": own})
    valve, oil = machine.config.hydraulics.valve, machine.config.circuit
    flows = {}
    for name, each in (("usual", machine), ("smaller", smaller)):
        circuit = build_circuit(each, dt)
        set_rest_pressures(circuit, each, START, MODES_N)
        circuit.actuators["valve_command"] = 1.0
        for _ in range(50):
            before = circuit.pressure.copy()
            circuit.advance(each.cylinder_lengths(START), np.zeros(3), 1)
        rated = [(valve.rated_flow, valve.rated_pressure_drop_per_land)] * 3
        if name == "smaller":
            rated[1] = (own["rated_flow"], own["rated_pressure_drop_per_land"])
        flows[name] = circuit.actuators["supply_flow"].copy()
        for j, (flow, drop) in enumerate(rated):
            over, x = before[3 * j + 2] - before[3 * j], circuit.actuators["spool"][j]
            law = x * flow / math.sqrt(drop) * over / (over**2 + oil.laminar_pressure**2) ** 0.25
            assert flows[name][j] == pytest.approx(law, rel=1e-6)
    assert flows["smaller"][1] < 0.5 * flows["usual"][1]
    np.testing.assert_allclose(flows["smaller"][[0, 2]], flows["usual"][[0, 2]], rtol=1e-2)


def test_shaft_energies_are_kept_apart_from_what_the_oil_gets(machine: Machine) -> None:
    _, circuit = run(machine, 5e-4)
    record, oil = circuit.energy[0], machine.config.circuit
    energies = {name: float(record[name]) for name in record.dtype.names}
    source = sum_energy_by_source(energies)
    main, servo = source["main_pump"], source["servo_pumps"]
    expected = main["hydraulic"] / oil.main_pump_efficiency + oil.main_pump_drag_power * END
    assert main["shaft"] == pytest.approx(expected, rel=1e-9)
    efficiency = machine.arrays.servo_pump_efficiency
    assert servo["hydraulic"] == pytest.approx(efficiency * servo["shaft"], rel=0.02)


def test_pressures_at_rest_equal_statics_and_stay(machine: Machine) -> None:
    circuit = build_circuit(machine, 5e-4)
    for q in (START, np.array([0.9, -0.6, -0.5]), np.array([-0.7, -0.3, 0.1])):
        set_rest_pressures(circuit, machine, q, MODES_N)
        circuit.advance(machine.cylinder_lengths(q), np.zeros(3), 400)
        p = circuit.pressure
        force = machine.arrays.cap_area * p[0:9:3] - machine.arrays.rod_area * p[1:9:3]
        np.testing.assert_allclose(force, machine.piston_forces(q), rtol=1e-9)
        assert p[:9].min() >= machine.arrays.tank_pressure


def test_a_leaking_line_is_fed_steadily_and_lets_nothing_back(machine: Machine) -> None:
    circuit = build_circuit(machine, 5e-4)
    set_rest_pressures(circuit, machine, START, MODES_N)
    length, lines, losses = machine.cylinder_lengths(START), [], []
    for _ in range(400):
        circuit.advance(length, np.zeros(3), 1)
        lines.append(circuit.pressure[2:9:3].copy())
        losses.append(circuit.energy["check_valves"][0])
    assert np.ptp(lines[200:], axis=0).max() < 100.0
    assert np.all(np.diff(losses) > 0.0)


def test_settling_in_boost_puts_the_line_above_the_load(machine: Machine) -> None:
    circuit = build_circuit(machine, 5e-4)
    q = np.array([0.5, -0.3, -0.3])
    set_rest_pressures(circuit, machine, q, np.array([2, 1, 0], np.uint8))
    cap, line = circuit.pressure[0:9:3], circuit.pressure[2:9:3]
    assert np.all(line[:2] > cap[:2])
    assert np.all(line[:2] > machine.arrays.supply_pressure)
    assert circuit.rail_pressure == line[0]
    assert line[2] == machine.arrays.supply_pressure


def test_a_shut_line_is_relieved_and_the_pump_obeys_its_power(machine: Machine) -> None:
    circuit = build_circuit(machine, 5e-4)
    length = machine.cylinder_lengths(START)
    circuit.modules["flow_command"] = 1.0
    circuit.advance(length, np.zeros(3), 2000)
    setting = machine.config.circuit.line_relief_pressure
    lines = circuit.pressure[2:9:3]
    assert np.all(lines > setting)
    assert np.all(lines < setting + 1e6)
    power = circuit.modules["flow"] * (lines.max() - circuit.manifold_pressure)
    largest = machine.config.circuit.servo_pump_power * machine.arrays.servo_pump_efficiency
    assert np.all(power <= largest * 1.01)
    assert circuit.energy["relief_valves"][0] > 0.0


def test_an_emptied_chamber_is_filled_from_the_tank(machine: Machine) -> None:
    circuit = build_circuit(machine, 5e-4)
    set_rest_pressures(circuit, machine, START, MODES_N)
    speed = np.array([0.02, 0.0, 0.0])
    circuit.advance(machine.cylinder_lengths(START), speed, 1000)
    assert 0.0 < circuit.pressure[0] <= machine.arrays.tank_pressure
    assert circuit.energy["anti_cavitation"][0] > 0.0


def test_the_main_pump_sags_beyond_its_flow(machine: Machine) -> None:
    circuit = build_circuit(machine, 5e-4)
    set_rest_pressures(circuit, machine, START, MODES_N)
    speed = np.array([0.06, 0.06, 0.06])
    circuit.actuators["valve_command"] = 1.0
    circuit.advance(machine.cylinder_lengths(START), speed, 1000)
    assert circuit.manifold_pressure < 0.9 * machine.arrays.supply_pressure


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_any_number_of_actuators_and_modules_needs_no_code(machine: Machine, mode: int) -> None:
    content = machine.config.model_dump()
    content["joints"] = content["joints"][:2]
    content["simulation"]["start_posture"] = content["simulation"]["start_posture"][:2]
    content["workspace"]["max_radius"] = 0.85
    content["hydraulics"]["modules"]["count"] = 2
    smaller = Machine.from_config(type(machine.config).model_validate(content))
    circuit = build_circuit(smaller, 5e-4)
    q = START[:2]
    set_rest_pressures(circuit, smaller, q, np.array([mode, 0], np.uint8))
    circuit.advance(smaller.cylinder_lengths(q), np.zeros(2), 200)
    assert circuit.pressure.shape == (9,)
    assert np.all(np.isfinite(circuit.pressure))
