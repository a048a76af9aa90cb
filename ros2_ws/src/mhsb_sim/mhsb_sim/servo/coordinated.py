"""Coordinated control: valve and servo pumps act on one demand.

The valve opens as far as the measured pressures ask for to make the demanded piston speed. The
servo pumps deliver the very flow that the valves are about to take, plus what charges the oil
along a rate-limited pressure target; the pressure error only trims. Lines are charged ahead of
a boost (the prepared modes), and a line is joined to the rail softly: throttled until their
pressures agree.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mhsb_model.hydraulics import load_pressure
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_sim.circuit_elements import orifice
from mhsb_sim.inverse_dynamics import SCRATCH_WIDTH, link_records
from mhsb_sim.records import Record, Records
from mhsb_sim.servo.cascade import (
    axis_records,
    gain_record,
    joins_rail,
    piston_demands,
    supply_need,
)
from mhsb_sim.servo.controller import ServoSignals

SMALLEST_DROP = 2e4
"""Pressure drop [Pa] that an edge is taken to have at least, so that openings stay moderate."""

IDLE_SHARE = 0.1
"""Share of a pump's flow below which its rail may be shut off."""


class CoordinatedController:
    """Valve and servo pumps on one demand; see the module's text."""

    def __init__(self, machine: Machine, signals: ServoSignals) -> None:
        circuit = signals.circuit
        self.preview: float = machine.config.servo.preview
        self._axes = axis_records(machine)
        self._axes["joined"] = circuit.actuators["join"]
        self._axes["supply_target"] = circuit.pressure[2:-3:3]
        self._rail_target = np.array([circuit.rail_pressure, 0.0])
        gains = gain_record(machine)
        self._cascade = (
            signals.reference,
            signals.sensors,
            machine.arrays.linkage,
            link_records(machine),
            circuit.cylinders,
            circuit.constants,
            gains,
            np.zeros((machine.joint_count, SCRATCH_WIDTH + 1)),
            self._axes,
        )
        self._supply = (
            signals.rail_pressure,
            signals.modes,
            signals.serves,
            circuit.module_home,
            circuit.actuators,
            circuit.modules,
            self._rail_target,
        )

    def update(self) -> None:
        """Write all commands for the next step."""
        control(*self._cascade, *self._supply)


@njit(cache=True, nogil=True)
def control(
    reference: FloatArray,
    sensors: Records,
    linkage: FloatArray,
    links: Records,
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
) -> None:
    """One step of the controller; shapes as in `piston_demands` and ServoSignals.

    rail_target: float64[2], pressure target of the rail [Pa] and its rate [Pa/s].
    """
    piston_demands(reference, sensors, linkage, links, cylinders, constants, gains, scratch, axes)
    for j in range(len(axes)):
        open_valve(axes[j], sensors[j], cylinders[j], constants, actuators[j])
        move_target(axes[j], sensors[j], cylinders[j], constants, gains, modes[j])
    join_lines(
        sensors,
        constants,
        gains,
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
        cylinders,
        constants,
        gains,
        axes,
        rail_pressure[0],
        serves,
        module_home,
        actuators,
        modules,
        rail_target,
    )


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def move_target(
    axis: Record,
    sensor: Record,
    cylinder: Record,
    constants: Records,
    gains: Records,
    mode: int,
) -> None:
    """Lead the line's pressure target towards its need, no faster than `pressure_rate`.

    Out of boost it follows the line's measured pressure, so that the next boost starts from it.
    """
    g = gains[0]
    if mode == Mode.N:
        axis.supply_target = max(sensor.line_pressure, constants[0].supply_pressure)
        axis.target_rate = 0.0
        return
    need = supply_need(axis, cylinder, constants, gains)
    change = g.pressure_rate * g.step
    moved = min(max(need - axis.supply_target, -change), change)
    axis.supply_target += moved
    axis.target_rate = moved / g.step


@njit(cache=True, nogil=True)
def join_lines(
    sensors: Records,
    constants: Records,
    gains: Records,
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
    c, g = constants[0], gains[0]
    rail_flow = 0.0
    for k in range(len(modules)):
        rail_flow += modules[k].flow * modules[k].to_rail
    coasting = rail_flow >= IDLE_SHARE * c.servo_pump_flow
    for j in range(len(axes)):
        if joins_rail(j, modes, module_home, serves):
            coasting = False
    highest, rate = 0.0, 0.0
    for j in range(len(axes)):
        axis = axes[j]
        leaves = not joins_rail(j, modes, module_home, serves)
        if leaves and not coasting:
            axis.joined = 0.0
        if (axis.joined > 0.0 or not leaves) and axis.supply_target > highest:
            highest, rate = axis.supply_target, axis.target_rate
        if leaves:
            actuators[j].join_command = axis.joined
            continue
        drop = rail_pressure - sensors[j].line_pressure
        if abs(drop) < g.join_pressure:
            axis.joined = 1.0
        throttled, _ = orifice(c.switching_coefficient, max(drop, 1.0), c.laminar_pressure)
        throttle = min(1.0, g.join_flow / throttled) if drop > 0.0 else 0.0
        actuators[j].join_command = max(axis.joined, throttle)
    rail_target[0] = highest
    rail_target[1] = rate


@njit(cache=True, nogil=True)
def line_flow(
    axis: Record, sensor: Record, cylinder: Record, constants: Records, gains: Records
) -> float:
    """Flow [m³/s] that a line is about to give: A_dir |u| of the demanded speed, and leakage.

    The reference ahead adds what the speed will have risen by when the pump has followed.
    """
    c, g = constants[0], gains[0]
    inlet = cylinder.cap_area if axis.demand > 0.0 else cylinder.rod_area
    rise = (abs(axis.speed_ahead) - abs(axis.speed)) / max(g.preview, g.step)
    speed = abs(axis.demand) + rise * min(c.servo_pump_lag, g.pump_response)
    leakage, _ = orifice(
        c.leakage_coefficient, sensor.line_pressure - c.tank_pressure, c.laminar_pressure
    )
    return max(0.0, inlet * speed) + leakage


@njit(cache=True, nogil=True)
def feeds_rail(module: Record, home: int, user: int, axes: Records) -> bool:
    """Whether a module in use feeds the rail: lent and switched over, or its line joined."""
    if home == user:
        return axes[user].joined > 0.0
    return module.to_rail > 1.0 - IDLE_SHARE


@njit(cache=True, nogil=True)
def drive_pumps(
    sensors: Records,
    cylinders: Records,
    constants: Records,
    gains: Records,
    axes: Records,
    rail_pressure: float,
    serves: IntArray,
    module_home: IntArray,
    actuators: Records,
    modules: Records,
    rail_target: FloatArray,
) -> None:
    """Flow command of every servo pump: its share of what its line, or the rail, will take.

    Q = line flows + C (dp_ref/dt + k (p_ref − p)), driven ahead of the pump's lag:
    Q_cmd = Q_now + λ (Q − Q_now). All modules on the rail share its flow equally; it also feeds
    what still passes join valves that are closing or throttled.
    """
    c, g = constants[0], gains[0]
    lead = max(1.0, c.servo_pump_lag / g.pump_response)
    drawn = 0.0
    capacity = c.rail_capacity
    for j in range(len(axes)):
        axis = axes[j]
        axis.line_flow = line_flow(axis, sensors[j], cylinders[j], constants, gains)
        if axis.joined > 0.0:
            drawn += axis.line_flow
            capacity += c.line_capacity
        else:
            through, _ = orifice(
                c.switching_coefficient * actuators[j].join,
                rail_pressure - sensors[j].line_pressure,
                c.laminar_pressure,
            )
            drawn += through
    trim = g.pressure_gain * (rail_target[0] - rail_pressure)
    rail_demand = drawn + capacity * (rail_target[1] + trim)
    sharing = 0
    for k in range(len(modules)):
        if serves[k] >= 0 and feeds_rail(modules[k], module_home[k], serves[k], axes):
            sharing += 1
    for k in range(len(modules)):
        module, user = modules[k], serves[k]
        module.lend = 1.0 if user >= 0 and module_home[k] != user else 0.0
        demand = 0.0
        if user >= 0 and feeds_rail(module, module_home[k], user, axes):
            demand = rail_demand / sharing
        elif user >= 0 and module.lend == 0.0:
            axis = axes[user]
            trim = g.pressure_gain * (axis.supply_target - sensors[user].line_pressure)
            demand = axis.line_flow + c.line_capacity * (axis.target_rate + trim)
        command = module.flow + lead * (demand - module.flow)
        module.flow_command = min(max(command, 0.0), c.servo_pump_flow)
