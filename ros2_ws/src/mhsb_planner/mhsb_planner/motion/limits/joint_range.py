"""Limit of the joint positions.

    q_min ≤ q ≤ q_max

Between two points a joint is bounded by the control points of its quintic (`bound_joint_excess`).
"""

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray
from mhsb_planner.motion.limits.limit import LimitInputs, StateLimit

JOINT_TOLERANCE = 1e-6
"""Distance beyond a joint limit that counts as rounding in table or interpolation [rad or m]."""


@kernel(borrows=True, forceinline=True)
def measure_joint_excess(m: MachineArrays, state: LimitInputs) -> float:
    """Return the largest distance of a joint beyond its limits [rad or m].

    Args:
        m: Arrays of the machine.
        state: State of the motion at one instant; only the joint positions count.

    Returns:
        Largest distance; negative if all joints are within their limits.
    """
    excess = -math.inf
    for j in range(len(state.position)):
        q = state.position[j]
        excess = max(excess, m.joint_min[j] - q, q - m.joint_max[j])
    return excess


JOINT_LIMIT = StateLimit(
    name="joint range",
    describe=lambda broken: f"a joint limit is passed by {broken.amount:.3g} rad or m",
    measure=measure_joint_excess,
    limit=0.0,
    broken_above=JOINT_TOLERANCE,
    proven_below=math.inf,
    clear_below=math.inf,
)
"""Limit of the joints [rad or m]. Instead of a parabola, `bound_joint_excess` proves intervals."""


@kernel(borrows=True)
def compute_outward_excess(lower: FloatArray, upper: FloatArray, position: FloatArray) -> float:
    """Compute how far a motion moves a joint outwards beyond its limits.

    A joint that starts beyond a limit may return, but must not move outwards again. So the smallest
    distance so far (at least 0) is subtracted from each distance beyond the limits:

        max_k ( e_k − min_{i ≤ k} max(e_i, 0) )

    e_k is the distance of a joint beyond its limits at instant k, negative within the limits. The
    value of the worst joint is returned.

    Args:
        lower: Lower limit of each joint, shape (n,) [rad or m].
        upper: Upper limit of each joint, shape (n,) [rad or m].
        position: Joint positions in time order, shape (k, n) [rad or m].

    Returns:
        Largest value [rad or m]. It is negative if all joints stay within their limits, and 0 if
        joints beyond their limits only return.
    """
    farthest = -math.inf
    for j in range(position.shape[1]):
        least = math.inf
        for k in range(len(position)):
            excess = max(lower[j] - position[k, j], position[k, j] - upper[j])
            least = min(least, max(excess, 0.0))
            farthest = max(farthest, excess - least)
    return farthest


@kernel
def bound_joint_excess(
    m: MachineArrays,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
) -> FloatArray:
    """Bound the distance of joints beyond their limits between the points of a trajectory.

    Each joint follows a polynomial of degree 5. It stays between the least and the largest of its
    six Bézier control points. Each end of an interval gives three control points: q, q + q̇h/5 and
    q + 2q̇h/5 + q̈h²/20. q, q̇ and q̈ are position, velocity and acceleration of the joint at this
    end. h is the duration of the interval, taken as negative at the interval's end.

    Args:
        m: Arrays of the machine.
        time: Times of the points, shape (k,) [s].
        position: Joint positions at the points, shape (k, n) [rad or m].
        velocity: Joint velocities at the points, shape (k, n) [rad/s or m/s].
        acceleration: Joint accelerations at the points, shape (k, n) [rad/s² or m/s²].

    Returns:
        Upper bound on the distance of the worst joint beyond its limits, for each interval, shape
        (k - 1,) [rad or m]. Negative if all joints certainly stay within their limits.
    """
    rows, n = position.shape
    bound = np.empty(rows - 1)
    for i in range(rows - 1):
        highest = -math.inf
        for k, h in ((i, time[i + 1] - time[i]), (i + 1, time[i] - time[i + 1])):
            for j in range(n):
                q, turn = position[k, j], 0.2 * h * velocity[k, j]
                bent = q + 2.0 * turn + 0.05 * h * h * acceleration[k, j]
                above = max(q, q + turn, bent) - m.joint_max[j]
                below = m.joint_min[j] - min(q, q + turn, bent)
                highest = max(highest, above, below)
        bound[i] = highest
    return bound
