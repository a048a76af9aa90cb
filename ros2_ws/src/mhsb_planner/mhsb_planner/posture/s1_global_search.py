"""Posture with the largest velocity polytope at a tip position, by global search (paper, step S1).

This module solves arms of three turning joints. `s1_chain_search` solves longer chains and chains
with sliding joints.

If the tip is held, the arm has one degree of freedom left on each of two elbow branches: the
end-link angle ψ. Most maxima lie at the ends of the feasible intervals of ψ, which are known in
closed form. Between the ends the area is sampled, and local maxima that could be the largest are
refined. Samples lie at ψ = middle − half·cos t for equally spaced t, so they are dense near the
ends. At the ends, the edge of the reach, joint angles vary as the square root of ψ.
"""

import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import MODE_COUNT
from mhsb_model.types import BoolArray, FloatArray, IntArray, ModeArray, frozen
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.errors import EmptyTableError, InfeasibleGoalError
from mhsb_planner.executor import Jobs, yield_results_of_ranges
from mhsb_planner.posture.grid import list_grid_nodes
from mhsb_planner.posture.s1_chain_search import find_largest_polytopes_of_chain
from mhsb_planner.posture.s1_polytope import (
    compute_area_from_limits,
    compute_cross_products,
    compute_flow_limits,
    compute_flow_scale,
    compute_tip_columns,
    get_shared_flow,
)
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.posture.s1_psi_intervals_3r import (
    MAX_INTERVALS,
    find_feasible_intervals,
    solve_posture_at_psi,
)

SAMPLES_PER_TURN = 720
"""Number of samples in one turn of the end-link angle ψ [1/turn].

The area has ridges at angles at which another flow limit becomes active. With four-bar linkages
some ridges are only 5 mrad wide."""

LEAST_SAMPLES = 8
"""Smallest number of steps between the samples of an interval."""
REFINED_TO = 1e-7
"""Width of the parameter t of ψ at which the search for a maximum ends [rad]."""

SAME_AREA = 1e-9
"""Largest relative gain in area at which two areas count as equal, so that the earlier posture is
kept [-].

The order is: interval ends before inner samples, elbow −1 before +1, smaller ψ before larger."""

RISE_BETWEEN = 2.0
"""Largest rise of the area between samples, as a factor on the drop to the lower neighbour [-].

A local maximum of the samples is refined only if the area plus this rise exceeds the largest area
so far. For a concave area the factor would be 1."""

NODES_PER_TASK = 8
"""Number of nodes that one task solves."""

PATTERNS_AT_ONCE = 4
"""Number of mode combinations that are solved between two checks of a deadline."""

Progress = Callable[[int, int], None]
"""Function that is called with the number of finished nodes and the number of all nodes."""
NodeSolver = Callable[[Machine, FloatArray, FloatArray, FloatArray], None]
"""Function that finds the postures of a posture table at given tip positions.

Its arguments are the machine, the tip positions, shape (nodes, 2) [m], and two arrays that it
writes: postures, shape (nodes, patterns, n), and polytope areas, shape (nodes, patterns). If no
posture is within limits, the entries of the node are NaN."""


@kernel
def _compute_psi(lower: float, upper: float, t: float) -> float:
    """Return the end-link angle ψ that belongs to a parameter t in an interval of ψ.

        ψ = (lower + upper)/2 − (upper − lower)/2 · cos t

    At t = 0 and t = π the result is exactly `lower` and `upper`.

    Args:
        lower: Lower end of the interval [rad].
        upper: Upper end of the interval [rad].
        t: Parameter from 0 (lower end) to π (upper end). Values beyond are clipped.

    Returns:
        ψ [rad].
    """
    if t <= 0.0:
        return lower
    if t >= math.pi:
        return upper
    return 0.5 * (lower + upper) - 0.5 * (upper - lower) * math.cos(t)


@kernel
def _compute_area_inputs(
    m: MachineArrays,
    tip: tuple[float, float],
    psi: float,
    elbow: int,
    q: FloatArray,
    cross: FloatArray,
    limit: FloatArray,
) -> bool:
    """Compute a posture, and two arrays that give the area of its velocity polytope.

    Args:
        m: Arrays of the machine.
        tip: Tip position (x, z) [m].
        psi: End-link angle [rad].
        elbow: Elbow branch (sign of the second-last joint's angle), −1 or 1.
        q: Posture, written in place, shape (3,) [rad].
        cross: Scalar cross products C_i × C_j, written in place, shape (3, 3) [-]. The plane vector
            C_j is the tip velocity per speed of piston j.
        limit: Largest inlet flows by joint, mode and direction (0 extends, 1 retracts), written in
            place, shape (3, modes, 2) [m³/s].

    Returns:
        True if the posture exists and is within limits. Otherwise `q` is not valid, and `cross` and
        `limit` are unchanged.
    """
    if not solve_posture_at_psi(m, tip[0], tip[1], psi, elbow, q):
        return False
    compute_flow_limits(m, q, limit)
    compute_cross_products(compute_tip_columns(m, q), cross)
    return True


@kernel(inline="always")
def _maximise_in_interval(
    m: MachineArrays,
    tip: tuple[float, float],
    interval: FloatArray,
    low: float,
    high: float,
    pattern: ModeArray,
    q: FloatArray,
) -> float:
    """Maximise the velocity polytope's area over part of an interval of the end-link angle ψ.

    The method is a golden-section search over a parameter t, which is 0 at the lower end of the
    interval and π at its upper end.

    Args:
        m: Arrays of the machine.
        tip: Tip position (x, z) [m].
        interval: Elbow branch (−1 or 1), lower and upper end of ψ [rad], shape (3,).
        low: Parameter t at the lower end of the part [rad].
        high: Parameter t at the upper end of the part [rad].
        pattern: Mode combination (one mode for each actuator), shape (3,).
        q: Posture of the maximum, written in place, shape (3,) [rad].

    Returns:
        Largest area found [m²/s²]; −1 if the search ends at postures beyond joint limits.
    """
    n = len(q)
    cross = np.empty((n, n))
    limit = np.empty((n, MODE_COUNT, 2))
    scale = compute_flow_scale(m)
    flow = get_shared_flow(m)
    elbow = int(interval[0])
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    area = np.empty(2)
    t = np.array([high - ratio * (high - low), low + ratio * (high - low)])
    pending = 2
    while True:
        for side in range(2):
            if pending == side or pending == 2:
                psi = _compute_psi(interval[1], interval[2], t[side])
                area[side] = -1.0
                if _compute_area_inputs(m, tip, psi, elbow, q, cross, limit):
                    area[side] = compute_area_from_limits(cross, scale, limit, pattern, flow)
        if high - low < REFINED_TO:
            break
        if area[0] >= area[1]:
            high, t[1], area[1], pending = t[1], t[0], area[0], 0
            t[0] = high - ratio * (high - low)
        else:
            low, t[0], area[0], pending = t[0], t[1], area[1], 1
            t[1] = low + ratio * (high - low)
    best = 0 if area[0] >= area[1] else 1
    psi = _compute_psi(interval[1], interval[2], t[best])
    solve_posture_at_psi(m, tip[0], tip[1], psi, elbow, q)
    return area[best]


class _PsiSamples(NamedTuple):
    """Samples of the end-link angle ψ in the feasible intervals at a tip position.

    Attributes:
        interval: Elbow branch (∓1), lower and upper end of ψ [rad] of each interval, shape
            (intervals, 3).
        first: Index of the first sample of each interval, and last the number of samples, shape
            (intervals + 1,).
        posture: Posture of each sample, shape (samples, 3) [rad].
        valid: True if the posture exists and is within limits, shape (samples,).
        cross: Cross products C_i × C_j of the tip velocities per piston speed, shape (samples, 3,
            3) [-].
        limit: Largest inlet flows by joint, mode and direction, shape (samples, 3, modes, 2)
            [m³/s].
    """

    interval: FloatArray
    first: IntArray
    posture: FloatArray
    valid: BoolArray
    cross: FloatArray
    limit: FloatArray


@kernel(inline="always")
def _sample_psi(m: MachineArrays, tip: tuple[float, float]) -> _PsiSamples:
    """Sample the end-link angle ψ in all its feasible intervals at a tip position.

    The arm must have three turning joints.

    Args:
        m: Arrays of the machine.
        tip: Tip position (x, z) [m].

    Returns:
        The intervals, and the samples of all intervals in order. Each sample has its posture, its
        validity, and the values from which the area of its velocity polytope is computed. Samples
        are at most 1 / SAMPLES_PER_TURN turns apart, denser near the ends of an interval, and
        include both ends. An interval has at least LEAST_SAMPLES + 1 samples. There are no samples
        if no posture is within joint limits.
    """
    interval = np.empty((MAX_INTERVALS, 3))
    intervals = find_feasible_intervals(m, tip[0], tip[1], interval)
    first = np.empty(intervals + 1, dtype=np.int64)
    first[0] = 0
    for i in range(intervals):
        turns = (interval[i, 2] - interval[i, 1]) / (2.0 * math.pi)
        between = math.ceil(turns * SAMPLES_PER_TURN * 0.5 * math.pi)  # widest step at the middle
        first[i + 1] = first[i] + max(LEAST_SAMPLES, between) + 1
    samples, q = first[intervals], np.empty(3)
    posture, valid = np.empty((samples, 3)), np.empty(samples, dtype=np.bool_)
    cross, limit = np.empty((samples, 3, 3)), np.empty((samples, 3, MODE_COUNT, 2))
    for i in range(intervals):
        steps = first[i + 1] - first[i] - 1
        for s in range(first[i], first[i + 1]):
            t = math.pi * ((s - first[i]) / steps)
            psi = _compute_psi(interval[i, 1], interval[i, 2], t)
            elbow = int(interval[i, 0])
            valid[s] = _compute_area_inputs(m, tip, psi, elbow, q, cross[s], limit[s])
            copy_row(posture[s], q)
    return _PsiSamples(interval[:intervals], first, posture, valid, cross, limit)


@kernel(borrows=True)
def _find_largest_sample(samples: _PsiSamples, value: FloatArray, q: FloatArray) -> float:
    """Find the sample with the largest velocity-polytope area.

    The ends of all intervals are compared first, then all samples. A later sample is taken only if
    its area is larger by more than the share SAME_AREA.

    Args:
        samples: Samples of the end-link angle ψ at one tip position.
        value: Area of each sample, shape (samples,) [m²/s²]; −1 if the sample is beyond joint
            limits.
        q: Posture of the sample found, written in place, shape (3,) [rad]; unchanged if all values
            are −1.

    Returns:
        Area of the sample found [m²/s²]; −1 if all values are −1.
    """
    best, first = -1.0, samples.first
    for i in range(len(first) - 1):
        for s in (first[i], first[i + 1] - 1):
            if value[s] > best * (1.0 + SAME_AREA):
                best = value[s]
                copy_row(q, samples.posture[s])
    for s in range(len(value)):
        if value[s] > best * (1.0 + SAME_AREA):
            best = value[s]
            copy_row(q, samples.posture[s])
    return best


@kernel(borrows=True)
def _compute_drop(value: FloatArray, s: int, first: int, last: int) -> float:
    """Compute the drop of the area from a local maximum of the samples to its lower neighbour.

    Among adjacent samples of equal area, only the last can be a local maximum.

    Args:
        value: Area of each sample, shape (samples,) [m²/s²]; −1 if the sample is beyond joint
            limits.
        s: Index of the sample.
        first: Index of the first sample of its interval.
        last: Index of the last sample of its interval.

    Returns:
        Difference to the lower of the two neighbours in the interval [m²/s²]. −inf if the sample is
        not a local maximum, or is beyond joint limits.
    """
    before = value[s - 1] if s > first else -math.inf
    after = value[s + 1] if s < last else -math.inf
    if value[s] < 0.0 or value[s] < before or value[s] <= after:
        return -math.inf
    drop = 0.0
    if s > first:
        drop = value[s] - before
    if s < last:
        drop = max(drop, value[s] - after)
    return drop


@kernel
def find_largest_polytopes_3r(
    m: MachineArrays,
    x: float,
    z: float,
    patterns: ModeArray,
    posture: FloatArray,
    area: FloatArray,
) -> bool:
    """Find for each mode combination the posture with the largest velocity polytope.

    The polytope contains all velocities of the tip that the pistons' limits allow. The arm has
    three turning joints, so its posture has one free coordinate, the end-link angle ψ. Samples of ψ
    are compared, and local maxima that could be the largest are refined.

    Tested against a dense scan of ψ on both elbow branches.

    Args:
        m: Arrays of the machine.
        x: Tip position forward [m].
        z: Tip position upward [m].
        patterns: Mode combinations (one mode for each actuator), shape (patterns, 3).
        posture: Posture for each mode combination, written in place, shape (patterns, 3) [rad].
        area: Area of the velocity polytope of each posture, written in place, shape (patterns,)
            [m²/s²].

    Returns:
        False if no posture is within joint limits; `posture` and `area` then stay as they are.
    """
    samples = _sample_psi(m, (x, z))
    if len(samples.valid) == 0:
        return False
    scale, flow, first = compute_flow_scale(m), get_shared_flow(m), samples.first
    q, value = np.empty(3), np.empty(len(samples.valid))
    for p in range(len(patterns)):
        for s in range(len(value)):
            value[s] = -1.0
            if samples.valid[s]:
                value[s] = compute_area_from_limits(
                    samples.cross[s], scale, samples.limit[s], patterns[p], flow
                )
        best = _find_largest_sample(samples, value, posture[p])
        for i in range(len(first) - 1):
            last = first[i + 1] - 1
            step = math.pi / (last - first[i])
            for s in range(first[i], last + 1):
                if value[s] + RISE_BETWEEN * _compute_drop(value, s, first[i], last) <= best:
                    continue
                low = step * max(s - first[i] - 1, 0)
                high = step * min(s - first[i] + 1, last - first[i])
                refined = _maximise_in_interval(
                    m, (x, z), samples.interval[i], low, high, patterns[p], q
                )
                if refined > best * (1.0 + SAME_AREA):
                    best = refined
                    copy_row(posture[p], q)
        area[p] = best
    return True


def find_largest_polytopes(
    machine: Machine,
    x: float,
    z: float,
    patterns: ModeArray,
    posture: FloatArray,
    area: FloatArray,
) -> bool:
    """Find for each mode combination the posture with the largest velocity polytope.

    The polytope contains all velocities of the tip that the pistons' limits allow. Arms of three
    turning joints have their own solver. The solver for all other arms may miss the largest area.

    Args:
        machine: The arm without a slewing joint.
        x: Tip position forward [m].
        z: Tip position upward [m].
        patterns: Mode combinations (one mode for each actuator), shape (patterns, n).
        posture: Posture for each mode combination, written in place, shape (patterns, n) [rad or
            m].
        area: Area of the velocity polytope of each posture, written in place, shape (patterns,)
            [m²/s²].

    Returns:
        False if no posture is within joint limits; `posture` and `area` are then NaN.
    """
    posture[:] = area[:] = np.nan
    solve = find_largest_polytopes_3r if machine.is_3r else find_largest_polytopes_of_chain
    return bool(solve(machine.arrays, x, z, patterns, posture, area))


def search_globally(
    machine: Machine, position: FloatArray, posture: FloatArray, area: FloatArray
) -> None:
    """Find the postures with the largest velocity polytope at many tip positions.

    This is the default `NodeSolver` of posture tables.

    Args:
        machine: The arm without a slewing joint.
        position: Tip positions, shape (nodes, 2) [m].
        posture: Posture for each position and mode combination, written in place, shape (nodes,
            patterns, n) [rad or m]; NaN if no posture is within joint limits.
        area: Area of the velocity polytope, written in place, shape (nodes, patterns) [m²/s²]; NaN
            if no posture is within joint limits.
    """
    for i, (x, z) in enumerate(position.tolist()):
        find_largest_polytopes(machine, x, z, machine.patterns, posture[i], area[i])


@dataclass(frozen=True, eq=False)
class PointPostures:
    """Postures with the largest velocity polytope at one tip position, like one row of a table.

    Attributes:
        posture: Posture for each mode combination, shape (patterns, n) [rad or m].
        area: Area of the velocity polytope, shape (patterns,) [m²/s²].
    """

    posture: FloatArray
    area: FloatArray


def find_postures_at(
    machine: Machine, x: float, z: float, deadline: Deadline = NO_DEADLINE
) -> PointPostures:
    """Find the postures with the largest velocity polytope at a tip position.

    The position need not be a node of the grid.

    Args:
        machine: The arm without a slewing joint.
        x: Tip position forward [m].
        z: Tip position upward [m].
        deadline: Instant after which the search is given up.

    Returns:
        Posture [rad or m] and polytope area [m²/s²] for each mode combination of the machine, in
        the order of `machine.patterns`.

    Raises:
        InfeasibleGoalError: No posture within joint limits reaches the position.
        DeadlineError: The deadline passed before all combinations were solved.
    """
    patterns = machine.patterns
    posture, area = np.empty(patterns.shape), np.empty(len(patterns))
    at_once = len(patterns) if deadline == NO_DEADLINE else PATTERNS_AT_ONCE
    for first in range(0, len(patterns), at_once):
        deadline.check("the search for the goal's postures")
        part = slice(first, first + at_once)
        if not find_largest_polytopes(machine, x, z, patterns[part], posture[part], area[part]):
            raise InfeasibleGoalError(x, z)
    return PointPostures(frozen(posture), frozen(area))


def build_posture_table(
    machine: Machine,
    spacing: float | None = None,
    jobs: Jobs = None,
    progress: Progress | None = None,
    solver: NodeSolver = search_globally,
) -> PostureTable:
    """Build the posture table of a machine.

    The table has the posture with the largest velocity polytope for each workspace node and mode
    combination. Nodes are solved in threads or on a cluster. The result does not depend on the kind
    or number of workers.

    Args:
        machine: The machine. The table belongs to the arm without a slewing joint.
        spacing: Grid spacing [m]; None means the machine's own.
        jobs: Number of threads, or a cluster; None means one thread for each processor.
        progress: Called after each task with the number of finished nodes and the number of all
            nodes. None means no calls.
        solver: Function that finds the postures.

    Returns:
        The table; entries of nodes without a posture within limits are NaN.

    Raises:
        RequestError: The spacing or the number of jobs is out of range.
        ClusterError: The cluster cannot be used.
        EmptyTableError: No node has a posture within limits.
    """
    machine, spacing = machine.planar_arm, machine.spacing if spacing is None else spacing
    nodes = list_grid_nodes(machine, spacing)
    position = nodes.astype(np.float64) * spacing
    posture = np.empty((len(nodes), *machine.patterns.shape))
    area = np.empty((len(nodes), len(machine.patterns)))
    work = partial(_solve_nodes, solver, machine, position)
    done = 0
    with closing(yield_results_of_ranges(work, len(nodes), NODES_PER_TASK, jobs)) as parts:
        for posture_part, area_part in parts:
            part = slice(done, done + len(area_part))
            posture[part], area[part] = posture_part, area_part
            done = part.stop
            if progress is not None:
                progress(done, len(nodes))
    table = PostureTable(
        machine_name=machine.name,
        machine_hash=machine.table_hash,
        spacing=spacing,
        nodes=nodes,
        patterns=machine.patterns,
        posture=posture,
        area=area,
    )
    if not table.feasible.any():
        raise EmptyTableError(machine.name, len(nodes))
    return table


def _solve_nodes(
    solver: NodeSolver, machine: Machine, position: FloatArray, begin: int, end: int
) -> tuple[FloatArray, FloatArray]:
    """Find the postures with the largest velocity polytope at a range of nodes.

    One worker executes this function as a task.

    Args:
        solver: Function that finds the postures.
        machine: The arm without a slewing joint.
        position: Tip positions of all nodes, shape (nodes, 2) [m].
        begin: Index of the first node to solve.
        end: Index after the last node to solve.

    Returns:
        Postures, shape (end - begin, patterns, n) [rad or m], and areas, shape (end - begin,
        patterns) [m²/s²].
    """
    posture = np.empty((end - begin, *machine.patterns.shape))
    area = np.empty((end - begin, len(machine.patterns)))
    solver(machine, position[begin:end], posture, area)
    return posture, area


def warm_up(machine: Machine) -> None:
    """Compile the kernels that find postures with the largest velocity polytope.

    The kernels are called without mode combinations, so that the call is quick.

    Args:
        machine: Machine whose chain of joints decides which kernels are compiled.
    """
    n, none = machine.joint_count, machine.patterns[:0]
    find_largest_polytopes(machine, 0.0, 0.0, none, np.empty((0, n)), np.empty(0))
