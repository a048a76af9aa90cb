"""Limit of the tip position: the tip stays in the workspace, where the search has its nodes.

    x ≥ x_min,   r_min ≤ √(x² + z²) ≤ r_max

(x, z) is the tip position in the arm's plane [m].
"""

from mhsb_model.arrays import MachineArrays
from mhsb_model.goal import format_distance
from mhsb_model.kernels.kernel import kernel
from mhsb_model.workspace import compute_region_excess
from mhsb_planner.motion.limits.limit import LimitInputs, StateLimit

TIP_TOLERANCE = 1e-4
"""Distance of the tip outside the workspace that is accepted [m].

The search checks a step only at some instants. Between these, the tip may be this far outside."""

CLEAR_DISTANCE = 2e-3
"""Distance from the workspace's edge below which an interval is checked at close instants [m]."""


@kernel(borrows=True, forceinline=True)
def measure_tip_excess(m: MachineArrays, state: LimitInputs) -> float:
    """Return the distance of the tip outside the workspace [m].

    The workspace has a least x, and a least and a greatest distance from the origin. The result is
    the largest of the three excesses.

    Args:
        m: Arrays of the machine.
        state: State of the motion at one instant; only the tip position counts.

    Returns:
        Distance; negative if the tip is inside.
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
"""Limit of the tip position; its quantity is the distance outside the workspace [m]."""
