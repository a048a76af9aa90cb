"""The postures in which a motion may end: all at a tip position, or those with a given ψ.

The arm with three joints has one degree of freedom left there, the end link's angle ψ, on two
elbow branches (`s1_psi_intervals_3r`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mhsb_model.inverse_kinematics_3r import ELBOW_BRANCHES
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.errors import InfeasibleGoalError
from mhsb_planner.posture.s1_psi_intervals_3r import MAX_INTERVALS, feasible, feasible_intervals
from mhsb_planner.search.goal_clearance import check_tip, clear_postures
from mhsb_planner.search.s2_step import Postures, describe

PSI_SPACING = math.radians(1.0)
FEWEST = 8
"""Samples of an interval of ψ, at least."""


@dataclass(frozen=True, eq=False)
class GoalPostures:
    """Postures with the tip at the goal.

    tip       (x, z) m
    postures  the samples, with their cylinders' lengths and forces
    elbow     int64[count], ∓1, the branch of each
    psi       float64[count] rad
    free      whether ψ may be changed between the samples
    """

    tip: tuple[float, float]
    postures: Postures
    elbow: IntArray
    psi: FloatArray
    free: bool


def goal_postures(
    machine: Machine, x: float, z: float, psi: float | None = None, spacing: float = PSI_SPACING
) -> GoalPostures:
    """Postures at (x, z) m, every `spacing` rad of ψ or less and at the ends of its intervals.

    Those that keep clear of obstacles. With psi [rad], the postures with that angle. Raises
    OutOfWorkspaceError, InfeasibleGoalError, ZoneError.
    """
    machine.check_in_workspace(x, z)
    check_tip(machine, x, z)
    samples = _all(machine, x, z, spacing) if psi is None else _with(psi)
    postures, kept = [], []
    q = np.empty(machine.joint_count)
    for elbow, angle in samples:
        if feasible(machine.arrays, x, z, angle, elbow, q):
            postures.append(q.copy())
            kept.append((elbow, angle))
    if not postures:
        raise InfeasibleGoalError(x, z, psi)
    clear = clear_postures(machine, x, z, np.array(postures))
    elbows, angles = zip(*kept, strict=True)
    return GoalPostures(
        (x, z),
        describe(machine.arrays, np.array(postures)[clear]),
        frozen(np.array(elbows, dtype=np.int64)[clear]),
        frozen(np.array(angles)[clear]),
        psi is None,
    )


def _all(machine: Machine, x: float, z: float, spacing: float) -> list[tuple[int, float]]:
    interval = np.empty((MAX_INTERVALS, 3))
    found = []
    for elbow, low, high in interval[: feasible_intervals(machine.arrays, x, z, interval)]:
        count = max(FEWEST, math.ceil((high - low) / spacing) + 1)
        found += [(int(elbow), float(angle)) for angle in np.linspace(low, high, count)]
    return found


def _with(psi: float) -> list[tuple[int, float]]:
    return [(elbow, psi) for elbow in ELBOW_BRANCHES]
