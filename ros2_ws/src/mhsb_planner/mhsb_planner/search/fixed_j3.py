"""The conventional method: joint 3 stays where it is (paper, Section 3.3, after its reference 18).

An initial J3 is given. At a tip position J1 and J2 then have at most two solutions; where neither
is within limits, J3 is changed by 1° at a time until one is. That gives one posture for each node
whatever the modes, from which the search takes path and modes at the same step costs as ever.

With more joints all but two are kept, those that the machine file names, and one of them is changed
where it must be. The elbow is then the second of the two that move.
"""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.tip_postures import posture_with, side_of
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import radians
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.errors import InfeasibleGoalError, RequestError
from mhsb_planner.posture.grid import Grid
from mhsb_planner.posture.s1_polytope import polytope_areas
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.s2_graph import StepGraph

J3_STEP = math.radians(1.0)
"""By how much a kept joint is changed at a time where the others have no solution [rad]; of one
that slides in its unit (`kinematics.radians`)."""

NODES_AT_ONCE = 50
"""Nodes of a table that are filled between two looks at a deadline."""

ELBOW_UP, ELBOW_DOWN = -1, 1
"""Side of the elbow, by the sign of the angle from what is before to the line from elbow to tip."""


@kernel
def _posture(
    m: MachineArrays,
    x: float,
    z: float,
    moved: IntArray,
    kept: FloatArray,
    elbow: int,
    q: FloatArray,
) -> bool:
    """Posture at (x, z) m with one kept joint the fewest steps off, on side `elbow` if possible.

    The first joint that will do, and of changes up and down by the same angle that up come first.
    False where none will do.
    """
    changed, unit = kept.copy(), radians(m)
    i, j = moved[0], moved[1]
    change, left = 0, True
    while left:
        left, at = False, 0
        for k in range(len(q)):
            if k in (i, j):
                continue
            step = change * J3_STEP * unit[k]
            up, down = kept[at] + step, kept[at] - step
            left = left or up <= m.joint_max[k] or down >= m.joint_min[k]
            for sign in (1, -1):
                changed[at] = kept[at] + sign * step
                for side in (elbow, -elbow):
                    if posture_with(m, x, z, i, j, changed, side, q):
                        return True
            changed[at] = kept[at]
            at += 1
        change += 1
    return False


@kernel(borrows=True)
def _fill(
    m: MachineArrays,
    position: FloatArray,
    moved: IntArray,
    kept: FloatArray,
    elbow: int,
    posture: FloatArray,
) -> None:
    for i in range(len(position)):
        if not _posture(m, position[i, 0], position[i, 1], moved, kept, elbow, posture[i]):
            posture[i] = np.nan


def _moved(machine: Machine) -> IntArray:
    """The two joints that are not kept."""
    kept = machine.kept_joints
    return frozen(np.array([j for j in range(machine.joint_count) if j not in kept]))


def kept_angles(machine: Machine, q: FloatArray) -> FloatArray:
    """Angles of the kept joints in posture q, put within their limits, float64[n - 2] rad."""
    kept, a = list(machine.kept_joints), machine.arrays
    return np.clip(np.asarray(q, dtype=np.float64)[kept], a.joint_min[kept], a.joint_max[kept])


def elbow_side(machine: Machine, q: FloatArray) -> int:
    """On which side of the line from shoulder to tip the elbow is in posture q [rad]."""
    i, j = _moved(machine)
    return int(side_of(machine.arrays, np.array(q, dtype=np.float64), i, j))


def fixed_j3_posture(
    machine: Machine, x: float, z: float, j3: float | FloatArray, elbow: int = ELBOW_UP
) -> FloatArray:
    """Posture float64[n] [rad] of the conventional method at (x, z) m.

    j3     initial angle of joint 3 or, of several kept joints, their angles, float64[n - 2] rad,
           within limits
    elbow  the side tried first

    Raises InfeasibleGoalError, RequestError.
    """
    kept, q = _checked(machine, j3), np.empty(machine.joint_count)
    if not _posture(machine.arrays, x, z, _moved(machine), kept, elbow, q):
        raise InfeasibleGoalError(x, z)
    return frozen(q)


def fixed_j3_graph(
    machine: Machine,
    like: PostureTable,
    j3: float | FloatArray,
    elbow: int,
    jobs: int | None = None,
    grid: Grid | None = None,
    deadline: Deadline = NEVER,
) -> StepGraph:
    """The steps between the conventional method's postures, on the nodes of another table.

    j3     as of `fixed_j3_posture`; RequestError where it is not within limits
    elbow  the side tried first
    grid   of the nodes, where it is known

    Raises DeadlineError.
    """
    kept, moved = _checked(machine, j3), _moved(machine)
    patterns, position = like.patterns, like.nodes * like.spacing
    posture = np.empty((len(position), machine.joint_count))
    area = np.empty((len(position), len(patterns)))
    for first in range(0, len(position), NODES_AT_ONCE):
        deadline.check("the table with joints fixed")
        part = slice(first, first + NODES_AT_ONCE)
        _fill(machine.arrays, position[part], moved, kept, elbow, posture[part])
        area[part] = polytope_areas(machine, posture[part], patterns)
    table = PostureTable(
        machine_name=machine.name,
        machine_hash=machine.hash,
        spacing=like.spacing,
        nodes=like.nodes,
        patterns=patterns,
        posture=np.repeat(posture[:, None, :], len(patterns), axis=1),
        area=area,
    )

    def resolve(machine: Machine, x: float, z: float, _: Deadline) -> FloatArray:
        q = fixed_j3_posture(machine, x, z, j3, elbow)
        return np.repeat(q[None, :], len(patterns), axis=0)

    return StepGraph(machine, table, jobs, resolve=resolve, grid=grid, deadline=deadline)


def _checked(machine: Machine, j3: float | FloatArray) -> FloatArray:
    """The kept joints' angles, float64[n - 2] rad; RequestError where not within limits."""
    kept, angles = machine.kept_joints, np.atleast_1d(np.asarray(j3, dtype=np.float64))
    if len(angles) != len(kept):
        rule = f"is of one joint, {len(kept)} are kept; they stay as they are at the start"
        raise RequestError("initial J3", j3, rule)
    for j, angle in zip(kept, angles.tolist(), strict=True):
        low, high = float(machine.arrays.joint_min[j]), float(machine.arrays.joint_max[j])
        if not low <= angle <= high:
            unit = machine.joint_units[j]
            rule = f"must be within {low:g} … {high:g} {unit}"
            raise RequestError(f"initial J{j + 1}", f"{angle:g} {unit}", rule)
    return frozen(angles)


def warm_up(graph: StepGraph) -> None:
    """Compile the kernels of this module."""
    machine, n = graph.machine, graph.machine.joint_count
    kept = kept_angles(machine, machine.arrays.joint_max)
    _fill(
        machine.arrays, np.empty((0, 2)), _moved(machine), frozen(kept), ELBOW_UP, np.empty((0, n))
    )
    elbow_side(machine, machine.arrays.joint_max)
    with suppress(InfeasibleGoalError):
        fixed_j3_posture(machine, 0.0, 0.0, kept)
    polytope_areas(machine, np.empty((0, n)), graph.table.patterns)
