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
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics_3r import joint_angles, within_limits
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.integrated.goal_postures import GoalPostures
from mhsb_planner.search.lower_bound import least_cost_between
from mhsb_planner.search.s2_step import Circuit

TOLERANCE = 1e-3
"""Share of the bound by which it may be lower than the least it could be."""

NARROWEST = 1e-5
"""Cells of ψ that are not halved any more [rad]."""

FIRST_CELLS = 32
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
    """Range of α over u ∈ [low, high] rad; it turns where cos u = L₃/R."""
    if radius <= link:
        return -math.pi, math.pi
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
def enclose(
    m: MachineArrays, tip: tuple[float, float], elbow: int, low: float, high: float, box: FloatArray
) -> bool:
    """Box of all cylinder lengths with ψ ∈ [low, high] rad, to box[2, 3] [m]; False where none."""
    l1, l2, l3 = m.link_length[0], m.link_length[1], m.link_length[2]
    radius, phi = math.hypot(tip[0], tip[1]), math.atan2(tip[1], tip[0])
    cosine = _cosine(low - phi, high - phi)
    square = radius * radius + l3 * l3
    c_low = (square - 2.0 * radius * l3 * cosine[1] - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)
    c_high = (square - 2.0 * radius * l3 * cosine[0] - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)
    if c_low > 1.0 + ROUNDING or c_high < -1.0 - ROUNDING:
        return False
    bend = math.acos(min(1.0, c_high)), math.acos(max(-1.0, min(1.0, c_low)))
    alpha = _wrist_direction(low - phi, high - phi, radius, l3)
    beta = _elbow_angle(bend[0], bend[1], l1, l2)
    if elbow > 0:
        q2 = bend
        q1 = phi + alpha[0] - beta[1], phi + alpha[1] - beta[0]
    else:
        q2 = -bend[1], -bend[0]
        q1 = phi + alpha[0] + beta[0], phi + alpha[1] + beta[1]
    q3 = low - q1[1] - q2[1], high - q1[0] - q2[0]
    angles = (q1, q2, q3)
    for j in range(3):
        inside = _within(
            angles[j][0] - ROUNDING, angles[j][1] + ROUNDING, m.joint_min[j], m.joint_max[j]
        )
        if inside[0] > inside[1] + ROUNDING:
            return False
        a = cylinder_length(m.linkage[j], inside[0])
        b = cylinder_length(m.linkage[j], inside[1])
        box[0, j], box[1, j] = min(a, b), max(a, b)
    return True


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
    """Kernel of `least_cost_to` for one tip: the bound, inf where no posture reaches the goal, and
    the least cost met so far, at other tips, `met`, or here."""
    q, nearest, box = np.empty(3), np.empty(3), np.empty((2, 3))
    cells = [(0, 0.0, 0.0)]
    cells.pop()
    for elbow in (-1, 1):
        for i in range(FIRST_CELLS):
            width = (psi[1] - psi[0]) / FIRST_CELLS
            cells.append((elbow, psi[0] + i * width, psi[0] + (i + 1) * width))
    least = math.inf
    while len(cells) > 0:
        elbow, low, high = cells.pop()
        if not enclose(m, tip, elbow, low, high, box):
            continue
        for j in range(3):
            nearest[j] = min(box[1, j], max(box[0, j], start[j]))
        bound = least_cost_between(c, start, nearest, weight)
        middle = 0.5 * (low + high)
        if joint_angles(m, tip[0], tip[1], middle, elbow, q) and within_limits(m, q):
            for j in range(3):
                nearest[j] = cylinder_length(m.linkage[j], q[j])
            met = min(met, least_cost_between(c, start, nearest, weight))
        if bound >= (1.0 - TOLERANCE) * met or high - low < NARROWEST or bound >= least:
            least = min(least, bound)
            continue
        cells.append((elbow, low, middle))
        cells.append((elbow, middle, high))
    return least, met


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
    for x, z in np.unique(goals.tips, axis=0).tolist():
        here, met = _branch_and_bound(
            machine.arrays, circuit, start, (x, z), between, weight, met
        )
        least = min(least, here)
    return least
