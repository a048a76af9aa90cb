"""Goal postures near the start posture, for chains with more than three joints.

Evenly spaced samples of two or more free coordinates are degrees apart, which is too coarse for a
short move. They rarely contain postures with a joint at its limit. This module therefore searches
curves through the joint space. On a curve, two joints close the chain, one other joint is sampled,
and the rest keep their start positions. There is a curve for each choice of these joints. On each
curve, the posture with the least lower bound on the cost is added.
"""

import math
from dataclasses import replace

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.closed_form_3r import is_within_limits
from mhsb_model.inverse_kinematics.tip_postures import close_chain
from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length, cylinder_lengths
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.errors import ZoneError
from mhsb_planner.integrated.goal_postures import GoalPostures, find_elbows_and_free_coordinates
from mhsb_planner.search.goal_clearance import find_clear_postures
from mhsb_planner.search.lower_bound import bound_cost_between
from mhsb_planner.search.s2_step import HydraulicCoefficients

JOINT_SAMPLE_COUNT = 24
"""Number of evenly spaced samples of a joint's range, limits included. The start position is an
additional sample.
"""


def add_postures_near_start(
    machine: Machine,
    goals: GoalPostures,
    start: FloatArray,
    circuit: HydraulicCoefficients,
    weight: FloatArray,
) -> GoalPostures:
    """Add goal postures near the start posture to the evenly sampled ones.

    The new postures have the tip at the goal itself, even if there is a goal region. Postures too
    near to obstacles are not added. Nothing is added in three cases:

    - The arm has three joints, so that its samples are dense.
    - The end-link angle is prescribed.
    - No sample has the tip at the goal itself.

    Args:
        machine: The arm without a slewing joint.
        goals: Sampled goal postures.
        start: Start posture, shape (n,) [rad or m].
        circuit: Hydraulic coefficients of the machine.
        weight: Weights of energy [1/J] and time [1/s], shape (2 or more,).

    Returns:
        The goal postures, the additional ones last; `goals` itself if nothing is added.
    """
    x, z = goals.tip
    if machine.joint_count == 3 or goals.psi_range is not None:
        return goals
    if not np.any(np.all(goals.tips == goals.tip, axis=1)):
        return goals
    lengths = machine.cylinder_lengths(start)
    near = _search_near_postures(machine.arrays, circuit, start, lengths, x, z, weight)
    if len(near) == 0:
        return goals
    try:
        near = near[find_clear_postures(machine, x, z, near)]
    except ZoneError:  # the sampled postures remain
        return goals
    posture = frozen(np.concatenate([goals.posture, near]))
    elbow, free = find_elbows_and_free_coordinates(machine, near)
    return replace(
        goals,
        tips=frozen(np.concatenate([goals.tips, np.tile(goals.tip, (len(near), 1))])),
        posture=posture,
        length=frozen(cylinder_lengths(machine.arrays.linkage, posture)),
        elbow=frozen(np.concatenate([goals.elbow, elbow])),
        free=frozen(np.concatenate([goals.free, free])),
    )


@kernel
def _search_near_postures(
    m: MachineArrays,
    c: HydraulicCoefficients,
    start: FloatArray,
    lengths: FloatArray,
    x: float,
    z: float,
    weight: FloatArray,
) -> FloatArray:
    """Find the best goal posture on each of many curves through the joint space.

    Each choice of a pair of joints and a third joint gives a curve. The third joint takes
    JOINT_SAMPLE_COUNT evenly spaced positions from limit to limit, and its start position. The pair
    then brings the tip to the goal, in up to two ways, which both belong to the curve. All other
    joints keep their start positions. The best posture has the least lower bound on the cost from
    the start.

    Tested against the same search in plain Python.

    Args:
        m: Arrays of the machine.
        c: Hydraulic coefficients of the machine.
        start: Start posture, shape (n,) [rad or m].
        lengths: Cylinder lengths in the start posture, shape (n,) [m].
        x: Goal position of the tip, forward [m].
        z: Goal position of the tip, upward [m].
        weight: Weights of energy [1/J] and time [1/s], shape (2 or more,).

    Returns:
        The best posture of each curve, shape (found, n) [rad or m]. Curves without a posture within
        the joint limits give none.
    """
    n, count = len(start), 0
    found = np.empty((n * (n - 1) // 2 * (n - 2), n))
    q, length = np.empty(n), np.empty(n)
    for i in range(n):
        for j in range(i + 1, n):
            for k in range(n):
                if k in (i, j):
                    continue
                least = math.inf
                for sample in range(2 * (JOINT_SAMPLE_COUNT + 1)):
                    copy_row(q, start)
                    share = (sample // 2) / (JOINT_SAMPLE_COUNT - 1)
                    if share <= 1.0:
                        q[k] = (1.0 - share) * m.joint_min[k] + share * m.joint_max[k]
                    if not close_chain(m, x, z, i, j, 2 * (sample % 2) - 1, q):
                        continue
                    if not is_within_limits(m, q):
                        continue
                    for joint in range(n):
                        length[joint] = cylinder_length(m.linkage[joint], q[joint])
                    cost = bound_cost_between(c, lengths, length, weight)
                    if cost < least:
                        least = cost
                        copy_row(found[count], q)
                if least < math.inf:
                    count += 1
    return found[:count]


def warm_up(machine: Machine, start: FloatArray, circuit: HydraulicCoefficients) -> None:
    """Compile the kernels that find goal postures near the start, by one call.

    Args:
        machine: The arm without a slewing joint.
        start: Posture used for the call, shape (n,) [rad or m].
        circuit: Hydraulic coefficients of the machine.
    """
    x, z = machine.tip_position(start)
    lengths = machine.cylinder_lengths(start)
    _search_near_postures(machine.arrays, circuit, start, lengths, float(x), float(z), np.ones(3))
