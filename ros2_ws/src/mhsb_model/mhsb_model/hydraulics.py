"""Quasi-static limits of a valve-controlled single-rod cylinder.

Symbols: cap-side area A and rod-side area a [m²], supply pressure p_S and tank pressure p_T [Pa].
The piston force F = p_A A − p_B a [N] is positive if the load resists extension. Piston speeds v
[m/s] are positive in extension. K [m³/(s √Pa)] is the flow coefficient of one metering edge of the
valve, Q = K √Δp.

Source: paper, Section 2.1, extended to the unequal areas of the cylinder.
"""

import math
from typing import NamedTuple, TypeVar

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.modes import BOOSTED_MODES, RAIL_MODES
from mhsb_model.types import FloatArray, ModeArray

FloatOrArray = TypeVar("FloatOrArray", float, FloatArray)

MARGIN_SHARE_WITHOUT_INERTIA = 0.5
"""Share of the boost margin that is reserved for friction and control [-]; inertia may use the
rest."""


@kernel
def compute_extension_speed(
    k: float, cap: float, rod: float, supply: float, tank: float, force: float
) -> float:
    """Compute the speed at which a fully open valve extends the piston.

        v = K √((A p_S − a p_T − F) / (A³ + a³))

    Args:
        k: Valve coefficient K [m³/(s √Pa)].
        cap: Cap-side area A [m²].
        rod: Rod-side area a [m²].
        supply: Supply pressure p_S [Pa].
        tank: Tank pressure p_T [Pa].
        force: Piston force F, positive if it resists extension [N].

    Returns:
        Speed [m/s]; 0 if the supply pressure cannot extend the piston.
    """
    drive = cap * supply - rod * tank - force
    if drive <= 0.0:
        return 0.0
    return k * math.sqrt(drive / (cap**3 + rod**3))


@kernel
def compute_retraction_speed(
    k: float, cap: float, rod: float, supply: float, tank: float, force: float
) -> float:
    """Compute the speed at which a fully open valve retracts the piston.

        v = K √((a p_S − A p_T + F) / (A³ + a³))

    Args:
        k: Valve coefficient K [m³/(s √Pa)].
        cap: Cap-side area A [m²].
        rod: Rod-side area a [m²].
        supply: Supply pressure p_S [Pa].
        tank: Tank pressure p_T [Pa].
        force: Piston force F, positive if it resists extension [N].

    Returns:
        Magnitude of the speed, not negative [m/s]; 0 if the supply pressure cannot retract the
        piston.
    """
    return compute_extension_speed(k, rod, cap, supply, tank, -force)


@kernel
def load_pressure(cap: float, rod: float, tank: float, force: float, direction: float) -> float:
    """Compute the load pressure: the supply pressure that balances a load at rest.

        p_L = (F + a p_T) / A     extending
        p_L = (−F + A p_T) / a    retracting

    At rest the valve has no pressure drop, and the return side has tank pressure.

    Args:
        cap: Cap-side area A [m²].
        rod: Rod-side area a [m²].
        tank: Tank pressure p_T [Pa].
        force: Piston force F, positive if it resists extension [N].
        direction: Direction of the motion: extending if > 0, otherwise retracting.

    Returns:
        Load pressure p_L [Pa]; negative if the load drives the motion strongly enough.
    """
    if direction > 0.0:
        return (force + rod * tank) / cap
    return (-force + cap * tank) / rod


@kernel
def compute_valve_drop(k: float, cap: float, rod: float, speed: float) -> float:
    """Compute the pressure that the fully open valve needs beyond the load pressure at a speed.

        m(v) = v² (A³ + a³) / (K² A)    extending (v > 0)
        m(v) = v² (A³ + a³) / (K² a)    retracting

    Both metering edges of the valve are included.

    Args:
        k: Valve coefficient K of one metering edge [m³/(s √Pa)].
        cap: Cap-side area A [m²].
        rod: Rod-side area a [m²].
        speed: Piston speed v, positive in extension [m/s].

    Returns:
        Pressure m(v) by which the supply must exceed the load pressure [Pa].
    """
    return speed * speed * (cap**3 + rod**3) / (k * k * inlet_area(cap, rod, speed))


@kernel
def compute_speed_from_drop(
    k: float, cap: float, rod: float, drop: float, direction: float
) -> float:
    """Compute the piston speed that a pressure beyond the load pressure allows.

        v = K √(Δp A_dir / (A³ + a³))

    This is the inverse of `compute_valve_drop`.

    Args:
        k: Valve coefficient K [m³/(s √Pa)].
        cap: Cap-side area A [m²].
        rod: Rod-side area a [m²].
        drop: Supply pressure minus load pressure, Δp [Pa].
        direction: Extending (A_dir = A) if > 0, otherwise retracting (A_dir = a).

    Returns:
        Magnitude of the speed [m/s]; 0 if Δp ≤ 0.
    """
    inlet = inlet_area(cap, rod, direction)
    return k * math.sqrt(max(0.0, drop) * inlet / (cap**3 + rod**3))


@kernel
def compute_pressure_without_margin(
    k: float, cap: float, rod: float, tank: float, force: float, speed: float
) -> float:
    """Compute the supply pressure that a cylinder needs to move at a speed, or to hold its load.

        p = p_L + m(v)

    p_L is the load pressure, which balances the load at rest, and m(v) the pressure that the fully
    open valve needs at the speed v. At speed 0 the cylinder holds, and m is 0. p_L is then the load
    pressure of extension if force > 0, otherwise of retraction.

    Args:
        k: Valve coefficient K [m³/(s √Pa)].
        cap: Cap-side area A [m²].
        rod: Rod-side area a [m²].
        tank: Tank pressure p_T [Pa].
        force: Piston force F, positive if it resists extension [N].
        speed: Piston speed v, positive in extension [m/s].

    Returns:
        Required supply pressure, without boost margin [Pa].
    """
    direction = speed if speed != 0.0 else force
    return load_pressure(cap, rod, tank, force, direction) + compute_valve_drop(k, cap, rod, speed)


@kernel
def opposes_motion(force: float, direction: float) -> bool:
    """Return whether the load acts against the motion.

    Args:
        force: Piston force, positive if it resists extension [N].
        direction: Number with the sign of the piston speed: > 0 extending, < 0 retracting.

    Returns:
        True if the load resists the motion. False if it helps, and for zero force or direction.
    """
    return force * direction > 0.0


def cavitates(
    cap: FloatArray,
    rod: FloatArray,
    supply: float,
    tank: float,
    force: FloatArray,
    direction: FloatArray,
) -> np.ndarray:
    """Return whether an overrunning load empties the inlet chamber of a cylinder.

    The valve is matched: its two metering edges have the same K. The inlet chamber then empties at
    any speed if

        F < −a³ p_S / A² − a p_T     extending
        F > A³ p_S / a² + A p_T      retracting

    All arrays broadcast against each other.

    Args:
        cap: Cap-side areas A [m²].
        rod: Rod-side areas a [m²].
        supply: Supply pressure p_S [Pa].
        tank: Tank pressure p_T [Pa].
        force: Piston forces F, positive if they resist extension [N].
        direction: Direction of each motion: extending if > 0, otherwise retracting (also for 0).

    Returns:
        Boolean array of the broadcast shape, True if the inlet chamber empties.
    """
    pulled = force < -(rod**3) * supply / cap**2 - rod * tank
    pushed = force > cap**3 * supply / rod**2 + cap * tank
    return np.where(direction > 0.0, pulled, pushed)


@kernel
def inlet_area(cap: float, rod: float, direction: float) -> float:
    """Return the piston area on the side that the supply fills [m²].

    Args:
        cap: Cap-side area A [m²].
        rod: Rod-side area a [m²].
        direction: Direction of motion: > 0 extends (result A), otherwise retracts (result a).
    """
    return cap if direction > 0.0 else rod


class SharedHydraulics(NamedTuple):
    """Pressures and flows that all actuators of a machine share.

    All fields are scalars. Unlike arrays, kernels pass them on at no cost.
    """

    supply_pressure: float
    """Main pump's pressure P_S [Pa]."""
    tank_pressure: float
    """Tank pressure p_T [Pa]."""
    max_boost_pressure: float
    """Highest boosted supply pressure [Pa]."""
    boost_margin: float
    """Pressure kept in reserve beyond load pressure and valve drop [Pa]."""
    main_pump_flow: float
    """Largest flow Q_MP of the main pump [m³/s]."""
    servo_pump_flow: float
    """Largest flow Q_SP of one servo pump [m³/s]."""
    servo_pump_slip: float
    """Slip c of one servo pump per pressure rise [m³/(s Pa)]."""
    leakage_flow: float
    """Leakage q_leak of one closed valve, with its overlap, at the main pump's pressure [m³/s]."""
    land_leakage: float
    """Share s of `leakage_flow` that flows past the lands of the spool [-]."""


@kernel(borrows=True)
def get_shared_hydraulics(m: MachineArrays) -> SharedHydraulics:
    """Return the pressures and flows that all actuators of a machine share."""
    return SharedHydraulics(
        m.supply_pressure,
        m.tank_pressure,
        m.max_boost_pressure,
        m.boost_margin,
        m.main_pump_flow,
        m.servo_pump_flow,
        m.servo_pump_slip,
        m.leakage_flow,
        m.land_leakage,
    )


@kernel
def compute_inertia_margin(oil: SharedHydraulics) -> float:
    """Compute the part of the boost margin that inertia forces may use up [Pa].

    The boost margin is a reserve of pressure beyond load pressure and valve drop.
    `MARGIN_SHARE_WITHOUT_INERTIA` of it is kept for friction and control.

    Args:
        oil: Boost margin.
    """
    return (1.0 - MARGIN_SHARE_WITHOUT_INERTIA) * oil.boost_margin


@kernel
def get_max_supply_pressure(oil: SharedHydraulics, modules: int) -> float:
    """Return the highest supply pressure that an actuator can get in a mode.

    Args:
        oil: Supply pressure and maximum boost pressure.
        modules: Number of booster modules that the mode gives the actuator.

    Returns:
        The maximum boost pressure [Pa]; the main pump's pressure P_S if there are no modules.
    """
    return oil.max_boost_pressure if modules > 0 else oil.supply_pressure


@kernel
def get_max_servo_pump_flow(oil: SharedHydraulics, modules: int) -> float:
    """Return the largest flow that the servo pumps give an actuator in a mode.

    Args:
        oil: Hydraulic numbers with the largest flow Q_SP of one servo pump [m³/s].
        modules: Number of booster modules, each with one servo pump, that the mode gives the
            actuator.

    Returns:
        Number of modules times Q_SP [m³/s]; inf without modules, since the main pump then feeds the
        actuator.
    """
    return modules * oil.servo_pump_flow if modules > 0 else math.inf


@kernel
def compute_pressure_with_margin(
    oil: SharedHydraulics, k: float, cap: float, rod: float, force: float, speed: float
) -> float:
    """Compute the supply pressure that a cylinder needs, including the boost margin.

        p = p_L + m(v) + boost margin

    p_L is the load pressure, which balances the load at rest, and m(v) the pressure that the fully
    open valve needs at the speed v. At speed 0 the cylinder holds its load. p_L is then the load
    pressure of extension if force > 0, otherwise of retraction.

    Args:
        oil: Tank pressure and boost margin.
        k: Valve coefficient K [m³/(s √Pa)].
        cap: Cap-side area A [m²].
        rod: Rod-side area a [m²].
        force: Piston force, positive if it resists extension [N].
        speed: Piston speed v, positive in extension [m/s].

    Returns:
        Required supply pressure, boost margin included [Pa].
    """
    return (
        compute_pressure_without_margin(k, cap, rod, oil.tank_pressure, force, speed)
        + oil.boost_margin
    )


@kernel
def cylinder_needs_boost(
    oil: SharedHydraulics, k: float, cap: float, rod: float, force: float, speed: float
) -> bool:
    """Return whether a cylinder needs boost to move or hold its load.

    Boost is needed if both of these hold:

    - The cylinder holds its load (speed 0), or moves against its load.
    - The main pump's pressure is below load pressure plus valve drop plus boost margin.

    A motion that the load helps, or that has no load, never needs boost.

    Args:
        oil: Pressures of the supply and the tank, and boost margin.
        k: Valve coefficient K [m³/(s √Pa)].
        cap: Cap-side area A [m²].
        rod: Rod-side area a [m²].
        force: Piston force, positive if it resists extension [N].
        speed: Piston speed, positive in extension [m/s].

    Returns:
        True if boost is needed.
    """
    if speed != 0.0 and not opposes_motion(force, speed):
        return False
    return compute_pressure_with_margin(oil, k, cap, rod, force, speed) > oil.supply_pressure


@kernel
def compute_boosted_supply(
    oil: SharedHydraulics, k: float, cap: float, rod: float, force: float, speed: float
) -> float:
    """Compute the pressure to which servo pumps charge the line of a boosted cylinder.

        p = max(P_S, min(p_max, max(p_0, p_L + m(v)) + margin))

    P_S is the main pump's pressure, and p_max the maximum boost pressure. p_L is the load pressure
    in the direction of v, and m(v) the drop across the fully open valve. p_0 is the pressure that
    holds the load at rest; during a motion the line pressure does not fall below it.

    Args:
        oil: Pressures of supply and tank, boost margin and maximum boost pressure.
        k: Valve coefficient K [m³/(s √Pa)].
        cap: Cap-side area A [m²].
        rod: Rod-side area a [m²].
        force: Piston force, positive if it resists extension [N].
        speed: Piston speed v, positive in extension; 0 for holding [m/s].

    Returns:
        Line pressure, from P_S to p_max [Pa].
    """
    need = compute_pressure_with_margin(oil, k, cap, rod, force, 0.0)
    if speed != 0.0:
        need = max(need, compute_pressure_with_margin(oil, k, cap, rod, force, speed))
    return max(oil.supply_pressure, min(need, oil.max_boost_pressure))


@kernel
def rail_pressure(oil: SharedHydraulics, line_pressure: FloatArray, modes: ModeArray) -> float:
    """Return the pressure of the rail, the line that all actuators in shared boost (SB) use.

    The result is the highest boosted line pressure of the actuators in SB.

    Args:
        oil: The main pump's pressure P_S.
        line_pressure: Boosted line pressure that each actuator needs, from
            `compute_boosted_supply`, shape (n,) [Pa]. Values of actuators in other modes are
            ignored.
        modes: Mode of each actuator, shape (n,).

    Returns:
        Rail pressure [Pa]; P_S if no actuator is in SB.
    """
    highest = oil.supply_pressure
    for j in range(len(modes)):
        if RAIL_MODES[modes[j]]:
            highest = max(highest, line_pressure[j])
    return highest


@kernel
def select_supply_pressure(
    oil: SharedHydraulics, mode: int, line_pressure: float, rail: float
) -> float:
    """Return the supply pressure that an actuator has in its mode.

    Args:
        oil: The main pump's pressure P_S.
        mode: Mode of the actuator: N (main pump alone), DB (own servo pump) or SB (shared rail).
        line_pressure: Boosted pressure of the actuator's own line, used in DB [Pa].
        rail: Pressure of the shared rail, used in SB [Pa].

    Returns:
        P_S in mode N, `line_pressure` in DB, `rail` in SB [Pa].
    """
    if RAIL_MODES[mode]:
        return rail
    return line_pressure if BOOSTED_MODES[mode] else oil.supply_pressure


@kernel
def compute_slip_flow(slip: float, pumps: int, rise: float) -> float:
    """Compute the oil that slips back through pumps, from their outlet to their inlet.

        Q_s = n c Δp

    The slip is a laminar flow through the pumps' gaps, so a pump with the theoretical flow Q_t
    delivers Q_t − c Δp.

    Args:
        slip: Slip c of one pump per pressure rise [m³/(s Pa)].
        pumps: Number n of pumps that work in parallel.
        rise: Pressure rise Δp from inlet to outlet [Pa].

    Returns:
        Flow through all n pumps together [m³/s]; 0 without a rise.

    Source:
        J. Ivantysyn, M. Ivantysynova, Hydrostatic Pumps and Motors (volumetric losses).
    """
    return pumps * slip * max(0.0, rise)


@kernel
def scale_leakage(land_leakage: float, ratio: FloatOrArray) -> FloatOrArray:
    """Return the ratio of a valve's leakage at some pressure drop to its leakage at the rated drop.

        f = (1 − s) √r + s r

    The share s of the leakage flows past the lands of the spool and is laminar. The rest, such as
    the flow through the pilot stage, is turbulent.

    Args:
        land_leakage: Share s of the leakage past the lands at the rated drop [-].
        ratio: Pressure drop from supply to tank, divided by the rated pressure drop, r ≥ 0 [-]; any
            shape.

    Returns:
        Factor f [-], in the shape of `ratio`.

    Source:
        H. E. Merritt, Hydraulic Control Systems (leakage of a closed spool valve).
    """
    return (1.0 - land_leakage) * np.sqrt(ratio) + land_leakage * ratio


@kernel
def compute_leakage_at(
    rated_flow: float, land_leakage: float, rated_pressure: float, tank: float, supply: float
) -> float:
    """Compute the leakage of a valve at a supply pressure.

        q = q_leak ((1 − s) √r + s r),   r = (p − p_T) / (P_S − p_T)

    The share s of the leakage flows past the lands of the spool and is laminar. The rest is
    turbulent.

    Args:
        rated_flow: Leakage q_leak at the rated supply pressure [m³/s].
        land_leakage: Share s of the leakage past the lands at the rated supply pressure [-].
        rated_pressure: Rated supply pressure P_S [Pa].
        tank: Tank pressure p_T [Pa].
        supply: Present supply pressure p of the valve [Pa].

    Returns:
        Leakage [m³/s]; 0 if the supply pressure is below the tank pressure.
    """
    ratio = max(0.0, supply - tank) / (rated_pressure - tank)
    return rated_flow * scale_leakage(land_leakage, ratio)


@kernel
def compute_valve_leakage(oil: SharedHydraulics, supply: float) -> float:
    """Compute the leakage of one valve at a supply pressure.

    The laminar part of the leakage, past the lands of the spool, is proportional to the pressure
    drop to the tank. The turbulent part is proportional to the root of this drop.

    Args:
        oil: Rated leakage, its share past the lands, and pressures of supply and tank.
        supply: Present supply pressure of the valve [Pa].

    Returns:
        Leakage [m³/s]; 0 if the supply pressure is below the tank pressure.
    """
    return compute_leakage_at(
        oil.leakage_flow, oil.land_leakage, oil.supply_pressure, oil.tank_pressure, supply
    )


def compute_sinking_speed(m: MachineArrays, j: int, force: float, supply: float) -> float:
    """Compute the speed of a loaded piston behind a closed valve whose lands leak.

        v = 2 G ((A − a) (p + p_T)/2 − F) / (A² + a²),   G = s q_leak/(P_S − p_T)

    This follows from the force balance A p_A − a p_B = F and from the flows past the four lands of
    the spool. Each land passes the flow G Δp; the valve's two overlaps are replaced by their mean:

        A v = G (p − p_A) − G (p_A − p_T)
        −a v = G (p − p_B) − G (p_B − p_T)

    The piston's seal is assumed to be tight.

    Args:
        m: Arrays of the machine, with the main pump's pressure P_S. q_leak is the leakage of a
            closed valve at P_S, and s the share of it that flows past the lands.
        j: Index of the actuator.
        force: Piston force F, positive if it resists extension [N].
        supply: Supply pressure p of the valve [Pa].

    Returns:
        Speed v, positive in extension [m/s]; 0 if no oil leaks past the lands.

    Source:
        H. E. Merritt, Hydraulic Control Systems (leakage of a closed spool valve).
    """
    conductance = m.land_leakage * m.leakage_flow / (m.supply_pressure - m.tank_pressure)
    cap, rod = float(m.cap_area[j]), float(m.rod_area[j])
    middle = 0.5 * (supply + m.tank_pressure)
    return 2.0 * conductance * ((cap - rod) * middle - force) / (cap * cap + rod * rod)


@kernel
def compute_piston_flow_budget(
    oil: SharedHydraulics, line_pressure: FloatArray, modes: ModeArray
) -> float:
    """Compute the main pump's flow that is left for the pistons after the leakage of all valves.

    A valve's leakage depends on the supply pressure of its actuator: P_S in mode N, the actuator's
    own line pressure in DB, and the rail's in SB.

    Args:
        oil: Pressures, main pump flow and leakage.
        line_pressure: Boosted line pressure that each actuator needs, from
            `compute_boosted_supply`, shape (n,) [Pa]; ignored for actuators in mode N.
        modes: Mode of each actuator, shape (n,).

    Returns:
        Remaining flow [m³/s]; negative if the valves leak more than the main pump gives.
    """
    rail = rail_pressure(oil, line_pressure, modes)
    flow = oil.main_pump_flow
    for j in range(len(modes)):
        if BOOSTED_MODES[modes[j]]:
            flow -= compute_valve_leakage(
                oil, select_supply_pressure(oil, modes[j], line_pressure[j], rail)
            )
        else:
            flow -= oil.leakage_flow
    return flow


@kernel(borrows=True)
def compute_required_pressure(m: MachineArrays, j: int, force: float, speed: float) -> float:
    """Compute the supply pressure at which actuator j moves or holds its load.

    This is the load pressure, plus the drop across the fully open valve, plus the boost margin.

    Args:
        m: Arrays of the machine.
        j: Index of the actuator.
        force: Piston force, positive if it resists extension [N].
        speed: Piston speed, positive in extension; 0 for holding [m/s].

    Returns:
        Required supply pressure [Pa].
    """
    k, cap, rod = m.valve_coefficient[j], m.cap_area[j], m.rod_area[j]
    return compute_pressure_with_margin(get_shared_hydraulics(m), k, cap, rod, force, speed)


@kernel(borrows=True)
def needs_boost(m: MachineArrays, j: int, force: float, speed: float) -> bool:
    """Return whether actuator j needs boost to move or hold its load.

    Boost is needed if the actuator holds its load or moves against it, and if the main pump's
    pressure is below load pressure plus valve drop plus boost margin. A motion that the load helps
    never needs boost.

    Args:
        m: Arrays of the machine.
        j: Index of the actuator.
        force: Piston force, positive if it resists extension [N].
        speed: Piston speed, positive in extension; 0 for holding [m/s].

    Returns:
        True if boost is needed.
    """
    k, cap, rod = m.valve_coefficient[j], m.cap_area[j], m.rod_area[j]
    return cylinder_needs_boost(get_shared_hydraulics(m), k, cap, rod, force, speed)


@kernel
def compute_required_pressures(
    m: MachineArrays, force: FloatArray, speed: FloatArray
) -> FloatArray:
    """Compute the supply pressures at which all actuators move or hold their loads.

    Each pressure is the load pressure, plus the drop across the fully open valve, plus the boost
    margin. The load pressure is that in the direction of motion; at rest, in the direction against
    the load.

    Args:
        m: Arrays of the machine.
        force: Piston forces of n actuators at k instants, positive if they resist extension, shape
            (k, n) [N].
        speed: Piston speeds, positive in extension, shape (k, n) [m/s]; 0 means that the actuator
            holds.

    Returns:
        Required supply pressures, shape (k, n) [Pa].
    """
    pressure = np.empty(force.shape)
    for i in range(force.shape[0]):
        for j in range(force.shape[1]):
            pressure[i, j] = compute_required_pressure(m, j, force[i, j], speed[i, j])
    return pressure
