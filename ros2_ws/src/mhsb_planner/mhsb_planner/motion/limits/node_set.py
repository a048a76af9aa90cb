"""Limit of the tip: it stays in the node set, which is the workspace in the arm's plane.

x ≥ x_min,   r_min ≤ √(x² + z²) ≤ r_max
"""

from __future__ import annotations

from mhsb_model.arrays import MachineArrays
from mhsb_model.goal import format_distance
from mhsb_model.kernels.kernel import kernel
from mhsb_model.workspace import compute_region_excess
from mhsb_planner.motion.limits.limit import LimitInputs, StateLimit

TIP_TOLERANCE = 1e-4
"""Distance out of the node set that is accepted [m].

The search checks a step at some instants; between them the tip may be so far outside."""

CLEAR_DISTANCE = 2e-3
"""Distance of the tip inside the node set that is a reserve [m]."""


@kernel(inline="always")
def measure_tip_excess(m: MachineArrays, state: LimitInputs) -> float:
    """Return how far the tip lies outside the workspace [m]; negative inside.

    The workspace has a least forward distance, and a least and a greatest distance from the base.
    The result is the largest of the three excesses.

    Args:
        m: Arrays of the machine.
        state: State of the motion at one instant; only the tip position counts.
    """
    return compute_region_excess(m.min_x, m.min_radius, m.max_radius, state.tip[0], state.tip[1])


NODE_SET_LIMIT = StateLimit(
    name="node set",
    describe=lambda broken: f"the tip leaves the workspace by {format_distance(broken.amount)}",
    measure=measure_tip_excess,
    limit=0.0,
    broken_above=TIP_TOLERANCE,
    proven_below=0.0,
    clear_below=-CLEAR_DISTANCE,
)
"""Limit of the tip [m]."""
