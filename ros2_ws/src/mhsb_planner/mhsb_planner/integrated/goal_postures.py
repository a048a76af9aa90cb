"""The postures in which a motion may end: at one or several tip positions, with ψ as asked for.

The arm with three joints has one degree of freedom left there, the end link's angle ψ, on two
elbow branches (`s1_psi_intervals_3r`). Longer chains have the inner joints' angles beside: of these
even samples are taken, and of each the intervals of ψ. Where joints slide, even samples of all
joints are taken but of the two that close the chain, or, where ψ is given, of ψ.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.errors import MhsbError
from mhsb_model.inverse_kinematics.closed_form_3r import ELBOW_BRANCHES
from mhsb_model.inverse_kinematics.tip_postures import (
    closing_joints,
    inner_angles,
    outer_tip,
    posture_at,
    side_of,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.errors import InfeasibleGoalError
from mhsb_planner.goal_region import Angle, Region, angle_range, tips
from mhsb_planner.posture.s1_psi_intervals_3r import MAX_INTERVALS, feasible, feasible_intervals
from mhsb_planner.search.goal_clearance import check_tip, clear_postures
from mhsb_planner.search.s2_step import Postures, describe

PSI_SPACING = math.radians(1.0)
FEWEST = 8
"""Samples of an interval of ψ, at least; with more free angles so many of all together."""


@dataclass(frozen=True, eq=False)
class GoalPostures:
    """Postures with the tip where it may end.

    tip       (x, z) m, the goal itself
    tips      float64[count, 2] m, where each posture has its tip
    postures  the samples, with their cylinders' lengths and forces
    elbow     int64[count], ∓1, the branch of each
    free      float64[count, n - 2], of each what `tip_postures` has as free [rad or m]
    turns     float64[n - 2], by how much of each that may be changed for a radian [rad or m]; 0
              where it stays
    between   rad, the least and the greatest ψ asked for; None where all will do
    """

    tip: tuple[float, float]
    tips: FloatArray
    postures: Postures
    elbow: IntArray
    free: FloatArray
    turns: FloatArray
    between: tuple[float, float] | None


def goal_postures(
    machine: Machine,
    x: float,
    z: float,
    psi: Angle = None,
    spacing: float = PSI_SPACING,
    region: Region | None = None,
) -> GoalPostures:
    """Postures at (x, z) m, every `spacing` rad of ψ or less and at the ends of its intervals.

    Of m > 1 free angles the samples lie farther apart, spacing^1/m, so that they are not many
    more. Those that keep clear of obstacles, with ψ as asked for. With a region also at its other
    points where these are possible, ψ being sampled the more sparsely the more points there are.
    Raises OutOfWorkspaceError, InfeasibleGoalError, ZoneError where there are none.
    """
    points, between, refused = tips((x, z), region), angle_range(psi), None
    found = []
    for point in points.tolist():
        try:
            found.append(_at(machine, point[0], point[1], between, spacing * len(points)))
        except MhsbError as error:
            refused = refused or error
    if refused is not None and not found:
        raise refused
    tip, postures, elbow, free = (np.concatenate(part) for part in zip(*found, strict=True))
    return GoalPostures(
        (x, z),
        frozen(tip),
        describe(machine.arrays, postures),
        frozen(elbow),
        frozen(free),
        frozen(_turns(machine, between)),
        between,
    )


def _turns(machine: Machine, between: tuple[float, float] | None) -> FloatArray:
    """See `GoalPostures`: where ψ is asked for, what it depends on stays."""
    if machine.has_telescope:
        unit = machine.radians[held_joints(machine)]
        return unit if between is None else np.zeros(len(unit))
    turns = np.ones(machine.joint_count - 2)
    turns[-1] = 1.0 if between is None else 0.0
    return turns


def held_joints(machine: Machine) -> IntArray:
    """Joints of a chain with telescopes that are held while the others close it, in order."""
    return np.delete(np.arange(machine.joint_count), closing_joints(machine.arrays))


def _at(
    machine: Machine, x: float, z: float, between: tuple[float, float] | None, spacing: float
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """Tips, postures, branches and what is free at one point; raises as `goal_postures`."""
    machine.check_in_workspace((x, z))
    check_tip(machine, (x, z))
    sampled = _with_telescopes if machine.has_telescope else _turning
    posture, elbow, free = sampled(machine, x, z, between, spacing)
    if len(posture) == 0:
        raise InfeasibleGoalError(x, z, between)
    kept = clear_postures(machine, x, z, posture)
    tip = np.tile([x, z], (int(kept.sum()), 1))
    return tip, posture[kept], elbow[kept], free[kept]


def _with_telescopes(
    machine: Machine, x: float, z: float, between: tuple[float, float] | None, spacing: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Postures, branches and what is free of a chain in which joints slide."""
    a, held = machine.arrays, held_joints(machine)
    i, j = closing_joints(a)
    if between is not None:
        count = math.ceil((between[1] - between[0]) / spacing) + 1
        posture = machine.postures(x, z, np.linspace(*between, count))
        elbow = np.array([side_of(a, q, i, j) for q in posture], dtype=np.int64)
        return posture, elbow, posture[:, held]
    apart = spacing ** (1.0 / len(held)) * machine.radians[held]
    counts = np.ceil((a.joint_max - a.joint_min)[held] / apart).astype(int) + 1
    ends = zip(a.joint_min[held], a.joint_max[held], counts, strict=True)
    grids = np.meshgrid(*(np.linspace(*each) for each in ends), indexing="ij")
    free = np.repeat(np.stack([grid.ravel() for grid in grids], axis=-1), 2, axis=0)
    elbow = np.tile(np.array(ELBOW_BRANCHES, dtype=np.int64), len(free) // 2)
    posture = np.empty((len(free), machine.joint_count))
    kept = _closed(a, x, z, free, elbow, posture)
    return posture[kept], elbow[kept], free[kept]


@kernel
def _closed(
    m: MachineArrays, x: float, z: float, free: FloatArray, elbow: IntArray, posture: FloatArray
) -> np.ndarray:
    """Which of these lead to a posture within limits; those are written to posture[count, n]."""
    within = np.empty(len(free), dtype=np.bool_)
    for k in range(len(free)):
        within[k] = posture_at(m, x, z, free[k], elbow[k], posture[k])
    return within


def _turning(
    machine: Machine, x: float, z: float, between: tuple[float, float] | None, spacing: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Postures, branches and free angles of a chain in which all joints turn."""
    a, n = machine.arrays, machine.joint_count
    given = between is not None and between[0] == between[1]
    apart = spacing ** (1.0 / max(1, n - 3 if given else n - 2))
    widest = max((a.joint_max - a.joint_min)[: n - 3], default=0.0)
    samples = math.ceil(widest / apart) + 1
    numbers = np.arange(samples ** (n - 3))
    if n > 3 and not given:  # most reach nothing, and are sooner left out than tried
        numbers = _in_reach(a, x, z, samples)
        if len(numbers) == 0:
            return np.empty((0, n)), np.empty(0, dtype=np.int64), np.empty((0, n - 2))
    found = []
    for number in numbers:
        q = np.empty(n)
        inner_angles(a, number, samples, q)
        found.append(_with_inner(machine, x, z, q, between, apart))
    posture, elbow, angle = (np.concatenate(part) for part in zip(*found, strict=True))
    return posture, elbow, np.column_stack([posture[:, : n - 3], angle])


@kernel
def _in_reach(m: MachineArrays, x: float, z: float, samples: int) -> IntArray:
    """Numbers of the inner joints' samples with which the others reach the tip in some ψ."""
    n, count = len(m.link_length), 0
    q, interval = np.empty(n), np.empty((MAX_INTERVALS, 3))
    numbers = np.empty(samples ** (n - 3), dtype=np.int64)
    for number in range(len(numbers)):
        inner_angles(m, number, samples, q)
        ahead, up, _ = outer_tip(m.link_length, x, z, q)
        if feasible_intervals(m, ahead, up, interval) > 0:
            numbers[count] = number
            count += 1
    return numbers[:count]


def _with_inner(
    machine: Machine,
    x: float,
    z: float,
    q: FloatArray,
    between: tuple[float, float] | None,
    spacing: float,
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Postures within limits with the inner joints as in q, their branches and ψ."""
    ahead, up, heading = outer_tip(machine.arrays.link_length, x, z, q)
    seen = None if between is None else (between[0] - heading, between[1] - heading)
    if seen is not None and seen[0] == seen[1]:
        elbow, angle = _with(seen[0])
    else:
        elbow, angle = _all(machine, ahead, up, spacing, seen)
    postures = np.tile(q, (len(angle), 1))
    kept = _feasible(machine.arrays, ahead, up, elbow, angle, postures)
    return postures[kept], elbow[kept], angle[kept] + heading


@kernel
def _feasible(
    m: MachineArrays,
    x: float,
    z: float,
    elbow: IntArray,
    angle: FloatArray,
    posture: FloatArray,
) -> np.ndarray:
    """Which of the branches and angles [rad] are within limits; the last three of posture[count, n]
    are written. Point and angles as the last three joints see them."""
    within = np.empty(len(angle), dtype=np.bool_)
    for i in range(len(angle)):
        within[i] = feasible(m, x, z, angle[i], elbow[i], posture[i])
    return within


def _all(
    machine: Machine, x: float, z: float, spacing: float, between: tuple[float, float] | None
) -> tuple[IntArray, FloatArray]:
    """Samples of all intervals of ψ: branch, int64[count], and angle, float64[count] rad."""
    interval = np.empty((MAX_INTERVALS, 3))
    fewest = max(2, round(FEWEST ** (1.0 / (machine.joint_count - 2))))
    elbows, angles = [np.empty(0, dtype=np.int64)], [np.empty(0)]
    for elbow, least, most in interval[: feasible_intervals(machine.arrays, x, z, interval)]:
        for low, high in _parts(least, most, between):
            count = max(fewest, math.ceil((high - low) / spacing) + 1)
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
