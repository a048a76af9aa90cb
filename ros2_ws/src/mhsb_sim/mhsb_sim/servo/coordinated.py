"""Coordinated control: valve and servo pumps act on one demand.

The valve opens as far as the measured pressures ask for to make the demanded piston speed. The
servo pumps deliver the very flow that the valves are about to take; the pressure error only
trims. No pump runs faster than it can be stopped before its oil would overfill the line, judged
by the reference ahead; on the rail, pumps that are no longer needed count until they have come to
rest. Lines are charged ahead of a boost (the prepared modes), and a line is joined to the rail
softly: throttled to what it needs until their pressures agree. The oil that charges a line comes
from the main pump, too: it is taken as that can spare it. As the valve goes by what is
measured, no pressure is kept in reserve beyond the plan's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mhsb_model.hydraulics import inlet_area, load_pressure
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED
from mhsb_model.types import FloatArray, IntArray
from mhsb_sim.bound_kernel import bind
from mhsb_sim.circuit.elements import orifice
from mhsb_sim.records import Record, Records
from mhsb_sim.servo.cascade import Servo, joins_rail, piston_demands, servo_of, set_targets
from mhsb_sim.servo.controller import REFERENCE_POINTS, ServoSignals
from mhsb_sim.servo.reference import AHEAD

FINE = 4
"""Looks that a coasting pump is given up to the first point of the reference ahead."""

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

MANIFOLD_LEFT = 0.94
"""Share of P_S in the manifold down to which lines are charged from what is pent up there."""

JOINED_DROP = 1e5
"""Difference of pressure below which a line and the rail are joined fully [Pa]."""

DAMPED = 4.0
"""Time in which a throttled join charges its line, in time constants of the join valve: the
shortest without overshoot."""

IDLE_SHARE = 0.02
"""Share of a pump's flow below which its rail may be shut off: the rest bursts into it."""

SWITCHED_OVER = 0.9
"""Share of a lent pump's flow that has to reach the rail before it counts as feeding it."""


class Pumps(NamedTuple):
    """What the servo pumps are driven by, beside the cascade."""

    gains: Records  # GAINS[1]
    rail_target: FloatArray  # [2] pressure targets of the rail [Pa], as those of an axis
    volume: FloatArray  # [n + 1, REFERENCE_POINTS] as in `look_ahead`; the last row is the rail's
    coasting: FloatArray  # [FINE + REFERENCE_POINTS − 1] as in `coasting_limit`
    spare: FloatArray  # [1] m³/s, what is left for charging lines


class CoordinatedController:
    """Valve and servo pumps on one demand; see the module's text."""

    usual_error = 8e-3

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
        cascade = servo_of(machine, signals, servo)
        cascade.axes["joined"] = circuit.actuators["join"]
        cascade.axes["supply_target"] = signals.sensors["line_pressure"]
        points = np.concatenate([np.arange(FINE) / FINE, np.arange(1, REFERENCE_POINTS)])
        pumps = Pumps(
            gains=own_gains,
            rail_target=np.full(2, signals.rail_pressure[0]),
            volume=np.zeros((machine.joint_count + 1, REFERENCE_POINTS)),
            coasting=-lag * np.expm1(-points * self.preview / (AHEAD * lag)),
            spare=np.zeros(1),
        )
        self._control = bind(control, cascade, pumps)

    def update(self) -> None:
        """Write all commands for the next step."""
        self._control()


@kernel
def control(s: Servo, p: Pumps) -> None:
    """One step of the controller."""
    piston_demands(s)
    for j in range(len(s.axes)):
        open_valve(s.axes[j], s.sensors[j], s.cylinders[j], s.constants, s.actuators[j])
        set_target(s.axes[j], s.sensors[j], s.cylinders[j], s.constants, s.gains, s.modes[j])
    look_ahead(s, p)
    join_lines(s, p.rail_target)
    drive_pumps(s, p)


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


@kernel(inline="always")
def join_lines(s: Servo, rail_target: FloatArray) -> None:
    """Open, throttle or shut the join valves, and set the rail's target.

    The rail's target is the greatest of the lines that draw on it. The last line to leave shared
    boost stays joined while the rail's pumps coast, which would else burst into a shut rail.
    """
    axes, sensors, actuators, modules = s.axes, s.sensors, s.actuators, s.modules
    modes, serves, module_home = s.modes, s.serves, s.module_home
    c = s.constants[0]
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
        drop = s.rail_pressure[0] - sensors[j].line_pressure
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


@kernel(inline="always")
def look_ahead(s: Servo, p: Pumps) -> None:
    """Flow that boosted lines are about to give, and the oil they give up to each point ahead.

    Flow: A_dir |u| of the demanded speed, leakage, and what the next point of the reference adds
    while the pump follows. Oil, p.volume [m³]: ∫ (A_dir |v| + leakage) dt of the reference, by the
    trapezoidal rule, with moment arms linear about point `AHEAD`.
    """
    reference, sensors, cylinders, axes = s.reference, s.sensors, s.cylinders, s.axes
    volume, c, g = p.volume, s.constants[0], p.gains[0]
    spacing = g.preview / AHEAD
    for j in range(len(axes)):
        axis, cylinder = axes[j], cylinders[j]
        if axis.joined == 0.0 and not is_served(j, s.serves):
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
    then and what the pressure may rise by, V(t) + C Δp(t), at each point ahead, and `FINE` times up
    to the first: pressure is highest when the pump has slowed down to what is drawn, soon after.
    volume float64[REFERENCE_POINTS] m³, V at the points; coasting
    float64[FINE + REFERENCE_POINTS − 1] s, τ (1 − e^(−t/τ)) at all these times from 0 on;
    rise: Δp [Pa] now, rise_ahead from point `AHEAD` on, linear in between.
    """
    limit = np.inf
    for k in range(1, FINE):
        share = k / FINE
        room = capacity * (rise + share / AHEAD * (rise_ahead - rise))
        limit = min(limit, (share * volume[1] + room) / coasting[k])
    for k in range(1, len(volume)):
        way = min(k / AHEAD, 1.0)
        room = capacity * (rise + way * (rise_ahead - rise))
        limit = min(limit, (volume[k] + room) / coasting[FINE - 1 + k])
    return limit


@kernel(inline="always")
def pump_demand(
    drawn: float,
    pressure: float,
    target: float,
    target_ahead: float,
    capacity: float,
    volume: FloatArray,
    p: Pumps,
) -> float:
    """Flow [m³/s] into a line or the rail: what is drawn + k C (p_ref − p), within the limit.

    What charges it is taken from p.spare. Arguments as in `coasting_limit`, and Pa, m³/s, m³/Pa.
    """
    g = p.gains[0]
    rise = g.allowed_rise + target - pressure
    rise_ahead = g.allowed_rise + target_ahead - pressure
    limit = coasting_limit(volume, p.coasting, capacity, rise, rise_ahead)
    charge = min(capacity * g.pressure_gain * (target - pressure), p.spare[0])
    p.spare[0] -= max(charge, 0.0)
    return min(drawn + charge, limit)


@kernel
def spare_flow(s: Servo, p: Pumps) -> float:
    """Flow [m³/s] that lines may be charged with; 0 while no pump is in use.

    What cylinders and valves leave of the main pump's, Q_MP − Σ (A_dir |v_ref| + leakage), and
    k C (p − MANIFOLD_LEFT P_S) of the manifold's own oil. Its pressure p is that of the lowest
    line: in N they do not hold theirs above it.
    """
    in_use = False
    for user in s.serves:
        in_use = in_use or user >= 0
    if not in_use:
        return 0.0
    c, g = s.constants[0], p.gains[0]
    left, lowest = c.main_pump_flow, np.inf
    for j in range(len(s.axes)):
        axis, cylinder, line = s.axes[j], s.cylinders[j], s.sensors[j].line_pressure
        leakage, _ = orifice(c.leakage_coefficient, line - c.tank_pressure, c.laminar_pressure)
        area = inlet_area(cylinder.cap_area, cylinder.rod_area, axis.speed)
        left -= area * abs(axis.speed) + leakage
        lowest = min(lowest, line)
    pent_up = c.manifold_capacity * (lowest - MANIFOLD_LEFT * c.supply_pressure)
    return max(0.0, left) + max(0.0, g.pressure_gain * pent_up)


@kernel
def feeds_rail(module: Record, home: int, user: int, axes: Records) -> bool:
    """Whether a module in use feeds the rail: lent and switched over, or its line joined."""
    if home == user:
        return axes[user].joined > 0.0
    return module.to_rail > SWITCHED_OVER


@kernel(inline="always")
def rail_demand(s: Servo, p: Pumps) -> float:
    """Flow [m³/s] into the rail, of all pumps together: as `pump_demand` for what is joined to it.

    It also feeds what still passes join valves that are closing or throttled.
    """
    axes, volume, rail_pressure = s.axes, p.volume, s.rail_pressure[0]
    c = s.constants[0]
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
                c.switching_coefficient * s.actuators[j].join,
                rail_pressure - s.sensors[j].line_pressure,
                c.laminar_pressure,
            )
            drawn += through
    target, ahead = p.rail_target[0], p.rail_target[1]
    return pump_demand(drawn, rail_pressure, target, ahead, capacity, rail_volume, p)


@kernel(inline="always")
def drive_pumps(s: Servo, p: Pumps) -> None:
    """Flow command of every servo pump, driven ahead of the pump's lag.

    Alone on its line: Q_cmd = Q + λ (Q_ref − Q). The n modules that feed the rail together:
    Q_cmd = Q̄ + λ (Q_ref − ΣQ)/n, with Q̄ their mean flow and ΣQ all that reaches the rail, also
    from pumps that are no longer needed and coast. So they come to share the flow equally at the
    pace of their lag, and the sum does not suffer from it.
    """
    axes, modules, serves, module_home = s.axes, s.modules, s.serves, s.module_home
    c, g = s.constants[0], p.gains[0]
    sharing, shared, reaching = 0, 0.0, 0.0
    for k in range(len(modules)):
        module, user = modules[k], serves[k]
        if user < 0:
            reaching += module.flow * module.to_rail
        elif feeds_rail(module, module_home[k], user, axes):
            sharing += 1
            shared += module.flow
    p.spare[0] = spare_flow(s, p)
    rail_command = 0.0
    if sharing > 0:
        demand = rail_demand(s, p)
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
                s.sensors[user].line_pressure,
                axis.supply_target,
                axis.target_ahead,
                c.line_capacity,
                p.volume[user],
                p,
            )
            command = module.flow + g.pump_lead * (demand - module.flow)
        module.flow_command = min(max(command, 0.0), c.servo_pump_flow)
