"""Limit of the speeds that main pump, servo pumps and valves allow.

    usage = max( Σ_j A_dir|v_j| / (Q_MP − Σ_j q_leak), max_j |v_j| / v_max,j ) ≤ 1

A_dir is the area of the chamber that the supply fills. v_j is a piston speed and v_max,j its limit
under its load (`compute_speed_limit`). Q_MP is the main pump's flow and q_leak the leakage of a
valve at its supply pressure. Cylinders up to MAX_HELD_SPEED have no speed limit, since their closed
valves carry the load. If the motion is slowed by the factor `usage`, it keeps the limit.

Source: paper, Section 2.1, extended to leakage and modes.
"""

import math

from mhsb_model.arrays import MachineArrays
from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.hydraulics import (
    SharedHydraulics,
    compute_boosted_supply,
    compute_extension_speed,
    compute_piston_flow_budget,
    compute_retraction_speed,
    compute_speed_from_drop,
    get_max_servo_pump_flow,
    get_max_supply_pressure,
    get_shared_hydraulics,
    inlet_area,
    load_pressure,
    opposes_motion,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_model.modes import BOOSTED_MODES
from mhsb_planner.motion.limits.limit import LimitInputs, StateLimit, TimeScaling


@kernel
def compute_speed_limit(
    oil: SharedHydraulics,
    k: float,
    cap: float,
    rod: float,
    force: float,
    direction: float,
    modules: int,
) -> float:
    """Compute the largest speed of a piston under a load.

    The pressure limits the speed of a piston that moves against its load:

        v = K √((p − margin − p_L) A_d/(A³ + a³))

    p is the main pump's pressure P_S in mode N, and the highest boost pressure in boost. p_L is the
    load pressure: the supply pressure that holds the force at rest. A_d is the area of the chamber
    that fills.

    A piston that moves with its load has two limits. The first is the equation with p = P_S and
    without margin. The second is v = (K/A_d) √P_S, at which the valve takes the whole pressure P_S.
    In boost, the flow Q_SP of each of n servo pumps sets a further limit, v = n Q_SP/A_d.

    Args:
        oil: Hydraulic numbers that all actuators share.
        k: Flow coefficient K of the valve [m³/(s √Pa)].
        cap: Cap-side piston area A [m²].
        rod: Rod-side piston area a [m²].
        force: Piston force, positive if it resists extension [N].
        direction: Positive for extension, negative for retraction.
        modules: Number n of booster modules; 0 means mode N.

    Returns:
        Largest speed as a magnitude [m/s]; 0 if the pressure does not suffice.
    """
    inlet = inlet_area(cap, rod, direction)
    if opposes_motion(force, direction):
        drive = get_max_supply_pressure(oil, modules) - oil.boost_margin
        drive -= load_pressure(cap, rod, oil.tank_pressure, force, direction)
        speed = compute_speed_from_drop(k, cap, rod, drive, direction)
    else:
        if direction > 0.0:
            speed = compute_extension_speed(
                k, cap, rod, oil.supply_pressure, oil.tank_pressure, force
            )
        else:
            speed = compute_retraction_speed(
                k, cap, rod, oil.supply_pressure, oil.tank_pressure, force
            )
        speed = min(speed, k * math.sqrt(oil.supply_pressure) / inlet)
    return min(speed, get_max_servo_pump_flow(oil, modules) / inlet)


@kernel(borrows=True, forceinline=True)
def measure_usage(m: MachineArrays, state: LimitInputs) -> float:
    """Return the share of the capacity of main pump, servo pumps and valves that a motion uses [-].

    The result is the largest of up to n + 1 ratios. The first ratio is the flow of all pistons,
    divided by the main pump's flow minus leakage. Each piston faster than MAX_HELD_SPEED has
    another ratio: its speed divided by its largest speed under its load.

    Args:
        m: Arrays of the machine.
        state: Speeds, forces and modes at one instant. The supply pressure of each boosted actuator
            [Pa] is written to `state.scratch` in place.

    Returns:
        Largest ratio; above 1 the motion is too fast by this factor. inf if a cylinder moves
        although its pressure does not suffice, or if leakage takes the whole flow.
    """
    oil, valve, cap, rod = get_shared_hydraulics(m), m.valve_coefficient, m.cap_area, m.rod_area
    own, modes = state.scratch, state.modes
    flow = fastest = 0.0
    for j in range(len(own)):
        v, f, modules = state.speed[j], state.force[j], m.modules_per_mode[modes[j]]
        flow += inlet_area(cap[j], rod[j], v) * abs(v)
        if BOOSTED_MODES[modes[j]]:
            own[j] = compute_boosted_supply(oil, valve[j], cap[j], rod[j], f, v)
        if abs(v) > MAX_HELD_SPEED:
            limit = compute_speed_limit(oil, valve[j], cap[j], rod[j], f, v, modules)
            fastest = max(fastest, abs(v) / limit) if limit > 0.0 else math.inf
    shared = compute_piston_flow_budget(oil, own, modes)
    return max(fastest, flow / shared) if shared > 0.0 else math.inf


USAGE_LIMIT = StateLimit(
    name="usage",
    describe=lambda broken: (
        f"valves and pumps would have to give {1 + broken.amount:.3g} times as much"
    ),
    time_scaling=TimeScaling.SPEED,
    measure=measure_usage,
)
"""Limit of pumps and valves; its quantity is the used share of their capacity [-]."""
