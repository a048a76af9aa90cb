"""Coordinated control: valve and servo pumps act on one demand.

The valve opens as far as the measured pressures ask for to make the demanded piston speed. The
servo pumps deliver the very flow that the valves are about to take; the pressure error only
trims. No pump runs faster than it can be stopped before its oil would overfill the line, judged
by the reference ahead; on the rail, pumps that are no longer needed count until they have come to
rest. Lines are charged ahead of a boost (the prepared modes), and a line is joined to the rail
softly: throttled to what it needs until their pressures agree. As the valve goes by what is
measured, no pressure is kept in reserve beyond the plan's.
"""

from __future__ import annotations

import numpy as np

from mhsb_model.hydraulics import inlet_area, load_pressure
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED
from mhsb_model.statics import Chain, chain_of
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_sim.bound_kernel import bind
from mhsb_sim.circuit.elements import orifice
from mhsb_sim.records import Record, Records
from mhsb_sim.servo.cascade import (
    SCRATCH,
    axis_records,
    gain_record,
    joins_rail,
    piston_demands,
    set_targets,
)
from mhsb_sim.servo.controller import REFERENCE_POINTS, ServoSignals
from mhsb_sim.servo.reference import AHEAD

SMALLEST_DROP = 2e4
"""Pressure drop [Pa] that an edge is taken to have at least, so that openings stay moderate."""

GAINS = np.dtype(
    [
        ("preview", "f8"),  # s
        ("pump_lead", "f8"),  # λ
        ("pressure_gain", "f8"),  # k, 1/s
        ("pump_rise", "f8"),  # share of the way to the next point for a pump's response
        ("allowed_rise", "f8"),  # Pa, above the target while a pump coasts
    ]
)

JOINED_DROP = 1e5
"""Difference of pressure below which a line and the rail are joined fully [Pa]."""

DAMPED = 4.0
"""Time in which a throttled join charges its line, in time constants of the join valve: the
shortest without overshoot."""

IDLE_SHARE = 0.02
"""Share of a pump's flow below which its rail may be shut off: the rest bursts into it."""

SWITCHED_OVER = 0.9
"""Share of a lent pump's flow that has to reach the rail before it counts as feeding it."""


class CoordinatedController:
    """Valve and servo pumps on one demand; see the module's text."""

    def __init__(self, machine: Machine, signals: ServoSignals) -> None:
        circuit, oil = signals.circuit, machine.config.circuit
        servo = machine.config.servo.coordinated
        lag = oil.servo_pump_lag
        self.preview: float = servo.preview
        own_gains = np.zeros(1, GAINS)
        own_gains["preview"] = self.preview
        spin_up = circuit.constants["servo_pump_flow"] / oil.servo_pump_slew
        own_gains["pump_lead"] = np.maximum(1.0, lag / (servo.pump_response * spin_up))
        own_gains["pump_rise"] = np.minimum(
            1.0, AHEAD * lag / (own_gains["pump_lead"] * self.preview)
        )
        own_gains["pressure_gain"] = servo.pressure_gain / lag
        own_gains["allowed_rise"] = servo.allowed_rise
        self._axes = axis_records(machine, servo)
        self._axes["joined"] = circuit.actuators["join"]
        self._axes["supply_target"] = circuit.pressure[2:-3:3]
        self._rail_target = np.full(2, circuit.rail_pressure)
        self._control = bind(
            control,
            signals.reference,
            signals.sensors,
            machine.arrays.linkage,
            chain_of(machine.arrays),
            circuit.cylinders,
            circuit.constants,
            gain_record(machine),
            np.zeros((SCRATCH, machine.joint_count)),
            self._axes,
            signals.rail_pressure,
            signals.modes,
            signals.serves,
            circuit.module_home,
            circuit.actuators,
            circuit.modules,
            self._rail_target,
            own_gains,
            np.zeros((machine.joint_count + 1, REFERENCE_POINTS)),
            -lag * np.expm1(-np.arange(REFERENCE_POINTS) * self.preview / (AHEAD * lag)),
        )

    def update(self) -> None:
        """Write all commands for the next step."""
        self._control()


@kernel
def control(
    reference: FloatArray,
    sensors: Records,
    linkage: FloatArray,
    chain: Chain,
    cylinders: Records,
    constants: Records,
    gains: Records,
    scratch: FloatArray,
    axes: Records,
    rail_pressure: FloatArray,
    modes: ModeArray,
    serves: IntArray,
    module_home: IntArray,
    actuators: Records,
    modules: Records,
    rail_target: FloatArray,
    own_gains: Records,
    volume: FloatArray,
    coasting: FloatArray,
) -> None:
    """One step of the controller; shapes as in `piston_demands` and ServoSignals.

    rail_target: float64[2], pressure targets of the rail [Pa], as those of an axis; own_gains:
    GAINS[1]; volume: as in `look_ahead`, with a last row for the rail; coasting: as in
    `coasting_limit`.
    """
    piston_demands(reference, sensors, linkage, chain, cylinders, constants, gains, scratch, axes)
    for j in range(len(axes)):
        open_valve(axes[j], sensors[j], cylinders[j], constants, actuators[j])
        set_target(axes[j], sensors[j], cylinders[j], constants, gains, modes[j])
    look_ahead(reference, sensors, cylinders, constants, serves, own_gains, axes, volume)
    join_lines(
        sensors,
        constants,
        axes,
        rail_pressure[0],
        modes,
        serves,
        module_home,
        actuators,
        modules,
        rail_target,
    )
    drive_pumps(
        sensors,
        constants,
        axes,
        rail_pressure[0],
        serves,
        module_home,
        actuators,
        modules,
        rail_target,
        own_gains,
        volume,
        coasting,
    )


@kernel
def open_valve(
    axis: Record, sensor: Record, cylinder: Record, constants: Records, actuator: Record
) -> None:
    """Opening x that makes dF/dt = k_h (u − v) at the measured pressures, both edges counted.

    x = k_h u / (K [A β/V_A S(Δp_A) + a β/V_B S(Δp_B)]) in extension, with S the orifice's law.
    Where the line does not carry the load, p_line < p_L of the measured force, the valve stays
    shut: opened, it would let the load down. A chamber that still holds more than the line from
    a motion the other way is no such case, it only gives off what it was compressed by.
    """
    c = constants[0]
    cap, rod = cylinder.cap_area, cylinder.rod_area
    force = cap * sensor.cap_pressure - rod * sensor.rod_pressure
    if axis.demand >= 0.0:
        carried = load_pressure(cap, rod, c.tank_pressure, force, 1.0)
        inlet_drop = sensor.line_pressure - sensor.cap_pressure
        outlet_drop = sensor.rod_pressure - c.tank_pressure
        inlet_gain, outlet_gain = cap * axis.cap_stiffness, rod * axis.rod_stiffness
    else:
        carried = load_pressure(cap, rod, c.tank_pressure, force, -1.0)
        inlet_drop = sensor.line_pressure - sensor.rod_pressure
        outlet_drop = sensor.cap_pressure - c.tank_pressure
        inlet_gain, outlet_gain = rod * axis.rod_stiffness, cap * axis.cap_stiffness
    inlet, _ = orifice(c.valve_coefficient, max(inlet_drop, 0.0), c.laminar_pressure)
    outlet, _ = orifice(c.valve_coefficient, max(outlet_drop, 0.0), c.laminar_pressure)
    smallest, _ = orifice(c.valve_coefficient, SMALLEST_DROP, c.laminar_pressure)
    gain = inlet_gain * max(inlet, smallest) + outlet_gain * max(outlet, smallest)
    opening = axis.stiffness * axis.demand / gain
    gate = min(max((sensor.line_pressure - carried) / c.laminar_pressure, 0.0), 1.0)
    actuator.valve_command = gate * min(max(opening, -1.0), 1.0)


@kernel
def set_target(
    axis: Record,
    sensor: Record,
    cylinder: Record,
    constants: Records,
    gains: Records,
    mode: int,
) -> None:
    """The line's pressure targets: what its motion needs in boost, else what is there."""
    if BOOSTED[mode]:
        set_targets(axis, cylinder, constants, gains)
    else:
        axis.supply_target = max(sensor.line_pressure, constants[0].supply_pressure)
        axis.target_ahead = axis.supply_target


@kernel
def join_lines(
    sensors: Records,
    constants: Records,
    axes: Records,
    rail_pressure: float,
    modes: ModeArray,
    serves: IntArray,
    module_home: IntArray,
    actuators: Records,
    modules: Records,
    rail_target: FloatArray,
) -> None:
    """Open, throttle or shut the join valves, and set the rail's target.

    The rail's target is the greatest of the lines that draw on it. The last line to leave shared
    boost stays joined while the rail's pumps coast, which would else burst into a shut rail.
    """
    c = constants[0]
    rail_flow = 0.0
    for k in range(len(modules)):
        rail_flow += modules[k].flow * modules[k].to_rail
    coasting = rail_flow >= IDLE_SHARE * c.servo_pump_flow
    for j in range(len(axes)):
        if joins_rail(j, modes, module_home, serves):
            coasting = False
    rail_target[:] = 0.0
    for j in range(len(axes)):
        axis = axes[j]
        leaves = not joins_rail(j, modes, module_home, serves)
        if leaves and not coasting:
            axis.joined = 0.0
        if axis.joined > 0.0 or not leaves:
            rail_target[0] = max(rail_target[0], axis.supply_target)
            rail_target[1] = max(rail_target[1], axis.target_ahead)
        if leaves:
            actuators[j].join_command = axis.joined
            continue
        drop = rail_pressure - sensors[j].line_pressure
        if abs(drop) < JOINED_DROP:
            axis.joined = 1.0
        lacking = c.line_capacity * (axis.supply_target - sensors[j].line_pressure)
        wanted = max(0.0, axis.line_flow + lacking / (DAMPED * c.switching_time))
        largest, _ = orifice(c.switching_coefficient, max(drop, 1.0), c.laminar_pressure)
        throttle = min(1.0, wanted / largest) if drop > 0.0 else 0.0
        actuators[j].join_command = max(axis.joined, throttle)


@kernel
def is_served(j: int, serves: IntArray) -> bool:
    """Whether any module is in use for actuator j."""
    found = False
    for user in serves:
        found = found or user == j
    return found


@kernel
def look_ahead(
    reference: FloatArray,
    sensors: Records,
    cylinders: Records,
    constants: Records,
    serves: IntArray,
    own_gains: Records,
    axes: Records,
    volume: FloatArray,
) -> None:
    """Flow that boosted lines are about to give, and the oil they give up to each point ahead.

    Flow: A_dir |u| of the demanded speed, leakage, and what the next point of the reference adds
    while the pump follows. volume float64[n, REFERENCE_POINTS] m³: ∫ (A_dir |v| + leakage) dt of
    the reference, by the trapezoidal rule, with moment arms linear about point `AHEAD`.
    """
    c, g = constants[0], own_gains[0]
    spacing = g.preview / AHEAD
    for j in range(len(axes)):
        axis, cylinder = axes[j], cylinders[j]
        if axis.joined == 0.0 and not is_served(j, serves):
            axis.line_flow = 0.0
            volume[j] = 0.0
            continue
        drop = sensors[j].line_pressure - c.tank_pressure
        leakage, _ = orifice(c.leakage_coefficient, drop, c.laminar_pressure)
        cap, rod = cylinder.cap_area, cylinder.rod_area
        axis.line_flow = inlet_area(cap, rod, axis.demand) * abs(axis.demand) + leakage
        before = 0.0
        for k in range(len(reference)):
            if k == 0:
                speed = axis.speed
            elif k == AHEAD:
                speed = axis.speed_ahead
            else:
                way = reference[k, 0, j] - reference[AHEAD, 0, j]
                speed = (axis.arm_ahead + axis.arm_slope_ahead * way) * reference[k, 1, j]
            flow = leakage + abs(speed) * inlet_area(cap, rod, speed)
            if k == 0:
                volume[j, k] = 0.0
            else:
                volume[j, k] = volume[j, k - 1] + 0.5 * spacing * (before + flow)
            if k == 1:
                axis.line_flow += max(0.0, flow - before) * g.pump_rise
            before = flow


@kernel
def coasting_limit(
    volume: FloatArray, coasting: FloatArray, capacity: float, rise: float, rise_ahead: float
) -> float:
    """Largest flow [m³/s] from which a pump can be stopped without filling its line too far.

    From Q it delivers at least Q τ (1 − e^(−t/τ)) up to t. That is not to exceed what is drawn by
    then and what the pressure may rise by: V(t) + C Δp, at each point ahead. volume
    float64[REFERENCE_POINTS] m³, V; coasting, of the same shape, τ (1 − e^(−t/τ)) s; rise: Δp
    [Pa] before point `AHEAD`, rise_ahead from there on.
    """
    limit = np.inf
    for k in range(1, len(volume)):
        room = capacity * (rise if k < AHEAD else rise_ahead)
        limit = min(limit, (volume[k] + room) / coasting[k])
    return limit


@kernel
def pump_demand(
    drawn: float,
    pressure: float,
    target: float,
    target_ahead: float,
    capacity: float,
    volume: FloatArray,
    coasting: FloatArray,
    g: Record,
) -> float:
    """Flow [m³/s] into a line or the rail: what is drawn + k C (p_ref − p), within the limit.

    g: the record of GAINS; the others as in `coasting_limit` and Pa, m³/s, m³/Pa.
    """
    rise = g.allowed_rise + target - pressure
    rise_ahead = g.allowed_rise + target_ahead - pressure
    limit = coasting_limit(volume, coasting, capacity, rise, rise_ahead)
    return min(drawn + capacity * g.pressure_gain * (target - pressure), limit)


@kernel
def feeds_rail(module: Record, home: int, user: int, axes: Records) -> bool:
    """Whether a module in use feeds the rail: lent and switched over, or its line joined."""
    if home == user:
        return axes[user].joined > 0.0
    return module.to_rail > SWITCHED_OVER


@kernel
def rail_demand(
    sensors: Records,
    constants: Records,
    axes: Records,
    rail_pressure: float,
    actuators: Records,
    rail_target: FloatArray,
    volume: FloatArray,
    coasting: FloatArray,
    g: Record,
) -> float:
    """Flow [m³/s] into the rail, of all pumps together: as `pump_demand` for what is joined to it.

    It also feeds what still passes join valves that are closing or throttled.
    """
    c = constants[0]
    drawn, capacity = 0.0, c.rail_capacity
    rail_volume = volume[len(axes)]
    rail_volume[:] = 0.0
    for j in range(len(axes)):
        axis = axes[j]
        if axis.joined > 0.0:
            drawn += axis.line_flow
            rail_volume += volume[j]
            capacity += c.line_capacity
        else:
            through, _ = orifice(
                c.switching_coefficient * actuators[j].join,
                rail_pressure - sensors[j].line_pressure,
                c.laminar_pressure,
            )
            drawn += through
    return pump_demand(
        drawn, rail_pressure, rail_target[0], rail_target[1], capacity, rail_volume, coasting, g
    )


@kernel
def drive_pumps(
    sensors: Records,
    constants: Records,
    axes: Records,
    rail_pressure: float,
    serves: IntArray,
    module_home: IntArray,
    actuators: Records,
    modules: Records,
    rail_target: FloatArray,
    own_gains: Records,
    volume: FloatArray,
    coasting: FloatArray,
) -> None:
    """Flow command of every servo pump, driven ahead of the pump's lag.

    Alone on its line: Q_cmd = Q + λ (Q_ref − Q). The n modules that feed the rail together:
    Q_cmd = Q̄ + λ (Q_ref − ΣQ)/n, with Q̄ their mean flow and ΣQ all that reaches the rail, also
    from pumps that are no longer needed and coast. So they come to share the flow equally at the
    pace of their lag, and the sum does not suffer from it.
    """
    c, g = constants[0], own_gains[0]
    sharing, shared, reaching = 0, 0.0, 0.0
    for k in range(len(modules)):
        module, user = modules[k], serves[k]
        if user < 0:
            reaching += module.flow * module.to_rail
        elif feeds_rail(module, module_home[k], user, axes):
            sharing += 1
            shared += module.flow
    rail_command = 0.0
    if sharing > 0:
        demand = rail_demand(
            sensors, constants, axes, rail_pressure, actuators, rail_target, volume, coasting, g
        )
        rail_command = (shared + g.pump_lead * (demand - shared - reaching)) / sharing
    for k in range(len(modules)):
        module, user = modules[k], serves[k]
        module.lend = 1.0 if user >= 0 and module_home[k] != user else 0.0
        command = 0.0
        if user >= 0 and feeds_rail(module, module_home[k], user, axes):
            command = rail_command
        elif user >= 0 and module.lend == 0.0:
            axis = axes[user]
            demand = pump_demand(
                axis.line_flow,
                sensors[user].line_pressure,
                axis.supply_target,
                axis.target_ahead,
                c.line_capacity,
                volume[user],
                coasting,
                g,
            )
            command = module.flow + g.pump_lead * (demand - module.flow)
        module.flow_command = min(max(command, 0.0), c.servo_pump_flow)
