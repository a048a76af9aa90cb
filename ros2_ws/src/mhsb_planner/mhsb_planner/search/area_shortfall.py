"""What a motion gives up of the velocity polytope's area, as a term of the cost.

    M = ∫ max(0, 1 − A(q, p)/A_ref) ds     [m]

along the tip's path s, with A the polytope's area (`s1_polytope`) in the posture q and the mode
pattern p in force, and A_ref the area that counts as full: half of the workspace's places offer
more. M is the length of a path without any area that would give up as much. It is never negative
and adds up over the parts of a path, however that is cut; in the cost
w₁ E + w₂ T + w₃ switches + w₄ M its weight is in 1/m. Area as in the paper's Section 2.1, which
weighs it against nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import tip_position
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import MODE_COUNT
from mhsb_model.trajectory import POINT_SPACING_NS, Trajectory
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.posture.s1_polytope import (
    cross_products,
    flow_limits,
    flow_scale,
    posture_area,
    projected_area,
    shared_flow,
    tip_columns,
)
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.discrete_path import DiscretePath

TURN = 0.02
"""Largest change of a joint between two places at which the area of a path is taken [rad]."""

SAMPLES_AT_ONCE = 128
"""Samples of a way whose area is taken between two looks at a deadline."""


class AreaTerm(NamedTuple):
    """w₄ and A_ref; a weight of 0 leaves the term out."""

    weight: float  # 1/m
    reference: float  # m²/s²


WITHOUT_AREA = AreaTerm(0.0, 1.0)


def area_term(weight: float, table: PostureTable) -> AreaTerm:
    """The term with a weight of w₄ [1/m] and the table's reference area."""
    return AreaTerm(weight, reference_area(table)) if weight > 0.0 else WITHOUT_AREA


def reference_area(table: PostureTable) -> float:
    """A_ref [m²/s²]: the median over the table's nodes of the largest area at each."""
    return float(np.median(np.nanmax(table.area[table.feasible], axis=1)))


@kernel
def price_shortfall(
    m: MachineArrays,
    term: AreaTerm,
    start: FloatArray,
    end: FloatArray,
    patterns: ModeArray,
    status: IntArray,
    admitted: int,
    cost: FloatArray,
) -> None:
    """w₄ M of the step from start[n] to end[n] [rad] in all patterns, to cost[patterns].

    Those with the status `admitted` alone are computed. Area in the middle of the step, as
    energy is, times the distance of its ends. Oracle: `AreaProfile` of a path cut finely.
    """
    n = len(start)
    middle = 0.5 * (start + end)
    limit, cross = np.empty((n, MODE_COUNT, 2)), np.empty((n, n))
    flow_limits(m, middle, limit)
    cross_products(tip_columns(m, middle), cross)
    scale, flow = flow_scale(m), shared_flow(m)
    here, there = tip_position(m, start), tip_position(m, end)
    weight = term.weight * math.hypot(there[0] - here[0], there[1] - here[1])
    for p in range(len(patterns)):
        if status[p] == admitted:
            area = projected_area(cross, scale, limit, patterns[p], flow)
            cost[p] = weight * max(0.0, 1.0 - area / term.reference)


@dataclass(frozen=True, eq=False)
class AreaProfile:
    """The polytope's area along a way of the tip.

    span  float64[k], lengths of the way's parts [m]
    area  float64[k], in their middles [m²/s²]
    """

    span: FloatArray
    area: FloatArray

    @property
    def mean(self) -> float | None:
        """∫ A ds / ∫ ds [m²/s²]; None where the tip stays."""
        length = float(self.span.sum())
        return float(self.span @ self.area) / length if length > 0.0 else None

    def shortfall(self, reference: float) -> float:
        """M, with A_ref = `reference` [m²/s²], in m."""
        return float(self.span @ np.maximum(0.0, 1.0 - self.area / reference))


def area_along_path(machine: Machine, path: DiscretePath) -> AreaProfile:
    """Along a discrete path, straight in joint space from each posture to the next."""
    turned = np.abs(np.diff(path.posture, axis=0)).max(axis=1, initial=0.0)
    parts = np.maximum(1, np.ceil(turned / TURN).astype(np.int64))
    edge = np.concatenate([[0.0], *(k + np.arange(1, n + 1) / n for k, n in enumerate(parts))])
    posture = np.column_stack(
        [np.interp(edge, np.arange(path.steps + 1), angle) for angle in path.posture.T]
    )
    return _profile(machine, posture, np.repeat(path.modes, parts, axis=0))


def area_along_motion(
    machine: Machine, trajectory: Trajectory, schedule: ModeSchedule, deadline: Deadline = NEVER
) -> AreaProfile:
    """Along a trajectory, in the modes of its schedule; raises DeadlineError."""
    count = max(1, -(-trajectory.duration_ns // POINT_SPACING_NS))
    at = trajectory.stamp_ns + np.linspace(0, trajectory.duration_ns, 2 * count + 1).astype(int)
    posture = trajectory.sample_many(at[::2])[0]
    return _profile(machine, posture, schedule.modes_at_many(at[1::2]), deadline)


def _profile(
    machine: Machine, posture: FloatArray, modes: ModeArray, deadline: Deadline = NEVER
) -> AreaProfile:
    """Over postures[k + 1, n] in the modes[k, n] between them, in the plane."""
    posture, modes = posture[:, machine.slews :], modes[:, machine.slews :].copy()
    machine = machine.plane
    tip = machine.tip_positions(posture)
    area = np.empty(len(modes))
    middle = 0.5 * (posture[1:] + posture[:-1])
    for first in range(0, len(modes), SAMPLES_AT_ONCE):
        deadline.check("the area along the motion")
        part = slice(first, first + SAMPLES_AT_ONCE)
        _areas(machine.arrays, middle[part], modes[part], area[part])
    return AreaProfile(np.hypot(*np.diff(tip, axis=0).T), area)


@kernel(borrows=True)
def _areas(m: MachineArrays, posture: FloatArray, modes: ModeArray, area: FloatArray) -> None:
    for k in range(len(area)):
        area[k] = posture_area(m, posture[k], modes[k])


def warm_up(machine: Machine) -> None:
    """Compile the kernels that a motion's area needs."""
    posture = machine.arrays.joint_min[None, :].repeat(2, axis=0)
    _profile(machine, posture, machine.patterns[:1].copy())
