"""Limit of the pressure at which cylinders hold their loads.

This limit never refuses a motion. It selects intervals with a value near 1 for the check at close
instants.

    holding = max_j p_j(F_j, 0) / p_max,j

p_j(F_j, 0) is the supply pressure that holds the load F_j of cylinder j at speed 0, with the boost
margin. p_max,j is the highest supply pressure of the cylinder's mode. Cylinders slower than a
quarter of MAX_HELD_SPEED do not count, since their valves are closed. Cylinders faster than
MAX_HELD_SPEED count only if they move against their load.

The limit `usage` needs this selection. It ignores cylinders up to MAX_HELD_SPEED, so its value
jumps at this speed, and a parabola through three values is no bound. The ratio `holding` does not
jump.
"""

import math

from mhsb_model.arrays import MachineArrays
from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.hydraulics import (
    compute_pressure_with_margin,
    get_max_supply_pressure,
    get_shared_hydraulics,
    opposes_motion,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_planner.motion.limits.limit import LimitInputs, StateLimit

CLEAR_PRESSURE = 0.999
"""Share of the available pressure up to which an interval is not checked at close instants [-].

The remaining pressure is enough for the valve at the lowest speeds."""


@kernel(borrows=True, forceinline=True)
def measure_holding_pressure(m: MachineArrays, state: LimitInputs) -> float:
    """Return the largest ratio of holding pressure to available pressure over all cylinders [-].

    The holding pressure carries the load at speed 0, with the boost margin. The available pressure
    is the highest supply pressure of the cylinder's mode. A cylinder slower than a quarter of
    MAX_HELD_SPEED does not count, because its closed valve holds the load. A cylinder faster than
    MAX_HELD_SPEED counts only if it moves against its load.

    Args:
        m: Arrays of the machine.
        state: Speeds, forces and modes at one instant.

    Returns:
        Largest ratio; 0 if no cylinder counts.
    """
    oil, valve, cap, rod = get_shared_hydraulics(m), m.valve_coefficient, m.cap_area, m.rod_area
    heaviest = 0.0
    for j in range(len(state.speed)):
        v, f = state.speed[j], state.force[j]
        lifts = abs(v) <= MAX_HELD_SPEED or opposes_motion(f, v)
        if lifts and abs(v) > 0.25 * MAX_HELD_SPEED:
            needed = compute_pressure_with_margin(oil, valve[j], cap[j], rod[j], f, 0.0)
            highest = get_max_supply_pressure(oil, m.modules_per_mode[state.modes[j]])
            heaviest = max(heaviest, needed / highest)
    return heaviest


HOLDING_PRESSURE_LIMIT = StateLimit(
    name="holding pressure",
    describe=lambda broken: (
        f"holding takes {100 * broken.amount:.3g} % more pressure than there is"
    ),
    measure=measure_holding_pressure,
    broken_above=math.inf,
    proven_below=CLEAR_PRESSURE,
)
"""Share of the highest supply pressure that is needed to hold the loads [-]; never broken."""
