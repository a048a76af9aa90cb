"""Posture of largest velocity polytope at a tip position, by global search (paper, step S1).

Chains with more than three joints, or with telescopes, are searched by `s1_chain_search`, three
joints that turn here.

With the tip held, the arm with three joints has one degree of freedom left, the end-link angle
ψ, on each of two elbow branches. Most maxima lie at the ends of the feasible intervals, which are
known in closed form; between them the area is sampled and every local maximum refined. Samples
lie at ψ = middle − half·cos t for equally spaced t, which resolves the square-root behaviour of
the joint angles at the edge of the reach.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, ModeArray, frozen
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.errors import (
    EmptyTableError,
    InfeasibleGoalError,
    PlanningCancelledError,
)
from mhsb_planner.posture.grid import grid_nodes
from mhsb_planner.posture.s1_chain_search import largest_polytopes_of_chain
from mhsb_planner.posture.s1_polytope import (
    cross_products,
    flow_limits,
    flow_scale,
    projected_area,
    shared_flow,
    tip_columns,
)
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.posture.s1_psi_intervals_3r import MAX_INTERVALS, feasible, feasible_intervals
from mhsb_planner.workers import Jobs, over_ranges

SAMPLES_PER_TURN = 720
"""Where flow limits change places the area has ridges; with four-bars some are 5 mrad wide."""

LEAST_SAMPLES = 8
REFINED_TO = 1e-7
"""Width to which the parameter t of a maximum is narrowed [rad]."""

SAME_AREA = 1e-9
"""A relative gain in area below this is none: the candidate met first stays, interval ends are
met before what lies between them, elbow −1 before +1, smaller ψ before larger."""

RISE_BETWEEN = 2.0
"""A local maximum of the samples is refined if the area could be the largest: between samples it
is taken to rise by at most so many times the drop to the next sample (once, were it concave)."""

NODES_PER_TASK = 8

PATTERNS_AT_ONCE = 4
"""Patterns for which the postures at one point are sought between two looks at a deadline."""

Progress = Callable[[int, int], None]
Cancelled = Callable[[], bool]
NodeSolver = Callable[[Machine, FloatArray, FloatArray, FloatArray], None]
"""Fills posture[nodes, patterns, n] and area[nodes, patterns] for the tip positions given as
float64[nodes, 2], with NaN where there is no posture within limits."""


@kernel
def _angle(lower: float, upper: float, t: float) -> float:
    """ψ = middle − half·cos t, exact at both ends."""
    if t <= 0.0:
        return lower
    if t >= math.pi:
        return upper
    return 0.5 * (lower + upper) - 0.5 * (upper - lower) * math.cos(t)


@kernel
def _measure(
    m: MachineArrays,
    x: float,
    z: float,
    psi: float,
    elbow: int,
    q: FloatArray,
    cross: FloatArray,
    limit: FloatArray,
) -> bool:
    """What the area needs of a posture; False where it is not within limits."""
    if not feasible(m, x, z, psi, elbow, q):
        return False
    flow_limits(m, q, limit)
    cross_products(tip_columns(m, q), cross)
    return True


@kernel
def _refine(
    m: MachineArrays,
    x: float,
    z: float,
    interval: FloatArray,
    low: float,
    high: float,
    pattern: ModeArray,
    q: FloatArray,
) -> float:
    """Golden section for the largest area in t ∈ [low, high]; posture written to q."""
    n = len(q)
    cross = np.empty((n, n))
    limit = np.empty((n, 3, 2))
    scale = flow_scale(m)
    flow = shared_flow(m)
    elbow = int(interval[0])
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    area = np.empty(2)
    t = np.array([high - ratio * (high - low), low + ratio * (high - low)])
    pending = 2
    while True:
        for side in range(2):
            if pending == side or pending == 2:
                psi = _angle(interval[1], interval[2], t[side])
                area[side] = -1.0
                if _measure(m, x, z, psi, elbow, q, cross, limit):
                    area[side] = projected_area(cross, scale, limit, pattern, flow)
        if high - low < REFINED_TO:
            break
        if area[0] >= area[1]:
            high, t[1], area[1], pending = t[1], t[0], area[0], 0
            t[0] = high - ratio * (high - low)
        else:
            low, t[0], area[0], pending = t[0], t[1], area[1], 1
            t[1] = low + ratio * (high - low)
    best = 0 if area[0] >= area[1] else 1
    feasible(m, x, z, _angle(interval[1], interval[2], t[best]), elbow, q)
    return area[best]


@kernel
def largest_polytopes_3r(
    m: MachineArrays,
    x: float,
    z: float,
    patterns: ModeArray,
    posture: FloatArray,
    area: FloatArray,
) -> bool:
    """Posture of largest polytope area at (x, z) m under each pattern.

    Written to posture[patterns, 3] [rad] and area[patterns] [m²/s²]. Returns False, with both
    NaN, where no posture is within limits. Oracle: a dense scan of ψ on both branches.
    """
    posture[:] = np.nan
    area[:] = np.nan
    interval = np.empty((MAX_INTERVALS, 3))
    intervals = feasible_intervals(m, x, z, interval)
    if intervals == 0:
        return False

    first = np.empty(intervals + 1, dtype=np.int64)
    first[0] = 0
    for i in range(intervals):
        turns = (interval[i, 2] - interval[i, 1]) / (2.0 * math.pi)
        between = math.ceil(turns * SAMPLES_PER_TURN * 0.5 * math.pi)  # widest step at the middle
        first[i + 1] = first[i] + max(LEAST_SAMPLES, between) + 1
    samples = first[intervals]
    q = np.empty(3)
    q_at = np.empty((samples, 3))
    valid = np.empty(samples, dtype=np.bool_)
    cross = np.empty((samples, 3, 3))
    limit = np.empty((samples, 3, 3, 2))
    for i in range(intervals):
        steps = first[i + 1] - first[i] - 1
        for s in range(first[i], first[i + 1]):
            t = math.pi * ((s - first[i]) / steps)
            psi = _angle(interval[i, 1], interval[i, 2], t)
            valid[s] = _measure(m, x, z, psi, int(interval[i, 0]), q, cross[s], limit[s])
            q_at[s] = q

    scale = flow_scale(m)
    flow = shared_flow(m)
    value = np.empty(samples)
    for p in range(len(patterns)):
        best = -1.0
        for s in range(samples):
            value[s] = -1.0
            if valid[s]:
                value[s] = projected_area(cross[s], scale, limit[s], patterns[p], flow)
        for i in range(intervals):
            for s in (first[i], first[i + 1] - 1):
                if value[s] > best * (1.0 + SAME_AREA):
                    best = value[s]
                    posture[p] = q_at[s]
        for s in range(samples):
            if value[s] > best * (1.0 + SAME_AREA):
                best = value[s]
                posture[p] = q_at[s]
        for i in range(intervals):
            last = first[i + 1] - 1
            for s in range(first[i], last + 1):
                before = value[s - 1] if s > first[i] else -math.inf
                after = value[s + 1] if s < last else -math.inf
                if value[s] < 0.0 or value[s] < before or value[s] <= after:
                    continue
                drop = 0.0
                if s > first[i]:
                    drop = value[s] - before
                if s < last:
                    drop = max(drop, value[s] - after)
                if value[s] + RISE_BETWEEN * drop <= best:
                    continue
                step = math.pi / (last - first[i])
                low = step * max(s - first[i] - 1, 0)
                high = step * min(s - first[i] + 1, last - first[i])
                refined = _refine(m, x, z, interval[i], low, high, patterns[p], q)
                if refined > best * (1.0 + SAME_AREA):
                    best = refined
                    posture[p] = q
        area[p] = best
    return True


def largest_polytopes(
    machine: Machine,
    x: float,
    z: float,
    patterns: ModeArray,
    posture: FloatArray,
    area: FloatArray,
) -> bool:
    """`largest_polytopes_3r` or, where more joints move or some slide, that of any chain."""
    solve = largest_polytopes_3r if machine.is_3r else largest_polytopes_of_chain
    return bool(solve(machine.arrays, x, z, patterns, posture, area))


def search_globally(
    machine: Machine, position: FloatArray, posture: FloatArray, area: FloatArray
) -> None:
    """The `NodeSolver` of this module."""
    for i, (x, z) in enumerate(position.tolist()):
        largest_polytopes(machine, x, z, machine.patterns, posture[i], area[i])


@dataclass(frozen=True, eq=False)
class PointPostures:
    """Postures of largest polytope at one tip position: what the table holds for a node.

    posture  float64[patterns, n], rad
    area     float64[patterns], m²/s²
    """

    posture: FloatArray
    area: FloatArray


def postures_at(
    machine: Machine, x: float, z: float, deadline: Deadline = NEVER
) -> PointPostures:
    """Postures of largest polytope at any point (x, z) m, on the grid or off it.

    Raises InfeasibleGoalError where no posture is within limits, DeadlineError.
    """
    patterns = machine.patterns
    posture, area = np.empty(patterns.shape), np.empty(len(patterns))
    at_once = len(patterns) if deadline == NEVER else PATTERNS_AT_ONCE
    for first in range(0, len(patterns), at_once):
        deadline.check("the search for the goal's postures")
        part = slice(first, first + at_once)
        if not largest_polytopes(
            machine, x, z, patterns[part], posture[part], area[part]
        ):
            raise InfeasibleGoalError(x, z)
    return PointPostures(frozen(posture), frozen(area))


def build_posture_table(
    machine: Machine,
    spacing: float | None = None,
    jobs: Jobs = None,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
    solver: NodeSolver = search_globally,
) -> PostureTable:
    """Posture table of a machine, in its plane, on a grid with the given spacing [m], or its own.

    jobs: threads, or a cluster; the result does not depend on them. progress(done, total) is told
    the nodes, cancelled() is asked between tasks.
    Raises RequestError for a useless spacing, PlanningCancelledError, ClusterError, and
    EmptyTableError where no node has a posture.
    """
    machine, spacing = machine.plane, machine.spacing if spacing is None else spacing
    nodes = grid_nodes(machine, spacing)
    position = nodes.astype(np.float64) * spacing
    posture = np.empty((len(nodes), *machine.patterns.shape))
    area = np.empty((len(nodes), len(machine.patterns)))
    work = partial(_solved, solver, machine, position)
    done = 0
    with closing(over_ranges(work, len(nodes), NODES_PER_TASK, jobs)) as parts:
        for posture_part, area_part in parts:
            part = slice(done, done + len(area_part))
            posture[part], area[part] = posture_part, area_part
            done = part.stop
            if progress is not None:
                progress(done, len(nodes))
            if cancelled is not None and cancelled():
                raise PlanningCancelledError("building the posture table")
    table = PostureTable(
        machine_name=machine.name,
        machine_hash=machine.hash,
        spacing=spacing,
        nodes=nodes,
        patterns=machine.patterns,
        posture=posture,
        area=area,
    )
    if not table.feasible.any():
        raise EmptyTableError(machine.name, len(nodes))
    return table


def _solved(
    solver: NodeSolver, machine: Machine, position: FloatArray, begin: int, end: int
) -> tuple[FloatArray, FloatArray]:
    """What the solver finds for some of the positions."""
    posture = np.empty((end - begin, *machine.patterns.shape))
    area = np.empty((end - begin, len(machine.patterns)))
    solver(machine, position[begin:end], posture, area)
    return posture, area


def warm_up(machine: Machine) -> None:
    """Compile the kernels of this module."""
    n, none = machine.joint_count, machine.patterns[:0]
    largest_polytopes(machine, 0.0, 0.0, none, np.empty((0, n)), np.empty(0))
