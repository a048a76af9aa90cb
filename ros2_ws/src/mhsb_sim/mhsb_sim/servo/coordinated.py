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

import math

from mhsb_model.arm_reports import Estimate
from mhsb_model.hydraulics import inlet_area, load_pressure
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED, ON_RAIL
from mhsb_model.types import IntArray
from mhsb_sim.bound_kernel import bind
from mhsb_sim.circuit.elements import orifice
from mhsb_sim.records import Record, Records
from mhsb_sim.servo.cascade import (
    POSITION_SHARE,
    Servo,
    joins_rail,
    piston_demands,
    servo_of,
    set_targets,
)
from mhsb_sim.servo.controller import ServoSignals
from mhsb_sim.servo.estimates import estimates_of
from mhsb_sim.servo.line_estimate import SHUT, weigh_lines
from mhsb_sim.servo.servo_pumps import (
    Pumps,
    drive_pumps,
    feeds_rail,
    look_ahead,
    pumps_of,
    spare_flow,
    watch_draws,
)
from mhsb_sim.servo.valve_estimate import Valves, inverse, learn, valves_of

SMALLEST_DROP = 2e4
"""Pressure drop [Pa] that an edge is taken to have at least, so that openings stay moderate."""

JOINED_DROP = 1e5
"""Difference of pressure below which a line and the rail are joined fully [Pa]."""

DAMPED = 4.0
"""Time in which a throttled join charges its line, in time constants of the join valve: the
shortest without overshoot."""

ONE_PUMP = 0.8
"""Share of a pump's flow up to which a line can do without the rail before its mode ends; once shut
off it stays so up to all of it."""

LAG_BORNE = 0.9
"""Phase [rad] that a force loop may lose at ω_F: it is left with 38 degrees of margin."""

CATCHING_UP = 1.1
"""Share of the reference's speed that a piston may always be told."""

IDLE_SHARE = 0.02
"""Share of a pump's flow below which its rail may be shut off: the rest bursts into it."""


class CoordinatedController:
    """Valve and servo pumps on one demand; see the module's text."""

    usual_error = 3e-3

    def __init__(self, machine: Machine, signals: ServoSignals) -> None:
        servo = machine.config.servo.coordinated
        self.preview: float = servo.preview
        cascade = servo_of(machine, signals, servo, learns=True)
        cascade.axes["joined"] = signals.circuit.actuators["join"]
        cascade.axes["supply_target"] = signals.sensors["line_pressure"]
        pumps = pumps_of(machine, signals)
        valves = valves_of(machine.joint_count)
        self._learnt = machine.actuator_names, cascade.load, valves, pumps.lines, pumps.drives
        self._control = bind(control, cascade, valves, pumps)

    def update(self) -> None:
        """Write all commands for the next step."""
        self._control()

    @property
    def estimates(self) -> list[Estimate]:
        """What has been learnt of the machine so far."""
        return estimates_of(*self._learnt)


@kernel(borrows=True)
def control(s: Servo, v: Valves, p: Pumps) -> None:
    """One step of the controller."""
    piston_demands(s)
    for j in range(len(s.axes)):
        axis, sensor, cylinder = s.axes[j], s.sensors[j], s.cylinders[j]
        force = sensor.cap_pressure * cylinder.cap_area - sensor.rod_pressure * cylinder.rod_area
        learn(v, j, axis.speed, sensor.length, force, axis.stiffness, s.gains[0].step)
        open_valve(axis, sensor, cylinder, s.constants, s.actuators[j], v.records[j])
        set_target(axis, sensor, cylinder, s.constants, s.gains, s.modes[j])
    weigh_lines(s, p.lines)
    look_ahead(s, p)
    watch_draws(s, p)
    keep_up(s, p)
    p.spare[0] = spare_flow(s, p)
    join_lines(s, p)
    drive_pumps(s, p)
    heed_delay(s, p)


@kernel(borrows=True)
def heed_delay(s: Servo, p: Pumps) -> None:
    """Force loops no faster than what is late bears, ω_F T ≤ LAG_BORNE c, and k_p with them.

    T: from a measurement to what the valve makes of it, a step, the spool's lag and the commands'
    delay as it is learnt; c: softness of the oil, where it is stiffer than the machine file's.
    """
    own, step = p.drives.record[0], s.gains[0].step
    late = step + s.gains[0].valve_lag + own.delay * own.step
    most = LAG_BORNE * min(p.lines.believed[0], 1.0) / late
    for j in range(len(s.axes)):
        axis = s.axes[j]
        axis.force_bandwidth = min(axis.fastest_force, most)
        axis.position_gain = min(axis.fastest_position, POSITION_SHARE * axis.force_bandwidth)


@kernel(borrows=True)
def open_valve(
    axis: Record,
    sensor: Record,
    cylinder: Record,
    constants: Records,
    actuator: Record,
    valve: Record,
) -> None:
    """Opening x that makes dF/dt = k_h (u − v) at the measured pressures, both edges counted.

    x = u/G, G = K [A β/V_A S(Δp_A) + a β/V_B S(Δp_B)]/k_h in extension, with S the orifice's law,
    for the valve that the machine file has; what is learnt of it is put right by `inverse`.
    Where the line does not carry the load, p_line < p_L of the measured force, the valve stays
    shut: opened, it would let the load down. A chamber that still holds more than the line from
    a motion the other way is no such case, it only gives off what it was compressed by.
    """
    c = constants[0]
    k, cap, rod = cylinder.valve_coefficient, cylinder.cap_area, cylinder.rod_area
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
    inlet, _ = orifice(k, max(inlet_drop, 0.0), c.laminar_pressure)
    outlet, _ = orifice(k, max(outlet_drop, 0.0), c.laminar_pressure)
    smallest, _ = orifice(k, SMALLEST_DROP, c.laminar_pressure)
    gain = inlet_gain * max(inlet, smallest) + outlet_gain * max(outlet, smallest)
    valve.speed_gain = gain / axis.stiffness
    opening = inverse(valve, axis.demand)
    gate = min(max((sensor.line_pressure - carried) / c.laminar_pressure, 0.0), 1.0)
    actuator.valve_command = gate * min(max(opening, -1.0), 1.0)
    valve.opening = actuator.valve_command if gate == 1.0 else 0.0
    held = gate < 1.0 or abs(opening) >= 1.0 or abs(axis.demand) >= axis.deliverable
    axis.bound = 1.0 if held else 0.0


@kernel(borrows=True)
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
def keep_up(s: Servo, p: Pumps) -> None:
    """Write the piston speeds that the pumps of boosted lines keep up with, from the next step on.

    (n Q_max − leakage − what others on the rail draw)/A_dir, with n pumps that feed the line or the
    rail. What a line gives beyond that it loses in pressure, and pumps at full speed burst into it
    as soon as its piston has caught up.
    """
    axes, full = s.axes, s.constants[0].servo_pump_flow
    pumps, shared = 0, 0.0
    for k in range(len(s.modules)):
        if s.serves[k] >= 0 and feeds_rail(s.modules[k], s.module_home[k], s.serves[k], axes):
            pumps += 1
    for j in range(len(axes)):
        if axes[j].joined > 0.0:
            shared += drawn_by(axes[j], s.cylinders[j]) + p.lines.believed[1 + j] * axes[j].leakage
    for j in range(len(axes)):
        axis, cylinder = axes[j], s.cylinders[j]
        if axis.line_flow == 0.0:
            axis.deliverable = math.inf
            continue
        left = full - p.lines.believed[1 + j] * axis.leakage
        if axis.joined > 0.0:
            left = pumps * full - shared + drawn_by(axis, cylinder)
        area = inlet_area(cylinder.cap_area, cylinder.rod_area, axis.demand)
        axis.deliverable = max(left / area, CATCHING_UP * abs(axis.speed))


@kernel
def drawn_by(axis: Record, cylinder: Record) -> float:
    """Flow [m³/s] that the reference's speed takes from a line."""
    return inlet_area(cylinder.cap_area, cylinder.rod_area, axis.speed) * abs(axis.speed)


@kernel(inline="always")
def join_lines(s: Servo, p: Pumps) -> None:
    """Open, throttle or shut the join valves, and set the rail's target.

    The rail's target is the greatest of the lines that draw on it. The last line to leave shared
    boost stays joined while the rail's pumps coast, which would else burst into a shut rail. One
    that needs less pressure than others is shut off as soon as it is known to leave, if one pump
    suffices for it at the pressure that it needs, so that none of theirs is left in it; and while
    its valve shuts, the rail does not rise to where more than the line draws would pass. What
    charges a line through its valve is taken from p.spare.
    """
    axes, sensors, actuators, modules = s.axes, s.sensors, s.actuators, s.modules
    modes, serves, module_home, rail_target = s.modes, s.serves, s.module_home, p.rail_target
    c, rail_pressure = s.constants[0], s.rail_pressure[0]
    rail_flow = 0.0
    for k in range(len(modules)):
        rail_flow += modules[k].flow * modules[k].to_rail
    coasting, highest = rail_flow >= IDLE_SHARE * c.servo_pump_flow, 0.0
    for j in range(len(axes)):
        if joins_rail(j, modes, module_home, serves):
            coasting = False
        if axes[j].joined > 0.0 and BOOSTED[modes[j]]:
            highest = max(highest, axes[j].supply_target)
    bearable = math.inf
    rail_target[:] = 0.0
    for j in range(len(axes)):
        axis = axes[j]
        leaves = not joins_rail(j, modes, module_home, serves)
        shed = axis.supply_target < highest - JOINED_DROP and not ON_RAIL[s.modes_ahead[j]]
        if shed:
            drop = axis.supply_target - c.tank_pressure
            leakage, _ = orifice(c.leakage_coefficient, drop, c.laminar_pressure)
            more = p.lines.believed[1 + j] * (axis.leakage - leakage)
            most = ONE_PUMP if axis.joined > 0.0 else 1.0
            shed = axis.line_flow - more < most * c.servo_pump_flow
        leaves = leaves or shed
        if leaves and (shed or not coasting):
            axis.joined = 0.0
        if axis.joined > 0.0 or not leaves:
            rail_target[0] = max(rail_target[0], axis.supply_target)
            rail_target[1] = max(rail_target[1], axis.target_ahead)
        if leaves:
            actuators[j].join_command = axis.joined
            if axis.joined == 0.0 and actuators[j].join > SHUT:
                cylinder = s.cylinders[j]
                area = inlet_area(cylinder.cap_area, cylinder.rod_area, axis.demand)
                drawn = axis.leakage + area * abs(axis.demand)
                passing = drawn / (c.switching_coefficient * actuators[j].join)
                bearable = min(bearable, axis.supply_target + passing * passing)
            continue
        drop = rail_pressure - sensors[j].line_pressure
        if abs(drop) < JOINED_DROP:
            axis.joined = 1.0
        lacking = c.line_capacity * (axis.supply_target - sensors[j].line_pressure)
        charge = min(max(0.0, lacking / (DAMPED * c.switching_time)), p.spare[0])
        own = c.servo_pump_flow if has_own_pump(j, module_home, serves) else 0.0
        largest, _ = orifice(c.switching_coefficient, max(drop, 1.0), c.laminar_pressure)
        throttle = 0.0
        if drop > 0.0:
            throttle = min(1.0, (max(0.0, axis.line_flow - own) + charge) / largest)
            p.spare[0] -= charge
        actuators[j].join_command = max(axis.joined, throttle)
    if bearable == math.inf:
        p.rail_before[0] = rail_pressure
    bearable = max(bearable, p.rail_before[0])
    rail_target[0] = min(rail_target[0], bearable)
    rail_target[1] = min(rail_target[1], bearable)


@kernel(borrows=True)
def has_own_pump(j: int, module_home: IntArray, serves: IntArray) -> bool:
    """Whether the module of actuator j's own line serves it."""
    found = False
    for k in range(len(serves)):
        found = found or (serves[k] == j and module_home[k] == j)
    return found
