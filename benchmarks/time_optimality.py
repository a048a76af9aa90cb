"""Comparison of plan durations with the shortest ones that an offline collocation finds.

The collocation has the plan's start, its goal with ψ free, and its modes at the same shares of the
duration. It keeps the plan's limits: joint ranges, workspace, V_max, what valves and servo pumps
give under the load, the pressure against load and inertia, the main pump's flow, acceleration and
jerk. Loads are taken slightly lighter than they are, so that it may be slightly too fast.

For a duration T it is a sequence of linear programmes in cylinder lengths L, speeds v and
accelerations a at the ends of intervals of constant jerk j,

    L₊ = L + v h + a h²/2 + j h³/6,   v₊ = v + a h + j h²/2,   a₊ = a + j h

with tip, workspace, the load's speed limits and the pistons' inertia M_ij/(r_i r_j) linearised
around the previous motion. The least T that has a solution is found by bisection. It starts from
the plan and so finds the best motion nearby.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_array
from tqdm import tqdm

from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.hydraulics import (
    compute_inertia_margin,
    compute_valve_drop,
    get_max_supply_pressure,
    get_shared_hydraulics,
)
from mhsb_model.linkages.linkage import cylinder_lengths
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.cases.moves import Move
from mhsb_planner.motion.limits.usage import compute_speed_limit
from mhsb_planner.motion.piston_motion import convert_to_joints
from mhsb_planner.planner import Plan, Planner, PlanOptions
from mhsb_planner.search.s2_search import Weights

TIME_OPTIMAL = Weights(0.0, 15.0, 2.0)
"""Weights of the paper's time-optimal cases."""

FINE, COARSE = 0.02, 0.1
"""Longest interval near both ends and elsewhere [s]."""

NEAR_ENDS = 0.3
"""Time from either end in which intervals are fine [s]."""

TRUST = 4e-3
"""Largest change of a cylinder length in the first programme [m]."""

PROGRAMMES = 6
"""Number of successive programmes for one duration; each has half the trust of the one before."""

LIGHTER, LIGHTEST = 0.98, 0.96
"""Shares of the loads in the programmes, and in the final check. With the full loads, a motion with
a load that P_S just lifts would not be found.
"""

SHORTEST, LONGEST = 0.75, 1.03
"""Shares of the plan's duration between which the shortest duration is searched."""

HALVINGS = 7
"""Number of bisection steps."""
SLACK = 2e-3
"""Excess over a speed limit that counts as none, as a share of V_max."""

TIP_ERROR = 1e-4
"""Largest distance of the final tip from the goal [m]."""

Figures = dict[str, Any]


def time_optimality_figures(planner: Planner, moves: Sequence[Move]) -> Figures:
    """Compare the integrated planner's durations with the collocation's, under time weights.

    Args:
        planner: The planner.
        moves: The moves.

    Returns:
        Number of moves, of those without a collocation (`unsolved`), and ratios of durations.
    """
    options, ratios, unsolved = PlanOptions(TIME_OPTIMAL, planner="integrated"), [], 0
    for move in tqdm(moves, "collocation", unit="move"):
        plan = planner.plan(move.goal, MotionState.at_rest(move.start), options=options)
        shortest = shortest_duration(planner.machine, plan)
        if shortest is None:
            unsolved += 1
        else:
            ratios.append(plan.duration / shortest)
    found = np.array(ratios)
    return {
        "moves": len(moves),
        "unsolved": unsolved,
        "ratio_p50": float(np.median(found)),
        "ratio_p95": float(np.percentile(found, 95)),
        "ratio_max": float(found.max()),
    }


def time_optimality_lines(figures: Figures) -> list[str]:
    """Format the ratios of durations as a line of text."""
    return [
        f"duration         over a collocation's, {figures['moves']} moves: median "
        f"{figures['ratio_p50']:.3f}, at worst {figures['ratio_max']:.3f}; "
        f"{figures['unsolved']} without one"
    ]


def shortest_duration(machine: Machine, plan: Plan) -> float | None:
    """Find the shortest duration of a motion near a plan's.

    Args:
        machine: The arm.
        plan: The plan.

    Returns:
        Duration [s]; None if the collocation has no solution even at 1.03 times the plan's.
    """
    grid = _Grid.from_plan(machine, plan)
    low, high = SHORTEST, LONGEST
    best = _solve_duration(grid, high, grid.length)
    if best is None:
        return None
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        found = _solve_duration(grid, middle, best)
        if found is None:
            low = middle
        else:
            high, best = middle, found
    return high * plan.duration


@dataclass(frozen=True, eq=False)
class _Grid:
    """Discretisation of a plan for the collocation: k intervals, n cylinders.

    Attributes:
        machine: The arm.
        step: Length of each interval at the plan's duration, shape (k,) [s].
        modes: Modes in force in each interval, shape (k, n), uint8.
        length: Cylinder lengths of the plan at the ends of the intervals, shape (k + 1, n) [m].
        goal: Tip position (x, z) at the plan's end, shape (2,) [m].
        start: Start posture, shape (n,) [rad].
    """

    machine: Machine
    step: FloatArray
    modes: ModeArray
    length: FloatArray
    goal: FloatArray
    start: FloatArray

    @classmethod
    def from_plan(cls, machine: Machine, plan: Plan) -> _Grid:
        """Divide a plan into intervals, fine near both ends and coarse between them.

        Args:
            machine: The arm.
            plan: The plan.

        Returns:
            The discretisation.
        """
        trajectory, duration = plan.motion.trajectory, plan.duration
        ends = min(NEAR_ENDS, 0.5 * duration)
        middle = duration - 2.0 * ends
        parts = [(ends, FINE), (middle, COARSE), (ends, FINE)]
        step = np.concatenate(
            [
                np.full(count, span / count)
                for span, longest in parts
                if (count := int(np.ceil(span / longest - 1e-9))) > 0
            ]
        )
        time = np.concatenate([[0.0], np.cumsum(step)])
        at_ns = np.rint(time * SECOND_NS).astype(np.int64)
        q = trajectory.sample_many(at_ns)[0]
        between = (0.5 * (at_ns[1:] + at_ns[:-1])).astype(np.int64)
        modes = plan.motion.schedule.modes_at_many(between)
        goal = machine.tip_position(trajectory.position[-1])
        return cls(machine, step, modes, cylinder_lengths(machine.arrays.linkage, q), goal, q[0])

    def posture(self, length: FloatArray) -> FloatArray:
        """Return the joint angles [rad] of cylinder lengths [m], both of shape (k + 1, n)."""
        still = np.zeros_like(length)
        return convert_to_joints(self.machine.arrays, length, still, still, self.start)[0]

    def speed_limits(self, q: FloatArray, share: float) -> tuple[FloatArray, FloatArray]:
        """Compute the limits of piston speed at the ends of the intervals.

        The limits of both adjacent intervals' modes count.

        Args:
            q: Postures, shape (k + 1, n) [rad].
            share: Factor on the gravity loads.

        Returns:
            Least and greatest piston speed [m/s], each of shape (k + 1, n).
        """
        m = self.machine.arrays
        oil = get_shared_hydraulics(m)
        upper = np.tile(m.max_piston_speed, (len(q), 1))
        lower = -upper
        force = share * np.array([self.machine.piston_forces(row) for row in q])
        for i, modes in enumerate(self.modes):
            for j, mode in enumerate(modes):
                modules = m.modules_per_mode[mode]
                for k in (i, i + 1):
                    own = (m.valve_coefficient[j], m.cap_area[j], m.rod_area[j], force[k, j])
                    out = compute_speed_limit(oil, *own, 1.0, modules)
                    back = compute_speed_limit(oil, *own, -1.0, modules)
                    upper[k, j] = min(upper[k, j], max(out, MAX_HELD_SPEED))
                    lower[k, j] = max(lower[k, j], -max(back, MAX_HELD_SPEED))
        return lower, upper

    def inertia_force_limits(self, q: FloatArray, speed: FloatArray, share: float) -> FloatArray:
        """Compute the force that the pressures leave for inertia in the direction of motion.

            F_room = A_in (p_supply − margin − m(v)) − A_out p_T − sign(v) F

        Args:
            q: Postures, shape (k + 1, n) [rad].
            speed: Piston speeds, shape (k + 1, n) [m/s].
            share: Factor on the gravity loads F.

        Returns:
            Largest inertia force [N], shape (k + 1, n); infinity for pistons within the dead band.
        """
        m = self.machine.arrays
        oil, room = get_shared_hydraulics(m), np.full(q.shape, np.inf)
        force = share * np.array([self.machine.piston_forces(row) for row in q])
        modes = np.vstack([self.modes, self.modes[-1:]])
        for k, j in zip(*np.nonzero(np.abs(speed) > MAX_HELD_SPEED), strict=True):
            v, cap, rod = speed[k, j], m.cap_area[j], m.rod_area[j]
            inlet, outlet = (cap, rod) if v > 0.0 else (rod, cap)
            supply = min(
                get_max_supply_pressure(oil, m.modules_per_mode[modes[i, j]])
                for i in (max(0, k - 1), k)
            )
            supply -= oil.boost_margin - compute_inertia_margin(oil)
            supply -= compute_valve_drop(m.valve_coefficient[j], cap, rod, v)
            room[k, j] = inlet * supply - outlet * oil.tank_pressure - np.sign(v) * force[k, j]
        return room

    def inertia(self, q: FloatArray) -> FloatArray:
        """Compute the inertia that the pistons move, M_ij/(r_i r_j).

        Args:
            q: Postures, shape (k + 1, n) [rad].

        Returns:
            Piston forces over piston accelerations [kg], shape (k + 1, n, n).
        """
        arms = np.array([self.machine.moment_arms(row) for row in q])
        mass = np.array([self.machine.mass_matrix(row) for row in q])
        return np.asarray(mass / (arms[:, :, None] * arms[:, None, :]))


class _Motion(NamedTuple):
    """Motion of the cylinders at the ends of the intervals, each of shape (k + 1, n).

    Attributes:
        length: Cylinder lengths [m].
        speed: Piston speeds [m/s].
        acceleration: Piston accelerations [m/s²].
    """

    length: FloatArray  # m
    speed: FloatArray  # m/s
    acceleration: FloatArray  # m/s²


def _solve_duration(grid: _Grid, share: float, length: FloatArray) -> FloatArray | None:
    """Find a motion that takes a share of the plan's duration and keeps the limits.

    Solves programmes in succession, each linearised around the motion before. The first result that
    passes the check with `LIGHTEST` loads is taken.

    Args:
        grid: Discretisation of the plan.
        share: Duration as a share of the plan's.
        length: Cylinder lengths of a motion nearby, shape (k + 1, n) [m].

    Returns:
        Cylinder lengths [m], shape (k + 1, n); None if there is no such motion.
    """
    time = share * np.concatenate([[0.0], np.cumsum(grid.step)])
    speed = np.asarray(np.gradient(length, time, axis=0))
    for k in range(PROGRAMMES):
        found = _solve_programme(grid, share, length, speed, TRUST / 2**k)
        if found is None:
            return None
        length, speed, acceleration = found
        q = grid.posture(length)
        lower, upper = grid.speed_limits(q, LIGHTEST)
        push = np.einsum("kij,kj->ki", grid.inertia(q), acceleration) * np.sign(speed)
        if np.any(push > grid.inertia_force_limits(q, speed, LIGHTEST)):
            continue
        beyond = np.maximum(speed - upper, lower - speed)
        excess = (beyond / grid.machine.arrays.max_piston_speed).max()
        tip = np.hypot(*(grid.machine.tip_position(q[-1]) - grid.goal))
        if excess <= SLACK and tip <= TIP_ERROR:
            return length
    return None


class _SparseRows:
    """Rows of a sparse matrix with their right-hand sides.

    Attributes:
        row: Row index of each value.
        column: Column index of each value.
        value: Values of the matrix.
        bound: Right-hand side of each row.
    """

    def __init__(self) -> None:
        self.row: list[int] = []
        self.column: list[int] = []
        self.value: list[float] = []
        self.bound: list[float] = []

    def add(self, terms: Iterable[tuple[int, float]], bound: float) -> None:
        """Append the row Σ value · x[column] = bound, or ≤ bound.

        Args:
            terms: Pairs of column and value.
            bound: Right-hand side.
        """
        for column, value in terms:
            self.row.append(len(self.bound))
            self.column.append(column)
            self.value.append(value)
        self.bound.append(bound)

    def matrix(self, columns: int) -> Any:
        """Return all rows as a sparse matrix in CSR format with a number of columns."""
        shape = (len(self.bound), columns)
        return coo_array((self.value, (self.row, self.column)), shape=shape).tocsr()


def _solve_programme(
    grid: _Grid, share: float, length: FloatArray, speed: FloatArray, trust: float
) -> _Motion | None:
    """Solve one linear programme around a motion: minimise the excess over the speed limits.

    Constraints are the motion of constant jerk in each interval, rest at both ends, the tip at the
    goal, and the limits. Speed is split into its positive and negative part, so that the flow is
    linear. Only the limits that the load sets on the speed may be exceeded.

    Args:
        grid: Discretisation of the plan.
        share: Duration as a share of the plan's.
        length: Cylinder lengths around which is linearised, shape (k + 1, n) [m].
        speed: Piston speeds around which is linearised, shape (k + 1, n) [m/s].
        trust: Largest change of a cylinder length [m].

    Returns:
        The motion; None if the programme is infeasible.
    """
    m, (points, n) = grid.machine.arrays, length.shape
    q = grid.posture(length)
    lower, upper = grid.speed_limits(q, LIGHTER)
    room, inertia = grid.inertia_force_limits(q, speed, LIGHTER), grid.inertia(q)
    column, slack = partial(_column, length.shape), 5 * points * n
    equal, below = _SparseRows(), _SparseRows()
    _join_intervals(equal, length.shape, share * grid.step)
    flow = m.main_pump_flow - n * m.leakage_flow
    for k in range(points):
        litres = [(column(1, k, j), float(m.cap_area[j]) / flow) for j in range(n)]
        below.add(
            [*litres, *((column(2, k, j), float(m.rod_area[j]) / flow) for j in range(n))], 1.0
        )
        for j in range(n):
            v = ((column(1, k, j), 1.0), (column(2, k, j), -1.0))
            below.add([*v, (slack, -1.0)], upper[k, j])
            below.add(
                [(column(1, k, j), -1.0), (column(2, k, j), 1.0), (slack, -1.0)], -lower[k, j]
            )
            if room[k, j] < math.inf:
                push = np.sign(speed[k, j]) * inertia[k, j]
                below.add([(column(3, k, i), float(push[i])) for i in range(n)], float(room[k, j]))
        _within_workspace(grid, below, k, q[k], length[k])
    tip, turn = grid.machine.tip_position(q[-1]), _tip_rates(grid.machine, q[-1])
    for axis in range(2):
        own = [(column(0, points - 1, j), turn[axis, j]) for j in range(n)]
        equal.add(own, float(grid.goal[axis] - tip[axis] + turn[axis] @ length[-1]))
    cost = np.zeros(slack + 1)
    cost[slack] = 1.0
    answer = linprog(
        cost,
        A_ub=below.matrix(slack + 1),
        b_ub=below.bound,
        A_eq=equal.matrix(slack + 1),
        b_eq=equal.bound,
        bounds=_limit_variables(grid, length, trust),
        method="highs",
    )
    if answer.x is None:
        return None
    values = answer.x[:slack].reshape(5, points, n)
    return _Motion(values[0], values[1] - values[2], values[3])


def _column(shape: tuple[int, ...], block: int, k: int, j: int) -> int:
    """Return the column of a variable of a programme.

    Args:
        shape: Number of points, and number of cylinders n.
        block: 0 length, 1 speed out, 2 speed in (both ≥ 0), 3 acceleration, 4 jerk.
        k: Index of the point.
        j: Index of the cylinder.
    """
    points, n = shape
    return (block * points + k) * n + j


def _limit_variables(grid: _Grid, length: FloatArray, trust: float) -> FloatArray:
    """Compute the bounds of all variables: ranges, V_max, acceleration, jerk, and rest at the ends.

    Args:
        grid: Discretisation of the plan.
        length: Cylinder lengths around which is linearised, shape (k + 1, n) [m].
        trust: Largest change of a cylinder length [m].

    Returns:
        Least and greatest value of each variable, in the order of the columns, shape (variables,
        2). The last variable is the excess over the speed limits that loads set, at least 0.
    """
    m, (points, n), size = grid.machine.arrays, length.shape, length.size
    slack = 5 * size
    low, high = np.full(slack + 1, -np.inf), np.full(slack + 1, np.inf)
    low[slack] = 0.0
    ends = np.sort(cylinder_lengths(m.linkage, np.array([m.joint_min, m.joint_max])), axis=0)
    low[:size] = np.maximum(length - trust, np.minimum(ends[0], length)).ravel()
    high[:size] = np.minimum(length + trust, np.maximum(ends[1], length)).ravel()
    low[size : 3 * size] = 0.0
    high[size : 3 * size] = np.tile(m.max_piston_speed, 2 * points)
    high[3 * size : 4 * size] = m.max_piston_acceleration
    low[3 * size : 4 * size] = -m.max_piston_acceleration
    high[4 * size : slack], low[4 * size : slack] = m.max_piston_jerk, -m.max_piston_jerk
    for block in (1, 2, 3):
        for k in (0, points - 1):
            at = _column(length.shape, block, k, 0)
            low[at : at + n] = high[at : at + n] = 0.0
    low[:n] = high[:n] = length[0]
    return np.column_stack([low, high])


def _join_intervals(equal: _SparseRows, shape: tuple[int, ...], steps: FloatArray) -> None:
    """Append rows by which each interval of constant jerk leads to the next point.

    Args:
        equal: Rows of equations; extended in place.
        shape: Number of points, and number of cylinders n.
        steps: Length of each interval, shape (points - 1,) [s].
    """
    for k, step in enumerate(steps):
        for j in range(shape[1]):
            here = [_column(shape, block, k, j) for block in range(5)]
            there = [_column(shape, block, k + 1, j) for block in range(4)]
            way = (1.0, step, -step, step**2 / 2, step**3 / 6)
            equal.add([(there[0], -1.0), *zip(here, way, strict=True)], 0.0)
            rate = ((here[1], 1.0), (here[2], -1.0), (here[3], step), (here[4], step**2 / 2))
            equal.add([(there[1], -1.0), (there[2], 1.0), *rate], 0.0)
            equal.add([(there[3], -1.0), (here[3], 1.0), (here[4], step)], 0.0)


def _tip_rates(machine: Machine, q: FloatArray) -> FloatArray:
    """Return the tip's derivatives by cylinder lengths, ∂(x, z)/∂L, shape (2, n)."""
    return machine.jacobian(q) / machine.moment_arms(q)


def _within_workspace(
    grid: _Grid, below: _SparseRows, k: int, q: FloatArray, length: FloatArray
) -> None:
    """Append rows that keep the tip in the workspace at one point.

    Only limits that the tip can reach within `TRUST` get a row.

    Args:
        grid: Discretisation of the plan.
        below: Rows of inequalities; extended in place.
        k: Index of the point.
        q: Posture at the point, shape (n,) [rad].
        length: Cylinder lengths there, shape (n,) [m].
    """
    m, n = grid.machine.arrays, len(q)
    tip, turn = grid.machine.tip_position(q), _tip_rates(grid.machine, q)
    radius = float(np.hypot(*tip))
    outwards = tip @ turn / radius
    reach = float(np.abs(turn).sum(axis=1).max()) * TRUST
    for value, slope, least, sign in (
        (float(tip[0]), turn[0], m.min_x, -1.0),
        (radius, outwards, m.min_radius, -1.0),
        (radius, outwards, m.max_radius, 1.0),
    ):
        room = sign * (least - value)
        if room <= reach:
            own = [(k * n + j, sign * float(slope[j])) for j in range(n)]
            below.add(own, max(room, 0.0) + sign * float(slope @ length))
