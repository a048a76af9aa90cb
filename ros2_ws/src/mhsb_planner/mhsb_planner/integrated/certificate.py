"""A lower bound on the cost of every plan from a posture to a tip position, whatever ψ it ends in.

`lower_bound.least_cost_between` to the nearest goal posture, its minimum over the continuous set
of goal postures found by branch and bound over ψ: for a cell [a, b] of ψ and an elbow branch,
interval arithmetic encloses the joint angles, hence the cylinder lengths (monotone in the angles),
in a box, and the least cost to the box bounds the cell. Cells are halved where their bound is
below the least cost met at their middles.

With the tip at distance R and direction φ, u = ψ − φ, the wrist lies at distance D and direction
φ + α, the elbow at β beside it:

    D² = R² + L₃² − 2 R L₃ cos u         α = atan2(−L₃ sin u, R − L₃ cos u)
    cos|q₂| = (D² − L₁² − L₂²)/(2 L₁ L₂)  β = atan2(L₂ sin|q₂|, L₁ + L₂ cos|q₂|)
    q₁ = φ + α − sgn(q₂) β                q₃ = ψ − q₁ − q₂

With more joints a cell holds angles of the inner ones, too. The tip as the end of an inner link
sees it is what the wrist is to the tip: the same D and α, now of intervals of R and φ. Where joints
slide, cells are of the joints that are held, `telescope_cells`.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.tip_postures import posture_at, slides_anywhere
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.integrated.goal_postures import GoalPostures, held_joints
from mhsb_planner.integrated.intervals import (
    ROUNDING,
    Interval,
    cosine_over,
    directions,
    enclose_lengths,
    without_link,
)
from mhsb_planner.integrated.telescope_cells import enclose_with_telescopes
from mhsb_planner.search.lower_bound import least_cost_between, least_costs_between
from mhsb_planner.search.s2_step import Circuit

TOLERANCE = 1e-3
"""Share of the bound by which it may be lower than the least it could be."""

NARROWEST = 1e-5
"""Cells of ψ that are not halved any more [rad]."""

FIRST_CELLS = 32
MOST_CELLS, SOON_CELLS = 4000, 1000
"""Cells of chains with more than three joints that are looked at, at most; where time is short."""


@kernel
def _elbow_angle(low: float, high: float, l1: float, l2: float) -> Interval:
    """Range of β over |q₂| ∈ [low, high] rad; where L₂ < L₁ it turns at cos|q₂| = −L₂/L₁."""
    a = math.atan2(l2 * math.sin(low), l1 + l2 * math.cos(low))
    b = math.atan2(l2 * math.sin(high), l1 + l2 * math.cos(high))
    most = max(a, b)
    if l2 < l1 and low < math.acos(-l2 / l1) < high:
        most = math.asin(l2 / l1)
    return min(a, b), most


@kernel
def enclose(
    m: MachineArrays, tip: tuple[float, float], elbow: int, cell: FloatArray, box: FloatArray
) -> bool:
    """Box of all cylinder lengths in a cell of what is free, to box[2, n] [m]; False where none.

    cell  float64[n - 2, 2], from and to: the inner joints' angles, then ψ [rad]; of a chain with
          telescopes the joints that are held [rad or m]
    """
    if slides_anywhere(m):
        return enclose_with_telescopes(m, tip, elbow, cell, box)
    k = len(m.link_length) - 3
    l1, l2, l3 = m.link_length[k], m.link_length[k + 1], m.link_length[k + 2]
    distance, phi = math.hypot(tip[0], tip[1]), math.atan2(tip[1], tip[0])
    radius, direction, heading = (distance, distance), (phi, phi), (0.0, 0.0)
    for j in range(k):
        if not enclose_lengths(m, j, cell[j, 0], cell[j, 1], box):
            return False
        heading = heading[0] + cell[j, 0], heading[1] + cell[j, 1]
        radius, direction = without_link(
            radius, direction, m.link_length[j], heading[0], heading[1]
        )
    low, high = cell[k, 0], cell[k, 1]
    cosine = cosine_over(low - direction[1], high - direction[0])
    near = min(max(l3 * cosine[1], radius[0]), radius[1])
    c_low = near * near + l3 * l3 - 2.0 * near * l3 * cosine[1] - l1 * l1 - l2 * l2
    c_high = -math.inf
    for r in radius:
        c_high = max(c_high, r * r + l3 * l3 - 2.0 * r * l3 * cosine[0] - l1 * l1 - l2 * l2)
    c_low, c_high = c_low / (2.0 * l1 * l2), c_high / (2.0 * l1 * l2)
    if c_low > 1.0 + ROUNDING or c_high < -1.0 - ROUNDING:
        return False
    bend = math.acos(min(1.0, c_high)), math.acos(max(-1.0, min(1.0, c_low)))
    alpha = directions(low - direction[1], high - direction[0], radius, l3)
    beta = _elbow_angle(bend[0], bend[1], l1, l2)
    if elbow > 0:
        q2 = bend
        q1 = direction[0] + alpha[0] - beta[1], direction[1] + alpha[1] - beta[0]
    else:
        q2 = -bend[1], -bend[0]
        q1 = direction[0] + alpha[0] + beta[0], direction[1] + alpha[1] + beta[1]
    q3 = low - q1[1] - q2[1], high - q1[0] - q2[0]
    angles = ((q1[0] - heading[1], q1[1] - heading[0]), q2, q3)
    found = True
    for j in range(3):
        found = found and enclose_lengths(m, k + j, angles[j][0], angles[j][1], box)
    return found


@kernel
def _bound_cell(
    m: MachineArrays,
    c: Circuit,
    start: FloatArray,
    tip: tuple[float, float],
    elbow: int,
    cell: FloatArray,
    weight: FloatArray,
    w: FloatArray,
) -> Interval:
    """Least cost to a cell, inf where it holds no posture, and the cost to its middle, likewise.

    w  float64[5, n], working memory
    """
    box, nearest, q, free = w[:2], w[2], w[3], w[4]
    if not enclose(m, tip, elbow, cell, box):
        return math.inf, math.inf
    for j in range(len(start)):
        nearest[j] = min(box[1, j], max(box[0, j], start[j]))
    bound, met = least_cost_between(c, start, nearest, weight), math.inf
    for j in range(len(cell)):
        free[j] = 0.5 * (cell[j, 0] + cell[j, 1])
    if posture_at(m, tip[0], tip[1], free[: len(cell)], elbow, q):
        for j in range(len(start)):
            nearest[j] = cylinder_length(m.linkage[j], q[j])
        met = least_cost_between(c, start, nearest, weight)
    return bound, met


@kernel
def _branch_and_bound(
    m: MachineArrays,
    c: Circuit,
    start: FloatArray,
    tip: tuple[float, float],
    psi: Interval,
    weight: FloatArray,
    met: float,
) -> Interval:
    """Kernel of `least_cost_to` for one tip and three joints: the bound, inf where no posture
    reaches the goal, and the least cost met so far, at other tips, `met`, or here."""
    work, cell = np.empty((5, len(start))), np.empty((1, 2))
    cells = [(0, 0.0, 0.0)]
    cells.pop()
    for elbow in (-1, 1):
        for i in range(FIRST_CELLS):
            width = (psi[1] - psi[0]) / FIRST_CELLS
            cells.append((elbow, psi[0] + i * width, psi[0] + (i + 1) * width))
    least = math.inf
    while len(cells) > 0:
        elbow, low, high = cells.pop()
        cell[0, 0], cell[0, 1] = low, high
        bound, middle = _bound_cell(m, c, start, tip, elbow, cell, weight, work)
        if bound == math.inf:
            continue
        met = min(met, middle)
        if bound >= (1.0 - TOLERANCE) * met or high - low < NARROWEST or bound >= least:
            least = min(least, bound)
            continue
        cells.append((elbow, low, 0.5 * (low + high)))
        cells.append((elbow, 0.5 * (low + high), high))
    return least, met


@kernel
def _branch_and_bound_of_chain(
    m: MachineArrays,
    c: Circuit,
    start: FloatArray,
    tip: tuple[float, float],
    ranges: FloatArray,
    weight: FloatArray,
    met: float,
    most_cells: int,
) -> Interval:
    """The same for any chain: the cell of the least bound is halved where it is widest.

    With more free angles than one the cells are many, and this looks at the fewest.

    ranges  float64[n - 2, 3], of what is free: from, to, and what counts as a radian
    """
    n = len(start)
    work, cell = np.empty((5, n)), np.empty((2 * FIRST_CELLS + most_cells, n - 2, 2))
    elbow = np.empty(len(cell), dtype=np.int64)
    for i in range(2 * FIRST_CELLS):
        elbow[i] = -1 if i < FIRST_CELLS else 1
        cell[i] = ranges[:, :2]
        low = ranges[n - 3, 0]
        width = (ranges[n - 3, 1] - low) / FIRST_CELLS
        cell[i, n - 3, 0] = low + (i % FIRST_CELLS) * width
        cell[i, n - 3, 1] = low + (i % FIRST_CELLS + 1) * width
    first = [(0.0, 0)]
    first.pop()
    begun, count = 0, 2 * FIRST_CELLS
    while True:
        for i in range(begun, count):
            bound, middle = _bound_cell(m, c, start, tip, elbow[i], cell[i], weight, work)
            met = min(met, middle)
            if bound < math.inf:
                heapq.heappush(first, (bound, i))
        if len(first) == 0:
            return math.inf, met
        bound, i = heapq.heappop(first)
        width = (cell[i, :, 1] - cell[i, :, 0]) / ranges[:, 2]
        widest = np.argmax(width)
        low, high = cell[i, widest, 0], cell[i, widest, 1]
        full = count + 2 > len(cell)
        if full or bound >= (1.0 - TOLERANCE) * met or width[widest] < NARROWEST:
            return bound, met
        begun = count
        for half in range(2):
            elbow[count], cell[count] = elbow[i], cell[i]
            cell[count, widest, 1 - half] = 0.5 * (low + high)
            count += 1


def least_cost_to(
    machine: Machine,
    circuit: Circuit,
    start: FloatArray,
    goals: GoalPostures,
    weight: FloatArray,
    most_cells: int = MOST_CELLS,
) -> float:
    """No plan from the cylinder lengths start[n] [m] to one of the goal's tips costs less.

    weight      float64[2 or more], of energy [1/J] and time [1/s]
    most_cells  that are looked at where there are more than three joints
    """
    between = (-math.pi, math.pi) if goals.between is None else goals.between
    least, met, three = math.inf, math.inf, machine.is_3r
    ranges = np.empty((0, 3)) if three else _ranges(machine, between)
    if not three:  # samples spare cells
        met = float(least_costs_between(circuit, start, goals.postures.length, weight).min())
    for tip in map(tuple, np.unique(goals.tips, axis=0).tolist()):
        if three:
            here, met = _branch_and_bound(
                machine.arrays, circuit, start, tip, between, weight, met
            )
        else:
            here, met = _branch_and_bound_of_chain(
                machine.arrays, circuit, start, tip, ranges, weight, met, most_cells
            )
        least = min(least, here)
    return least


def _ranges(machine: Machine, psi: Interval) -> FloatArray:
    """See `_branch_and_bound_of_chain`. With telescopes ψ is not among what is free, and the bound
    is that of any ψ."""
    a = machine.arrays
    if machine.has_telescope:
        held = held_joints(machine)
        return np.column_stack([a.joint_min[held], a.joint_max[held], machine.radians[held]])
    inner = slice(0, machine.joint_count - 3)
    low, high = np.append(a.joint_min[inner], psi[0]), np.append(a.joint_max[inner], psi[1])
    return np.column_stack([low, high, np.ones(len(low))])
