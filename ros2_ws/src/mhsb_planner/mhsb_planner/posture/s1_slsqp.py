"""Posture of largest velocity polytope by sequential quadratic programming, as the paper does it.

    maximise area(q)  subject to  tip(q) = node,  q_min ≤ q ≤ q_max

by SciPy's SLSQP from random starts, on the same area kernel as the global search. An equality
constraint is only ever met within a tolerance, which here would gain area; so each result is
projected onto the exact position and the limits before it counts. It may well miss the largest
polytope: it is here to be compared with.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import minimize

from mhsb_model.inverse_kinematics.tip_postures import nearest_posture
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.posture.s1_polytope import polytope_area
from mhsb_planner.posture.s1_psi_intervals_3r import MAX_INTERVALS, feasible, feasible_intervals

STARTS = 5
SEED = 0
TURN = 2.0 * math.pi


def search_by_slsqp(
    machine: Machine, position: FloatArray, posture: FloatArray, area: FloatArray
) -> None:
    """The `NodeSolver` of this module."""
    posture[:] = np.nan
    area[:] = np.nan
    for node, (x, z) in enumerate(position):
        for p, pattern in enumerate(machine.patterns):
            found = largest_by_slsqp(machine, float(x), float(z), pattern, SEED + p)
            if found is not None:
                posture[node, p], area[node, p] = found


def largest_by_slsqp(
    machine: Machine, x: float, z: float, pattern: ModeArray, seed: int, starts: int = STARTS
) -> tuple[FloatArray, float] | None:
    """Best posture [rad] of several starts and its area [m²/s²], tip at (x, z) m.

    None where no posture is within limits. The same arguments give the same result.
    """
    if machine.is_3r:
        interval = np.empty((MAX_INTERVALS, 3))
        interval = interval[: feasible_intervals(machine.arrays, x, z, interval)]
        if len(interval) == 0:
            return None
    low, high = machine.arrays.joint_min, machine.arrays.joint_max
    place = [seed, *np.array([x, z]).view(np.uint64)]
    random = np.random.default_rng(place)
    best: tuple[FloatArray, float] | None = None
    for start in random.uniform(low, high, (starts, machine.joint_count)):
        result = minimize(
            lambda q: -polytope_area(machine, q, pattern),
            start,
            method="SLSQP",
            bounds=list(zip(low, high, strict=True)),
            constraints={
                "type": "eq",
                "fun": lambda q: machine.tip_position(q) - (x, z),
                "jac": machine.jacobian,
            },
        )
        if not np.all(np.isfinite(result.x)):
            continue
        if machine.is_3r:
            q = _projected(machine, x, z, interval, result.x)
        else:
            q = np.empty(machine.joint_count)
            if not nearest_posture(machine.arrays, x, z, result.x, q):
                continue
        area = polytope_area(machine, q, pattern)
        if best is None or area > best[1]:
            best = q, area
    return best


def _projected(
    machine: Machine, x: float, z: float, interval: FloatArray, q: FloatArray
) -> FloatArray:
    """Of three joints the posture with its tip exactly at (x, z) and within limits whose ψ is
    nearest to q's.

    On q's own elbow branch where that is feasible at all.
    """
    elbow = 1 if q[1] > 0.0 else -1
    own = interval[interval[:, 0] == elbow]
    candidates = own if len(own) else interval
    middle, half = candidates[:, 1:].mean(axis=1), np.ptp(candidates[:, 1:], axis=1) / 2
    offset = (q.sum() - middle + math.pi) % TURN - math.pi
    nearest = int(np.argmin(np.abs(offset) - half))
    branch, lower, upper = candidates[nearest]
    psi = min(max(middle[nearest] + offset[nearest], lower), upper)
    exact = np.empty(3)
    if not feasible(machine.arrays, x, z, psi, int(branch), exact):
        feasible(
            machine.arrays, x, z, lower if psi < middle[nearest] else upper, int(branch), exact
        )
    return exact
