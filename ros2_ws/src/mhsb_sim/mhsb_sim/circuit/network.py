"""The hydraulic circuit, assembled from the machine for any number of actuators and modules.

Nodes, in this order: p_A, p_B, p_line of each actuator; the shared rail; the main pump's
manifold; the tank (constant). Between them:

    main pump → manifold                     constant-pressure pump with a flow limit
    manifold → each line, manifold → rail    check valves
    manifold → own line or rail              servo pump of each module, through its diverter
    rail ↔ each line                         join valve
    line, p_A, p_B, tank                     servo valve: four metering edges, one spool
    line → tank                              the servo valve's leakage
    each line, rail, p_A, p_B → tank         relief valves
    tank → p_A, tank → p_B                   anti-cavitation valves
    rail → tank                              bleed

Module j feeds actuator j's line directly, or the rail when it is lent; modules beyond the
actuators feed the rail. An actuator in SB has its join valve open.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mhsb_model.hydraulics import required_pressure
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED, ON_RAIL
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_sim.bound_kernel import bind
from mhsb_sim.circuit.elements import (
    chamber_capacity,
    check_valve,
    constant_pressure_pump,
    first_order_lag,
    friction_force,
    orifice,
    relief_valve,
    servo_pump_flow,
    spool_transition,
)
from mhsb_sim.circuit.nodal_analysis import solve_in_place, stamp
from mhsb_sim.records import Record, Records

RATED_BLEED_PRESSURE = 1e7

CYLINDER = np.dtype(
    [
        ("cap_area", "f8"),  # m²
        ("rod_area", "f8"),  # m²
        ("min_length", "f8"),  # m, at one joint limit
        ("max_length", "f8"),  # m, at the other
    ]
)

CONSTANTS = np.dtype(
    [
        (name, "f8")
        for name in (
            "tank_pressure",  # Pa
            "supply_pressure",  # Pa
            "main_pump_flow",  # m³/s
            "main_pump_droop",  # Pa
            "bulk_modulus",  # Pa
            "dead_volume",  # m³
            "line_capacity",  # m³/Pa
            "rail_capacity",  # m³/Pa
            "manifold_capacity",  # m³/Pa
            "laminar_pressure",  # Pa
            "valve_coefficient",  # m³/(s √Pa), one edge fully open; likewise below
            "leakage_coefficient",
            "check_coefficient",
            "switching_coefficient",
            "bleed_conductance",  # m³/(s Pa), likewise both below
            "anti_cavitation_gain",
            "relief_gain",
            "line_relief",  # Pa
            "servo_pump_flow",  # m³/s, the most one pump gives
            "servo_pump_lag",  # s
            "servo_pump_slew",  # m³/s²
            "servo_pump_power",  # W
            "servo_pump_efficiency",
            "switching_time",  # s
            "coulomb_friction",  # N
            "viscous_friction",  # N s/m
            "friction_speed",  # m/s
            "substep",  # s
            "spool_00",  # transition of the spool over one substep
            "spool_01",
            "spool_10",
            "spool_11",
        )
    ]
)

ACTUATOR = np.dtype(
    [
        ("valve_command", "f8"),  # −1 … 1, positive extends
        ("join_command", "f8"),  # 0 … 1, opening of the join valve
        ("spool", "f8"),
        ("spool_speed", "f8"),  # 1/s
        ("join", "f8"),
        ("relief", "f8"),  # Pa, setting of the relief valves of its chambers
        ("force", "f8"),  # N, p_A A − p_B a
        ("friction", "f8"),  # N
        ("supply_flow", "f8"),  # m³/s, line to chambers
        ("return_flow", "f8"),  # m³/s, chambers to tank
    ]
)

MODULE = np.dtype(
    [
        ("flow_command", "f8"),  # m³/s
        ("lend", "f8"),  # 1 where the module is to feed the rail
        ("flow", "f8"),  # m³/s, displacement times speed
        ("to_rail", "f8"),  # share of the flow that the diverter sends to the rail
    ]
)

ENERGY = np.dtype(
    [
        (name, "f8")
        for name in (  # all in J since the start
            "main_pump",
            "servo_pumps",
            "servo_pump_losses",
            "piston_work",
            "compression",
            "servo_valves",
            "leakage",
            "check_valves",
            "join_valves",
            "relief_valves",
            "anti_cavitation",
            "bleed",
            "return_oil",
            "friction",  # within piston_work, not beside it
        )
    ]
)

VOLUME = np.dtype(
    [
        (name, "f8")
        for name in (  # all in m³ since the start
            "main_pump",  # delivered
            "returned",  # to the tank, less what was drawn from it
            "pistons",  # room that the pistons have made
            "compression",  # ∫ C dp of all nodes
        )
    ]
)

(SERVO_VALVE, LEAKAGE, CHECK, JOIN, SERVO_PUMP, RELIEF, ANTI_CAVITATION, BLEED) = range(8)

ELEMENT = np.dtype(
    [
        ("kind", "i8"),  # one of those above
        ("start", "i8"),  # node
        ("end", "i8"),  # node
        ("flow", "f8"),  # m³/s, from start to end
        ("slope", "f8"),  # m³/(s Pa), by the pressure drop
    ]
)


class Circuit(NamedTuple):
    """State of the circuit; `advance` writes into its arrays."""

    cylinders: Records  # CYLINDER[n]
    constants: Records  # CONSTANTS[1]
    module_home: IntArray  # [m] actuator whose line the module feeds, −1 where it has none
    pressure: FloatArray  # [3 n + 3] Pa, in the order of the nodes
    actuators: Records  # ACTUATOR[n]
    modules: Records  # MODULE[m]
    energy: Records  # ENERGY[1]
    volume: Records  # VOLUME[1]
    net: Records  # ELEMENT[…], this and the following are working memory
    conductance: FloatArray  # [nodes, nodes]
    inflow: FloatArray  # [nodes]
    capacity: FloatArray  # [nodes]

    def advance(self, length: FloatArray, speed: FloatArray, substeps: int) -> None:
        """Advance by `substeps` substeps with pistons at `length` [m] moving at `speed` [m/s]."""
        advance(self, length, speed, substeps)

    def bound_advance(self, length: FloatArray, speed: FloatArray) -> Callable[[int], None]:
        """`advance` for pistons whose lengths and speeds are written into these arrays."""
        return bind(advance, self, length, speed, integers=1)

    @property
    def rail_pressure(self) -> float:
        """Pressure of the shared rail [Pa]."""
        return float(self.pressure[-3])

    @property
    def manifold_pressure(self) -> float:
        """Pressure behind the main pump [Pa]."""
        return float(self.pressure[-2])


def build_circuit(machine: Machine, substep: float) -> Circuit:
    """Circuit of a machine with everything at supply pressure and closed; substep in s."""
    arrays = machine.arrays
    actuator_count, module_count = machine.joint_count, arrays.module_count
    nodes = 3 * actuator_count + 3
    home = np.arange(module_count, dtype=np.int64)
    home[home >= actuator_count] = -1
    pressure = np.full(nodes, arrays.supply_pressure)
    pressure[-1] = arrays.tank_pressure
    actuators = np.zeros(actuator_count, ACTUATOR)
    actuators["relief"] = machine.config.circuit.chamber_relief_pressure
    return Circuit(
        cylinders=_cylinders(machine),
        constants=_constants(machine, substep),
        module_home=home,
        pressure=pressure,
        actuators=actuators,
        modules=_modules(home),
        energy=np.zeros(1, ENERGY),
        volume=np.zeros(1, VOLUME),
        net=np.zeros(3 + 2 * module_count + 10 * actuator_count, ELEMENT),
        conductance=np.zeros((nodes, nodes)),
        inflow=np.zeros(nodes),
        capacity=np.zeros(nodes),
    )


def settle(circuit: Circuit, machine: Machine, q: FloatArray, modes: ModeArray) -> None:
    """Set the pressures in which the arm rests at q [rad] in `modes`, valves closed.

    p_A A − p_B a = F with p_A + p_B = p_line + p_T, as a symmetric valve about its centre makes
    it, and neither chamber below the tank's pressure. Lines are at P_S, or where boosted at what
    holds the load.
    """
    m = machine.arrays
    force = machine.piston_forces(q)
    pressure = circuit.pressure
    pressure[-3] = pressure[-2] = m.supply_pressure
    for j in range(machine.joint_count):
        cap, rod = m.cap_area[j], m.rod_area[j]
        line = m.supply_pressure
        if BOOSTED[modes[j]]:
            line = max(line, required_pressure(m, j, force[j], 0.0))
        if ON_RAIL[modes[j]]:
            pressure[-3] = max(pressure[-3], line)
        total = line + m.tank_pressure
        cap_pressure = (force[j] + rod * total) / (cap + rod)
        emptied = (force[j] + rod * m.tank_pressure) / cap
        cap_pressure = max(cap_pressure, emptied, m.tank_pressure)
        pressure[3 * j] = cap_pressure
        pressure[3 * j + 1] = (cap_pressure * cap - force[j]) / rod
        pressure[3 * j + 2] = line
    circuit.actuators["force"] = force
    circuit.actuators["join"] = ON_RAIL[modes]


@kernel(inline="always")
def enter(
    net: Records, count: int, kind: int, start: int, end: int, flow: float, slope: float
) -> int:
    """Add an element to the net of this substep, if anything flows in it; returns their number."""
    if flow == 0.0 and slope == 0.0:
        return count
    element = net[count]
    element.kind, element.start, element.end = kind, start, end
    element.flow, element.slope = flow, slope
    return count + 1


@kernel
def move_spool(actuator: Record, c: Record) -> None:
    """ẍ + 2 ζ ω ẋ + ω² (x − u) = 0 over one substep, x within −1 … 1 (c: CONSTANTS)."""
    away = actuator.spool - actuator.valve_command
    rate = actuator.spool_speed
    spool = actuator.valve_command + c.spool_00 * away + c.spool_01 * rate
    actuator.spool_speed = c.spool_10 * away + c.spool_11 * rate
    actuator.spool = min(max(spool, -1.0), 1.0)
    if spool != actuator.spool:
        actuator.spool_speed = 0.0


@kernel
def audit(
    net: Records,
    count: int,
    pressure: FloatArray,
    change: FloatArray,
    tank: int,
    efficiency: float,
    dt: float,
    e: Record,
    volume: Record,
) -> None:
    """Add the energy that each element turned over in a substep to its counter [J].

    With the mean flow and the mean pressures of the step, as the implicit scheme has it, so that
    power in = power out holds node by node (Tellegen's theorem). Oil to and from the tank is
    counted too [m³]. change: Δp [Pa] of the step.
    """
    for k in range(count):
        element = net[k]
        i, j = element.start, element.end
        flow = element.flow + element.slope * (change[i] - change[j])
        drop = pressure[i] - pressure[j] + 0.5 * (change[i] - change[j])
        work = flow * drop * dt
        if element.kind == SERVO_VALVE:
            e.servo_valves += work
        elif element.kind == LEAKAGE:
            e.leakage += work
        elif element.kind == CHECK:
            e.check_valves += work
        elif element.kind == JOIN:
            e.join_valves += work
        elif element.kind == SERVO_PUMP:
            shaft = max(0.0, -work) / efficiency
            e.servo_pumps += shaft
            e.servo_pump_losses += shaft + work
        elif element.kind == RELIEF:
            e.relief_valves += work
        elif element.kind == ANTI_CAVITATION:
            e.anti_cavitation += work
        else:
            e.bleed += work
        if j == tank or i == tank:
            returned = flow * dt if j == tank else -flow * dt
            e.return_oil += returned * pressure[tank]
            volume.returned += returned


@kernel
def advance(circuit: Circuit, length: FloatArray, speed: FloatArray, substeps: int) -> None:
    """Advance the circuit in place, pistons at length[n] [m] moving at speed[n] [m/s].

    Each substep moves the valves and pumps, enters every element at the present pressures and
    solves for the pressures after it. Oracle: SciPy's Radau on the same equations
    (test/circuit/test_network.py).
    """
    cylinders, actuators, pressure = circuit.cylinders, circuit.actuators, circuit.pressure
    modules, module_home = circuit.modules, circuit.module_home
    net, conductance = circuit.net, circuit.conductance
    inflow, capacity = circuit.inflow, circuit.capacity
    c, e, v = circuit.constants[0], circuit.energy[0], circuit.volume[0]
    n = len(actuators)
    rail, manifold, tank = 3 * n, 3 * n + 1, 3 * n + 2
    dt = c.substep
    laminar = c.laminar_pressure
    pump_decay = math.exp(-dt / c.servo_pump_lag)
    switch_decay = math.exp(-dt / c.switching_time)
    pump_change = c.servo_pump_slew * dt
    capacity[rail], capacity[manifold] = c.rail_capacity, c.manifold_capacity
    for _ in range(substeps):
        inflow[:] = 0.0
        conductance[:, :] = 0.0
        count = 0

        pump_flow, pump_slope = constant_pressure_pump(
            c.main_pump_flow, c.supply_pressure, c.main_pump_droop, pressure[manifold]
        )
        inflow[manifold] += pump_flow
        conductance[manifold, manifold] += pump_slope

        drop = pressure[manifold] - pressure[rail]
        flow, slope = check_valve(c.check_coefficient, drop, laminar)
        count = enter(net, count, CHECK, manifold, rail, flow, slope)
        drop = pressure[rail] - pressure[tank]
        flow = c.bleed_conductance * drop
        count = enter(net, count, BLEED, rail, tank, flow, c.bleed_conductance)
        flow, slope = relief_valve(c.relief_gain, drop, c.line_relief)
        count = enter(net, count, RELIEF, rail, tank, flow, slope)

        for k in range(len(modules)):
            module = modules[k]
            home = 3 * module_home[k] + 2 if module_home[k] >= 0 else rail
            goal = module.lend if module_home[k] >= 0 else 1.0
            module.to_rail = first_order_lag(module.to_rail, goal, switch_decay)
            outlet = pressure[home] + module.to_rail * (pressure[rail] - pressure[home])
            boost = max(0.0, outlet - pressure[manifold])
            largest = c.servo_pump_flow
            if boost * largest > c.servo_pump_efficiency * c.servo_pump_power:
                largest = c.servo_pump_efficiency * c.servo_pump_power / boost
            module.flow = servo_pump_flow(
                module.flow, module.flow_command, largest, pump_decay, pump_change
            )
            to_rail = module.flow * module.to_rail
            count = enter(net, count, SERVO_PUMP, manifold, rail, to_rail, 0.0)
            count = enter(net, count, SERVO_PUMP, manifold, home, module.flow - to_rail, 0.0)

        for j in range(n):
            a, b, line = 3 * j, 3 * j + 1, 3 * j + 2
            actuator = actuators[j]
            cylinder = cylinders[j]
            move_spool(actuator, c)
            actuator.join = first_order_lag(actuator.join, actuator.join_command, switch_decay)

            # The servo valve: line to one chamber, the other chamber to tank.
            fed, emptied = (a, b) if actuator.spool >= 0.0 else (b, a)
            k_edge = c.valve_coefficient * abs(actuator.spool)
            flow, slope = orifice(k_edge, pressure[line] - pressure[fed], laminar)
            count = enter(net, count, SERVO_VALVE, line, fed, flow, slope)
            actuator.supply_flow = flow
            flow, slope = orifice(k_edge, pressure[emptied] - pressure[tank], laminar)
            count = enter(net, count, SERVO_VALVE, emptied, tank, flow, slope)
            actuator.return_flow = flow

            drop = pressure[line] - pressure[tank]
            flow, slope = orifice(c.leakage_coefficient, drop, laminar)
            count = enter(net, count, LEAKAGE, line, tank, flow, slope)
            flow, slope = relief_valve(c.relief_gain, drop, c.line_relief)
            count = enter(net, count, RELIEF, line, tank, flow, slope)
            drop = pressure[manifold] - pressure[line]
            flow, slope = check_valve(c.check_coefficient, drop, laminar)
            count = enter(net, count, CHECK, manifold, line, flow, slope)
            drop = pressure[rail] - pressure[line]
            flow, slope = orifice(c.switching_coefficient * actuator.join, drop, laminar)
            count = enter(net, count, JOIN, rail, line, flow, slope)
            for chamber in (a, b):
                drop = pressure[chamber] - pressure[tank]
                flow, slope = relief_valve(c.relief_gain, drop, actuator.relief)
                count = enter(net, count, RELIEF, chamber, tank, flow, slope)
                flow, slope = relief_valve(c.anti_cavitation_gain, -drop, 0.0)
                count = enter(net, count, ANTI_CAVITATION, tank, chamber, flow, slope)

            inflow[a] -= cylinder.cap_area * speed[j]
            inflow[b] += cylinder.rod_area * speed[j]
            capacity[a] = chamber_capacity(
                c.dead_volume, cylinder.cap_area, length[j] - cylinder.min_length, c.bulk_modulus
            )
            capacity[b] = chamber_capacity(
                c.dead_volume, cylinder.rod_area, cylinder.max_length - length[j], c.bulk_modulus
            )
            capacity[line] = c.line_capacity

        for k in range(count):
            element = net[k]
            stamp(inflow, conductance, element.start, element.end, element.flow, element.slope)
        for i in range(tank):
            conductance[i, i] += capacity[i] / dt
        solve_in_place(conductance, inflow, tank)
        inflow[tank] = 0.0
        mean_flow = pump_flow - pump_slope * inflow[manifold]
        e.main_pump += mean_flow * (pressure[manifold] + 0.5 * inflow[manifold]) * dt
        v.main_pump += mean_flow * dt
        audit(net, count, pressure, inflow, tank, c.servo_pump_efficiency, dt, e, v)
        for j in range(n):
            force = cylinders[j].cap_area * (pressure[3 * j] + 0.5 * inflow[3 * j])
            force -= cylinders[j].rod_area * (pressure[3 * j + 1] + 0.5 * inflow[3 * j + 1])
            e.piston_work += force * speed[j] * dt
            v.pistons += (cylinders[j].cap_area - cylinders[j].rod_area) * speed[j] * dt
        for i in range(tank):
            e.compression += capacity[i] * inflow[i] * (pressure[i] + 0.5 * inflow[i])
            v.compression += capacity[i] * inflow[i]
            pressure[i] += inflow[i]

    for j in range(n):
        actuator = actuators[j]
        cylinder = cylinders[j]
        actuator.friction = friction_force(
            c.coulomb_friction, c.viscous_friction, c.friction_speed, speed[j]
        )
        e.friction += actuator.friction * speed[j] * dt * substeps
        actuator.force = (
            cylinder.cap_area * pressure[3 * j] - cylinder.rod_area * pressure[3 * j + 1]
        )


def _cylinders(machine: Machine) -> Records:
    arrays = machine.arrays
    cylinders = np.zeros(machine.joint_count, CYLINDER)
    cylinders["cap_area"] = arrays.cap_area
    cylinders["rod_area"] = arrays.rod_area
    for j in range(machine.joint_count):
        ends = [
            cylinder_length(arrays.linkage[j], q)
            for q in (arrays.joint_min[j], arrays.joint_max[j])
        ]
        cylinders[j]["min_length"], cylinders[j]["max_length"] = min(ends), max(ends)
    return cylinders


def _modules(home: IntArray) -> Records:
    modules = np.zeros(len(home), MODULE)
    modules["to_rail"] = home < 0
    return modules


def _constants(machine: Machine, substep: float) -> Records:
    arrays = machine.arrays
    oil = machine.config.circuit
    beta = oil.bulk_modulus
    spool = spool_transition(oil.valve_frequency, oil.valve_damping, substep)
    values = {
        "tank_pressure": arrays.tank_pressure,
        "supply_pressure": arrays.supply_pressure,
        "main_pump_flow": arrays.main_pump_flow,
        "main_pump_droop": oil.main_pump_droop,
        "bulk_modulus": beta,
        "dead_volume": oil.chamber_dead_volume,
        "line_capacity": oil.line_volume / beta,
        "rail_capacity": oil.rail_volume / beta,
        "manifold_capacity": oil.manifold_volume / beta,
        "laminar_pressure": oil.laminar_pressure,
        "valve_coefficient": arrays.valve_coefficient,
        "leakage_coefficient": arrays.leakage_flow
        / math.sqrt(arrays.supply_pressure - arrays.tank_pressure),
        "check_coefficient": oil.check_valve_flow / math.sqrt(oil.check_valve_pressure_drop),
        "switching_coefficient": oil.switching_valve_flow
        / math.sqrt(oil.switching_valve_pressure_drop),
        "anti_cavitation_gain": oil.anti_cavitation_flow / oil.anti_cavitation_pressure_drop,
        "bleed_conductance": oil.rail_bleed_flow / RATED_BLEED_PRESSURE,
        "relief_gain": oil.relief_flow_gain,
        "line_relief": oil.line_relief_pressure,
        "servo_pump_flow": arrays.servo_pump_flow + oil.servo_pump_flow_reserve,
        "servo_pump_lag": oil.servo_pump_lag,
        "servo_pump_slew": oil.servo_pump_slew,
        "servo_pump_power": oil.servo_pump_power,
        "servo_pump_efficiency": arrays.servo_pump_efficiency,
        "switching_time": oil.switching_valve_time,
        "coulomb_friction": oil.coulomb_friction,
        "viscous_friction": oil.viscous_friction,
        "friction_speed": oil.friction_speed,
        "substep": substep,
        "spool_00": spool[0],
        "spool_01": spool[1],
        "spool_10": spool[2],
        "spool_11": spool[3],
    }
    constants = np.zeros(1, CONSTANTS)
    for name, value in values.items():
        constants[name] = value
    return constants
