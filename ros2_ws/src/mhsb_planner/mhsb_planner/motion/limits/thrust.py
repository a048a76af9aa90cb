"""Limit of the supply pressure that moving cylinders need against gravity and inertia.

    thrust = max_j (p_L(F + (M q̈ + C q̇)/r) + m(v) + margin) / p_max,j ≤ 1

p_L is the load pressure. Its argument is the piston force F of gravity plus the piston force of
inertia, with the moment arm r. m(v) is the pressure drop over the valve. `margin` is the part of
the boost margin that must remain in spite of inertia. p_max,j is the highest supply pressure of the
mode of actuator j. Only cylinders that move against their load count.

Source: paper, Section 2.1, with inertia added.
"""

from __future__ import annotations

from mhsb_model.arrays import MachineArrays
from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.hydraulics import (
    compute_inertia_margin,
    compute_pressure_with_margin,
    get_max_supply_pressure,
    get_shared_hydraulics,
    opposes_motion,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_planner.motion.limits.limit import LimitInputs, StateLimit, TimeScaling


@kernel(borrows=True, forceinline=True)
def measure_thrust(m: MachineArrays, state: LimitInputs) -> float:
    """Return the largest ratio of needed to available supply pressure over all cylinders [-].

    The needed pressure carries the load (gravity and inertia) at the piston's speed. The part of
    the boost margin that must remain in spite of inertia is added. The available pressure is the
    highest supply pressure of the cylinder's mode. Only cylinders that move against their load and
    faster than MAX_HELD_SPEED count.

    Args:
        m: Arrays of the machine.
        state: Speeds, forces and modes at one instant.

    Returns:
        Largest ratio; above 1 the pressure is too low. 0 if no cylinder counts.
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
    return hardest


THRUST_LIMIT = StateLimit(
    name="thrust",
    describe=lambda broken: f"it takes {100 * broken.amount:.3g} % more pressure than there is",
    time_scaling=TimeScaling.INERTIA,
    measure=measure_thrust,
)
"""Limit of the supply pressure of moving cylinders, as a share of the highest pressure [-]."""
