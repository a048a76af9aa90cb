"""Posture with the largest velocity polytope by sequential quadratic programming, as in the paper.

    maximise area(q)  subject to  tip(q) = node,  q_min ≤ q ≤ q_max

SciPy's SLSQP runs from random starts. It meets the tip position only within a tolerance, from which
it would gain area. So each result is moved to the exact tip position and into the joint limits
before its area is computed. The method often misses the largest polytope, and is only used for
comparison.
"""

import math

import numpy as np
from scipy.optimize import minimize

from mhsb_model.inverse_kinematics.tip_postures import find_nearest_posture
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.posture.s1_polytope import compute_polytope_area
from mhsb_planner.posture.s1_psi_intervals_3r import (
    MAX_INTERVALS,
    find_feasible_intervals,
    solve_posture_at_psi,
)

DEFAULT_STARTS = 5
"""Number of random starts for each entry of a table."""
DEFAULT_SEED = 0
"""Seed for the first mode combination of a table; the seed of each further combination is larger by
1.
"""
FULL_TURN = 2.0 * math.pi
"""One turn [rad]."""


def search_by_slsqp(
    machine: Machine, position: FloatArray, posture: FloatArray, area: FloatArray
) -> None:
    """Search for the postures with the largest velocity polytope at many tip positions, by SLSQP.

    The function is a `NodeSolver` of posture tables. It is used for comparison with the global
    search, and may miss the largest polytope.

    Args:
        machine: The arm without a slewing joint.
        position: Tip positions, shape (nodes, 2) [m].
        posture: Posture for each position and mode combination, written in place, shape (nodes,
            patterns, n) [rad or m]; NaN if none is found.
        area: Area of the velocity polytope, written in place, shape (nodes, patterns) [m²/s²]; NaN
            if none is found.
    """
    posture[:] = np.nan
    area[:] = np.nan
    for node, (x, z) in enumerate(position):
        for p, pattern in enumerate(machine.patterns):
            found = find_largest_polytope_by_slsqp(
                machine, float(x), float(z), pattern, DEFAULT_SEED + p
            )
            if found is not None:
                posture[node, p], area[node, p] = found


def find_largest_polytope_by_slsqp(
    machine: Machine,
    x: float,
    z: float,
    pattern: ModeArray,
    seed: int,
    starts: int = DEFAULT_STARTS,
) -> tuple[FloatArray, float] | None:
    """Search for the posture with the largest velocity polytope at a tip position, by SLSQP.

    The polytope contains all velocities of the tip that the pistons' limits allow. The optimisation
    begins at random starts. Each result is moved to the exact tip position and into the joint
    limits. The largest area may be missed. Equal arguments give equal results.

    Args:
        machine: The arm without a slewing joint.
        x: Tip position forward [m].
        z: Tip position upward [m].
        pattern: Mode combination (one mode for each actuator), shape (n,).
        seed: Seed of the random starts, which also depend on the tip position.
        starts: Number of starts.

    Returns:
        Best posture, shape (n,) [rad or m], and its area [m²/s²]. None if no posture is within
        limits, or if no start leads to such a posture.
    """
    if machine.is_3r:
        interval = np.empty((MAX_INTERVALS, 3))
        interval = interval[: find_feasible_intervals(machine.arrays, x, z, interval)]
        if len(interval) == 0:
            return None
    low, high = machine.arrays.joint_min, machine.arrays.joint_max
    place = [seed, *np.array([x, z]).view(np.uint64)]
    random = np.random.default_rng(place)
    best: tuple[FloatArray, float] | None = None
    for start in random.uniform(low, high, (starts, machine.joint_count)):
        result = minimize(
            lambda q: -compute_polytope_area(machine, q, pattern),
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
            q = _project_onto_limits(machine, x, z, interval, result.x)
        else:
            q = np.empty(machine.joint_count)
            if not find_nearest_posture(machine.arrays, x, z, result.x, q):
                continue
        area = compute_polytope_area(machine, q, pattern)
        if best is None or area > best[1]:
            best = q, area
    return best


def _project_onto_limits(
    machine: Machine, x: float, z: float, interval: FloatArray, q: FloatArray
) -> FloatArray:
    """Move a posture of three turning joints to the exact tip position and into the joint limits.

    The result is the feasible posture whose end-link angle ψ is nearest to that of `q`. If the
    elbow branch of `q` (sign of its second joint angle) has a feasible posture, the result is on
    this branch.

    Args:
        machine: The arm without a slewing joint.
        x: Tip position forward [m].
        z: Tip position upward [m].
        interval: Intervals of ψ with feasible postures, shape (k, 3) with k ≥ 1. Each row has the
            elbow branch (−1 or 1), lower end and upper end [rad].
        q: Posture to move, shape (3,) [rad].

    Returns:
        The posture, shape (3,) [rad].
    """
    elbow = 1 if q[1] > 0.0 else -1
    own = interval[interval[:, 0] == elbow]
    candidates = own if len(own) else interval
    middle, half = candidates[:, 1:].mean(axis=1), np.ptp(candidates[:, 1:], axis=1) / 2
    offset = (q.sum() - middle + math.pi) % FULL_TURN - math.pi
    nearest = int(np.argmin(np.abs(offset) - half))
    branch, lower, upper = candidates[nearest]
    psi = min(max(middle[nearest] + offset[nearest], lower), upper)
    exact = np.empty(3)
    if not solve_posture_at_psi(machine.arrays, x, z, psi, int(branch), exact):
        solve_posture_at_psi(
            machine.arrays, x, z, lower if psi < middle[nearest] else upper, int(branch), exact
        )
    return exact
