"""The hydraulic circuit, assembled from the machine for any number of actuators and modules.

Nodes, in this order: p_A, p_B, p_line of each actuator; the shared rail; the main pump's manifold;
the tank (constant). Between them:

    main pump → manifold                     constant-pressure pump with a flow limit
    manifold → each line, manifold → rail    check valves
    manifold → own line or rail              servo pump of each module, through its diverter
    own line, rail → manifold                slip of the servo pumps
    rail ↔ each line                         join valve
    line, p_A, p_B, tank                     servo valve: four metering edges, one spool, and
                                             isolating valves between them and the chambers
    line → tank                              the servo valve's leakage
    line → p_A, p_B → tank                   its leakage past the lands of the spool
    manifold, each line, rail, p_A, p_B → tank    relief valves
    tank → p_A, tank → p_B                   anti-cavitation valves
    further valves                           kinds of `valves.registry`, such as the rail's bleed;
                                             port valves are in series with the servo valve

Module j feeds actuator j's line directly, or the rail if it is lent. Modules beyond the actuators
feed the rail. An actuator in SB has its join valve open.

No pressure falls below the vapour pressure of the oil. There the liquid column separates, and
vapour fills the volume until oil has come back. Servo pumps deliver only what their inlet fills.
"""

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.circuit.components import describe_components
from mhsb_model.circuit.constants import build_valve_curves
from mhsb_model.circuit.elements import (
    advance_bristle_deflection,
    advance_first_order_lag,
    advance_pressure_and_cavity,
    advance_servo_pump_flow,
    apply_valve_curve,
    compute_accumulator_capacity,
    compute_air_factor,
    compute_chamber_volumes,
    compute_check_valve_flow,
    compute_friction_force,
    compute_land_conductance,
    compute_main_pump_flow,
    compute_metering_flow,
    compute_orifice_flow,
    compute_pump_filling,
    compute_relief_valve_flow,
    compute_sliding_friction,
    compute_valve_opening,
    follow_with_backlash,
)
from mhsb_model.circuit.quantities import (
    ActuatorState,
    CircuitConstants,
    CylinderConstants,
    ModuleState,
)
from mhsb_model.hydraulics import compute_required_pressure
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED_MODES, RAIL_MODES
from mhsb_model.records import Records, create_records
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_sim.circuit.audit import audit_drag, audit_elements, audit_main_pump, audit_node
from mhsb_sim.circuit.quantities import (
    ANTI_CAVITATION,
    CHECK_VALVE,
    FIRST_VALVE,
    JOIN_VALVE,
    LEAKAGE_PATH,
    RELIEF_VALVE,
    SERVO_PUMP,
    SERVO_PUMP_SLIP,
    SERVO_VALVE,
    CircuitElement,
    CircuitVolumes,
)
from mhsb_sim.circuit.valves.registry import (
    EnergyCounters,
    PlacedValves,
    compute_port_opening,
    compute_valve_flow,
    place_valves,
)
from mhsb_sim.circuit.valves.valve_kind import CircuitSite


@kernel(inline="always")
def add_to_linear_system(
    inflow: FloatArray, conductance: FloatArray, i: int, j: int, flow: float, slope: float
) -> None:
    """Add the flow of one element between two nodes to the linear system of a substep.

    The flow is subtracted from the inflow of node i and added to that of node j. The slope is added
    to both diagonal entries of G and subtracted from the two entries between i and j.

    Args:
        inflow: Net flow into each node [m³/s]. Updated in place.
        conductance: Matrix G of the linear system, float64[nodes, nodes], [m³/(s Pa)]. Updated in
            place.
        i: Node from which the flow comes.
        j: Node into which the flow goes.
        flow: Flow from i to j [m³/s].
        slope: Slope dQ/d(pᵢ − pⱼ) of the flow [m³/(s Pa)].
    """
    inflow[i] -= flow
    inflow[j] += flow
    conductance[i, i] += slope
    conductance[j, j] += slope
    conductance[i, j] -= slope
    conductance[j, i] -= slope


@kernel(borrows=True)
def solve_in_place(matrix: FloatArray, right: FloatArray, size: int) -> None:
    """Solve a symmetric positive definite linear system by elimination without pivoting.

    Zeros of the matrix are skipped. In a circuit, nodes of different actuators are connected only
    through the common nodes, which are numbered last. The cost is then proportional to the number
    of actuators. Only the upper triangle is read.

    Args:
        matrix: The system matrix, float64[≥ size, ≥ size]. Overwritten.
        right: Right-hand side. Its leading `size` entries are overwritten with the solution.
        size: Number of leading rows and columns that form the system.
    """
    for k in range(size):
        pivot = matrix[k, k]
        for i in range(k + 1, size):
            if matrix[k, i] == 0.0:
                continue
            factor = matrix[k, i] / pivot
            for j in range(i, size):
                matrix[i, j] -= factor * matrix[k, j]
            right[i] -= factor * right[k]
    for k in range(size - 1, -1, -1):
        total = right[k]
        for j in range(k + 1, size):
            total -= matrix[k, j] * right[j]
        right[k] = total / matrix[k, k]


VAPOUR_STIFFNESS_FACTOR = 1e6
"""Factor on the capacity of a node at vapour pressure, so that its pressure stays there."""

LOCK_VALVE_PILOT_RATIO = 3.0
"""Chamber pressure against which a lock valve opens, divided by the pilot pressure [-].

Usual ratios are 3 to 4. With a larger one the valve opens at a lower line pressure."""

CAVITY_REFILL_FACTOR = 2.0
"""Multiple of the oil that comes in a substep; a smaller cavity may fill up in it."""


class Circuit(NamedTuple):
    """State of the circuit; `advance` writes into its arrays."""

    cylinders: Records[CylinderConstants]  # [n]
    constants: Records[CircuitConstants]  # [1]
    module_home: IntArray  # [m] actuator whose line the module feeds, −1 for a spare
    pressure: FloatArray  # [3 n + 3] Pa, in the order of the nodes
    cavity: FloatArray  # [3 n + 3] m³ of vapour at each node
    actuators: Records[ActuatorState]  # [n]
    valve_curves: FloatArray  # [2, 2, k] extending and retracting: stroke, opening
    modules: Records[ModuleState]  # [m]
    valves: PlacedValves
    main_pump: FloatArray  # [1] m³/s, flow by the swash plate's position
    energy: Records[EnergyCounters]  # [1]
    counters: FloatArray  # [energies], the memory of `energy`
    volume: Records[CircuitVolumes]  # [1]
    net: Records[CircuitElement]  # […], working memory like the next two
    conductance: FloatArray  # [nodes, nodes]
    nodes: FloatArray  # [4, nodes]: inflow, capacity C, C as used, coefficient of the port valve

    def advance(self, length: FloatArray, speed: FloatArray, substeps: int) -> None:
        """Advance the circuit in place by some substeps, with given piston motion.

        The pistons displace oil at their speeds. The cylinder lengths, which determine the chamber
        volumes, are constant during the call.

        Args:
            length: Length of each cylinder, float64[n], [m].
            speed: Speed of each piston, float64[n], [m/s]; constant during the call.
            substeps: Number of substeps.
        """
        advance_alone(self, length, speed, substeps)

    @property
    def rail_pressure(self) -> float:
        """Pressure of the shared rail [Pa]."""
        return float(self.pressure[-3])

    @property
    def manifold_pressure(self) -> float:
        """Pressure of the manifold behind the main pump [Pa]."""
        return float(self.pressure[-2])


def build_circuit(machine: Machine, substep: float) -> Circuit:
    """Build the circuit of a machine with all nodes at supply pressure and all valves closed.

    Args:
        machine: The machine to be simulated.
        substep: Length of a substep [s].

    Returns:
        The circuit at rest. There is no vapour, all energy and oil counters are 0, and the tank is
        at tank pressure. The main pump delivers what the closed valves leak.

    Raises:
        MachineFileError: A section `circuit.valves` is wrong, or two port valves are at one
            chamber.
    """
    arrays = machine.arrays
    actuator_count, module_count = machine.joint_count, arrays.module_count
    nodes = 3 * actuator_count + 3
    parts = describe_components(machine, substep)
    pressure = np.full(nodes, arrays.supply_pressure)
    pressure[-1] = arrays.tank_pressure
    valves = place_valves(CircuitSite(machine, parts.constants))
    energy = create_records(EnergyCounters, 1)
    net_size = 3 + len(valves.records) + 4 * module_count + 15 * actuator_count
    return Circuit(
        cylinders=parts.cylinders,
        constants=parts.constants,
        module_home=parts.module_home,
        pressure=pressure,
        cavity=np.zeros(nodes),
        actuators=parts.actuators,
        valve_curves=build_valve_curves(machine),
        modules=parts.modules,
        valves=valves,
        main_pump=np.full(1, actuator_count * arrays.leakage_flow),
        energy=energy,
        counters=np.asarray(energy).view(np.float64),
        volume=create_records(CircuitVolumes, 1),
        net=create_records(CircuitElement, net_size),
        conductance=np.zeros((nodes, nodes)),
        nodes=np.vstack([np.zeros((3, nodes)), np.full(nodes, np.inf)]),
    )


def set_rest_pressures(circuit: Circuit, machine: Machine, q: FloatArray, modes: ModeArray) -> None:
    """Set the pressures at which the arm rests in a posture with closed valves.

    The chamber pressures satisfy

        p_A A − p_B a = F,    p_A + p_B = p_line + p_T

    p_A and p_B are the pressures on the cap side and the rod side, A and a the piston areas there.
    F is the piston force of the load. p_line and p_T are the pressures of line and tank. The second
    equation holds for a symmetric valve near its centre. If a chamber would fall below tank
    pressure, the pressures of both chambers are raised.

    Each line is at the main pump's pressure. A line of an actuator in DB or SB is at the pressure
    that holds the load with the boost margin, if this is higher. The rail has the highest pressure
    of the lines in SB, or the main pump's pressure if none is in SB. The join valves of the
    actuators in SB are open.

    Args:
        circuit: Circuit, updated in place: `pressure`, `cavity` and, of the actuators, `force` and
            `join`.
        machine: The machine with its actual payload.
        q: Joint positions, float64[n], [rad or m].
        modes: Mode of each actuator, uint8[n].
    """
    m = machine.arrays
    force = machine.piston_forces(q)
    pressure = circuit.pressure
    circuit.cavity[:] = 0.0
    pressure[-3] = pressure[-2] = m.supply_pressure
    for j in range(machine.joint_count):
        cap, rod = m.cap_area[j], m.rod_area[j]
        line = m.supply_pressure
        if BOOSTED_MODES[modes[j]]:
            line = max(line, compute_required_pressure(m, j, force[j], 0.0))
        if RAIL_MODES[modes[j]]:
            pressure[-3] = max(pressure[-3], line)
        total = line + m.tank_pressure
        cap_pressure = (force[j] + rod * total) / (cap + rod)
        emptied = (force[j] + rod * m.tank_pressure) / cap
        cap_pressure = max(cap_pressure, emptied, m.tank_pressure)
        pressure[3 * j] = cap_pressure
        pressure[3 * j + 1] = (cap_pressure * cap - force[j]) / rod
        pressure[3 * j + 2] = line
    circuit.actuators["force"] = force
    circuit.actuators["join"] = RAIL_MODES[modes]


@kernel(inline="always")
def add_element(
    net: Records[CircuitElement],
    count: int,
    kind: int,
    start: int,
    end: int,
    flow: float,
    slope: float,
) -> int:
    """Add an element to the list of this substep, if it has a flow or a slope.

    Args:
        net: Elements, CircuitElement. Record `count` is written in place.
        count: Number of elements so far.
        kind: Kind of the element, such as CHECK_VALVE.
        start: Node from which the flow is counted.
        end: Node to which the flow is counted.
        flow: Flow [m³/s].
        slope: dQ/dΔp [m³/(s Pa)].

    Returns:
        New number of elements: `count`, or one more if the element was added.
    """
    if flow == 0.0 and slope == 0.0:
        return count
    element = net[count]
    element.kind, element.start, element.end = kind, start, end
    element.flow, element.slope = flow, slope
    return count + 1


@kernel
def move_spool(actuator: ActuatorState, c: CircuitConstants) -> None:
    """Advance the spool of a servo valve by one substep.

        ẍ + 2 ζ ω ẋ + ω² (x − u) = 0

    x is the spool position, −1 … 1, and u the command after the hysteresis. ω is the natural
    frequency [rad/s] and ζ the damping ratio. |ẋ| stays within the rate limit. Two faults change
    the motion. A seized spool does not move. A spool that does not follow its command goes to the
    position `runaway`.

    Args:
        actuator: State of one servo valve and cylinder. Writes `spool_target` (u), `spool` (x) and
            `spool_speed` (ẋ) in place.
        c: Constants of the circuit.
    """
    if actuator.seized > 0.0:
        actuator.spool_speed = 0.0
        return
    command = actuator.valve_command if actuator.follows_command > 0.0 else actuator.runaway
    actuator.spool_target = follow_with_backlash(actuator.spool_target, command, c.valve_hysteresis)
    before = actuator.spool
    away, rate = before - actuator.spool_target, actuator.spool_speed
    spool = actuator.spool_target + c.spool_00 * away + c.spool_01 * rate
    actuator.spool_speed = c.spool_10 * away + c.spool_11 * rate
    way = c.spool_rate * c.substep
    if abs(spool - before) > way:
        spool = before + math.copysign(way, spool - before)
        actuator.spool_speed = math.copysign(c.spool_rate, spool - before)
    actuator.spool = min(max(spool, -1.0), 1.0)
    if spool != actuator.spool:
        actuator.spool_speed = 0.0


@kernel
def update_friction(
    actuator: ActuatorState, speed: float, share: float, c: CircuitConstants, dt: float
) -> None:
    """Compute the friction of a cylinder after it has moved at a constant speed for a time.

    If the bristle stiffness σ₀ is above 0, the friction F follows the LuGre model,

        F = σ₀ z + σ₁ ż + b v

    z is the bristle deflection [m], and σ₁ the damping [N s/m]. b is the viscous friction [N s/m].
    If σ₀ is 0, F is Coulomb and viscous friction without memory (`compute_friction_force`).

    Args:
        actuator: State of one servo valve and cylinder. Writes `friction` [N] and, with bristles,
            `bristle_deflection` [m] in place.
        speed: Piston speed v [m/s].
        share: Factor on the friction of this cylinder [-].
        c: Constants of the circuit.
        dt: Time that has passed [s].
    """
    if c.bristle_stiffness == 0.0:
        actuator.friction = share * compute_friction_force(
            c.coulomb_friction, c.viscous_friction, c.friction_speed, speed
        )
        return
    sliding = compute_sliding_friction(c.coulomb_friction, c.breakaway, c.stribeck_speed, speed)
    before = actuator.bristle_deflection
    actuator.bristle_deflection = advance_bristle_deflection(
        before, speed, sliding, c.bristle_stiffness, dt
    )
    bending = (actuator.bristle_deflection - before) / dt
    actuator.friction = share * (
        c.bristle_stiffness * actuator.bristle_deflection
        + c.bristle_damping * bending
        + c.viscous_friction * speed
    )


@kernel(inline="always")
def move_port_valve(circuit: Circuit, k: int) -> None:
    """Advance the opening of a port valve by a substep, with the pressures at the substep's start.

    The opening follows that of `compute_port_opening` as a first-order lag.

    Args:
        circuit: The circuit. Writes the opening into `valves`, and the coefficient of the chamber
            into `nodes`, in place.
        k: Index of the valve in `valves`.
    """
    valve, pressure = circuit.valves.records[k], circuit.pressure
    tank = pressure[len(pressure) - 1]
    wanted = compute_port_opening(
        valve.kind,
        circuit.valves.numbers[k],
        pressure[valve.start] - tank,
        pressure[valve.end] - tank,
    )
    valve.opening = advance_first_order_lag(valve.opening, wanted, valve.decay)
    circuit.nodes[3, valve.start] = valve.opening * valve.coefficient


@kernel(inline="always")
def connect_supply(circuit: Circuit, count: int) -> int:
    """Add the elements between manifold, rail and tank to the list of elements.

    These are, in this order:

    - the check valve from manifold to rail,
    - the valves of all registered kinds (`valves.registry`), wherever they are in the circuit; port
      valves add no element here, but their spools are moved by one step (`move_port_valve`),
    - the relief valves from rail and from manifold to tank.

    Each element gets the flow at the present pressures, and its slope over the pressure drop.

    Args:
        circuit: The circuit. Writes into `net` (the list of elements) in place.
        count: Number of elements so far.

    Returns:
        New number of elements.
    """
    net, pressure, c = circuit.net, circuit.pressure, circuit.constants[0]
    n = len(circuit.actuators)
    rail, manifold, tank = 3 * n, 3 * n + 1, 3 * n + 2
    drop = pressure[manifold] - pressure[rail]
    flow, slope = compute_check_valve_flow(c.check_coefficient, drop, c.laminar_pressure)
    count = add_element(net, count, CHECK_VALVE, manifold, rail, flow, slope)
    for k in range(len(circuit.valves.records)):
        valve, numbers = circuit.valves.records[k], circuit.valves.numbers[k]
        if valve.counter < 0:
            move_port_valve(circuit, k)
            continue
        drop = pressure[valve.start] - pressure[valve.end]
        flow, slope = compute_valve_flow(valve.kind, numbers, drop)
        kind = FIRST_VALVE + valve.counter
        count = add_element(net, count, kind, valve.start, valve.end, flow, slope)
    drop = pressure[rail] - pressure[tank]
    flow, slope = compute_relief_valve_flow(c.relief_gain, drop, c.line_relief)
    count = add_element(net, count, RELIEF_VALVE, rail, tank, flow, slope)
    drop = pressure[manifold] - pressure[tank]
    flow, slope = compute_relief_valve_flow(c.relief_gain, drop, c.manifold_relief)
    return add_element(net, count, RELIEF_VALVE, manifold, tank, flow, slope)


@kernel(inline="always")
def connect_servo_pumps(circuit: Circuit, count: int) -> int:
    """Advance servo pumps and diverters by a substep, and add the pumps to the list of elements.

    A diverter leads a pump's flow to the rail or to the actuator's own line; spare modules feed the
    rail only. So each pump has up to two elements for its flow, and two for its slip. A pump's flow
    is limited by its largest speed and by its drive's power, and falls if the manifold's pressure
    does not fill the pump.

    Slip is the flow that leaks back through a pump, also if the pump stands still. It is
    proportional to the pressure rise, and negative if the manifold has the higher pressure.

    Args:
        circuit: The circuit. Writes into `net` (the list of elements) and `modules` in place.
        count: Number of elements so far.

    Returns:
        New number of elements.
    """
    net, pressure, c = circuit.net, circuit.pressure, circuit.constants[0]
    n = len(circuit.actuators)
    modules, module_home, rail, manifold = circuit.modules, circuit.module_home, 3 * n, 3 * n + 1
    filled, filling = compute_pump_filling(pressure[manifold], c.vapour_pressure, c.pump_filling)
    for k in range(len(modules)):
        module = modules[k]
        home = 3 * module_home[k] + 2 if module_home[k] >= 0 else rail
        goal = module.to_rail_command if module_home[k] >= 0 else 1.0
        module.to_rail = advance_first_order_lag(module.to_rail, goal, c.switching_decay)
        outlet = pressure[home] + module.to_rail * (pressure[rail] - pressure[home])
        boost = max(0.0, outlet - pressure[manifold])
        largest = module.flow_ratio * c.servo_pump_flow
        if boost * largest > c.servo_pump_efficiency * c.servo_pump_power:
            largest = c.servo_pump_efficiency * c.servo_pump_power / boost
        commanded_flow = largest if module.runs_on > 0.0 else module.flow_command
        decay = c.servo_pump_decay
        if module.lag_ratio != 1.0:
            decay = c.servo_pump_decay ** (1.0 / module.lag_ratio)
        module.flow = advance_servo_pump_flow(
            module.flow, commanded_flow, largest, decay, c.servo_pump_slew * c.substep
        )
        module.delivered = filled * module.flow
        to_rail, slope = module.delivered * module.to_rail, filling * module.flow
        own, own_slope = module.delivered - to_rail, slope * (1.0 - module.to_rail)
        slope *= module.to_rail
        count = add_element(net, count, SERVO_PUMP, manifold, rail, to_rail, slope)
        count = add_element(net, count, SERVO_PUMP, manifold, home, own, own_slope)
        for start, slip in (
            (rail, c.servo_pump_slip * module.to_rail),
            (home, c.servo_pump_slip * (1.0 - module.to_rail)),
        ):
            slipped = slip * (pressure[start] - pressure[manifold])
            module.delivered -= slipped
            count = add_element(net, count, SERVO_PUMP_SLIP, start, manifold, slipped, slip)
    return count


@kernel(inline="always")
def combine_with_port_valve(circuit: Circuit, edge: float, chamber: int, outside: int) -> float:
    """Return the flow coefficient of a metering edge and the port valve of its chamber in series.

        k = k₁ k₂ / √(k₁² + k₂²)

    Oil that flows into the chamber passes the port valve without loss: then k = k₁. At the same
    flow, a drop Δp over the edge alone is Δp (k₁/k)² over both.

    Args:
        circuit: The circuit.
        edge: Coefficient k₁ of the edge [m³/(s √Pa)].
        chamber: Node of the chamber. Its port valve has the coefficient k₂; inf without one.
        outside: Node at the other end of the edge.

    Returns:
        Coefficient k [m³/(s √Pa)]. It is 0 if the edge is shut, or if oil would flow out of the
        chamber while the port valve is shut.

    Source:
        H. E. Merritt, Hydraulic Control Systems (orifices in series).
    """
    port = circuit.nodes[3, chamber]
    if math.isinf(port) or circuit.pressure[chamber] <= circuit.pressure[outside]:
        return edge
    if edge <= 0.0 or port <= 0.0:
        return 0.0
    return edge * port / math.sqrt(edge * edge + port * port)


@kernel(inline="always")
def connect_lands(circuit: Circuit, j: int, count: int) -> int:
    """Add the leakage past the lands of a servo valve's spool to the elements of a substep.

    Two of the four lands have the overlap o₁ − x, and two have o₂ + x. o₁ and o₂ are the overlaps
    of the centred spool, extending and retracting, and x is the spool position (−1 … 1). If the
    valves that isolate the chambers are shut, the oil flows from line to tank instead. It passes
    the two lands of each work port in series. A port valve that is shut lets no oil out of its
    chamber.

    Args:
        circuit: The circuit. Writes into `net` in place. Adds to `supply_flow` of the actuator what
            flows from the line into chambers.
        j: Index of the actuator. Its spool must have been moved in this substep.
        count: Number of elements so far.

    Returns:
        New number of elements.
    """
    net, pressure, c = circuit.net, circuit.pressure, circuit.constants[0]
    actuator, line, tank = circuit.actuators[j], 3 * j + 2, len(circuit.pressure) - 1
    conductance = actuator.leakage * c.land_conductance
    if conductance <= 0.0:
        return count
    extending = compute_land_conductance(
        conductance, c.valve_overlap - actuator.spool, c.land_length
    )
    retracting = compute_land_conductance(
        conductance, c.valve_overlap_retracting + actuator.spool, c.land_length
    )
    passing = 1.0 - actuator.isolated
    for start, end, slope in (
        (line, 3 * j, passing * extending),
        (3 * j, tank, passing * retracting),
        (line, 3 * j + 1, passing * retracting),
        (3 * j + 1, tank, passing * extending),
        (line, tank, actuator.isolated * 2.0 * extending * retracting / (extending + retracting)),
    ):
        flow = slope * (pressure[start] - pressure[end])
        chamber, leaves = (end, flow < 0.0) if start == line else (start, flow > 0.0)
        if leaves and circuit.nodes[3, chamber] == 0.0:
            continue
        if start == line and end != tank:
            actuator.supply_flow += flow
        count = add_element(net, count, LEAKAGE_PATH, start, end, flow, slope)
    return count


@kernel(inline="always")
def connect_actuator(circuit: Circuit, j: int, count: int) -> int:
    """Advance the valves of an actuator by a substep, and add its elements to the list.

    The list has the elements of the present substep with their flows and slopes. An actuator has
    these elements: both open edges of its servo valve, the valve's leakage, and the relief, check
    and join valves of its line. Each chamber also has a relief valve and an anti-cavitation valve.

    Isolating valves shut the chambers off, tightly in both directions. They follow
    `isolating_command`. If `lock_valve_opening` is above 0, the isolating valves also act as lock
    valves. They then shut in two more cases:

    - The opening of the servo valve is below `lock_valve_opening`.
    - The pilot pressure, that of the line, is below the higher chamber pressure divided by
      LOCK_VALVE_PILOT_RATIO.

    Args:
        circuit: The circuit. Writes into `net` (the list of elements) and `actuators` in place.
        j: Index of the actuator.
        count: Number of elements so far.

    Returns:
        New number of elements.
    """
    net, pressure, c = circuit.net, circuit.pressure, circuit.constants[0]
    n = len(circuit.actuators)
    actuator, laminar = circuit.actuators[j], c.laminar_pressure
    a, b, line = 3 * j, 3 * j + 1, 3 * j + 2
    rail, manifold, tank = 3 * n, 3 * n + 1, 3 * n + 2
    move_spool(actuator, c)
    actuator.join = advance_first_order_lag(actuator.join, actuator.join_command, c.switching_decay)

    # The servo valve: line to one chamber, the other chamber to tank.
    overlap = c.valve_overlap if actuator.spool >= 0.0 else c.valve_overlap_retracting
    opening = compute_valve_opening(actuator.spool, overlap, c.valve_exponent)
    if circuit.valve_curves.shape[2] > 2:
        opening = apply_valve_curve(opening, circuit.valve_curves[0 if opening >= 0.0 else 1])
    fed, emptied = (a, b) if opening >= 0.0 else (b, a)
    locked = actuator.isolating_command
    if c.lock_valve_opening > 0.0:
        pilot = LOCK_VALVE_PILOT_RATIO * (pressure[line] - pressure[tank])
        if abs(opening) < c.lock_valve_opening or pilot < (
            max(pressure[a], pressure[b]) - pressure[tank]
        ):
            locked = 1.0
    actuator.isolated = advance_first_order_lag(actuator.isolated, locked, c.switching_decay)
    k_edge = circuit.cylinders[j].valve_coefficient * abs(opening) * (1.0 - actuator.isolated)
    k = combine_with_port_valve(circuit, k_edge, fed, line)
    kept = c.compensated_drop * (k_edge / k) ** 2 if k > 0.0 else math.inf
    flow, slope = compute_metering_flow(k, pressure[line] - pressure[fed], laminar, kept)
    count = add_element(net, count, SERVO_VALVE, line, fed, flow, slope)
    actuator.supply_flow = flow
    k = combine_with_port_valve(circuit, k_edge, emptied, tank)
    kept = c.compensated_drop * (k_edge / k) ** 2 if k > 0.0 else math.inf
    flow, slope = compute_metering_flow(k, pressure[emptied] - pressure[tank], laminar, kept)
    count = add_element(net, count, SERVO_VALVE, emptied, tank, flow, slope)

    drop = pressure[line] - pressure[tank]
    flow, slope = compute_orifice_flow(actuator.leakage * c.leakage_coefficient, drop, laminar)
    count = add_element(net, count, LEAKAGE_PATH, line, tank, flow, slope)
    count = connect_lands(circuit, j, count)
    flow, slope = compute_relief_valve_flow(c.relief_gain, drop, c.line_relief)
    count = add_element(net, count, RELIEF_VALVE, line, tank, flow, slope)
    drop = pressure[manifold] - pressure[line]
    flow, slope = compute_check_valve_flow(c.check_coefficient, drop, laminar)
    count = add_element(net, count, CHECK_VALVE, manifold, line, flow, slope)
    drop = pressure[rail] - pressure[line]
    flow, slope = compute_orifice_flow(c.switching_coefficient * actuator.join, drop, laminar)
    count = add_element(net, count, JOIN_VALVE, rail, line, flow, slope)
    for chamber in (a, b):
        drop = pressure[chamber] - pressure[tank]
        flow, slope = compute_relief_valve_flow(c.relief_gain, drop, actuator.relief)
        count = add_element(net, count, RELIEF_VALVE, chamber, tank, flow, slope)
        flow, slope = compute_relief_valve_flow(c.anti_cavitation_gain, -drop, 0.0)
        count = add_element(net, count, ANTI_CAVITATION, tank, chamber, flow, slope)
    return count


@kernel(inline="always")
def displace_oil(circuit: Circuit, j: int, length: float, speed: float) -> None:
    """Add the oil that a piston displaces to the inflow of its chambers, and set their capacities.

    Args:
        circuit: The circuit, changed in place. The inflow of both chambers is added to. The
            capacities of both chambers and of the supply line are set.
        j: Index of the actuator.
        length: Length of its cylinder [m].
        speed: Speed of its piston [m/s].
    """
    inflow, capacity = circuit.nodes[0], circuit.nodes[1]
    cylinder, c = circuit.cylinders[j], circuit.constants[0]
    inflow[3 * j] -= cylinder.cap_area * speed
    inflow[3 * j + 1] += cylinder.rod_area * speed
    cap_room, rod_room = compute_chamber_volumes(cylinder, length)
    capacity[3 * j] = cap_room / c.bulk_modulus
    capacity[3 * j + 1] = rod_room / c.bulk_modulus
    capacity[3 * j + 2] = c.line_capacity


@kernel(inline="always")
def add_gas(circuit: Circuit) -> None:
    """Add the capacities of free air in the oil, and of the accumulator at the manifold.

    The capacity of air depends on the pressure. It is computed for each node's pressure before the
    substep, but at least for the vapour pressure.

    Args:
        circuit: The circuit. Updates the capacities of its nodes in place.
    """
    pressure, capacity, c = circuit.pressure, circuit.nodes[1], circuit.constants[0]
    manifold = len(pressure) - 2
    if c.free_air > 0.0:
        for i in range(manifold + 1):
            absolute = max(pressure[i], c.vapour_pressure, 1.0)
            capacity[i] *= compute_air_factor(c.bulk_modulus, c.free_air, absolute)
    if c.accumulator_volume > 0.0:
        capacity[manifold] += compute_accumulator_capacity(
            pressure[manifold],
            c.accumulator_volume,
            c.accumulator_precharge,
            c.accumulator_exponent,
        )


@kernel(inline="always")
def solve_pressure_changes(circuit: Circuit, count: int) -> None:
    """Solve the linear system of a substep for the pressure change of every node.

        (G + C/dt) Δp = inflow

    G is the matrix of the elements' slopes, C the diagonal matrix of the nodes' capacities, and dt
    the duration of the substep. A node with a vapour cavity gets a large capacity, so that its
    pressure stays, unless the cavity may fill up in this substep. The tank's pressure does not
    change.

    Args:
        circuit: The circuit. The inflows [m³/s], `nodes[0]`, are overwritten with the pressure
            changes [Pa]. The conductance matrix and the capacities as used, `nodes[2]`, are written
            in place.
        count: Number of elements in `net`.
    """
    net, conductance, cavity = circuit.net, circuit.conductance, circuit.cavity
    inflow, capacity, stiffness = circuit.nodes[0], circuit.nodes[1], circuit.nodes[2]
    dt, tank = circuit.constants[0].substep, len(circuit.pressure) - 1
    for k in range(count):
        element = net[k]
        add_to_linear_system(
            inflow, conductance, element.start, element.end, element.flow, element.slope
        )
    for i in range(tank):
        stiffness[i] = capacity[i]
        if cavity[i] > CAVITY_REFILL_FACTOR * inflow[i] * dt and cavity[i] > 0.0:
            stiffness[i] *= VAPOUR_STIFFNESS_FACTOR
        conductance[i, i] += stiffness[i] / dt
    solve_in_place(conductance, inflow, tank)
    inflow[tank] = 0.0


@kernel(inline="always")
def apply_pressure_changes(circuit: Circuit) -> None:
    """Apply the pressure changes of a substep, and count what each node has stored.

    No pressure falls below the vapour pressure. At vapour pressure, vapour fills the volume without
    oil. This volume is the node's cavity.

    Args:
        circuit: The circuit. Reads the pressure changes in `nodes[0]`. Writes pressures, cavities
            and counters in place.
    """
    pressure, cavity, c = circuit.pressure, circuit.cavity, circuit.constants[0]
    change, capacity, stiffness = circuit.nodes[0], circuit.nodes[1], circuit.nodes[2]
    e, v = circuit.energy[0], circuit.volume[0]
    for i in range(len(pressure) - 1):
        before, volume = pressure[i], stiffness[i] * change[i]
        pressure[i] = before + change[i]
        if cavity[i] > 0.0 or pressure[i] < c.vapour_pressure:
            pressure[i], cavity[i] = advance_pressure_and_cavity(
                before, cavity[i], capacity[i], c.vapour_pressure, volume
            )
        audit_node(capacity[i], volume, change[i], before, pressure[i], e, v)


@kernel(borrows=True)
def advance(circuit: Circuit, length: FloatArray, speed: FloatArray, substeps: int) -> None:
    """Advance the circuit in place by some substeps, with given piston motion.

    Each substep moves valves and pumps, linearises every element at the present pressures, and
    solves for the new pressures. It also updates the counters of energy and oil. Friction and the
    cylinder forces are computed after the last substep. The pistons displace oil at their speeds.
    The cylinder lengths, which determine the chamber volumes, are constant during the call.

    Tested against SciPy's Radau method on the same equations (test/circuit/test_network.py).

    Args:
        circuit: The circuit. Writes pressures, cavities, actuators, modules and counters in place.
        length: Length of each cylinder, float64[n], [m].
        speed: Speed of each piston, float64[n], [m/s]; constant during the call.
        substeps: Number of substeps.
    """
    cylinders, actuators, pressure = circuit.cylinders, circuit.actuators, circuit.pressure
    inflow, capacity = circuit.nodes[0], circuit.nodes[1]
    c, e, v = circuit.constants[0], circuit.energy[0], circuit.volume[0]
    n = len(actuators)
    rail, manifold = 3 * n, 3 * n + 1
    dt = c.substep
    for _ in range(substeps):
        capacity[rail], capacity[manifold] = c.rail_capacity, c.manifold_capacity
        pump_flow, pump_slope = compute_main_pump_flow(
            c.main_pump_flow, c.supply_pressure, c.main_pump_droop, pressure[manifold]
        )
        # The mean flow of the substep, as the regulator's change of the swash plate begins.
        mean_flow = pump_flow + c.main_pump_memory * (circuit.main_pump[0] - pump_flow)
        mean_slope = (1.0 - c.main_pump_memory) * pump_slope
        inflow[:] = 0.0
        circuit.conductance[:, :] = 0.0
        inflow[manifold] += mean_flow
        circuit.conductance[manifold, manifold] += mean_slope
        count = connect_servo_pumps(circuit, connect_supply(circuit, 0))
        for j in range(n):
            count = connect_actuator(circuit, j, count)
            displace_oil(circuit, j, length[j], speed[j])
        add_gas(circuit)
        solve_pressure_changes(circuit, count)
        change = inflow
        mean_flow -= mean_slope * change[manifold]
        pump_flow = min(max(pump_flow - pump_slope * change[manifold], 0.0), c.main_pump_flow)
        circuit.main_pump[0] = advance_first_order_lag(
            circuit.main_pump[0], pump_flow, c.main_pump_decay
        )
        audit_main_pump(mean_flow, pressure[manifold] + 0.5 * change[manifold], c, e, v)
        if c.servo_pump_drag > 0.0:
            audit_drag(circuit.modules, c, e)
        audit_elements(circuit.net, count, pressure, change, c, e, circuit.counters, v)
        for j in range(n):
            force = cylinders[j].cap_area * (pressure[3 * j] + 0.5 * change[3 * j])
            force -= cylinders[j].rod_area * (pressure[3 * j + 1] + 0.5 * change[3 * j + 1])
            e.piston_work += force * speed[j] * dt
            v.pistons += (cylinders[j].cap_area - cylinders[j].rod_area) * speed[j] * dt
        apply_pressure_changes(circuit)

    for j in range(n):
        actuator = actuators[j]
        cylinder = cylinders[j]
        update_friction(actuator, speed[j], cylinder.friction, c, dt * substeps)
        e.friction += actuator.friction * speed[j] * dt * substeps
        actuator.force = (
            cylinder.cap_area * pressure[3 * j] - cylinder.rod_area * pressure[3 * j + 1]
        )


@kernel(borrows=True)
def advance_alone(circuit: Circuit, length: FloatArray, speed: FloatArray, substeps: int) -> None:
    """Call `advance` from Python, with the same arguments.

    The version of `advance` that the simulator's kernels link is linked here, too. If Python called
    `advance` itself, all of it would be compiled once more.

    Args:
        circuit: The circuit, advanced in place.
        length: Length of each cylinder, float64[n], [m].
        speed: Speed of each piston, float64[n], [m/s].
        substeps: Number of substeps.
    """
    advance(circuit, length, speed, substeps)
