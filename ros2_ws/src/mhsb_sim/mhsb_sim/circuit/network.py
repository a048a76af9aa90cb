"""The hydraulic circuit, assembled from the machine for any number of actuators and modules.

Nodes, in this order: p_A, p_B, p_line of each actuator; the shared rail; the main pump's
manifold; the tank (constant). Between them:

    main pump → manifold                     constant-pressure pump with a flow limit
    manifold → each line, manifold → rail    check valves
    manifold → own line or rail              servo pump of each module, through its diverter
    rail ↔ each line                         join valve
    line, p_A, p_B, tank                     servo valve: four metering edges, one spool, and
                                             isolating valves between them and the chambers
    line → tank                              the servo valve's leakage
    manifold, each line, rail, p_A, p_B → tank    relief valves
    tank → p_A, tank → p_B                   anti-cavitation valves
    rail → tank                              bleed

Module j feeds actuator j's line directly, or the rail when it is lent; modules beyond the
actuators feed the rail. An actuator in SB has its join valve open.
Nowhere does pressure fall below the oil's vapour pressure: the oil parts there, vapour takes the
room until oil has come back, and servo pumps deliver what their inlet fills them with.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.hydraulics import required_pressure
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED, ON_RAIL
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_sim.circuit.audit import audit, audit_drag, audit_main_pump, audit_node
from mhsb_sim.circuit.constants import actuators_of, constants_of, cylinders_of, modules_of
from mhsb_sim.circuit.elements import (
    accumulator_capacity,
    bristle_bend,
    chamber_volumes,
    check_valve,
    constant_pressure_pump,
    first_order_lag,
    friction_force,
    metered_opening,
    orifice,
    play,
    pressure_and_cavity,
    pump_filling,
    relief_valve,
    servo_pump_flow,
    sliding_friction,
)
from mhsb_sim.circuit.nodal_analysis import solve_in_place, stamp
from mhsb_sim.circuit.quantities import (
    ANTI_CAVITATION,
    BLEED,
    CHECK,
    ELEMENT,
    ENERGY,
    JOIN,
    LEAKAGE,
    RELIEF,
    SERVO_PUMP,
    SERVO_VALVE,
    VOLUME,
)
from mhsb_sim.records import Record, Records

RIGID = 1e6
"""By which a node at vapour pressure is taken to be stiffer, so that its pressure stays."""

REFILLING = 2.0
"""Times the oil that is coming in a substep: a cavity that is smaller may fill in it."""


class Circuit(NamedTuple):
    """State of the circuit; `advance` writes into its arrays."""

    cylinders: Records  # CYLINDER[n]
    constants: Records  # CONSTANTS[1]
    module_home: IntArray  # [m] actuator whose line the module feeds, −1 where it has none
    pressure: FloatArray  # [3 n + 3] Pa, in the order of the nodes
    cavity: FloatArray  # [3 n + 3] m³ of vapour at each node
    actuators: Records  # ACTUATOR[n]
    modules: Records  # MODULE[m]
    energy: Records  # ENERGY[1]
    volume: Records  # VOLUME[1]
    net: Records  # ELEMENT[…], this and the following are working memory
    conductance: FloatArray  # [nodes, nodes]
    nodes: FloatArray  # [3, nodes]: inflow, C, and C as the step takes it

    def advance(self, length: FloatArray, speed: FloatArray, substeps: int) -> None:
        """Advance by `substeps` substeps with pistons at `length` [m] moving at `speed` [m/s]."""
        advance(self, length, speed, substeps)

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
    return Circuit(
        cylinders=cylinders_of(machine),
        constants=constants_of(machine, substep),
        module_home=home,
        pressure=pressure,
        cavity=np.zeros(nodes),
        actuators=actuators_of(machine),
        modules=modules_of(home),
        energy=np.zeros(1, ENERGY),
        volume=np.zeros(1, VOLUME),
        net=np.zeros(4 + 2 * module_count + 10 * actuator_count, ELEMENT),
        conductance=np.zeros((nodes, nodes)),
        nodes=np.zeros((3, nodes)),
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
    circuit.cavity[:] = 0.0
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
    """ẍ + 2 ζ ω ẋ + ω² (x − u) = 0 over one substep, x within −1 … 1 (c: CONSTANTS).

    u is the command beyond the hysteresis, and |ẋ| stays within the spool's rate.
    """
    if actuator.seized > 0.0:
        actuator.spool_speed = 0.0
        return
    told = actuator.valve_command if actuator.obeys > 0.0 else actuator.runaway
    actuator.pilot = play(actuator.pilot, told, c.valve_hysteresis)
    before = actuator.spool
    away, rate = before - actuator.pilot, actuator.spool_speed
    spool = actuator.pilot + c.spool_00 * away + c.spool_01 * rate
    actuator.spool_speed = c.spool_10 * away + c.spool_11 * rate
    way = c.spool_rate * c.substep
    if abs(spool - before) > way:
        spool = before + math.copysign(way, spool - before)
        actuator.spool_speed = math.copysign(c.spool_rate, spool - before)
    actuator.spool = min(max(spool, -1.0), 1.0)
    if spool != actuator.spool:
        actuator.spool_speed = 0.0


@kernel
def rub(actuator: Record, speed: float, share: float, c: Record, dt: float) -> None:
    """Friction of a cylinder after dt [s] at `speed` [m/s]: with bristles where there are any.

    F = σ₀ z + σ₁ ż + b v (LuGre), else as `friction_force` (c: CONSTANTS), times its own share.
    """
    if c.bristle_stiffness == 0.0:
        actuator.friction = share * friction_force(
            c.coulomb_friction, c.viscous_friction, c.friction_speed, speed
        )
        return
    sliding = sliding_friction(c.coulomb_friction, c.breakaway, c.stribeck_speed, speed)
    before = actuator.bend
    actuator.bend = bristle_bend(before, speed, sliding, c.bristle_stiffness, dt)
    bending = (actuator.bend - before) / dt
    actuator.friction = share * (
        c.bristle_stiffness * actuator.bend
        + c.bristle_damping * bending
        + c.viscous_friction * speed
    )


@kernel(borrows=True)
def advance(circuit: Circuit, length: FloatArray, speed: FloatArray, substeps: int) -> None:
    """Advance the circuit in place, pistons at length[n] [m] moving at speed[n] [m/s].

    Each substep moves the valves and pumps, enters every element at the present pressures and
    solves for the pressures after it. Oracle: SciPy's Radau on the same equations
    (test/circuit/test_network.py).
    """
    cylinders, actuators, pressure = circuit.cylinders, circuit.actuators, circuit.pressure
    modules, module_home = circuit.modules, circuit.module_home
    net, conductance, cavity = circuit.net, circuit.conductance, circuit.cavity
    inflow, capacity, stiffness = circuit.nodes[0], circuit.nodes[1], circuit.nodes[2]
    c, e, v = circuit.constants[0], circuit.energy[0], circuit.volume[0]
    n = len(actuators)
    rail, manifold, tank = 3 * n, 3 * n + 1, 3 * n + 2
    dt = c.substep
    laminar = c.laminar_pressure
    pump_decay, switch_decay = c.servo_pump_decay, c.switching_decay
    pump_change = c.servo_pump_slew * dt
    capacity[rail], capacity[manifold] = c.rail_capacity, c.manifold_capacity
    for _ in range(substeps):
        if c.accumulator_volume > 0.0:
            capacity[manifold] = c.manifold_capacity + accumulator_capacity(
                pressure[manifold],
                c.accumulator_volume,
                c.accumulator_precharge,
                c.accumulator_exponent,
            )
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
        drop = pressure[manifold] - pressure[tank]
        flow, slope = relief_valve(c.relief_gain, drop, c.manifold_relief)
        count = enter(net, count, RELIEF, manifold, tank, flow, slope)

        filled, filling = pump_filling(pressure[manifold], c.vapour_pressure, c.pump_filling)
        for k in range(len(modules)):
            module = modules[k]
            home = 3 * module_home[k] + 2 if module_home[k] >= 0 else rail
            goal = module.lend if module_home[k] >= 0 else 1.0
            module.to_rail = first_order_lag(module.to_rail, goal, switch_decay)
            outlet = pressure[home] + module.to_rail * (pressure[rail] - pressure[home])
            boost = max(0.0, outlet - pressure[manifold])
            largest = module.strength * c.servo_pump_flow
            if boost * largest > c.servo_pump_efficiency * c.servo_pump_power:
                largest = c.servo_pump_efficiency * c.servo_pump_power / boost
            told = largest if module.runs_on > 0.0 else module.flow_command
            decay = pump_decay
            if module.slowness != 1.0:
                decay = pump_decay ** (1.0 / module.slowness)
            module.flow = servo_pump_flow(module.flow, told, largest, decay, pump_change)
            module.delivered = filled * module.flow
            to_rail, slope = module.delivered * module.to_rail, filling * module.flow
            count = enter(
                net, count, SERVO_PUMP, manifold, rail, to_rail, slope * module.to_rail
            )
            count = enter(
                net,
                count,
                SERVO_PUMP,
                manifold,
                home,
                module.delivered - to_rail,
                slope * (1.0 - module.to_rail),
            )

        for j in range(n):
            a, b, line = 3 * j, 3 * j + 1, 3 * j + 2
            actuator = actuators[j]
            cylinder = cylinders[j]
            move_spool(actuator, c)
            actuator.join = first_order_lag(actuator.join, actuator.join_command, switch_decay)

            # The servo valve: line to one chamber, the other chamber to tank.
            opening = metered_opening(actuator.spool, c.valve_overlap)
            fed, emptied = (a, b) if opening >= 0.0 else (b, a)
            actuator.isolated = first_order_lag(
                actuator.isolated, actuator.isolating_command, switch_decay
            )
            k_edge = cylinder.valve_coefficient * abs(opening) * (1.0 - actuator.isolated)
            flow, slope = orifice(k_edge, pressure[line] - pressure[fed], laminar)
            count = enter(net, count, SERVO_VALVE, line, fed, flow, slope)
            actuator.supply_flow = flow
            flow, slope = orifice(k_edge, pressure[emptied] - pressure[tank], laminar)
            count = enter(net, count, SERVO_VALVE, emptied, tank, flow, slope)
            actuator.return_flow = flow

            drop = pressure[line] - pressure[tank]
            flow, slope = orifice(actuator.leakage * c.leakage_coefficient, drop, laminar)
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
            cap_room, rod_room = chamber_volumes(cylinder, length[j])
            capacity[a] = cap_room / c.bulk_modulus
            capacity[b] = rod_room / c.bulk_modulus
            capacity[line] = c.line_capacity

        for k in range(count):
            element = net[k]
            stamp(inflow, conductance, element.start, element.end, element.flow, element.slope)
        for i in range(tank):
            stiffness[i] = capacity[i]
            if cavity[i] > REFILLING * inflow[i] * dt and cavity[i] > 0.0:
                stiffness[i] *= RIGID
            conductance[i, i] += stiffness[i] / dt
        solve_in_place(conductance, inflow, tank)
        inflow[tank] = 0.0
        mean_flow = pump_flow - pump_slope * inflow[manifold]
        audit_main_pump(mean_flow, pressure[manifold] + 0.5 * inflow[manifold], c, e, v)
        if c.servo_pump_drag > 0.0:
            audit_drag(modules, c, e)
        audit(net, count, pressure, inflow, tank, c.servo_pump_efficiency, dt, e, v)
        for j in range(n):
            force = cylinders[j].cap_area * (pressure[3 * j] + 0.5 * inflow[3 * j])
            force -= cylinders[j].rod_area * (pressure[3 * j + 1] + 0.5 * inflow[3 * j + 1])
            e.piston_work += force * speed[j] * dt
            v.pistons += (cylinders[j].cap_area - cylinders[j].rod_area) * speed[j] * dt
        for i in range(tank):
            before, volume = pressure[i], stiffness[i] * inflow[i]
            pressure[i] = before + inflow[i]
            if cavity[i] > 0.0 or pressure[i] < c.vapour_pressure:
                pressure[i], cavity[i] = pressure_and_cavity(
                    before, cavity[i], capacity[i], c.vapour_pressure, volume
                )
            audit_node(capacity[i], volume, inflow[i], before, pressure[i], e, v)

    for j in range(n):
        actuator = actuators[j]
        cylinder = cylinders[j]
        rub(actuator, speed[j], cylinder.friction, c, dt * substeps)
        e.friction += actuator.friction * speed[j] * dt * substeps
        actuator.force = (
            cylinder.cap_area * pressure[3 * j] - cylinder.rod_area * pressure[3 * j + 1]
        )
