"""The conventional method: joint 3 stays where it is (paper, Section 3.3, after its reference 18).

An initial J3 is given. At a tip position J1 and J2 then have at most two solutions; where neither
is within limits, J3 is changed by 1° at a time until one is. That gives one posture for each node
whatever the modes, from which the search takes path and modes at the same step costs as ever.
"""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics_3r import within_limits, wrap_near
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.errors import InfeasibleGoalError, RequestError
from mhsb_planner.posture.grid import Grid
from mhsb_planner.posture.s1_polytope import polytope_areas
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.s2_graph import StepGraph

J3_STEP = math.radians(1.0)
"""By how much J3 is changed at a time where J1 and J2 have no solution [rad]."""

NODES_AT_ONCE = 50
"""Nodes of a table that are filled between two looks at a deadline."""

ELBOW_UP, ELBOW_DOWN = -1, 1
"""Side of the elbow, by the sign of the angle from link 1 to the line from elbow to tip."""


@kernel
def _solution(m: MachineArrays, x: float, z: float, j3: float, elbow: int, q: FloatArray) -> bool:
    """Posture at (x, z) m with joint 3 at j3 rad; False where it is not within limits.

    Links 2 and 3 are one rigid link D at β from link 2: with R² = x² + z²,
    cos α = (R² − L₁² − D²)/(2 L₁ D), q₂ = ±|α| − β.
    """
    l1, l2, l3 = m.link_length[0], m.link_length[1], m.link_length[2]
    ahead, across = l2 + l3 * math.cos(j3), l3 * math.sin(j3)
    rigid = math.hypot(ahead, across)
    cosine = (x * x + z * z - l1 * l1 - rigid * rigid) / (2.0 * l1 * rigid)
    if abs(cosine) > 1.0:
        return False
    alpha = elbow * math.acos(cosine)
    q1 = math.atan2(z, x) - math.atan2(rigid * math.sin(alpha), l1 + rigid * math.cos(alpha))
    q[0] = wrap_near(q1, 0.5 * (m.joint_min[0] + m.joint_max[0]))
    q[1] = wrap_near(alpha - math.atan2(across, ahead), 0.5 * (m.joint_min[1] + m.joint_max[1]))
    q[2] = j3
    return within_limits(m, q)


@kernel
def _posture(m: MachineArrays, x: float, z: float, j3: float, elbow: int, q: FloatArray) -> bool:
    """Posture at (x, z) m whose J3 is the fewest steps from j3, on side `elbow` if possible.

    Of changes up and down by the same angle that up comes first. False where no J3 will do.
    """
    change = 0
    while j3 + change * J3_STEP <= m.joint_max[2] or j3 - change * J3_STEP >= m.joint_min[2]:
        for sign in (1, -1):
            for side in (elbow, -elbow):
                if _solution(m, x, z, j3 + sign * change * J3_STEP, side, q):
                    return True
        change += 1
    return False


@kernel
def _fill(
    m: MachineArrays, position: FloatArray, j3: float, elbow: int, posture: FloatArray
) -> None:
    for i in range(len(position)):
        if not _posture(m, position[i, 0], position[i, 1], j3, elbow, posture[i]):
            posture[i] = np.nan


def elbow_side(machine: Machine, q: FloatArray) -> int:
    """On which side of the line from shoulder to tip the elbow is in posture q [rad]."""
    _, l2, l3 = machine.arrays.link_length
    beta = math.atan2(l3 * math.sin(q[2]), l2 + l3 * math.cos(q[2]))
    return ELBOW_DOWN if q[1] + beta > 0.0 else ELBOW_UP


def fixed_j3_posture(
    machine: Machine, x: float, z: float, j3: float, elbow: int = ELBOW_UP
) -> FloatArray:
    """Posture float64[3] [rad] of the conventional method at (x, z) m.

    j3     initial angle of joint 3 [rad], within its limits
    elbow  the side tried first

    Raises InfeasibleGoalError, RequestError.
    """
    _check(machine, j3)
    q = np.empty(3)
    if not _posture(machine.arrays, x, z, j3, elbow, q):
        raise InfeasibleGoalError(x, z)
    return frozen(q)


def fixed_j3_graph(
    machine: Machine,
    like: PostureTable,
    j3: float,
    elbow: int,
    jobs: int | None = None,
    grid: Grid | None = None,
    deadline: Deadline = NEVER,
) -> StepGraph:
    """The steps between the conventional method's postures, on the nodes of another table.

    j3     initial angle of joint 3 [rad]; RequestError where it is not within its limits
    elbow  the side tried first
    grid   of the nodes, where it is known

    Raises DeadlineError.
    """
    _check(machine, j3)
    patterns, position = like.patterns, like.nodes * like.spacing
    posture = np.empty((len(position), machine.joint_count))
    area = np.empty((len(position), len(patterns)))
    for first in range(0, len(position), NODES_AT_ONCE):
        deadline.check("the table with joint 3 fixed")
        part = slice(first, first + NODES_AT_ONCE)
        _fill(machine.arrays, position[part], j3, elbow, posture[part])
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


def _check(machine: Machine, j3: float) -> None:
    low, high = float(machine.arrays.joint_min[2]), float(machine.arrays.joint_max[2])
    if not low <= j3 <= high:
        raise RequestError("initial J3", f"{j3:g} rad", f"must be within {low:g} … {high:g} rad")


def warm_up(graph: StepGraph) -> None:
    """Compile the kernels of this module."""
    j3 = float(graph.machine.arrays.joint_max[2])
    _fill(graph.machine.arrays, np.empty((0, 2)), j3, ELBOW_UP, np.empty((0, 3)))
    with suppress(InfeasibleGoalError):
        fixed_j3_posture(graph.machine, 0.0, 0.0, j3)
    polytope_areas(graph.machine, np.empty((0, 3)), graph.table.patterns)
