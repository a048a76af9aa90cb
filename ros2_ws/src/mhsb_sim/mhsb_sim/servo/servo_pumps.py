"""The servo pumps of coordinated control: how much each is to deliver.

They deliver the very flow that the valves are about to take; the pressure error only trims. No
pump runs faster than it can be stopped before its oil would overfill the line, judged by the
reference ahead: where it gives no more than what is drawn, by what is known of its lag and by
leakage that may be less, and where it charges a line beyond that, by a pump that may be slower and
later, and a stiffer line, too. What is told now acts late: all goes by the flow and the oil that
are there by then. On the rail, pumps that are no longer needed count until they have come to rest.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.hydraulics import inlet_area, pressure_against
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED
from mhsb_model.types import FloatArray, IntArray
from mhsb_sim.circuit.elements import orifice
from mhsb_sim.records import Record, Records
from mhsb_sim.servo.cascade import Servo
from mhsb_sim.servo.coasting import FINE, coasting_limit, coasting_volumes
from mhsb_sim.servo.controller import REFERENCE_POINTS, ServoSignals
from mhsb_sim.servo.draw_estimate import drawn_less, draws_of, observe
from mhsb_sim.servo.line_estimate import CLEAR, SHUT, Lines, lines_of
from mhsb_sim.servo.pump_estimate import Drives, drives_of, follow_drives
from mhsb_sim.servo.reference import AHEAD

AT_LEAST = 0.15
"""Share of what a line lacks that is charged however little is known of line and pump."""

DOUBTS = 1.5
"""Standard deviations by which charging reckons with less leakage, stiffer oil and a longer lag of
pumps."""

GAINS = np.dtype(
    [
        ("preview", "f8"),  # s
        ("bandwidth", "f8"),  # 1/s, λ/τ
        ("pressure_gain", "f8"),  # k, 1/s
        ("pump_rise", "f8"),  # share of the way to the next point for a pump's response
        ("allowed_rise", "f8"),  # Pa, above the target while a pump coasts
        ("fed_below", "f8"),  # Pa, up to where the manifold may feed a line, too
    ]
)

LEAST_SOFT = 0.3
"""Share of what a line takes to be compressed that charging reckons with at least."""

MANIFOLD_LEFT = 0.94
"""Share of P_S in the manifold down to which lines are charged from what is pent up there."""

KEPT = 2e5
"""Pressure beyond p_L + m(v) that is left in the manifold to what moves in N [Pa]: friction, and a
reserve at which the guard does not act."""

SWITCHED_OVER = 0.9
"""Share of a lent pump's flow that has to reach the rail before it counts as feeding it."""


class Pumps(NamedTuple):
    """What the servo pumps are driven by, beside the cascade."""

    gains: Records  # GAINS[1]
    rail_target: FloatArray  # [2] pressure targets of the rail [Pa], as those of an axis
    rail_before: FloatArray  # [1] Pa, its pressure before the last line began to leave it
    volume: FloatArray  # [n + 1, REFERENCE_POINTS] as in `look_ahead`; the last row is the rail's
    coasting: FloatArray  # [FINE + REFERENCE_POINTS − 1] as in `coasting_limit`
    slow: FloatArray  # likewise, of pumps that stop later than the machine file's
    spare: FloatArray  # [1] m³/s, what is left for charging lines
    lines: Lines
    doubt: FloatArray  # [n + 1] m³/s, of what lines leak; the last one is the rail's
    drives: Drives
    draws: Records  # DRAW[n + 1], the last row is the rail's
    looks: FloatArray  # [FINE + REFERENCE_POINTS − 1] s, times ahead of `coasting`


def pumps_of(machine: Machine, signals: ServoSignals) -> Pumps:
    """The pumps of a machine at rest."""
    servo, oil, n = machine.config.servo.coordinated, machine.config.circuit, machine.joint_count
    lag, preview = oil.servo_pump_lag, servo.preview
    gains = np.zeros(1, GAINS)
    gains["preview"] = preview
    spin_up = signals.circuit.constants["servo_pump_flow"] / oil.servo_pump_slew
    gains["bandwidth"] = 1.0 / (servo.pump_response * spin_up)
    gains["pump_rise"] = np.minimum(
        1.0, AHEAD / (np.maximum(1.0 / lag, gains["bandwidth"]) * preview)
    )
    gains["pressure_gain"] = servo.pressure_gain / lag
    gains["allowed_rise"] = servo.allowed_rise
    gains["fed_below"] = signals.circuit.constants["supply_pressure"] + CLEAR
    points = np.concatenate([np.arange(FINE) / FINE, np.arange(1, REFERENCE_POINTS)])
    full_flow = float(signals.circuit.constants["servo_pump_flow"][0])
    step, count = machine.config.simulation.step, len(signals.circuit.modules)
    pumps = Pumps(
        gains=gains,
        rail_target=np.full(2, signals.rail_pressure[0]),
        rail_before=np.full(1, signals.rail_pressure[0]),
        volume=np.zeros((n + 1, REFERENCE_POINTS)),
        coasting=np.zeros(len(points)),
        slow=np.zeros(len(points)),
        spare=np.zeros(1),
        lines=lines_of(n),
        doubt=np.zeros(n + 1),
        drives=drives_of(lag, step, full_flow, oil.servo_pump_slew, count),
        draws=draws_of(n),
        looks=points * preview / AHEAD,
    )
    foresee(pumps)
    return pumps


@kernel(borrows=True)
def foresee(p: Pumps) -> None:
    """Write how pumps coast, by what is known of their lag and their commands' delay."""
    own = p.drives.record[0]
    delay, later = own.delay * own.step, (own.latest - own.delay) * own.step
    coasting_volumes(own.lag, delay, 0.0, p.looks, p.coasting)
    coasting_volumes((1.0 + DOUBTS * own.deviation) * own.lag, delay, later, p.looks, p.slow)


@kernel(borrows=True)
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
    while the pump follows. Oil, p.volume [m³]: ∫ (A_dir |v| + leakage) dt + A_dir ΔF/k_h of the
    reference, by the trapezoidal rule, with moment arms linear about point `AHEAD`; ΔF compresses
    the chamber, once the piston sets out. The first is what the flow of now draws up to point 1.
    """
    reference, cylinders, axes = s.reference, s.cylinders, s.axes
    volume, g = p.volume, p.gains[0]
    spacing = g.preview / AHEAD
    for j in range(len(axes)):
        axis, cylinder = axes[j], cylinders[j]
        if axis.joined == 0.0 and not is_served(j, s.serves):
            axis.line_flow = 0.0
            volume[j] = 0.0
            continue
        leakage = p.lines.believed[1 + j] * axis.leakage
        p.doubt[j] = DOUBTS * math.sqrt(p.lines.covariance[1 + j, 1 + j]) * axis.leakage
        cap, rod = cylinder.cap_area, cylinder.rod_area
        pressed = (axis.force_ahead - axis.force) / axis.stiffness
        pressed *= cap if axis.speed_ahead > 0.0 else -rod
        axis.line_flow = told_flow(axis, cylinder) + leakage
        before, moving = 0.0, 0
        for k in range(1, AHEAD + 1):
            moving += 1 if reference[k, 1, j] != 0.0 else 0
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
                volume[j, k] = spacing * flow
            else:
                drawn = volume[j, k - 1] if k > 1 else 0.0
                volume[j, k] = drawn + 0.5 * spacing * (before + flow)
                moves = k <= AHEAD and reference[k, 1, j] != 0.0
                volume[j, k] += pressed / moving if moves else 0.0
            if k == 1:
                axis.line_flow += max(0.0, flow - before) * g.pump_rise
            before = flow


@kernel(inline="always")
def watch_draws(s: Servo, p: Pumps) -> None:
    """Observe what lines draw, and take what they draw less than told off what they are about to.

    All that is joined to the rail is one line with it.
    """
    axes, draws, lines, own, rail = s.axes, p.draws, p.lines, p.drives.record[0], s.rail_pressure[0]
    c, g, squeeze, n = s.constants[0], p.gains[0], lines.believed[0], len(s.axes)
    lag = s.gains[0].valve_lag + own.delay * own.step
    supplied = lines.fed[n, 0] - c.bleed_conductance * (rail - c.tank_pressure)
    joined_told, capacity, alone = 0.0, squeeze * c.rail_capacity, rail > g.fed_below
    line_capacity = squeeze * c.line_capacity
    for j in range(n):
        axis, line, shut = axes[j], s.sensors[j].line_pressure, s.actuators[j].join < SHUT
        told = told_flow(axis, s.cylinders[j])
        own_supply = lines.fed[j, 0] - lines.believed[1 + j] * axis.leakage
        if axis.joined > 0.0:
            supplied += own_supply
            joined_told += told
            capacity += line_capacity
        alone = alone and (shut or axis.joined > 0.0)
        own_alone = shut and line > g.fed_below and axis.line_flow > 0.0
        observe(draws[j], line, own_supply, told, line_capacity, lag, own.step, own_alone)
        if own_alone:
            axis.line_flow -= min(drawn_less(draws[j], axis.supply_target), told)
    observe(draws[n], rail, supplied, joined_told, capacity, lag, own.step, alone)


@kernel
def told_flow(axis: Record, cylinder: Record) -> float:
    """Flow [m³/s] that a piston is told to take, A_dir |u|; against the motion it seldom does.

    Such a demand is that of a piston which is held up, by a valve whose overlap is not known yet.
    """
    motion = axis.speed_ahead if axis.speed_ahead != 0.0 else axis.speed
    if axis.demand * motion < 0.0:
        return 0.0
    return inlet_area(cylinder.cap_area, cylinder.rod_area, axis.demand) * abs(axis.demand)


@kernel(inline="always")
def pump_demand(
    drawn: float,
    pressure: float,
    target: float,
    target_ahead: float,
    capacity: float,
    volume: FloatArray,
    pending: float,
    doubt: float,
    p: Pumps,
) -> float:
    """Flow [m³/s] into a line or the rail: what is drawn + k C (p_ref − p), within the limit.

    p is the pressure when what is told now begins to act. What is more than drawn is within the
    limit of a slow pump on a stiff line that leaks less, too. A line that the manifold may feed as
    well gets what is drawn and AT_LEAST of what it lacks however little is known of its leakage:
    that shows only once its pump alone feeds it.
    What charges it is taken from p.spare. Arguments as in `coasting_limit`, and Pa, m³/s, m³/Pa.
    """
    g = p.gains[0]
    rise = g.allowed_rise + target - pressure
    rise_ahead = g.allowed_rise + target_ahead - pressure
    spacing = g.preview / AHEAD
    limit = coasting_limit(volume, p.coasting, capacity, rise, rise_ahead, pending, doubt, spacing)
    squeeze = p.lines.believed[0]
    stiff = capacity * max(1.0 - DOUBTS * math.sqrt(p.lines.covariance[0, 0]) / squeeze, LEAST_SOFT)
    cautious = coasting_limit(volume, p.slow, stiff, rise, rise_ahead, pending, doubt, spacing)
    own = p.drives.record[0]
    filled = pending - drawn * own.delay * own.step
    lacking = g.pressure_gain * (capacity * (target - pressure) - filled)
    charge = min(lacking, p.spare[0])
    least = AT_LEAST * charge
    if pressure < min(target, g.fed_below):
        sure = coasting_limit(volume, p.coasting, capacity, rise, rise_ahead, pending, 0.0, spacing)
        limit = max(limit, min(drawn + least, sure))
    charge = min(charge, max(cautious - drawn, least))
    p.spare[0] -= max(charge, 0.0)
    return min(drawn + charge, limit)


@kernel(borrows=True)
def spare_flow(s: Servo, p: Pumps) -> float:
    """Flow [m³/s] that lines may be charged with; 0 while no pump is in use.

    What cylinders and valves leave of the main pump's, Q_MP − Σ (A_dir |v_ref| + leakage), and
    k C (p − p_kept) of the manifold's own oil, down to MANIFOLD_LEFT P_S and not below what moves
    in N needs. Its pressure p is that of the lowest line: in N they do not hold theirs above it.
    """
    in_use = False
    for user in s.serves:
        in_use = in_use or user >= 0
    if not in_use:
        return 0.0
    c, g = s.constants[0], p.gains[0]
    left, lowest, kept = c.main_pump_flow, np.inf, MANIFOLD_LEFT * c.supply_pressure
    for j in range(len(s.axes)):
        axis, cylinder, line = s.axes[j], s.cylinders[j], s.sensors[j].line_pressure
        area = inlet_area(cylinder.cap_area, cylinder.rod_area, axis.speed)
        left -= area * abs(axis.speed) + p.lines.believed[1 + j] * axis.leakage
        lowest = min(lowest, line)
        if not BOOSTED[s.modes[j]] and axis.speed != 0.0:
            force = axis.force + axis.bias
            needed = pressure_against(
                cylinder.valve_coefficient, cylinder.cap_area, cylinder.rod_area, c.tank_pressure,
                force, axis.speed,
            )  # fmt: skip
            kept = max(kept, min(needed + KEPT, c.supply_pressure))
    pent_up = c.manifold_capacity * (lowest - kept)
    return max(0.0, left) + max(0.0, g.pressure_gain * pent_up)


@kernel(borrows=True)
def feeds_rail(module: Record, home: int, user: int, axes: Records) -> bool:
    """Whether a module in use feeds the rail: lent and switched over, or its line joined."""
    if home == user:
        return axes[user].joined > 0.0
    return module.to_rail > SWITCHED_OVER


@kernel(inline="always")
def rail_demand(s: Servo, p: Pumps, pending: float) -> float:
    """Flow [m³/s] into the rail, of all pumps together: as `pump_demand` for what is joined to it.

    It also feeds what still passes join valves that are closing or throttled. pending: oil [m³]
    that comes whatever is told now.
    """
    axes, volume, rail_pressure = s.axes, p.volume, s.rail_pressure[0]
    c = s.constants[0]
    drawn, capacity = 0.0, c.rail_capacity
    rail_volume = volume[len(axes)]
    rail_volume[:] = 0.0
    p.doubt[len(axes)] = 0.0
    for j in range(len(axes)):
        axis = axes[j]
        if axis.joined > 0.0:
            drawn += axis.line_flow
            rail_volume += volume[j]
            p.doubt[len(axes)] += p.doubt[j]
            capacity += c.line_capacity
        else:
            through, _ = orifice(
                c.switching_coefficient * s.actuators[j].join,
                rail_pressure - s.sensors[j].line_pressure,
                c.laminar_pressure,
            )
            drawn += through
    target, ahead = p.rail_target[0], p.rail_target[1]
    drawn -= min(drawn_less(p.draws[len(axes)], target), drawn)
    return pump_demand(
        drawn,
        rail_pressure,
        target,
        ahead,
        p.lines.believed[0] * capacity,
        rail_volume,
        pending,
        p.doubt[len(axes)],
        p,
    )


@kernel(inline="always")
def drive_pumps(s: Servo, p: Pumps) -> None:
    """Flow command of every servo pump, driven ahead of the pump's lag.

    Alone on its line: Q_cmd = Q + λ (Q_ref − Q). The n modules that feed the rail together:
    Q_cmd = Q̄ + λ (Q_ref − ΣQ)/n, with Q̄ their mean flow and ΣQ all that reaches the rail, also
    from pumps that are no longer needed and coast. So they come to share the flow equally at the
    pace of their lag, and the sum does not suffer from it. Q are the flows when the command acts.
    """
    axes, modules, serves, module_home = s.axes, s.modules, s.serves, s.module_home
    c, g, drives = s.constants[0], p.gains[0], p.drives
    if follow_drives(drives, modules):
        foresee(p)
    lead = max(1.0, g.bandwidth * drives.record[0].lag)
    sharing, shared, reaching, pending = 0, 0.0, 0.0, 0.0
    for k in range(len(modules)):
        module, user = modules[k], serves[k]
        if user < 0:
            reaching += drives.flow[k] * module.to_rail
            pending += drives.pending[k] * module.to_rail
        elif feeds_rail(module, module_home[k], user, axes):
            sharing += 1
            shared += drives.flow[k]
            pending += drives.pending[k]
    rail_command = 0.0
    if sharing > 0:
        demand = rail_demand(s, p, pending)
        rail_command = (shared + lead * (demand - shared - reaching)) / sharing
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
                p.lines.believed[0] * c.line_capacity,
                p.volume[user],
                drives.pending[k],
                p.doubt[user],
                p,
            )
            command = drives.flow[k] + lead * (demand - drives.flow[k])
        module.flow_command = min(max(command, 0.0), c.servo_pump_flow)
