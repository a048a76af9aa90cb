"""Manipulability loss: velocity-polytope area lost along a motion, as a term of the cost.

    M = ∫ max(0, 1 − A(q, p)/A_ref) ds     [m]

The integral runs along the tip's path s [m]. A [m²/s²] is the polytope's area (`s1_polytope`) in
posture q and the mode combination p in force. A_ref [m²/s²] is the area that counts as full; half
of the workspace nodes have a larger area. M equals the length of a path with area 0 that would have
the same loss. It is never negative, and the losses of the parts of a path add up to the loss of the
path. In the cost w₁ E + w₂ T + w₃ switches + w₄ M its weight w₄ has the unit 1/m. The area is
defined in the paper's Section 2.1; the paper does not use it in the cost.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import tip_position
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import MODE_COUNT
from mhsb_model.trajectory import MAX_POINT_SPACING_NS, Trajectory
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.posture.s1_polytope import (
    compute_area_from_limits,
    compute_cross_products,
    compute_flow_limits,
    compute_flow_scale,
    compute_posture_area,
    compute_tip_columns,
    get_shared_flow,
)
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.discrete_path import DiscretePath

MAX_JOINT_STEP = 0.02
"""Largest change of a joint between two samples of the area along a path [rad or m]."""

SAMPLES_AT_ONCE = 128
"""Number of samples whose area is computed between two looks at the clock."""


class AreaTerm(NamedTuple):
    """Parameters of the cost term w₄ M. A weight of 0 leaves the term out.

    Attributes:
        weight: Weight w₄ [1/m].
        reference: Area A_ref that counts as full [m²/s²].
    """

    weight: float
    reference: float


WITHOUT_AREA = AreaTerm(0.0, 1.0)
"""Area term that adds no cost."""


def create_area_cost(weight: float, table: PostureTable) -> AreaTerm:
    """Create the cost term of the manipulability loss, with the reference area of a table.

    Args:
        weight: Weight w₄ of the manipulability loss [1/m].
        table: Posture table (best posture for each workspace node and mode combination), which
            gives the reference area.

    Returns:
        The weight with the table's reference area, or WITHOUT_AREA if the weight is 0 or negative.
    """
    return AreaTerm(weight, compute_reference_area(table)) if weight > 0.0 else WITHOUT_AREA


def compute_reference_area(table: PostureTable) -> float:
    """Compute the velocity-polytope area that counts as full, from a posture table.

    Args:
        table: Posture table with at least one feasible node.

    Returns:
        Reference area [m²/s²]: each feasible node has a largest area over its mode combinations;
        the median of these areas.
    """
    return float(np.median(np.nanmax(table.area[table.feasible], axis=1)))


@kernel
def compute_step_area_loss(
    m: MachineArrays,
    term: AreaTerm,
    start: FloatArray,
    end: FloatArray,
    patterns: ModeArray,
    status: IntArray,
    required_status: int,
    cost: FloatArray,
) -> None:
    """Compute the cost of the manipulability loss of one step in all mode combinations.

    The area A_p in mode combination p is evaluated at the middle of the step in joint space. It
    applies to the straight distance between the tip positions at both ends. With the weight w₄ and
    the reference area A_ref:

        cost[p] = w₄ |tip(end) − tip(start)| max(0, 1 − A_p/A_ref)

    Tested against the `AreaProfile` of a finely divided path.

    Args:
        m: Arrays of the machine.
        term: Weight and reference area.
        start: Joint positions at the start of the step, shape (n,) [rad or m].
        end: Joint positions at the end of the step, shape (n,) [rad or m].
        patterns: Mode combinations, shape (patterns, n).
        status: Status code of the step in each combination, from `s2_step.price_steps_to_node`,
            shape (patterns,).
        required_status: Only combinations with this status are computed; all others are skipped.
        cost: Cost in each combination, shape (patterns,) [-]. Written in place; entries of skipped
            combinations stay as they are.
    """
    n = len(start)
    middle = 0.5 * (start + end)
    limit, cross = np.empty((n, MODE_COUNT, 2)), np.empty((n, n))
    compute_flow_limits(m, middle, limit)
    compute_cross_products(compute_tip_columns(m, middle), cross)
    scale, flow = compute_flow_scale(m), get_shared_flow(m)
    here, there = tip_position(m, start), tip_position(m, end)
    weight = term.weight * math.hypot(there[0] - here[0], there[1] - here[1])
    for p in range(len(patterns)):
        if status[p] == required_status:
            area = compute_area_from_limits(cross, scale, limit, patterns[p], flow)
            cost[p] = weight * max(0.0, 1.0 - area / term.reference)


@dataclass(frozen=True, eq=False)
class AreaProfile:
    """Area of the velocity polytope along a path of the tip, divided into k parts.

    Attributes:
        span: Straight length of each part of the tip's path, shape (k,) [m].
        area: Polytope area at the middle of each part, shape (k,) [m²/s²].
    """

    span: FloatArray
    area: FloatArray

    @property
    def mean(self) -> float | None:
        """Mean area along the path, ∫ A ds / ∫ ds [m²/s²]; None if the tip does not move."""
        length = float(self.span.sum())
        return float(self.span @ self.area) / length if length > 0.0 else None

    def compute_area_loss(self, reference: float) -> float:
        """Compute the manipulability loss along the tip's path.

            M = ∫ max(0, 1 − A/A_ref) ds

        A is the polytope's area and s the length along the tip's path.

        Args:
            reference: Reference area A_ref [m²/s²].

        Returns:
            Manipulability loss M [m]. M equals the length of a path with area 0 that would have the
            same loss.
        """
        return float(self.span @ np.maximum(0.0, 1.0 - self.area / reference))


def compute_area_along_path(machine: Machine, path: DiscretePath) -> AreaProfile:
    """Compute the velocity-polytope area along a discrete path, in the modes of its steps.

    Joint positions are interpolated linearly within each step. A step is divided into equal parts
    so that no joint moves by more than `MAX_JOINT_STEP` in a part.

    Args:
        machine: Machine of the path; a slewing joint 1 is ignored.
        path: Discrete path.

    Returns:
        Straight length of each part of the tip's path [m], and the area at the middle of each part
        [m²/s²].
    """
    turned = np.abs(np.diff(path.posture, axis=0)).max(axis=1, initial=0.0)
    parts = np.maximum(1, np.ceil(turned / MAX_JOINT_STEP).astype(np.int64))
    edge = np.concatenate([[0.0], *(k + np.arange(1, n + 1) / n for k, n in enumerate(parts))])
    posture = np.column_stack(
        [np.interp(edge, np.arange(path.steps + 1), angle) for angle in path.posture.T]
    )
    return _compute_area_profile(machine, posture, np.repeat(path.modes, parts, axis=0))


def compute_area_along_motion(
    machine: Machine,
    trajectory: Trajectory,
    schedule: ModeSchedule,
    deadline: Deadline = NO_DEADLINE,
) -> AreaProfile:
    """Compute the velocity-polytope area along a trajectory, in the modes of its schedule.

    The trajectory is divided into parts of equal duration, none longer than `MAX_POINT_SPACING_NS`.

    Args:
        machine: Machine of the trajectory; a slewing joint 1 is ignored.
        trajectory: Joint trajectory.
        schedule: Modes over time.
        deadline: Instant at which the work is given up.

    Returns:
        Straight distance of the tip in each part [m], and area of each part [m²/s²]. The area is
        computed in the mean of the two end postures, for the modes half-way in time.

    Raises:
        DeadlineError: The deadline passed.
    """
    count = max(1, -(-trajectory.duration_ns // MAX_POINT_SPACING_NS))
    at = trajectory.stamp_ns + np.linspace(0, trajectory.duration_ns, 2 * count + 1).astype(int)
    posture = trajectory.sample_many(at[::2])[0]
    return _compute_area_profile(machine, posture, schedule.modes_at_many(at[1::2]), deadline)


def _compute_area_profile(
    machine: Machine, posture: FloatArray, modes: ModeArray, deadline: Deadline = NO_DEADLINE
) -> AreaProfile:
    """Compute the velocity-polytope area between successive postures, in given modes.

    The postures divide the motion into k parts, and each part gets one area. If joint 1 slews, the
    arm is evaluated without it.

    Args:
        machine: Machine with n joints.
        posture: Joint positions at the ends of the parts, shape (k + 1, n) [rad or m].
        modes: Mode codes during each part, shape (k, n).
        deadline: Instant at which the work is given up.

    Returns:
        Straight distance of the tip in each part [m], and area at the mean of the part's two end
        postures [m²/s²], both of shape (k,).

    Raises:
        DeadlineError: The deadline passed.
    """
    posture, modes = posture[:, machine.slews :], modes[:, machine.slews :].copy()
    machine = machine.planar_arm
    tip = machine.tip_positions(posture)
    area = np.empty(len(modes))
    middle = 0.5 * (posture[1:] + posture[:-1])
    for first in range(0, len(modes), SAMPLES_AT_ONCE):
        deadline.check("the area along the motion")
        part = slice(first, first + SAMPLES_AT_ONCE)
        _compute_areas(machine.arrays, middle[part], modes[part], area[part])
    return AreaProfile(np.hypot(*np.diff(tip, axis=0).T), area)


@kernel(borrows=True)
def _compute_areas(
    m: MachineArrays, posture: FloatArray, modes: ModeArray, area: FloatArray
) -> None:
    """Compute the velocity-polytope area of k postures, each in its own modes.

    Args:
        m: Arrays of the machine without a slewing joint.
        posture: Joint positions, shape (k, n) [rad or m].
        modes: Mode codes, shape (k, n).
        area: Areas, shape (k,) [m²/s²]. Written in place.
    """
    for k in range(len(area)):
        area[k] = compute_posture_area(m, posture[k], modes[k])


def warm_up(machine: Machine) -> None:
    """Compile the kernels that compute the velocity-polytope area along a motion.

    Args:
        machine: Machine whose joints and mode combinations give the argument types.
    """
    posture = machine.arrays.joint_min[None, :].repeat(2, axis=0)
    _compute_area_profile(machine, posture, machine.patterns[:1].copy())
