"""Local improvement of a cylinder path: remove waypoints, move waypoints, change the goal posture.

A change is kept only if it makes the whole path cheaper. The path therefore never becomes worse,
and the improvement can end after any change.
"""

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.tip_postures import solve_posture
from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.types import FloatArray
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.integrated.cylinder_path import (
    PathCostBuffers,
    PathCostModel,
    begin_path,
    compute_costs_to_go,
    continue_path,
    price_path,
)


class SweptPath(NamedTuple):
    """A cylinder path with its end posture; a compass search changes both in place.

    Attributes:
        waypoints: Waypoints, shape (points, n) [m].
        start: Joint positions at waypoints[0], shape (n,) [rad or m].
        tip: Tip position (x, z) at the end [m].
        elbow: Elbow branch (sign of the second-last joint's angle) of the posture at the end, −1 or
            1. With telescopes: sign of the last turning joint's angle.
        free: Free coordinates of the posture at the end, shape (n - 2,) [rad or m]: the first n − 3
            joint angles, and ψ of the end link. With telescopes: the positions of all joints except
            the last two turning joints.
    """

    waypoints: FloatArray
    start: FloatArray
    tip: tuple[float, float]
    elbow: int
    free: FloatArray


class Strides(NamedTuple):
    """Sizes of the changes that one sweep of a compass search tries.

    Attributes:
        stroke: Stroke by which an inner waypoint is moved along each cylinder [m].
        turn: Stride of each free coordinate at the end, shape (n - 2,) [rad or m]; 0 keeps the
            coordinate.
    """

    stroke: float
    turn: FloatArray


def remove_waypoints(
    t: PathCostModel,
    w: PathCostBuffers,
    via: FloatArray,
    start: FloatArray,
    cost: float,
    deadline: Deadline = NO_DEADLINE,
) -> tuple[FloatArray, float]:
    """Remove inner waypoints of a cylinder path as long as its cost does not increase.

    For each inner waypoint in turn, the path without this waypoint is priced.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        w: Working memory of the thread, overwritten.
        via: Waypoints, shape (points, n) [m]; not changed.
        start: Joint positions at via[0], shape (n,) [rad or m].
        cost: Cost of the path.
        deadline: Instant after which no more waypoints are tried; untried waypoints stay.

    Returns:
        The remaining waypoints (`via` itself if all remain), and the cost of the path through them.
    """
    i = 1
    while i < len(via) - 1 and not deadline.has_passed:
        without = np.delete(via, i, axis=0)
        shorter = price_path(t, w, without, start, cost * (1.0 + 1e-9))
        if shorter < math.inf:
            via, cost = without, min(cost, shorter)
        else:
            i += 1
    return via, cost


def sweep_waypoints(
    t: PathCostModel,
    w: PathCostBuffers,
    path: SweptPath,
    cost: float,
    strides: Strides,
    deadline: Deadline = NO_DEADLINE,
) -> float:
    """Run one sweep of a compass search: try to move each waypoint of a path except the start.

    The sweep tries to move each inner waypoint along each cylinder by a stride, and keeps each move
    that makes the path cheaper. The last waypoint moves by changes of the goal posture. A path with
    the cost inf stays as it is.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        w: Working memory of the thread, overwritten.
        path: The path; its waypoints and free coordinates are changed in place.
        cost: Cost of the path.
        strides: Strides of the sweep.
        deadline: Instant after which no more waypoints are tried; untried waypoints stay as they
            are.

    Returns:
        Cost of the changed path, at most `cost`.
    """
    if cost == math.inf:
        return cost
    ahead = compute_costs_to_go(t, w, path.waypoints, path.start)
    for i in range(1, len(path.waypoints)):
        if deadline.has_passed:
            break
        cost = sweep_waypoint(t, w, path, cost, strides, i, ahead)
    return cost


@kernel(inline="always")
def compute_goal_lengths(
    t: PathCostModel, tip: tuple[float, float], elbow: int, free: FloatArray, length: FloatArray
) -> bool:
    """Compute the cylinder lengths of the goal posture with given free coordinates.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        tip: Tip position (x, z) at the goal [m].
        elbow: Elbow branch (sign of the second-last joint's angle), −1 or 1; with telescopes the
            sign of the last turning joint's angle.
        free: Free coordinates, shape (n - 2,) [rad or m]: the first n − 3 joint angles and the
            end-link angle ψ. With telescopes: the positions of all joints except the last two
            turning joints.
        length: Written in place, shape (n,) [m]; unchanged if there is no posture.

    Returns:
        False if there is no posture within the joint limits.
    """
    m = t.machine
    q = np.empty(len(length))
    if not solve_posture(m, tip[0], tip[1], free, elbow, q):
        return False
    for j in range(len(length)):
        length[j] = cylinder_length(m.linkage[j], q[j])
    return True


@kernel
def sweep_waypoint(
    t: PathCostModel,
    w: PathCostBuffers,
    path: SweptPath,
    cost: float,
    strides: Strides,
    i: int,
    ahead: FloatArray,
) -> float:
    """Try to move waypoint i of a cylinder path, as one part of a sweep.

    An inner waypoint is moved along each cylinder by the same stroke, both ways. The last waypoint
    moves with the goal posture. The m free coordinates of the posture are changed one by one and
    together, in all 3^m − 1 directions. A move that makes the path cheaper is kept at once. Its
    opposite is then not tried, and the next move begins at the new place.

    The function must be called for i = 1, 2, … in sequence, because the working memory holds the
    costs up to the previous waypoint.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        w: Working memory of the thread, as the call for the previous waypoint left it; changed in
            place.
        path: The path. Its waypoint i is changed in place; for the last waypoint the free
            coordinates are changed, too.
        cost: Cost of the path.
        strides: Sizes of the moves: stroke of inner waypoints [m], and change of each free
            coordinate [rad or m].
        i: Index of the waypoint, at least 1.
        ahead: Costs from each waypoint to the end, by mode combination of arrival at the waypoint,
            shape (points, patterns). `compute_costs_to_go` gives them before the sweep.

    Returns:
        Cost of the changed path, at most `cost`.
    """
    points, via, free = w.points, path.waypoints, path.free
    n = via.shape[1]
    if i == 1:
        begin_path(t, w, via[0], path.start)
    else:
        continue_path(t, w, via[i - 2 : i], math.inf, False)
    # State of the dynamic programming at the previous waypoint, from which every trial begins.
    value, posture, force = w.value[0].copy(), points.posture[0].copy(), points.force[0].copy()
    kept = np.empty(n)
    last = i == len(via) - 1
    left = 0.0 if last else np.min(ahead[i + 1])
    free_before = free.copy()
    for k in range((3 ** len(free) - 1) // 2 if last else n):
        for sign in (-1.0, 1.0):
            copy_row(kept, via[i])
            if last:
                copy_row(free_before, free)
                moved = _turn_goal(free, strides.turn, k, sign) and compute_goal_lengths(
                    t, path.tip, path.elbow, free, via[i]
                )
            else:
                moved = _move_waypoint(t.machine, via[i], k, sign * strides.stroke)
            if moved:
                copy_row(points.posture[0], posture)
                copy_row(points.length[0], via[i - 1])
                copy_row(points.force[0], force)
                copy_row(w.value[0], value)
                trial = continue_path(t, w, via[i - 1 : i + 2], cost - left, last)
                if trial < math.inf and not last:
                    trial = np.min(w.value[0, :-1] + ahead[i + 1])
                if trial < cost:
                    cost = trial
                    break
            copy_row(via[i], kept)
            copy_row(free, free_before)
    copy_row(points.posture[0], posture)
    copy_row(points.length[0], via[i - 1])
    copy_row(points.force[0], force)
    copy_row(w.value[0], value)
    return cost


@kernel(inline="always")
def _turn_goal(free: FloatArray, turn: FloatArray, k: int, sign: float) -> bool:
    """Change the free coordinates of the goal posture by their strides, in direction k.

    The m digits of k to the base 3 choose the direction. Digit 0 adds the stride of a coordinate, 1
    leaves the coordinate as it is, and 2 subtracts the stride. The numbers below (3^m − 1) / 2 give
    one direction of each opposite pair. Directions that change several coordinates are needed,
    because the cost has kinks and may fall only along a kink.

    Args:
        free: Free coordinates, shape (m,) [rad or m]; changed in place.
        turn: Stride of each free coordinate, shape (m,) [rad or m]; 0 keeps the coordinate.
        k: Number of the direction, from 0.
        sign: −1 for the opposite direction, otherwise 1.

    Returns:
        False if no coordinate changes.
    """
    moved = False
    for j in range(len(free)):
        stride = sign * (1 - k % 3) * turn[j]
        k //= 3
        free[j] += stride
        moved = moved or stride != 0.0
    return moved


@kernel(inline="always")
def _move_waypoint(m: MachineArrays, corner: FloatArray, j: int, stroke: float) -> bool:
    """Change the length of cylinder j at a waypoint by a stroke.

    A length beyond the cylinder's range is replaced by the nearer end of the range.

    Args:
        m: Arrays of the machine.
        corner: Waypoint, shape (n,) [m]; changed in place.
        j: Index of the cylinder.
        stroke: Stroke, positive in extension [m].

    Returns:
        False if the waypoint does not change because the cylinder is at the end of its range.
    """
    one = cylinder_length(m.linkage[j], m.joint_min[j])
    other = cylinder_length(m.linkage[j], m.joint_max[j])
    before = corner[j]
    corner[j] = min(max(one, other), max(min(one, other), before + stroke))
    return corner[j] != before
