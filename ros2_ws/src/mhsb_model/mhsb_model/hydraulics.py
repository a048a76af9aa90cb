"""Quasi-static limits of a valve-controlled single-rod cylinder.

F > 0 resists extension: F = p_A A − p_B a, with the cap-side area A and the rod-side area a.
K is the flow coefficient of one metering edge, Q = K √Δp. Speeds are of the piston, positive in
extension. Source: paper, Section 2.1, with the asymmetric cylinder worked out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.modes import BOOSTED, ON_RAIL
from mhsb_model.types import FloatArray, ModeArray

LEFT_BY_INERTIA = 0.5
"""Share of the boost margin that inertia leaves to friction and servo."""


@kernel
def extension_speed(
    k: float, cap: float, rod: float, supply: float, tank: float, force: float
) -> float:
    """v = K √((A p_S − a p_T − F)/(A³ + a³)) [m/s]; 0 where the supply cannot extend."""
    drive = cap * supply - rod * tank - force
    if drive <= 0.0:
        return 0.0
    return k * math.sqrt(drive / (cap**3 + rod**3))


@kernel
def retraction_speed(
    k: float, cap: float, rod: float, supply: float, tank: float, force: float
) -> float:
    """v = K √((a p_S − A p_T + F)/(A³ + a³)) [m/s], as a magnitude; 0 where it cannot retract."""
    drive = rod * supply - cap * tank + force
    if drive <= 0.0:
        return 0.0
    return k * math.sqrt(drive / (cap**3 + rod**3))


@kernel
def load_pressure(cap: float, rod: float, tank: float, force: float, direction: float) -> float:
    """p_L = (F + a p_T)/A extending (direction > 0), (−F + A p_T)/a retracting [Pa]."""
    if direction > 0.0:
        return (force + rod * tank) / cap
    return (-force + cap * tank) / rod


@kernel
def valve_margin(k: float, cap: float, rod: float, speed: float) -> float:
    """m(v) = v² (A³ + a³)/(K² A) extending (v > 0), over K² a retracting [Pa].

    The supply pressure beyond p_L that the fully open valve needs to reach the speed v [m/s].
    """
    inlet = cap if speed > 0.0 else rod
    return speed * speed * (cap**3 + rod**3) / (k * k * inlet)


@kernel
def speed_of_drop(k: float, cap: float, rod: float, drop: float, direction: float) -> float:
    """v = K √(Δp A_dir/(A³ + a³)) [m/s], the inverse of `valve_margin`; 0 where Δp ≤ 0 [Pa]."""
    inlet = inlet_area(cap, rod, direction)
    return k * math.sqrt(max(0.0, drop) * inlet / (cap**3 + rod**3))


@kernel
def pressure_against(
    k: float, cap: float, rod: float, tank: float, force: float, speed: float
) -> float:
    """p_L + m(v) [Pa]: load pressure, and the drop over the open valve at the speed v [m/s].

    Speed 0 is judged as a hold against the load: extension where force > 0, retraction otherwise.
    """
    direction = speed if speed != 0.0 else force
    return load_pressure(cap, rod, tank, force, direction) + valve_margin(k, cap, rod, speed)


@kernel
def opposes_motion(force: float, direction: float) -> bool:
    """Whether the load acts against a motion in `direction` (> 0 extension)."""
    return force * direction > 0.0


def cavitates(
    cap: FloatArray,
    rod: FloatArray,
    supply: float,
    tank: float,
    force: FloatArray,
    direction: FloatArray,
) -> np.ndarray:
    """Whether an overrunning load empties the inlet chamber through a matched valve.

    F < −a³ p_S/A² − a p_T extending, F > A³ p_S/a² + A p_T retracting, at any speed. Arrays
    broadcast.
    """
    pulled = force < -(rod**3) * supply / cap**2 - rod * tank
    pushed = force > cap**3 * supply / rod**2 + cap * tank
    return np.where(direction > 0.0, pulled, pushed)


@kernel
def inlet_area(cap: float, rod: float, direction: float) -> float:
    """A_dir: the area that the supply fills, A extending, a retracting [m²]."""
    return cap if direction > 0.0 else rod


class Oil(NamedTuple):
    """What all actuators share; numbers alone, which kernels hand on at no cost, unlike arrays."""

    supply_pressure: float  # Pa
    tank_pressure: float  # Pa
    max_boost_pressure: float  # Pa
    boost_margin: float  # Pa
    main_pump_flow: float  # m³/s
    servo_pump_flow: float  # m³/s
    leakage_flow: float  # m³/s, one valve at the supply pressure


@kernel(borrows=True)
def oil_of(m: MachineArrays) -> Oil:
    """These numbers of a machine."""
    return Oil(
        m.supply_pressure,
        m.tank_pressure,
        m.max_boost_pressure,
        m.boost_margin,
        m.main_pump_flow,
        m.servo_pump_flow,
        m.leakage_flow,
    )


@kernel
def spared_margin(oil: Oil) -> float:
    """Part of the boost margin that the forces of inertia may use up [Pa]."""
    return (1.0 - LEFT_BY_INERTIA) * oil.boost_margin


@kernel
def highest_supply(oil: Oil, modules: int) -> float:
    """Highest supply pressure of an actuator with so many booster modules; P_S with none [Pa]."""
    return oil.max_boost_pressure if modules > 0 else oil.supply_pressure


@kernel
def highest_flow(oil: Oil, modules: int) -> float:
    """n Q_SP, what so many booster modules give an actuator; with none they set no limit [m³/s]."""
    return modules * oil.servo_pump_flow if modules > 0 else math.inf


@kernel
def pressure_to_move(
    oil: Oil, k: float, cap: float, rod: float, force: float, speed: float
) -> float:
    """p_L + m(v) + margin [Pa]: supply pressure at which a cylinder moves, or holds, its load.

    k [m³/(s √Pa)], cap, rod [m²], force [N], speed [m/s] of its piston, as in `pressure_against`.
    """
    return pressure_against(k, cap, rod, oil.tank_pressure, force, speed) + oil.boost_margin


@kernel
def lacks_pressure(
    oil: Oil, k: float, cap: float, rod: float, force: float, speed: float
) -> bool:
    """Whether a cylinder moves (or holds) against its load and P_S is not enough for it."""
    if speed != 0.0 and not opposes_motion(force, speed):
        return False
    return pressure_to_move(oil, k, cap, rod, force, speed) > oil.supply_pressure


@kernel
def boosted_supply(
    oil: Oil, k: float, cap: float, rod: float, force: float, speed: float
) -> float:
    """Pressure [Pa] to which a servo pump charges the line of a boosted cylinder.

    max(P_S, p_L(0), p_L(v) + m(v)) + margin, at most the highest boost pressure: it carries the
    load whichever way the cylinder moves, since it has to be carried at every reversal.
    """
    need = pressure_to_move(oil, k, cap, rod, force, 0.0)
    if speed != 0.0:
        need = max(need, pressure_to_move(oil, k, cap, rod, force, speed))
    return max(oil.supply_pressure, min(need, oil.max_boost_pressure))


@kernel
def rail_pressure(oil: Oil, own: FloatArray, modes: ModeArray) -> float:
    """Pressure [Pa] of the shared rail: the highest of those that draw on it, at least P_S.

    own  float64[n] Pa, `boosted_supply` of each actuator; what is not boosted is not looked at
    """
    highest = oil.supply_pressure
    for j in range(len(modes)):
        if ON_RAIL[modes[j]]:
            highest = max(highest, own[j])
    return highest


@kernel
def supply_in(oil: Oil, mode: int, own: float, rail: float) -> float:
    """Supply pressure [Pa] of an actuator in its mode: P_S, its own boosted one, or the rail's."""
    if ON_RAIL[mode]:
        return rail
    return own if BOOSTED[mode] else oil.supply_pressure


@kernel
def leakage_at(rated_flow: float, rated: float, tank: float, supply: float) -> float:
    """q_leak √((p − p_T)/(P_S − p_T)) [m³/s] of a valve at the supply pressure p: an orifice.

    It leaks rated_flow [m³/s] at the rated supply pressure P_S; pressures in Pa.
    """
    return rated_flow * math.sqrt(max(0.0, supply - tank) / (rated - tank))


@kernel
def leakage(oil: Oil, supply: float) -> float:
    """`leakage_at` of each valve [m³/s] at a supply pressure [Pa]."""
    return leakage_at(oil.leakage_flow, oil.supply_pressure, oil.tank_pressure, supply)


@kernel
def flow_for_pistons(oil: Oil, own: FloatArray, modes: ModeArray) -> float:
    """Q_MP less what all valves leak in these modes [m³/s]; `own` as in `rail_pressure`."""
    rail = rail_pressure(oil, own, modes)
    flow = oil.main_pump_flow
    for j in range(len(modes)):
        if BOOSTED[modes[j]]:
            flow -= leakage(oil, supply_in(oil, modes[j], own[j], rail))
        else:
            flow -= oil.leakage_flow
    return flow


@kernel(borrows=True)
def required_pressure(m: MachineArrays, j: int, force: float, speed: float) -> float:
    """`pressure_to_move` of actuator j [Pa]."""
    k, cap, rod = m.valve_coefficient[j], m.cap_area[j], m.rod_area[j]
    return pressure_to_move(oil_of(m), k, cap, rod, force, speed)


@kernel(borrows=True)
def needs_boost(m: MachineArrays, j: int, force: float, speed: float) -> bool:
    """`lacks_pressure` of actuator j."""
    k, cap, rod = m.valve_coefficient[j], m.cap_area[j], m.rod_area[j]
    return lacks_pressure(oil_of(m), k, cap, rod, force, speed)


@kernel
def required_pressures(m: MachineArrays, force: FloatArray, speed: FloatArray) -> FloatArray:
    """`required_pressure` of all actuators, float64[k, n] Pa, for force and speed of that shape."""
    pressure = np.empty(force.shape)
    for i in range(force.shape[0]):
        for j in range(force.shape[1]):
            pressure[i, j] = required_pressure(m, j, force[i, j], speed[i, j])
    return pressure
