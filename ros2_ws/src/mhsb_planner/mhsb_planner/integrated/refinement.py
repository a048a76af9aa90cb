"""Local improvement of a route: corners taken out, corners moved, the goal's free angles turned.

Every change is kept only where the whole route then costs less, so a route never gets worse, and
work can end after any of them.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.tip_postures import posture_at
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.types import FloatArray
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.integrated.route import (
    Memory,
    Terms,
    begin_route,
    continue_route,
    costs_ahead,
    price_route,
)


def shortcut(
    t: Terms,
    w: Memory,
    via: FloatArray,
    start: FloatArray,
    cost: float,
    deadline: Deadline = NEVER,
) -> tuple[FloatArray, float]:
    """The route with every corner taken out whose absence makes it no dearer, and its cost.

    After the deadline the rest of the corners stay.
    """
    i = 1
    while i < len(via) - 1 and not deadline.passed:
        without = np.delete(via, i, axis=0)
        shorter = price_route(t, w, without, start, cost * (1.0 + 1e-9))
        if shorter < math.inf:
            via, cost = without, min(cost, shorter)
        else:
            i += 1
    return via, cost


def sweep(
    t: Terms,
    w: Memory,
    via: FloatArray,
    start: FloatArray,
    cost: float,
    tip: tuple[float, float],
    elbow: int,
    free: FloatArray,
    stroke: float,
    turn: FloatArray,
    deadline: Deadline = NEVER,
) -> float:
    """One round of a compass search, `sweep_corner` by corner; returns the cost.

    A route that is not possible, of infinite cost, stays as it is, and after the deadline the rest
    of the corners do.
    """
    if cost == math.inf:
        return cost
    ahead = costs_ahead(t, w, via, start)
    for i in range(1, len(via)):
        if deadline.passed:
            break
        cost = sweep_corner(t, w, via, start, cost, tip, elbow, free, stroke, turn, i, ahead)
    return cost


@kernel
def goal_lengths(
    t: Terms, tip: tuple[float, float], elbow: int, free: FloatArray, length: FloatArray
) -> bool:
    """Cylinder lengths [m] with the tip at the goal; False where they are not within limits."""
    m = t.machine
    q = np.empty(len(length))
    if not posture_at(m, tip[0], tip[1], free, elbow, q):
        return False
    for j in range(len(length)):
        length[j] = cylinder_length(m.linkage[j], q[j])
    return True


@kernel
def sweep_corner(
    t: Terms,
    w: Memory,
    via: FloatArray,
    start: FloatArray,
    cost: float,
    tip: tuple[float, float],
    elbow: int,
    free: FloatArray,
    stroke: float,
    turn: FloatArray,
    i: int,
    ahead: FloatArray,
) -> float:
    """One corner's part of a round of a compass search; returns the cost.

    The corner is moved along each cylinder, or, at the route's end, each free angle there, both
    ways. Corners are taken from i = 1 on, one after the other: w keeps what is known where the
    one before was. What follows the next corner does not change, and is priced once a round.

    via     float64[points, n] m, changed in place
    stroke  m, by which the corner is moved
    free    float64[n - 2] rad, of the posture at the end, changed in place
    turn    float64[n - 2] rad, by which they are turned; 0 leaves one
    ahead   of `route.costs_ahead`, before the round began
    """
    m, points = t.machine, w.points
    n = via.shape[1]
    parent = np.empty((1, len(t.patterns)), dtype=np.int64)
    if i == 1:
        begin_route(t, w, via[0], start)
    else:
        continue_route(t, w, via[i - 2 : i], math.inf, parent, False)
    # What is known at the corner before the one that is moved: trials begin there.
    value, posture, force = w.value[0].copy(), points.posture[0].copy(), points.force[0].copy()
    kept = np.empty(n)
    last = i == len(via) - 1
    left = 0.0 if last else np.min(ahead[i + 1])
    for k in range(len(free) if last else n):
        before = free[k] if last else 0.0
        for sign in (-1.0, 1.0):
            kept[:] = via[i]
            if last:
                free[k] = before + sign * turn[k]
                moved = turn[k] > 0.0 and goal_lengths(t, tip, elbow, free, via[i])
            else:
                moved = _move(m, via[i], k, sign * stroke)
            if moved:
                points.posture[0] = posture
                points.length[0] = via[i - 1]
                points.force[0] = force
                w.value[0] = value
                trial = continue_route(t, w, via[i - 1 : i + 2], cost - left, parent, last)
                if trial < math.inf and not last:
                    trial = np.min(w.value[0, :-1] + ahead[i + 1])
                if trial < cost:
                    cost = trial
                    break
            via[i] = kept
            if last:
                free[k] = before
    points.posture[0] = posture
    points.length[0] = via[i - 1]
    points.force[0] = force
    w.value[0] = value
    return cost


@kernel(borrows=True)
def _move(m: MachineArrays, corner: FloatArray, j: int, stroke: float) -> bool:
    """Move a corner along cylinder j [m] as far as its limits allow; False where it stays."""
    one = cylinder_length(m.linkage[j], m.joint_min[j])
    other = cylinder_length(m.linkage[j], m.joint_max[j])
    before = corner[j]
    corner[j] = min(max(one, other), max(min(one, other), before + stroke))
    return corner[j] != before
