"""Lower bound on the cost of every plan from a start posture to a tip position, for any ψ.

The bound is the minimum of `bound_cost_between` over the continuous set of goal postures. Branch
and bound over the end-link angle ψ finds it. For a cell [a, b] of ψ and an elbow branch, interval
arithmetic encloses the joint positions, and so the cylinder lengths, in a box. The lower bound on
the cost of a move into the box is the bound of the cell. The middle posture of a cell gives an
upper bound on the minimum. The cell with the least bound is halved until this bound is close to the
least such upper bound.

The tip is at distance R in direction φ, and u = ψ − φ. The wrist lies at distance D in direction φ
+ α. The angle between the upper arm and the line to the wrist is β:

    D² = R² + L₃² − 2 R L₃ cos u         α = atan2(−L₃ sin u, R − L₃ cos u)
    cos|q₂| = (D² − L₁² − L₂²)/(2 L₁ L₂)  β = atan2(L₂ sin|q₂|, L₁ + L₂ cos|q₂|)
    q₁ = φ + α − sgn(q₂) β                q₃ = ψ − q₁ − q₂

With more joints, a cell also holds intervals of the angles of the first n − 3 joints. Their links
are removed one by one: the formulas for D and α give the tip's position as seen from the end of
each link. With telescopes a cell holds intervals of all joints that do not close the chain
(`telescope_cells`).
"""

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.tip_postures import has_prismatic_joint, solve_posture
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.goal_region import Angle, Region, angle_range, tip_positions
from mhsb_planner.integrated.goal_postures import (
    GoalPostures,
    held_joints,
)
from mhsb_planner.integrated.intervals import (
    INTERVAL_ROUNDING,
    Interval,
    cosine_range,
    enclose_lengths,
    tip_relative_to_link_end,
    wrist_direction_range,
)
from mhsb_planner.integrated.telescope_cells import enclose_with_telescopes
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.lower_bound import (
    ENERGY_ONLY_WEIGHTS,
    bound_cost_between,
    bound_costs_between,
)
from mhsb_planner.search.open_list import (
    NO_STATE,
    OpenList,
    create_open_list,
    pop_first_state,
    record_path_to,
)
from mhsb_planner.search.s2_step import (
    HydraulicCoefficients,
    compute_hydraulic_coefficients,
)

BOUND_TOLERANCE = 1e-3
"""Gap between the bound found and the true minimum at which the branch and bound stops, as a share
of the minimum [-].
"""

MIN_CELL_WIDTH = 1e-5
"""Width below which a cell is not halved further [rad]; range/π of a telescope stands for 1 rad."""

FIRST_CELLS = 32
"""Number of cells into which the range of ψ is divided at first, for each elbow branch. With
telescopes the range of the last free coordinate is divided.
"""
MAX_CELLS, MAX_CELLS_WITH_DEADLINE = 4000, 1000
"""Largest number of cells that halving may add: without and with a deadline."""


def max_bound_cells(progress: PlanProgress) -> int:
    """Return the largest number of cells that a lower bound may add; fewer with a deadline."""
    return MAX_CELLS_WITH_DEADLINE if progress.has_deadline else MAX_CELLS


@kernel
def _elbow_offset_range(low: float, high: float, l1: float, l2: float) -> Interval:
    """Return the range of the angle β between link 1 and the wrist over a range of elbow angles.

    Links 1 and 2 have the lengths L₁ and L₂ and meet at the elbow with the joint angle q₂. The
    angle β lies between link 1 and the line from its start to the end of link 2:

        β = atan2(L₂ sin|q₂|, L₁ + L₂ cos|q₂|)

    If L₂ < L₁, the greatest β is asin(L₂/L₁), at cos|q₂| = −L₂/L₁.

    Args:
        low: Least |q₂| [rad].
        high: Greatest |q₂| [rad].
        l1: Length L₁ of the first link [m].
        l2: Length L₂ of the second link [m].

    Returns:
        Least and greatest β [rad].
    """
    a = math.atan2(l2 * math.sin(low), l1 + l2 * math.cos(low))
    b = math.atan2(l2 * math.sin(high), l1 + l2 * math.cos(high))
    most = max(a, b)
    if l2 < l1 and low < math.acos(-l2 / l1) < high:
        most = math.asin(l2 / l1)
    return min(a, b), most


@kernel(inline="always")
def enclose_cell(
    m: MachineArrays, tip: tuple[float, float], elbow: int, cell: FloatArray, box: FloatArray
) -> bool:
    """Compute the ranges of all cylinder lengths that occur in a cell of goal postures.

    A cell holds an interval for each free coordinate. Free coordinates are the first n − 3 joint
    angles and the end-link angle ψ. With telescopes they are the positions of all joints except the
    last two turning joints, which close the chain. Interval arithmetic gives ranges that may be too
    wide, but never too narrow.

    Args:
        m: Arrays of the machine.
        tip: Tip position (x, z) [m].
        elbow: Elbow branch (sign of the second-last joint's angle), −1 or 1; with telescopes the
            sign of the last turning joint's angle.
        cell: Lower and upper ends of the free coordinates, shape (n - 2, 2) [rad or m].
        box: Written in place, shape (2, n): shortest and longest length of each cylinder [m].

    Returns:
        False if the cell certainly holds no posture within the joint limits; `box` is then
        incomplete.
    """
    if has_prismatic_joint(m):
        return enclose_with_telescopes(m, tip, elbow, cell, box)
    k = len(m.link_length) - 3
    l1, l2, l3 = m.link_length[k], m.link_length[k + 1], m.link_length[k + 2]
    distance, phi = math.hypot(tip[0], tip[1]), math.atan2(tip[1], tip[0])
    radius, direction, heading = (distance, distance), (phi, phi), (0.0, 0.0)
    for j in range(k):
        if not enclose_lengths(m, j, cell[j, 0], cell[j, 1], box):
            return False
        heading = heading[0] + cell[j, 0], heading[1] + cell[j, 1]
        radius, direction = tip_relative_to_link_end(
            radius, direction, m.link_length[j], heading[0], heading[1]
        )
    low, high = cell[k, 0], cell[k, 1]
    cosine = cosine_range(low - direction[1], high - direction[0])
    near = min(max(l3 * cosine[1], radius[0]), radius[1])
    c_low = near * near + l3 * l3 - 2.0 * near * l3 * cosine[1] - l1 * l1 - l2 * l2
    c_high = -math.inf
    for r in radius:
        c_high = max(c_high, r * r + l3 * l3 - 2.0 * r * l3 * cosine[0] - l1 * l1 - l2 * l2)
    c_low, c_high = c_low / (2.0 * l1 * l2), c_high / (2.0 * l1 * l2)
    if c_low > 1.0 + INTERVAL_ROUNDING or c_high < -1.0 - INTERVAL_ROUNDING:
        return False
    bend = math.acos(min(1.0, c_high)), math.acos(max(-1.0, min(1.0, c_low)))
    alpha = wrist_direction_range(low - direction[1], high - direction[0], radius, l3)
    beta = _elbow_offset_range(bend[0], bend[1], l1, l2)
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


class CostFromStart(NamedTuple):
    """Data from which a lower bound on the cost from a start to any posture follows.

    Attributes:
        machine: Arrays of the machine.
        circuit: Hydraulic coefficients of the machine.
        start: Cylinder lengths at the start, shape (n,) [m].
        weight: Weights of energy [1/J] and time [1/s], shape (2 or more,).
    """

    machine: MachineArrays
    circuit: HydraulicCoefficients
    start: FloatArray
    weight: FloatArray


@kernel(borrows=True)
def _compute_cell_bounds(
    cost: CostFromStart, tip: tuple[float, float], elbow: int, cell: FloatArray, w: FloatArray
) -> Interval:
    """Compute lower bounds on the cost to all postures of a cell, and to its middle posture.

    Args:
        cost: Machine, cylinder lengths at the start, and weights.
        tip: Tip position (x, z) [m].
        elbow: Elbow branch (sign of the second-last joint's angle), −1 or 1; with telescopes the
            sign of the last turning joint's angle.
        cell: Lower and upper ends of the free coordinates, shape (n - 2, 2) [rad or m]. The free
            coordinates are the first n − 3 joint angles and the end-link angle ψ. With telescopes:
            the positions of all joints except the last two turning joints.
        w: Working memory, shape (5, n), overwritten.

    Returns:
        Two bounds. The first holds for every posture of the cell. It is inf if interval arithmetic
        proves that the cell holds no posture; for other cells without a posture it is finite. The
        second is the bound for the posture in the middle of the cell; inf if there is no such
        posture within the joint limits.
    """
    m, c, start, weight = cost
    box, nearest, q, free = w[:2], w[2], w[3], w[4]
    if not enclose_cell(m, tip, elbow, cell, box):
        return math.inf, math.inf
    for j in range(len(start)):
        nearest[j] = min(box[1, j], max(box[0, j], start[j]))
    bound, achieved = bound_cost_between(c, start, nearest, weight), math.inf
    for j in range(len(cell)):
        free[j] = 0.5 * (cell[j, 0] + cell[j, 1])
    if solve_posture(m, tip[0], tip[1], free[: len(cell)], elbow, q):
        for j in range(len(start)):
            nearest[j] = cylinder_length(m.linkage[j], q[j])
        achieved = bound_cost_between(c, start, nearest, weight)
    return bound, achieved


@kernel
def _branch_and_bound(
    cost: CostFromStart,
    tip: tuple[float, float],
    ranges: FloatArray,
    best_sampled_bound: float,
    open_cells: OpenList,
) -> Interval:
    """Compute a lower bound on the cost to every goal posture at a tip position.

    A cell holds an interval for each free coordinate. Best-first branch and bound halves the cell
    of the least bound along its widest side. It stops at a cell whose bound is at least (1 −
    BOUND_TOLERANCE) `best_sampled_bound`, or whose widest side is below MIN_CELL_WIDTH. It also
    stops when no more cells are allowed. The result is the least bound of all cells at this moment.

    Args:
        cost: Machine, cylinder lengths at the start, and weights.
        tip: Tip position (x, z) [m].
        ranges: Lower end, upper end and unit of each free coordinate, shape (n - 2, 3) [rad or m].
            Widths are divided by the unit before they are compared.
        best_sampled_bound: Least known bound for a single goal posture at any tip position; inf
            means none. A small value ends the halving earlier.
        open_cells: Empty open list, changed in place. A cell is a state of it whose cost is the
            cell's bound. There is room for 2 · FIRST_CELLS cells and for those that halving adds.

    Returns:
        Two values. The first is the lower bound on the cost [-]; inf if no posture reaches the tip
        position. The second is the least of `best_sampled_bound` and the bounds for the middle
        postures of all cells.
    """
    n, cell_capacity = len(cost.start), len(open_cells.states) - 1
    work, cell = np.empty((5, n)), np.empty((cell_capacity, n - 2, 2))
    elbow = np.empty(cell_capacity, dtype=np.int64)
    low, high = ranges[n - 3, 0], ranges[n - 3, 1]
    for i in range(2 * FIRST_CELLS):
        elbow[i] = -1 if i < FIRST_CELLS else 1
        _copy_cell(cell[i], ranges)
        width = (high - low) / FIRST_CELLS
        cell[i, n - 3, 0] = low + (i % FIRST_CELLS) * width
        cell[i, n - 3, 1] = low + (i % FIRST_CELLS + 1) * width
    begun, count = 0, 2 * FIRST_CELLS
    while True:
        for i in range(begun, count):
            bound, middle = _compute_cell_bounds(cost, tip, elbow[i], cell[i], work)
            best_sampled_bound = min(best_sampled_bound, middle)
            if bound < math.inf:
                record_path_to(open_cells, i, NO_STATE, 0, bound, 0.0)
        i = pop_first_state(open_cells)
        if i == NO_STATE:
            return math.inf, best_sampled_bound
        bound = open_cells.states[i].cost
        widest, width = 0, -math.inf
        for k in range(n - 2):
            here = (cell[i, k, 1] - cell[i, k, 0]) / ranges[k, 2]
            if here > width:
                widest, width = k, here
        if (
            count + 2 > cell_capacity
            or bound >= (1.0 - BOUND_TOLERANCE) * best_sampled_bound
            or width < MIN_CELL_WIDTH
        ):
            return bound, best_sampled_bound
        begun = count
        for half in range(2):
            elbow[count] = elbow[i]
            _copy_cell(cell[count], cell[i])
            cell[count, widest, 1 - half] = 0.5 * (cell[i, widest, 0] + cell[i, widest, 1])
            count += 1


@kernel(borrows=True, forceinline=True)
def _copy_cell(target: FloatArray, source: FloatArray) -> None:
    """Copy the intervals of a cell.

    Args:
        target: Receives lower and upper end of each free coordinate in place, shape (n - 2, 2).
        source: Lower and upper ends, shape (n - 2, 2 or more).
    """
    for k in range(len(target)):
        target[k, 0], target[k, 1] = source[k, 0], source[k, 1]


def bound_cost_to_goals(
    machine: Machine,
    circuit: HydraulicCoefficients,
    start: FloatArray,
    goals: GoalPostures,
    weight: FloatArray,
    most_cells: int = MAX_CELLS,
) -> float:
    """Compute a lower bound on the cost of every plan from a start to the goal, in any modes.

    The bound is found by branch and bound. It is at most BOUND_TOLERANCE (relative) below the
    minimum over all admissible tip positions and all their postures, sampled or not. It is lower if
    `most_cells` is used up, or cells become narrower than MIN_CELL_WIDTH. Mode switches and the
    manipulability loss do not count.

    Args:
        machine: The arm without a slewing joint.
        circuit: Hydraulic coefficients of the machine.
        start: Cylinder lengths at the start, shape (n,) [m].
        goals: Goal postures, which give the tip positions and the range of the end-link angle ψ.
        weight: Weights of energy [1/J] and time [1/s], shape (2 or more,).
        most_cells: Limit on the effort for each tip position: largest number of cells that the
            branch and bound adds.

    Returns:
        The bound [-]; inf if no posture reaches any of the tip positions.
    """
    # A known cost lets cells be closed earlier.
    best_sampled_bound = float(bound_costs_between(circuit, start, goals.length, weight).min())
    cost = CostFromStart(machine.arrays, circuit, start, weight)
    return _bound_cost_to_tips(
        machine, cost, goals.tips, goals.psi_range, best_sampled_bound, most_cells
    )


def bound_energy_to_goal(
    machine: Machine,
    start: FloatArray,
    goal: tuple[float, float],
    psi: Angle = None,
    region: Region | None = None,
    others: tuple[float, float] = (0.0, 0.0),
    most_cells: int = MAX_CELLS,
) -> float:
    """Compute a lower bound on the energy of every plan from a posture to a goal.

    The bound is found by branch and bound over all postures at the admissible tip positions.

    Args:
        machine: The arm without a slewing joint.
        start: Start posture, shape (n,) [rad or m].
        goal: Tip position (x, z) [m].
        psi: End-link angle at the goal, or its range (least, greatest) [rad]; None means any.
        region: Other admissible tip positions; None means the goal alone.
        others: Oil volume [m³] and least duration [s] that the slew needs for its part of the move;
            0 without a slew.
        most_cells: Limit on the effort for each tip position: largest number of cells that the
            branch and bound adds.

    Returns:
        The bound [J]; inf if no posture reaches the goal.
    """
    circuit = compute_hydraulic_coefficients(machine.arrays, machine.patterns)
    cost = CostFromStart(
        machine.arrays,
        circuit._replace(other_oil=others[0], other_time=others[1]),
        machine.cylinder_lengths(start),
        ENERGY_ONLY_WEIGHTS,
    )
    tips = tip_positions(goal, region)
    return _bound_cost_to_tips(machine, cost, tips, angle_range(psi), math.inf, most_cells)


def _bound_cost_to_tips(
    machine: Machine,
    cost: CostFromStart,
    tips: FloatArray,
    psi_range: Interval | None,
    best_sampled_bound: float,
    most_cells: int,
) -> float:
    """Compute a lower bound on the cost to any posture at any of several tip positions.

    Args:
        machine: The arm without a slewing joint.
        cost: Machine, cylinder lengths at the start, and weights.
        tips: Tip positions (x, z), shape (k, 2) [m].
        psi_range: Least and greatest end-link angle [rad]; None means any.
        best_sampled_bound: Least known bound for a single goal posture; inf means none. A small
            value ends the search earlier. For every value, the result is a lower bound.
        most_cells: Limit on the effort for each tip position: largest number of cells that the
            branch and bound adds.

    Returns:
        The bound [-]; inf if no posture reaches any of the tip positions.
    """
    ranges = _free_coordinate_ranges(machine, psi_range or (-math.pi, math.pi))
    least = math.inf
    for tip in map(tuple, np.unique(tips, axis=0).tolist()):
        open_cells = create_open_list(2 * FIRST_CELLS + most_cells)
        here, best_sampled_bound = _branch_and_bound(
            cost, tip, ranges, best_sampled_bound, open_cells
        )
        least = min(least, here)
    return least


def _free_coordinate_ranges(machine: Machine, psi: Interval) -> FloatArray:
    """Return the range and the unit of each free joint coordinate of a goal posture.

    Free coordinates are the first n − 3 joint angles and the end-link angle ψ. With telescopes they
    are the positions of all joints except the last two turning joints; the range of ψ is then
    ignored.

    Args:
        machine: The arm without a slewing joint.
        psi: Least and greatest ψ [rad].

    Returns:
        Lower end, upper end and unit of each coordinate, shape (n - 2, 3) [rad or m]. The unit is 1
        rad for an angle, and the range divided by π for a telescope.
    """
    a = machine.arrays
    if machine.has_telescope:
        held = held_joints(machine)
        return np.column_stack(
            [a.joint_min[held], a.joint_max[held], machine.radian_equivalents[held]]
        )
    inner = slice(0, machine.joint_count - 3)
    low, high = np.append(a.joint_min[inner], psi[0]), np.append(a.joint_max[inner], psi[1])
    return np.column_stack([low, high, np.ones(len(low))])
