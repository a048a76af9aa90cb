"""Limit of the pressures that drive and brake moving cylinders against gravity and inertia.

A cylinder that moves against its load is driven by its supply:

    thrust = (p_L(F + (M q̈ + C q̇)/r) + m(v) + margin) / p_max ≤ 1

p_L is the load pressure. Its argument is the piston force F of gravity plus the piston force of
inertia, with the moment arm r. m(v) is the pressure drop over the valve. `margin` is the part of
the boost margin that must remain in spite of inertia. p_max is the highest supply pressure of the
actuator's mode.

If the load drives the motion, the oil in the return chamber brakes it. This takes at least the
pressure p_o, because the other chamber does not fall below the tank's pressure p_T:

    thrust = p_o / p_max ≤ 1,   p_o = (A_i p_T + F_d)/A_o

A_i and A_o are the piston areas of the chambers that fill and empty. F_d > 0 is the force with
which gravity and inertia drive the piston. Here p_max is `MachineArrays.max_chamber_pressure`.
Above the setting of the chamber's relief valves, oil escapes and the load runs on. The limit is the
largest value of all cylinders.

Source: paper, Section 2.1, with inertia added; H. E. Merritt, Hydraulic Control Systems (relief
valves limit the deceleration of a load).
"""

import math

from mhsb_model.arrays import MachineArrays
from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.hydraulics import (
    compute_inertia_margin,
    compute_pressure_with_margin,
    get_max_supply_pressure,
    get_shared_hydraulics,
    load_pressure,
    opposes_motion,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.motion.limits.limit import LimitInputs, StateLimit, TimeScaling


@kernel(borrows=True, forceinline=True)
def measure_thrust(m: MachineArrays, state: LimitInputs) -> float:
    """Return the largest ratio of needed to available pressure over all cylinders [-].

    The load is gravity and inertia. For a cylinder that moves against its load, both pressures are
    those of the supply; the needed one includes the part of the boost margin that must remain in
    spite of inertia. For a cylinder that its load drives, both are those of the return chamber.
    Only cylinders faster than MAX_HELD_SPEED count.

    Args:
        m: Arrays of the machine.
        state: Speeds, forces and modes at one instant.

    Returns:
        Largest ratio; above 1 the motion is not possible. 0 if no cylinder counts.
    """
    oil, valve, cap, rod = get_shared_hydraulics(m), m.valve_coefficient, m.cap_area, m.rod_area
    hardest = 0.0
    for j in range(len(state.speed)):
        v, load = state.speed[j], state.force[j] + state.inertia[j]
        if abs(v) > MAX_HELD_SPEED and opposes_motion(load, v):
            needed = compute_pressure_with_margin(oil, valve[j], cap[j], rod[j], load, v)
            needed -= compute_inertia_margin(oil)
            highest = get_max_supply_pressure(oil, m.modules_per_mode[state.modes[j]])
            hardest = max(hardest, needed / highest)
        elif abs(v) > MAX_HELD_SPEED:
            needed = load_pressure(cap[j], rod[j], oil.tank_pressure, load, -v)
            hardest = max(hardest, needed / m.max_chamber_pressure[j])
    return hardest


@kernel
def find_inertia_excess(
    m: MachineArrays,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    modes: ModeArray,
) -> float:
    """Find the factor by which inertia forces are too large for the available pressure.

    If all inertia forces are divided by this factor, the thrust is 1. The needed pressure p, of the
    supply or of the return chamber, is linear in the inertia force. With p_0 without inertia, and
    the highest available pressure p_max, the factor is (p − p_0)/(p_max − p_0).

    Args:
        m: Arrays of the machine.
        speed: Piston speeds, shape (k, n) [m/s].
        force: Piston forces under gravity, shape (k, n) [N].
        inertia: Piston forces from inertia, shape (k, n) [N].
        modes: Mode codes (N, DB, SB), shape (k, n).

    Returns:
        Largest factor of all instants and of the moving cylinders [-]; 1 if the pressure suffices
        for all. inf if it does not even suffice without inertia.
    """
    oil, valve, cap, rod = get_shared_hydraulics(m), m.valve_coefficient, m.cap_area, m.rod_area
    margin, largest = compute_inertia_margin(oil), 1.0
    for k in range(len(speed)):
        for j in range(speed.shape[1]):
            v, f, load = speed[k, j], force[k, j], force[k, j] + inertia[k, j]
            if abs(v) <= MAX_HELD_SPEED:
                continue
            if opposes_motion(load, v):
                highest = margin + get_max_supply_pressure(oil, m.modules_per_mode[modes[k, j]])
                needed = compute_pressure_with_margin(oil, valve[j], cap[j], rod[j], load, v)
                still = compute_pressure_with_margin(oil, valve[j], cap[j], rod[j], f, v)
            else:
                highest, tank = m.max_chamber_pressure[j], oil.tank_pressure
                needed = load_pressure(cap[j], rod[j], tank, load, -v)
                still = load_pressure(cap[j], rod[j], tank, f, -v)
            if needed > highest > still:
                largest = max(largest, (needed - still) / (highest - still))
            elif needed > highest:
                largest = math.inf
    return largest


THRUST_LIMIT = StateLimit(
    name="thrust",
    describe=lambda broken: (
        f"it takes {100 * broken.amount:.3g} % more pressure than supply or relief valves allow"
    ),
    time_scaling=TimeScaling.INERTIA,
    measure=measure_thrust,
)
"""Limit of the pressures that drive and brake moving cylinders, as a share of the highest pressures
[-]."""
