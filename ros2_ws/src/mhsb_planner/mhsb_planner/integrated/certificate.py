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
sees it is what the wrist is to the tip: the same D and α, now of intervals of R and φ.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.tip_postures import LEAST_JOINTS, posture_at
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.integrated.goal_postures import GoalPostures
from mhsb_planner.search.lower_bound import least_cost_between, least_costs_between
from mhsb_planner.search.s2_step import Circuit

TOLERANCE = 1e-3
"""Share of the bound by which it may be lower than the least it could be."""

NARROWEST = 1e-5
"""Cells of ψ that are not halved any more [rad]."""

FIRST_CELLS = 32
MOST_CELLS = 4000
"""Cells of chains with more than three joints that are looked at, at most."""

ROUNDING = 1e-9

Interval = tuple[float, float]


@kernel
def _cosine(low: float, high: float) -> Interval:
    """Range of cos over [low, high] rad."""
    a, b = math.cos(low), math.cos(high)
    least, most = min(a, b), max(a, b)
    turn = 2.0 * math.pi
    if math.floor(high / turn) > math.floor(low / turn) or low % turn == 0.0:
        most = 1.0
    if math.floor((high - math.pi) / turn) > math.floor((low - math.pi) / turn):
        least = -1.0
    return least, most


@kernel
def _wrist_direction(low: float, high: float, radius: float, link: float) -> Interval:
    """Range of α over u ∈ [low, high] rad; where R ≤ L₃, u in the first turn or beyond it.

    For R > L₃ it turns where cos u = L₃/R; otherwise the wrist goes round the origin with u.
    """
    if radius <= link:
        return _around_origin(low, radius, link), _around_origin(high, radius, link)
    a = math.atan2(-link * math.sin(low), radius - link * math.cos(low))
    b = math.atan2(-link * math.sin(high), radius - link * math.cos(high))
    least, most = min(a, b), max(a, b)
    extreme = math.asin(link / radius)
    turn = 2.0 * math.pi
    for side in (-1.0, 1.0):
        at = side * math.acos(link / radius)
        if math.floor((high - at) / turn) > math.floor((low - at) / turn):
            least = min(least, -side * extreme)
            most = max(most, -side * extreme)
    return least, most


@kernel
def _around_origin(u: float, radius: float, link: float) -> float:
    """α where R ≤ L₃, continuous and growing with u ≥ 0, −π at u = 0 and 2π more every turn."""
    turns = math.floor(u / (2.0 * math.pi))
    w = min(math.pi, max(-math.pi, u - (2.0 * turns + 1.0) * math.pi))
    around = math.atan2(link * math.sin(w), radius + link * math.cos(w))
    return around + 2.0 * math.pi * turns


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
def _within(low: float, high: float, least: float, most: float) -> Interval:
    """The part of an interval of angles, taken by whole turns, that lies within [least, most]."""
    found_low, found_high = math.inf, -math.inf
    for turns in range(-2, 3):
        a = max(low + 2.0 * math.pi * turns, least)
        b = min(high + 2.0 * math.pi * turns, most)
        if a <= b + ROUNDING:
            found_low, found_high = min(found_low, a), max(found_high, b)
    return found_low, found_high


@kernel
def _without_link(
    radius: Interval, direction: Interval, link: float, low: float, high: float
) -> tuple[Interval, Interval]:
    """Distances and directions of the tip as the end of a link sees it that points to [low, high].

    D² = R² + L² − 2 R L cos u, direction φ + α(u), u the link's angle less φ: as of the wrist.
    """
    cosine = _cosine(low - direction[1], high - direction[0])
    nearest = min(max(link * cosine[1], radius[0]), radius[1])
    least = nearest * nearest + link * link - 2.0 * nearest * link * cosine[1]
    most = 0.0
    for r in radius:
        most = max(most, r * r + link * link - 2.0 * r * link * cosine[0])
    alpha = _directions(low - direction[1], high - direction[0], radius, link)
    distances = math.sqrt(max(0.0, least)), math.sqrt(most)
    return distances, (direction[0] + alpha[0], direction[1] + alpha[1])


@kernel
def _directions(low: float, high: float, radius: Interval, link: float) -> Interval:
    """Range of α over u ∈ [low, high] rad and distances in `radius`: α is monotone in these.

    Any, where the wrist may be at the origin: R = L₃ and u = 0.
    """
    if radius[0] - ROUNDING < link:
        turn = 2.0 * math.pi
        shift = turn * math.floor(low / turn)
        low, high = low - shift, high - shift
        if link < radius[1] + ROUNDING and (low < ROUNDING or high > turn - ROUNDING):
            return -math.pi, math.pi
    one = _wrist_direction(low, high, radius[0], link)
    other = _wrist_direction(low, high, radius[1], link)
    return min(one[0], other[0]), max(one[1], other[1])


@kernel
def _enclose_lengths(
    m: MachineArrays, j: int, low: float, high: float, box: FloatArray
) -> bool:
    """Lengths of cylinder j at angles in [low, high] rad, by whole turns, to box[:, j] [m]."""
    inside = _within(low - ROUNDING, high + ROUNDING, m.joint_min[j], m.joint_max[j])
    if inside[0] > inside[1] + ROUNDING:
        return False
    a = cylinder_length(m.linkage[j], inside[0])
    b = cylinder_length(m.linkage[j], inside[1])
    box[0, j], box[1, j] = min(a, b), max(a, b)
    return True


@kernel
def enclose(
    m: MachineArrays, tip: tuple[float, float], elbow: int, cell: FloatArray, box: FloatArray
) -> bool:
    """Box of all cylinder lengths in a cell of free angles, to box[2, n] [m]; False where none.

    cell  float64[n - 2, 2], from and to [rad]: the inner joints' angles, then ψ
    """
    k = len(m.link_length) - 3
    l1, l2, l3 = m.link_length[k], m.link_length[k + 1], m.link_length[k + 2]
    distance, phi = math.hypot(tip[0], tip[1]), math.atan2(tip[1], tip[0])
    radius, direction, heading = (distance, distance), (phi, phi), (0.0, 0.0)
    for j in range(k):
        if not _enclose_lengths(m, j, cell[j, 0], cell[j, 1], box):
            return False
        heading = heading[0] + cell[j, 0], heading[1] + cell[j, 1]
        radius, direction = _without_link(
            radius, direction, m.link_length[j], heading[0], heading[1]
        )
    low, high = cell[k, 0], cell[k, 1]
    cosine = _cosine(low - direction[1], high - direction[0])
    near = min(max(l3 * cosine[1], radius[0]), radius[1])
    c_low = near * near + l3 * l3 - 2.0 * near * l3 * cosine[1] - l1 * l1 - l2 * l2
    c_high = -math.inf
    for r in radius:
        c_high = max(c_high, r * r + l3 * l3 - 2.0 * r * l3 * cosine[0] - l1 * l1 - l2 * l2)
    c_low, c_high = c_low / (2.0 * l1 * l2), c_high / (2.0 * l1 * l2)
    if c_low > 1.0 + ROUNDING or c_high < -1.0 - ROUNDING:
        return False
    bend = math.acos(min(1.0, c_high)), math.acos(max(-1.0, min(1.0, c_low)))
    alpha = _directions(low - direction[1], high - direction[0], radius, l3)
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
        found = found and _enclose_lengths(m, k + j, angles[j][0], angles[j][1], box)
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
    psi: Interval,
    weight: FloatArray,
    met: float,
) -> Interval:
    """The same for more joints: the cell of the least bound is halved at its widest angle.

    With more free angles than one the cells are many, and this looks at the fewest.
    """
    n = len(start)
    work, cell = np.empty((5, n)), np.empty((2 * FIRST_CELLS + MOST_CELLS, n - 2, 2))
    elbow = np.empty(len(cell), dtype=np.int64)
    for i in range(2 * FIRST_CELLS):
        elbow[i] = -1 if i < FIRST_CELLS else 1
        width = (psi[1] - psi[0]) / FIRST_CELLS
        for k in range(n - 3):
            cell[i, k, 0], cell[i, k, 1] = m.joint_min[k], m.joint_max[k]
        cell[i, n - 3, 0] = psi[0] + (i % FIRST_CELLS) * width
        cell[i, n - 3, 1] = psi[0] + (i % FIRST_CELLS + 1) * width
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
        widest = np.argmax(cell[i, :, 1] - cell[i, :, 0])
        low, high = cell[i, widest, 0], cell[i, widest, 1]
        full = count + 2 > len(cell)
        if full or bound >= (1.0 - TOLERANCE) * met or high - low < NARROWEST:
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
) -> float:
    """No plan from the cylinder lengths start[n] [m] to one of the goal's tips costs less.

    weight  float64[2 or more], of energy [1/J] and time [1/s]
    """
    between = (-math.pi, math.pi) if goals.between is None else goals.between
    least = met = math.inf
    solve = _branch_and_bound
    if machine.joint_count > LEAST_JOINTS:  # samples spare cells
        solve = _branch_and_bound_of_chain
        met = float(least_costs_between(circuit, start, goals.postures.length, weight).min())
    for x, z in np.unique(goals.tips, axis=0).tolist():
        here, met = solve(machine.arrays, circuit, start, (x, z), between, weight, met)
        least = min(least, here)
    return least
