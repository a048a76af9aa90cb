"""The postures in which a motion may end: all at a tip position, or those with a given ψ.

The arm with three joints has one degree of freedom left there, the end link's angle ψ, on two
elbow branches (`s1_psi_intervals_3r`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics_3r import ELBOW_BRANCHES
from mhsb_model.kernels.kernel import kernel
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
    elbow, angle = _all(machine, x, z, spacing) if psi is None else _with(psi)
    postures = np.empty((len(angle), machine.joint_count))
    kept = _feasible(machine.arrays, x, z, elbow, angle, postures)
    if not kept.any():
        raise InfeasibleGoalError(x, z, psi)
    kept[kept] = clear_postures(machine, x, z, postures[kept])
    return GoalPostures(
        (x, z),
        describe(machine.arrays, postures[kept]),
        frozen(elbow[kept]),
        frozen(angle[kept]),
        psi is None,
    )


@kernel
def _feasible(
    m: MachineArrays,
    x: float,
    z: float,
    elbow: IntArray,
    angle: FloatArray,
    posture: FloatArray,
) -> np.ndarray:
    """Which of the branches and angles [rad] are within limits; postures[count, n], written."""
    within = np.empty(len(angle), dtype=np.bool_)
    for i in range(len(angle)):
        within[i] = feasible(m, x, z, angle[i], elbow[i], posture[i])
    return within


def _all(machine: Machine, x: float, z: float, spacing: float) -> tuple[IntArray, FloatArray]:
    """Samples of all intervals of ψ: branch, int64[count], and angle, float64[count] rad."""
    interval = np.empty((MAX_INTERVALS, 3))
    elbows, angles = [np.empty(0, dtype=np.int64)], [np.empty(0)]
    for elbow, low, high in interval[: feasible_intervals(machine.arrays, x, z, interval)]:
        count = max(FEWEST, math.ceil((high - low) / spacing) + 1)
        elbows.append(np.full(count, int(elbow)))
        angles.append(np.linspace(low, high, count))
    return np.concatenate(elbows), np.concatenate(angles)


def _with(psi: float) -> tuple[IntArray, FloatArray]:
    """Both branches with one ψ [rad]."""
    return np.array(ELBOW_BRANCHES, dtype=np.int64), np.full(len(ELBOW_BRANCHES), psi)
