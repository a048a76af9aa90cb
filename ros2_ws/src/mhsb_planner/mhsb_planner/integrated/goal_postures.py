"""The postures in which a motion may end: at one or several tip positions, with ψ as asked for.

The arm with three joints has one degree of freedom left there, the end link's angle ψ, on two
elbow branches (`s1_psi_intervals_3r`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.errors import MhsbError
from mhsb_model.inverse_kinematics_3r import ELBOW_BRANCHES
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.tip_postures import LEAST_JOINTS
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.errors import InfeasibleGoalError, RequestError
from mhsb_planner.goal_region import Angle, Region, angle_range, tips
from mhsb_planner.posture.s1_psi_intervals_3r import MAX_INTERVALS, feasible, feasible_intervals
from mhsb_planner.search.goal_clearance import check_tip, clear_postures
from mhsb_planner.search.s2_step import Postures, describe

PSI_SPACING = math.radians(1.0)
FEWEST = 8
"""Samples of an interval of ψ, at least."""


@dataclass(frozen=True, eq=False)
class GoalPostures:
    """Postures with the tip where it may end.

    tip       (x, z) m, the goal itself
    tips      float64[count, 2] m, where each posture has its tip
    postures  the samples, with their cylinders' lengths and forces
    elbow     int64[count], ∓1, the branch of each
    psi       float64[count] rad
    between   rad, the least and the greatest ψ asked for; None where all will do
    """

    tip: tuple[float, float]
    tips: FloatArray
    postures: Postures
    elbow: IntArray
    psi: FloatArray
    between: tuple[float, float] | None

    @property
    def free(self) -> bool:
        """Whether ψ may be changed between the samples."""
        return self.between is None


def goal_postures(
    machine: Machine,
    x: float,
    z: float,
    psi: Angle = None,
    spacing: float = PSI_SPACING,
    region: Region | None = None,
) -> GoalPostures:
    """Postures at (x, z) m, every `spacing` rad of ψ or less and at the ends of its intervals.

    Those that keep clear of obstacles, with ψ as asked for. With a region also at its other points
    where these are possible, ψ being sampled the more sparsely the more points there are. Raises
    OutOfWorkspaceError, InfeasibleGoalError, ZoneError where there are none.
    """
    if machine.joint_count > LEAST_JOINTS:
        rule = f"plans for {LEAST_JOINTS} joints, the machine has {machine.joint_count}; take table"
        raise RequestError("planner", "integrated", rule)
    points, between, refused = tips((x, z), region), angle_range(psi), None
    found = []
    for point in points.tolist():
        try:
            found.append(_at(machine, point[0], point[1], between, spacing * len(points)))
        except MhsbError as error:
            refused = refused or error
    if refused is not None and not found:
        raise refused
    tip, postures, elbow, angle = (np.concatenate(part) for part in zip(*found, strict=True))
    return GoalPostures(
        (x, z),
        frozen(tip),
        describe(machine.arrays, postures),
        frozen(elbow),
        frozen(angle),
        between,
    )


def _at(
    machine: Machine, x: float, z: float, between: tuple[float, float] | None, spacing: float
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """Tips, postures, branches and angles at one point; raises as `goal_postures`."""
    machine.check_in_workspace(x, z)
    check_tip(machine, x, z)
    if between is not None and between[0] == between[1]:
        elbow, angle = _with(between[0])
    else:
        elbow, angle = _all(machine, x, z, spacing, between)
    postures = np.empty((len(angle), machine.joint_count))
    kept = _feasible(machine.arrays, x, z, elbow, angle, postures)
    if not kept.any():
        raise InfeasibleGoalError(x, z, between)
    kept[kept] = clear_postures(machine, x, z, postures[kept])
    tip = np.tile([x, z], (int(kept.sum()), 1))
    return tip, postures[kept], elbow[kept], angle[kept]


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


def _all(
    machine: Machine, x: float, z: float, spacing: float, between: tuple[float, float] | None
) -> tuple[IntArray, FloatArray]:
    """Samples of all intervals of ψ: branch, int64[count], and angle, float64[count] rad."""
    interval = np.empty((MAX_INTERVALS, 3))
    elbows, angles = [np.empty(0, dtype=np.int64)], [np.empty(0)]
    for elbow, least, most in interval[: feasible_intervals(machine.arrays, x, z, interval)]:
        for low, high in _parts(least, most, between):
            count = max(FEWEST, math.ceil((high - low) / spacing) + 1)
            elbows.append(np.full(count, int(elbow)))
            angles.append(np.linspace(low, high, count))
    return np.concatenate(elbows), np.concatenate(angles)


def _parts(
    low: float, high: float, between: tuple[float, float] | None
) -> list[tuple[float, float]]:
    """The parts of an interval of ψ that lie in a range, taken by whole turns [rad]."""
    if between is None:
        return [(low, high)]
    turns = 2.0 * math.pi * np.arange(-2, 3)
    parts = [(max(low, between[0] + turn), min(high, between[1] + turn)) for turn in turns]
    return [(a, b) for a, b in parts if a <= b]


def _with(psi: float) -> tuple[IntArray, FloatArray]:
    """Both branches with one ψ [rad]."""
    return np.array(ELBOW_BRANCHES, dtype=np.int64), np.full(len(ELBOW_BRANCHES), psi)
