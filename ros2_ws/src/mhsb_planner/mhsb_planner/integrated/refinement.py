"""Local improvement of a route: corners taken out, corners moved, the goal's ψ turned.

Every change is kept only where the whole route then costs less, so a route never gets worse.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mhsb_model.inverse_kinematics_3r import joint_angles, within_limits
from mhsb_model.linkage import cylinder_length
from mhsb_model.types import FloatArray
from mhsb_planner.integrated.route import Memory, Terms, price_route


@njit(cache=True, nogil=True)
def shortcut(
    t: Terms, w: Memory, via: FloatArray, start: FloatArray, cost: float
) -> tuple[FloatArray, float]:
    """The route with every corner taken out whose absence makes it no dearer, and its cost."""
    i = 1
    while i < len(via) - 1:
        without = np.empty((len(via) - 1, via.shape[1]))
        without[:i] = via[:i]
        without[i:] = via[i + 1 :]
        shorter = price_route(t, w, without, start, cost * (1.0 + 1e-9))
        if shorter < math.inf:
            via, cost = without, min(cost, shorter)
        else:
            i += 1
    return via, cost


@njit(cache=True, nogil=True)
def goal_lengths(
    t: Terms, tip: tuple[float, float], elbow: int, psi: float, length: FloatArray
) -> bool:
    """Cylinder lengths [m] with the tip at the goal; False where they are not within limits."""
    m = t.machine
    q = np.empty(len(length))
    if not (joint_angles(m, tip[0], tip[1], psi, elbow, q) and within_limits(m, q)):
        return False
    for j in range(len(length)):
        length[j] = cylinder_length(m.linkage[j], q[j])
    return True


@njit(cache=True, nogil=True)
def sweep(
    t: Terms,
    w: Memory,
    via: FloatArray,
    start: FloatArray,
    cost: float,
    tip: tuple[float, float],
    elbow: int,
    psi: float,
    stroke: float,
    turn: float,
) -> tuple[float, float]:
    """One round of a compass search; returns cost and ψ.

    Each corner is moved along each cylinder and along each pair, then ψ is turned, both ways.

    via     float64[points, n] m, changed in place
    stroke  m, by which corners are moved
    turn    rad, by which the goal's ψ is turned; 0 leaves it
    """
    m = t.machine
    n = via.shape[1]
    old = np.empty(n)
    for i in range(1, len(via) - 1):
        for j in range(n):
            low = cylinder_length(m.linkage[j], m.joint_min[j])
            high = cylinder_length(m.linkage[j], m.joint_max[j])
            low, high = min(low, high), max(low, high)
            for sign in (-1.0, 1.0):
                kept = via[i, j]
                via[i, j] = min(high, max(low, kept + sign * stroke))
                if via[i, j] == kept:
                    continue
                moved = price_route(t, w, via, start, cost)
                if moved < cost:
                    cost = moved
                    break
                via[i, j] = kept
    if turn > 0.0:
        for sign in (-1.0, 1.0):
            old[:] = via[-1]
            if goal_lengths(t, tip, elbow, psi + sign * turn, via[-1]):
                moved = price_route(t, w, via, start, cost)
                if moved < cost:
                    cost, psi = moved, psi + sign * turn
                    break
            via[-1] = old
    return cost, psi
