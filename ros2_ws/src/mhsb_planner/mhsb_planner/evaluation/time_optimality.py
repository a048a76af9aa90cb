"""How near plans are to the shortest time: durations over those of an offline collocation.

The collocation has the plan's start, its goal with ψ free, its modes at the same shares of the
duration, and its limits: joint ranges, workspace, V_max, what valves and servo pumps give under
the load, the pressure against load and inertia, the main pump's flow, acceleration and jerk. Loads
are taken a little lighter than they are, so that it may be a little too fast.

For a duration T it is a sequence of linear programmes in cylinder lengths L, their speeds v and
accelerations a at the ends of intervals in which the jerk is constant,

    L₊ = L + v h + a h²/2 + j h³/6,   v₊ = v + a h + j h²/2,   a₊ = a + j h

with tip, workspace, the load's speed limits and the pistons' inertia M_ij/(r_i r_j) taken around
the motion before. The least T that has a solution is found by halving. It starts from the plan, and
so finds the best motion nearby.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_array
from tqdm import tqdm

from mhsb_model.hydraulics import highest_supply, oil_of, spared_margin, valve_margin
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.evaluation.moves import Move
from mhsb_planner.motion.piston_motion import joint_motion, lengths_of
from mhsb_planner.motion.s3_limits import DEAD_BAND, speed_limit
from mhsb_planner.planner import Plan, Planner, PlanOptions
from mhsb_planner.search.s2_search import Weights

TIME_OPTIMAL = Weights(0.0, 15.0, 2.0)
"""Weights of the paper's time-optimal cases."""

FINE, COARSE = 0.02, 0.1
"""Longest intervals near both ends and elsewhere [s]."""

NEAR_ENDS = 0.3  # s

TRUST = 4e-3
"""The first programme moves a piston by so much at most [m]."""

PROGRAMMES = 6
"""One after the other for one duration; each has half the trust of the one before."""

LIGHTER, LIGHTEST = 0.98, 0.96
"""Shares of the loads in the programmes, and in judging what comes out: where a load is just what
P_S lifts, a motion would not be found otherwise."""

SHORTEST, LONGEST = 0.75, 1.03
"""Shares of the plan's duration between which the shortest is looked for."""

HALVINGS = 7
SLACK = 2e-3
"""Excess over a speed limit that counts as none, as a share of V_max."""

TIP_ERROR = 1e-4  # m

Figures = dict[str, Any]


def time_optimality_figures(planner: Planner, moves: Sequence[Move]) -> Figures:
    """Ratios of the integrated planner's durations to the collocation's, under time weights."""
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
    """The figures for people."""
    return [
        f"duration         over a collocation's, {figures['moves']} moves: median "
        f"{figures['ratio_p50']:.3f}, at worst {figures['ratio_max']:.3f}; "
        f"{figures['unsolved']} without one"
    ]


def shortest_duration(machine: Machine, plan: Plan) -> float | None:
    """The collocation's duration [s]; None where it has no solution near the plan's either."""
    grid = _Grid.of(machine, plan)
    low, high = SHORTEST, LONGEST
    best = _solved(grid, high, grid.length)
    if best is None:
        return None
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        found = _solved(grid, middle, best)
        if found is None:
            low = middle
        else:
            high, best = middle, found
    return high * plan.duration


@dataclass(frozen=True, eq=False)
class _Grid:
    """What a collocation is about: k intervals, n cylinders.

    step    float64[k] s, at the plan's duration
    modes   uint8[k, n]
    length  float64[k + 1, n] m, of the plan
    goal    float64[2] m
    """

    machine: Machine
    step: FloatArray
    modes: ModeArray
    length: FloatArray
    goal: FloatArray
    start: FloatArray

    @classmethod
    def of(cls, machine: Machine, plan: Plan) -> _Grid:
        trajectory, duration = plan.motion.trajectory, plan.duration
        ends = min(NEAR_ENDS, 0.5 * duration)
        middle = duration - 2.0 * ends
        parts = [(ends, FINE), (middle, COARSE), (ends, FINE)]
        step = np.concatenate([
            np.full(count, span / count)
            for span, longest in parts
            if (count := int(np.ceil(span / longest - 1e-9))) > 0
        ])
        time = np.concatenate([[0.0], np.cumsum(step)])
        at_ns = np.rint(time * SECOND_NS).astype(np.int64)
        q = trajectory.sample_many(at_ns)[0]
        between = (0.5 * (at_ns[1:] + at_ns[:-1])).astype(np.int64)
        modes = plan.motion.schedule.modes_at_many(between)
        goal = machine.tip_position(trajectory.position[-1])
        return cls(machine, step, modes, lengths_of(machine.arrays, q), goal, q[0])

    def posture(self, length: FloatArray) -> FloatArray:
        """Joint angles [rad] of cylinder lengths [m]."""
        still = np.zeros_like(length)
        return joint_motion(self.machine.arrays, length, still, still, self.start)[0]

    def fastest(self, q: FloatArray, share: float) -> tuple[FloatArray, FloatArray]:
        """Least and greatest piston speeds in the postures at the ends, float64[k + 1, n] m/s.

        share: of the loads that gravity gives
        """
        m = self.machine.arrays
        oil = oil_of(m)
        upper = np.tile(m.max_piston_speed, (len(q), 1))
        lower = -upper
        force = share * np.array([self.machine.piston_forces(row) for row in q])
        for i, modes in enumerate(self.modes):
            for j, mode in enumerate(modes):
                modules = m.modules_per_mode[mode]
                for k in (i, i + 1):
                    own = (m.valve_coefficient[j], m.cap_area[j], m.rod_area[j], force[k, j])
                    out = speed_limit(oil, *own, 1.0, modules)
                    back = speed_limit(oil, *own, -1.0, modules)
                    upper[k, j] = min(upper[k, j], max(out, DEAD_BAND))
                    lower[k, j] = max(lower[k, j], -max(back, DEAD_BAND))
        return lower, upper


    def thrusts(self, q: FloatArray, speed: FloatArray, share: float) -> FloatArray:
        """What the pressures leave for inertia at these piston speeds, float64[k + 1, n] N.

        The force of inertia in the direction of motion may be that much; of pistons that rest
        nothing is asked. share: of the loads that gravity gives
        """
        m = self.machine.arrays
        oil, room = oil_of(m), np.full(q.shape, np.inf)
        force = share * np.array([self.machine.piston_forces(row) for row in q])
        modes = np.vstack([self.modes, self.modes[-1:]])
        for k, j in zip(*np.nonzero(np.abs(speed) > DEAD_BAND), strict=True):
            v, cap, rod = speed[k, j], m.cap_area[j], m.rod_area[j]
            inlet, outlet = (cap, rod) if v > 0.0 else (rod, cap)
            supply = min(
                highest_supply(oil, m.modules_per_mode[modes[i, j]]) for i in (max(0, k - 1), k)
            )
            supply -= oil.boost_margin - spared_margin(oil)
            supply -= valve_margin(m.valve_coefficient[j], cap, rod, v)
            room[k, j] = inlet * supply - outlet * oil.tank_pressure - np.sign(v) * force[k, j]
        return room

    def inertia(self, q: FloatArray) -> FloatArray:
        """M_ij/(r_i r_j): forces over accelerations of the pistons, float64[k + 1, n, n] kg."""
        arms = np.array([self.machine.moment_arms(row) for row in q])
        mass = np.array([self.machine.mass_matrix(row) for row in q])
        return np.asarray(mass / (arms[:, :, None] * arms[:, None, :]))


class _Motion(NamedTuple):
    """Of the cylinders at the ends of the intervals, float64[k + 1, n] each."""

    length: FloatArray  # m
    speed: FloatArray  # m/s
    acceleration: FloatArray  # m/s²


def _solved(grid: _Grid, share: float, length: FloatArray) -> FloatArray | None:
    """Lengths of a motion that lasts `share` of the plan, from those of one nearby; or None."""
    time = share * np.concatenate([[0.0], np.cumsum(grid.step)])
    speed = np.asarray(np.gradient(length, time, axis=0))
    for k in range(PROGRAMMES):
        found = _programme(grid, share, length, speed, TRUST / 2**k)
        if found is None:
            return None
        length, speed, acceleration = found
        q = grid.posture(length)
        lower, upper = grid.fastest(q, LIGHTEST)
        push = np.einsum("kij,kj->ki", grid.inertia(q), acceleration) * np.sign(speed)
        if np.any(push > grid.thrusts(q, speed, LIGHTEST)):
            continue
        beyond = np.maximum(speed - upper, lower - speed)
        excess = (beyond / grid.machine.arrays.max_piston_speed).max()
        tip = np.hypot(*(grid.machine.tip_position(q[-1]) - grid.goal))
        if excess <= SLACK and tip <= TIP_ERROR:
            return length
    return None


class _Rows:
    """Rows of a sparse matrix with their right-hand sides, and slack where there is some."""

    def __init__(self) -> None:
        self.row: list[int] = []
        self.column: list[int] = []
        self.value: list[float] = []
        self.bound: list[float] = []

    def add(self, terms: Iterable[tuple[int, float]], bound: float) -> None:
        """Σ value · x[column], = or ≤ bound."""
        for column, value in terms:
            self.row.append(len(self.bound))
            self.column.append(column)
            self.value.append(value)
        self.bound.append(bound)

    def matrix(self, columns: int) -> Any:
        """All of them."""
        shape = (len(self.bound), columns)
        return coo_array((self.value, (self.row, self.column)), shape=shape).tocsr()


def _programme(
    grid: _Grid, share: float, length: FloatArray, speed: FloatArray, trust: float
) -> _Motion | None:
    """One linear programme around lengths and speeds: the least slack in the speed limits."""
    m, h = grid.machine.arrays, share * grid.step
    points, n = length.shape
    q = grid.posture(length)
    lower, upper = grid.fastest(q, LIGHTER)
    room, inertia = grid.thrusts(q, speed, LIGHTER), grid.inertia(q)
    size = points * n

    def at(block: int, k: int, j: int) -> int:  # blocks: L, v⁺, v⁻, a, j, then the slack
        return block * size + k * n + j

    slack = 5 * size
    equal, below = _Rows(), _Rows()
    low, high = np.full(slack + 1, -np.inf), np.full(slack + 1, np.inf)
    low[slack] = 0.0
    ends = np.sort(lengths_of(m, np.array([m.joint_min, m.joint_max])), axis=0)
    low[:size] = np.maximum(length - trust, np.minimum(ends[0], length)).ravel()
    high[:size] = np.minimum(length + trust, np.maximum(ends[1], length)).ravel()
    low[size : 3 * size] = 0.0
    high[size : 3 * size] = np.tile(m.max_piston_speed, 2 * points)
    high[3 * size : 4 * size] = m.max_piston_acceleration
    low[3 * size : 4 * size] = -m.max_piston_acceleration
    high[4 * size : slack], low[4 * size : slack] = m.max_piston_jerk, -m.max_piston_jerk
    for k in (0, points - 1):
        for j in range(n):
            for block in (1, 2, 3):
                low[at(block, k, j)] = high[at(block, k, j)] = 0.0
    low[:n] = high[:n] = length[0]
    for k, step in enumerate(h):
        for j in range(n):
            here = (at(0, k, j), at(1, k, j), at(2, k, j), at(3, k, j), at(4, k, j))
            there = (at(0, k + 1, j), at(1, k + 1, j), at(2, k + 1, j), at(3, k + 1, j))
            way = (1.0, step, -step, step**2 / 2, step**3 / 6)
            equal.add([(there[0], -1.0), *zip(here, way, strict=True)], 0.0)
            rate = ((here[1], 1.0), (here[2], -1.0), (here[3], step), (here[4], step**2 / 2))
            equal.add([(there[1], -1.0), (there[2], 1.0), *rate], 0.0)
            equal.add([(there[3], -1.0), (here[3], 1.0), (here[4], step)], 0.0)
    flow = m.main_pump_flow - n * m.leakage_flow
    for k in range(points):
        litres = [(at(1, k, j), float(m.cap_area[j]) / flow) for j in range(n)]
        below.add([*litres, *((at(2, k, j), float(m.rod_area[j]) / flow) for j in range(n))], 1.0)
        for j in range(n):
            v = ((at(1, k, j), 1.0), (at(2, k, j), -1.0))
            below.add([*v, (slack, -1.0)], upper[k, j])
            below.add([(at(1, k, j), -1.0), (at(2, k, j), 1.0), (slack, -1.0)], -lower[k, j])
            if room[k, j] < math.inf:
                push = np.sign(speed[k, j]) * inertia[k, j]
                below.add([(at(3, k, i), float(push[i])) for i in range(n)], float(room[k, j]))
        _within_workspace(grid, below, k, q[k], length[k])
    tip, turn = grid.machine.tip_position(q[-1]), _tip_rates(grid.machine, q[-1])
    for axis in range(2):
        own = [(at(0, points - 1, j), turn[axis, j]) for j in range(n)]
        equal.add(own, float(grid.goal[axis] - tip[axis] + turn[axis] @ length[-1]))
    cost = np.zeros(slack + 1)
    cost[slack] = 1.0
    answer = linprog(
        cost,
        A_ub=below.matrix(slack + 1),
        b_ub=below.bound,
        A_eq=equal.matrix(slack + 1),
        b_eq=equal.bound,
        bounds=np.column_stack([low, high]),
        method="highs",
    )
    if answer.x is None:
        return None
    values = answer.x[:slack].reshape(5, points, n)
    return _Motion(values[0], values[1] - values[2], values[3])


def _tip_rates(machine: Machine, q: FloatArray) -> FloatArray:
    """∂(x, z)/∂L, float64[2, n]."""
    return machine.jacobian(q) / machine.moment_arms(q)


def _within_workspace(
    grid: _Grid, below: _Rows, k: int, q: FloatArray, length: FloatArray
) -> None:
    """The tip's ranges at point k, where it is near their ends."""
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
