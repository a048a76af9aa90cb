"""Feasible intervals of the end-link angle ψ at a tip position, for three turning joints.

The tip is held and ψ varies. A posture then becomes infeasible only if the wrist (last joint)
reaches the edge of its range, or a joint reaches a limit. Each of these events fixes one side of a
triangle, from which the law of cosines gives ψ. Between two such angles, the postures of an elbow
branch are either all feasible or all infeasible.

For a longer chain, the module describes the last three joints. Tip and ψ are then given in the
frame of these joints (`tip_postures.transform_tip_to_outer_frame`).
"""

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.closed_form_3r import is_within_limits, solve_last_three_joints
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kernels.sorting import sort_in_place
from mhsb_model.types import FloatArray

MAX_CRITICAL = 16
"""Largest number of angles ψ at which postures may become infeasible.

There are two angles for each of 8 events: outer reach, inner reach, and both limits of q₁, q₂ and
q₃."""

MAX_INTERVALS = 2 * (MAX_CRITICAL + 1)
"""Largest number of feasible intervals on both elbow branches."""
COSINE_TOLERANCE = 1e-12
"""Excess of a cosine beyond ±1 that counts as rounding, as in a degenerate triangle [-]."""


@kernel(borrows=True)
def solve_posture_at_psi(
    m: MachineArrays, x: float, z: float, psi: float, elbow: int, q: FloatArray
) -> bool:
    """Compute the posture with a given tip position and end-link angle, and check its limits.

    Args:
        m: Arrays of the machine.
        x: Tip position forward, in the frame of the last three joints [m].
        z: Tip position upward, in the frame of the last three joints [m].
        psi: End-link angle in the same frame [rad].
        elbow: Elbow branch (sign of the second-last joint's angle), −1 or 1.
        q: Posture, shape (n,) [rad]. Its last three entries are written in place; the others must
            be set.

    Returns:
        True if the posture exists and all joints are within their limits.
    """
    return solve_last_three_joints(m, x, z, psi, elbow, q) and is_within_limits(m, q)


@kernel(borrows=True)
def _append_angle_pair(found: FloatArray, count: int, center: float, cosine: float) -> int:
    """Append the two angles center ± acos(cosine) to a list, if they exist.

    Args:
        found: Angles [rad], written in place from index `count` on.
        count: Number of angles in the list before the call.
        center: Middle of the two angles [rad].
        cosine: Cosine of half the difference of the angles. If it is beyond ±1 by more than
            COSINE_TOLERANCE, the angles do not exist.

    Returns:
        Number of angles in the list after the call.
    """
    if abs(cosine) > 1.0 + COSINE_TOLERANCE:
        return count
    half = math.acos(min(1.0, max(-1.0, cosine)))
    found[count] = center - half
    found[count + 1] = center + half
    return count + 2


@kernel(borrows=True)
def _find_critical_angles(m: MachineArrays, x: float, z: float, found: FloatArray) -> int:
    """Find all end-link angles ψ at which a posture of the last three joints may become infeasible.

    The tip position is given in the frame of these joints, named shoulder, elbow and wrist. Their
    links are L₁, L₂ and L₃ long. The tip lies at the distance R from the shoulder, in the direction
    φ. A posture becomes infeasible if the wrist reaches the edge of its range, or a joint reaches a
    limit. The triangles in brackets give ψ for each case:

    - Reach and limits of q₂ (shoulder, wrist at distance D, tip):
        cos(ψ − φ) = (R² + L₃² − D²)/(2 L₃ R)
    - Limits of q₁ (elbow, wrist, tip; the tip at distance d from the elbow, in direction δ):
        cos(ψ − δ) = (d² + L₃² − L₂²)/(2 L₃ d)
    - Limits of q₃ (shoulder, elbow, tip; the outer two links form a line of length D, with the
      direction θ and the angle β from the middle link):
        cos(θ − φ) = (R² + D² − L₁²)/(2 D R),  ψ = θ − β + q₃

    Args:
        m: Arrays of the machine.
        x: Tip position forward [m].
        z: Tip position upward [m].
        found: Written in place, shape (MAX_CRITICAL,): the angles in ascending order, in [−π, π)
            [rad].

    Returns:
        Number of angles.
    """
    k = len(m.link_length) - 3
    l1, l2, l3 = m.link_length[k], m.link_length[k + 1], m.link_length[k + 2]
    radius, phi = math.hypot(x, z), math.atan2(z, x)
    count = 0
    if radius > 0.0:
        double = 2.0 * l3 * radius
        count = _append_angle_pair(found, count, phi, (radius**2 + l3**2 - (l1 + l2) ** 2) / double)
        count = _append_angle_pair(found, count, phi, (radius**2 + l3**2 - (l1 - l2) ** 2) / double)
    for side in range(2):
        q1 = m.joint_min[k] if side == 0 else m.joint_max[k]
        q2 = m.joint_min[k + 1] if side == 0 else m.joint_max[k + 1]
        q3 = m.joint_min[k + 2] if side == 0 else m.joint_max[k + 2]
        dx, dz = x - l1 * math.cos(q1), z - l1 * math.sin(q1)
        d = math.hypot(dx, dz)
        if d > 0.0:
            cosine = (d**2 + l3**2 - l2**2) / (2.0 * l3 * d)
            count = _append_angle_pair(found, count, math.atan2(dz, dx), cosine)
        if radius > 0.0:
            square = l1**2 + l2**2 + 2.0 * l1 * l2 * math.cos(q2)
            count = _append_angle_pair(
                found, count, phi, (radius**2 + l3**2 - square) / (2.0 * l3 * radius)
            )
            ahead, across = l2 + l3 * math.cos(q3), l3 * math.sin(q3)
            rigid = math.hypot(ahead, across)
            if rigid > 0.0:
                cosine = (radius**2 + rigid**2 - l1**2) / (2.0 * rigid * radius)
                count = _append_angle_pair(
                    found, count, phi - math.atan2(across, ahead) + q3, cosine
                )
    for i in range(count):
        turns = math.floor((found[i] + math.pi) / (2.0 * math.pi))
        found[i] -= 2.0 * math.pi * turns
    sort_in_place(found, count)
    return count


@kernel(borrows=True)
def _find_nearest_feasible_psi(
    m: MachineArrays, x: float, z: float, end: float, middle: float, elbow: int, q: FloatArray
) -> float:
    """Find the feasible end-link angle ψ nearest to a computed end of an interval.

    Rounding may have put the end slightly outside the joint limits. The angle is then moved towards
    the middle of the interval, by growing steps.

    Args:
        m: Arrays of the machine.
        x: Tip position forward [m].
        z: Tip position upward [m].
        end: Computed end of the interval [rad].
        middle: Middle of the interval [rad].
        elbow: Elbow branch (sign of the second-last joint's angle), −1 or 1.
        q: Posture, shape (n,) [rad]. The last three joints are overwritten; the others must be
            within their limits.

    Returns:
        Feasible ψ [rad]; `middle` if no feasible angle is found between end and middle.
    """
    psi = end
    step = 1e-16
    while not solve_posture_at_psi(m, x, z, psi, elbow, q):
        if step >= abs(middle - end):
            return middle
        psi = end + math.copysign(step, middle - end)
        step *= 2.0
    return psi


@kernel
def find_feasible_intervals(m: MachineArrays, x: float, z: float, found: FloatArray) -> int:
    """Find the intervals of the end-link angle ψ with feasible postures at a tip position.

    A posture is feasible if it exists and the last three joints are within their limits. The tip is
    given in the frame of these joints. An interval can be a single point. Its end can be the
    beginning of the next interval.

    Tested against a fine scan of ψ.

    Args:
        m: Arrays of the machine.
        x: Tip position forward [m].
        z: Tip position upward [m].
        found: Intervals, shape (MAX_INTERVALS, 3). Written in place: elbow branch (−1 or 1), lower
            end and upper end of ψ [rad]. Branch −1 comes first, and ψ ascends within a branch. The
            ends are feasible.

    Returns:
        Number of intervals; 0 if there is no feasible posture.
    """
    critical = np.empty(MAX_CRITICAL)
    edges = _find_critical_angles(m, x, z, critical)
    if edges == 0:
        critical[0] = -math.pi
        edges = 1
    q = m.joint_min.copy()  # any values within limits for the inner joints
    count = 0
    for elbow in (-1, 1):
        open_interval = False
        for i in range(edges):
            lower = critical[i]
            upper = critical[i + 1] if i + 1 < edges else critical[0] + 2.0 * math.pi
            if not solve_posture_at_psi(m, x, z, 0.5 * (lower + upper), elbow, q):
                open_interval = False
                continue
            if not open_interval:
                found[count, 0], found[count, 1] = elbow, lower
                count += 1
                open_interval = True
            found[count - 1, 2] = upper
    for i in range(count):
        elbow = int(found[i, 0])
        middle = 0.5 * (found[i, 1] + found[i, 2])
        found[i, 1] = _find_nearest_feasible_psi(m, x, z, found[i, 1], middle, elbow, q)
        found[i, 2] = _find_nearest_feasible_psi(m, x, z, found[i, 2], middle, elbow, q)
    return count
