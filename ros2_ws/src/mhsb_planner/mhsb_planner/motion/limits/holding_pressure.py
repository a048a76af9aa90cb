"""Pressure that cylinders take to hold their loads, near which an interval is looked at closely.

    holding = max_j p_j(F_j, 0) / p_max,j

p_j is the supply pressure at which a cylinder holds its load F_j, with margin, and p_max,j the
highest one of its mode. Only cylinders that may be lifting their load count. Far below the dead
band the valve is closed, and a cylinder does not count.

`usage` itself leaves out cylinders in the dead band and jumps at its edge. This quantity does not,
so it shows where a parabola through three values of `usage` would prove too much.
"""

from __future__ import annotations

import math

from mhsb_model.arrays import MachineArrays
from mhsb_model.hydraulics import (
    compute_pressure_with_margin,
    get_max_supply_pressure,
    get_shared_hydraulics,
    opposes_motion,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_planner.motion.limits.limit import LimitInputs, StateLimit
from mhsb_planner.motion.motion_profile import DEAD_BAND

CLEAR_PRESSURE = 0.999
"""Largest share of the available pressure up to which an interval counts as clear [-].

The rest is enough for the valve at the lowest speeds."""


@kernel(inline="always")
def measure_holding_pressure(m: MachineArrays, state: LimitInputs) -> float:
    """Return the largest share of its highest supply pressure that a cylinder takes to hold [-]."""
    oil, valve, cap, rod = get_shared_hydraulics(m), m.valve_coefficient, m.cap_area, m.rod_area
    heaviest = 0.0
    for j in range(len(state.speed)):
        v, f = state.speed[j], state.force[j]
        lifts = abs(v) <= DEAD_BAND or opposes_motion(f, v)
        if lifts and abs(v) > 0.25 * DEAD_BAND:
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
"""Share of the highest supply pressure that holding takes [-]; never broken by itself."""
