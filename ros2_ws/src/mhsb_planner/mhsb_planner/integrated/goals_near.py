"""Goal postures of chains with more than three joints that are near where the motion begins.

Even samples of two and more free angles lie degrees apart, more than a short move turns its joints,
and those that hold a joint at its limit are hardly among them. So all pairs of joints close the
chain in turn, one other joint is sampled, and the rest stay as they are at the start: a move
seldom needs all joints. Of each such curve the posture counts to which the way may be cheapest.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.closed_form_3r import within_limits
from mhsb_model.inverse_kinematics.tip_postures import close_chain, closing_joints, side_of
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.errors import ZoneError
from mhsb_planner.integrated.goal_postures import GoalPostures, held_joints
from mhsb_planner.search.goal_clearance import clear_postures
from mhsb_planner.search.lower_bound import least_cost_between
from mhsb_planner.search.s2_step import Circuit, describe

SAMPLES = 24
"""Of a joint's range, limits included; one more is where the joint is at the start."""


def with_those_near(
    machine: Machine, goals: GoalPostures, start: FloatArray, circuit: Circuit, weight: FloatArray
) -> GoalPostures:
    """The same goal postures and, at the goal itself, those near the posture start[n].

    weight  float64[2 or more], of energy [1/J] and time [1/s]

    None are added with three joints, of which the samples are close, or where ψ is asked for.
    """
    x, z = goals.tip
    at_goal = np.any(np.all(goals.tips == goals.tip, axis=1))
    if machine.joint_count == 3 or goals.between is not None or not at_goal:
        return goals
    lengths = machine.cylinder_lengths(start)
    near = _nearest(machine.arrays, circuit, start, lengths, x, z, weight)
    try:
        near = near[clear_postures(machine, x, z, near)]
    except ZoneError:  # others are clear
        return goals
    if len(near) == 0:
        return goals
    postures = np.concatenate([goals.postures.posture, near])
    elbow, free = _as_told(machine, near)
    return replace(
        goals,
        tips=frozen(np.concatenate([goals.tips, np.tile(goals.tip, (len(near), 1))])),
        postures=describe(machine.arrays, postures),
        elbow=frozen(np.concatenate([goals.elbow, elbow])),
        free=frozen(np.concatenate([goals.free, free])),
    )


def _as_told(machine: Machine, postures: FloatArray) -> tuple[np.ndarray, FloatArray]:
    """Branches and what is free of postures [k, n], as `goal_postures` has them."""
    a, n = machine.arrays, machine.joint_count
    if machine.has_telescope:
        i, j = closing_joints(a)
        sides = np.array([side_of(a, q, i, j) for q in postures], dtype=np.int64)
        return sides, postures[:, held_joints(machine)]
    elbow = np.where(postures[:, n - 2] > 0.0, 1, -1)
    return elbow, np.column_stack([postures[:, : n - 3], postures.sum(axis=1)])


@kernel
def _nearest(
    m: MachineArrays,
    c: Circuit,
    start: FloatArray,
    lengths: FloatArray,
    x: float,
    z: float,
    weight: FloatArray,
) -> FloatArray:
    """Of each curve the posture of the least bound from lengths[n] m, float64[found, n].

    Oracle: the same in plain Python.
    """
    n, count = len(start), 0
    found = np.empty((n * (n - 1) // 2 * (n - 2), n))
    q, length = np.empty(n), np.empty(n)
    for i in range(n):
        for j in range(i + 1, n):
            for k in range(n):
                if k in (i, j):
                    continue
                least = math.inf
                for sample in range(2 * (SAMPLES + 1)):
                    q[:] = start
                    share = (sample // 2) / (SAMPLES - 1)
                    if share <= 1.0:
                        q[k] = (1.0 - share) * m.joint_min[k] + share * m.joint_max[k]
                    if not close_chain(m, x, z, i, j, 2 * (sample % 2) - 1, q):
                        continue
                    if not within_limits(m, q):
                        continue
                    for joint in range(n):
                        length[joint] = cylinder_length(m.linkage[joint], q[joint])
                    cost = least_cost_between(c, lengths, length, weight)
                    if cost < least:
                        least = cost
                        found[count] = q
                if least < math.inf:
                    count += 1
    return found[:count]


def warm_up(machine: Machine, start: FloatArray, circuit: Circuit) -> None:
    """Compile what chains of any number of joints run through."""
    x, z = machine.tip_position(start)
    lengths = machine.cylinder_lengths(start)
    _nearest(machine.arrays, circuit, start, lengths, float(x), float(z), np.ones(3))
