"""Slew motion along a path in the arm's plane such that the arm keeps clear of zones in space.

The path is cut into stretches, and the slew's stroke into equal parts. A state of the search is the
number of stretches followed and the number of parts turned. There are two kinds of steps:

- The joints in the plane follow one stretch while the slew turns by several parts, or rests.
- The slew turns by one part while the joints in the plane rest.

A step is allowed if `move_is_clear` accepts every path step in it. No step leads back, so dynamic
programming gives the least time to each state. Within a stretch the slew's stroke grows in
proportion to the path's time. Path step i takes the time

    max(tᵢ, sᵢ/V_max, (Vᵢ + A sᵢ)/Q)

tᵢ [s] is the step's duration and Vᵢ [m³] its oil volume without the slew. sᵢ [m] is the stroke of
the slew's piston in the step, V_max its largest speed and A its area. Q is the flow of the main
pump minus leakage. The slew takes the same oil at any time, so the quickest motion is also the
cheapest.
"""

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import move_is_clear
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.motion.s3_trajectory import create_example_path
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.slewing.slew_distribution import compute_path_oil, compute_slew_stroke
from mhsb_planner.slewing.turned_path import REST_STEP, SlewMotion, compute_even_turning

MAX_STRETCHES = 24
"""Largest number of stretches into which a path is cut."""

SLEW_PART_ANGLE, MAX_SLEW_PARTS = 0.06, 32
"""Largest slew angle of one part of the stroke [rad], and largest number of parts.

A slew too large for both limits is cut into the largest number of parts, each with a larger angle.
"""

MAX_PARTS_PER_STEP = 5
"""Largest number of parts that the slew turns during one stretch of the path."""


class PathStretches(NamedTuple):
    """Path of k steps in the arm's plane, cut into stretches of one or more steps.

    Attributes:
        posture: Postures of the path, float64[k + 1, n], [rad or m]. Column 0, the slew, is
            ignored.
        duration: Duration of each path step without the slew, float64[k], [s].
        oil: Oil volume of each path step without the slew, float64[k], [m³].
        corner: Indices of the postures at which stretches begin and end, int64[stretches + 1], in
            ascending order from 0 to k.
    """

    posture: FloatArray
    duration: FloatArray
    oil: FloatArray
    corner: IntArray


class SlewStroke(NamedTuple):
    """Stroke of the slew's piston in one part, and the limits of its speed.

    Attributes:
        part: Stroke of one part [m]; the whole stroke is cut into equal parts.
        max_speed: Largest speed V_max of the piston [m/s].
        flow: Flow Q of the main pump that the slew and the other joints share [m³/s].
        area: Area A of the piston [m²].
    """

    part: float
    max_speed: float
    flow: float
    area: float


def find_clear_turning(
    machine: Machine, path: DiscretePath, start_angle: float, end_angle: float
) -> SlewMotion | None:
    """Find a slew motion along a planar path on which the arm keeps clear of zones in space.

    First a slew at an even speed is tried (`compute_even_turning`). If the arm would come too near
    to a zone, `find_quickest_turning` searches the quickest clear slew motion.

    Args:
        machine: Whole arm, which slews.
        path: Path in the arm's plane, which turns with the slew.
        start_angle: Slew angle at the start of the path [rad].
        end_angle: Slew angle at its end [rad].

    Returns:
        Slew motion: path step, slew angle [rad] and duration [s] of each step of the whole arm.
        None if no clear slew motion is found.
    """
    rows = _list_rows_in_space(machine)
    even = compute_even_turning(machine, path, start_angle, end_angle)
    posture = np.column_stack([even.angle, path.posture[even.path_index]])
    if is_way_clear(machine.arrays, rows, posture):
        return even
    return find_quickest_turning(machine, path, start_angle, end_angle)


def find_quickest_turning(
    machine: Machine, path: DiscretePath, start_angle: float, end_angle: float
) -> SlewMotion | None:
    """Find the quickest slew motion along a planar path on which the arm keeps clear of zones.

    The path is cut into stretches and the slew's stroke into equal parts. In each step the slew
    turns alone by one part, or the arm follows one stretch while the slew turns by 0 or more parts.
    Dynamic programming finds the quickest motion of this kind.

    Args:
        machine: Whole arm, which slews.
        path: Path in the arm's plane, which turns with the slew.
        start_angle: Slew angle at the start of the path [rad].
        end_angle: Slew angle at its end [rad].

    Returns:
        Slew motion: path step, slew angle [rad] and duration [s] of each step of the whole arm.
        None if there is no clear slew motion of this kind.
    """
    m, rows = machine.arrays, _list_rows_in_space(machine)
    parts = min(MAX_SLEW_PARTS, math.ceil(abs(end_angle - start_angle) / SLEW_PART_ANGLE - 1e-9))
    way = compute_slew_stroke(machine, start_angle, end_angle) / max(1, parts)
    evenly = np.linspace(0, path.steps, min(MAX_STRETCHES, path.steps) + 1)
    corner = np.unique(evenly.round().astype(np.int64))
    posture = np.column_stack([np.zeros(path.steps + 1), path.posture])
    oil = compute_path_oil(machine.planar_arm, path.posture)
    angle = np.linspace(start_angle, end_angle, parts + 1)
    flow = m.main_pump_flow - machine.joint_count * m.leakage_flow
    slew = SlewStroke(way, float(m.max_piston_speed[0]), flow, float(m.cap_area[0]))
    stretches = PathStretches(posture, path.duration, oil, corner)
    least, came = compute_least_times(m, rows, stretches, angle, slew)
    if least[-1, -1] == math.inf:
        return None
    return _reconstruct_turning(came, stretches, angle, slew)


def _list_rows_in_space(machine: Machine) -> FloatArray:
    """Return the zones in space, each enlarged by the margin of discrete paths.

    Args:
        machine: Whole arm, which slews.

    Returns:
        One row of numbers for each zone, with its kind and shape, float64[rows, ROW_WIDTH]. Zones
        that turn with the arm's plane are left out.
    """
    obstacles = machine.obstacles
    return frozen(obstacles.path_rows[obstacles.is_in_space])


def warm_up(machine: Machine) -> None:
    """Compile the kernels that find slew motions among zones.

    The kernels are called with a path of one step without motion.

    Args:
        machine: Any machine.
    """
    path = create_example_path(machine.planar_arm)
    for turning in (find_clear_turning, find_quickest_turning):
        turning(machine.without_obstacles(), path, 0.0, 0.0)


@kernel
def is_way_clear(m: MachineArrays, rows: FloatArray, posture: FloatArray) -> bool:
    """Return whether the moves between successive postures keep clear of obstacles.

    A move that begins in an obstacle counts as clear if it gets no deeper. A move counts as not
    clear if the check cannot prove that it is.

    Args:
        m: Arrays of the whole arm, with the slew as joint 1.
        rows: Obstacles, one row each with kind and shape, float64[rows, ROW_WIDTH].
        posture: Postures in order, float64[k + 1, n], the slew first [rad or m]. The arm moves
            along a straight line in joint space from one posture to the next.

    Returns:
        True if all k moves are clear, or if k is 0.
    """
    for i in range(len(posture) - 1):
        if not move_is_clear(m, rows, posture[i], posture[i + 1], False):
            return False
    return True


@kernel
def _compute_step_time(duration: float, oil: float, stroke: float, slew: SlewStroke) -> float:
    """Compute the duration of a path step during which the slew also moves.

    Args:
        duration: Duration of the step without the slew [s].
        oil: Oil volume that the step takes without the slew [m³].
        stroke: Stroke of the slew's piston in this step [m].
        slew: Limits of the slew; the field `part` is ignored.

    Returns:
        max(duration, stroke/V_max, (oil + area · stroke)/flow) [s].
    """
    return max(duration, max(stroke / slew.max_speed, (oil + slew.area * stroke) / slew.flow))


@kernel
def _compute_time_share(duration: FloatArray, first: int, last: int, s: int) -> float:
    """Compute the share of one path step in the total duration of several path steps.

    Args:
        duration: Duration of each step of the path, float64[k], [s].
        first: Index of the first of the several steps.
        last: Index after the last of the several steps.
        s: Index of the one step.

    Returns:
        Share from 0 to 1 [-]. If the several steps take no time, each has an equal share.
    """
    whole = duration[first:last].sum()
    return duration[s] / whole if whole > 0.0 else 1.0 / (last - first)


@kernel
def _is_stretch_clear(
    m: MachineArrays,
    rows: FloatArray,
    path: PathStretches,
    i: int,
    begin: float,
    end: float,
) -> bool:
    """Return whether the arm keeps clear of obstacles in a stretch of a path while the slew turns.

    The slew angle changes in proportion to the time of the path steps.

    Args:
        m: Arrays of the whole arm, with the slew as joint 1.
        rows: Obstacles, one row each with kind and shape, float64[rows, ROW_WIDTH].
        path: The path, cut into stretches.
        i: Index of the stretch.
        begin: Slew angle at the start of the stretch [rad].
        end: Slew angle at the end of the stretch [rad].

    Returns:
        True if all moves of the stretch are clear.
    """
    posture, first, last = path.posture, path.corner[i], path.corner[i + 1]
    here, there = posture[first].copy(), posture[first].copy()
    here[0] = begin
    for s in range(first, last):
        copy_row(there, posture[s + 1])
        there[0] = here[0] + _compute_time_share(path.duration, first, last, s) * (end - begin)
        if not move_is_clear(m, rows, here, there, False):
            return False
        copy_row(here, there)
    return True


@kernel
def compute_least_times(
    m: MachineArrays,
    rows: FloatArray,
    path: PathStretches,
    angle: FloatArray,
    slew: SlewStroke,
) -> tuple[FloatArray, IntArray]:
    """Compute the least time to each state of path and slew by dynamic programming.

    In state (i, k), i stretches of the path have been followed and k parts of the slew's stroke
    turned. A step either turns the slew by one part, or follows one stretch while the slew turns by
    0 to MAX_PARTS_PER_STEP parts. Steps on which the arm touches an obstacle are not allowed.

    Tested against scipy.sparse.csgraph.dijkstra over the same states and steps.

    Args:
        m: Arrays of the whole arm, with the slew as joint 1.
        rows: Zones in space, one row each with kind and shape, float64[rows, ROW_WIDTH].
        path: The path, cut into stretches.
        angle: Slew angle at the ends of the parts of the stroke, float64[parts + 1], [rad]. Index
            k: k parts are done.
        slew: Stroke and limits of the slew.

    Returns:
        Two arrays of shape [stretches + 1, parts + 1]. First, the least time to each state, float64
        [s]; inf if the state cannot be reached. Second, the last step of the quickest motion to
        each state, int64: REST_STEP if the slew turned alone, otherwise the number of parts by
        which the slew turned while the arm followed a stretch.
    """
    posture, duration, oil, corner = path
    corners, parts = len(corner), len(angle) - 1
    least = np.full((corners, parts + 1), math.inf)
    came = np.zeros((corners, parts + 1), dtype=np.int64)
    least[0, 0] = 0.0
    alone = _compute_step_time(0.0, 0.0, slew.part, slew)
    begin = np.empty(posture.shape[1])
    end = np.empty(posture.shape[1])
    for i in range(corners):
        for k in range(parts + 1):
            if least[i, k] == math.inf:
                continue
            if k < parts and least[i, k] + alone < least[i, k + 1]:
                copy_row(begin, posture[corner[i]])
                copy_row(end, begin)
                begin[0], end[0] = angle[k], angle[k + 1]
                if move_is_clear(m, rows, begin, end, False):
                    least[i, k + 1] = least[i, k] + alone
                    came[i, k + 1] = REST_STEP
            if i == corners - 1:
                continue
            first, last = corner[i], corner[i + 1]
            for more in range(min(MAX_PARTS_PER_STEP, parts - k) + 1):
                there = least[i, k]
                for s in range(first, last):
                    way = more * slew.part * _compute_time_share(duration, first, last, s)
                    there += _compute_step_time(duration[s], oil[s], way, slew)
                if there >= least[i + 1, k + more]:
                    continue
                if _is_stretch_clear(m, rows, path, i, angle[k], angle[k + more]):
                    least[i + 1, k + more] = there
                    came[i + 1, k + more] = more
    return least, came


def _reconstruct_turning(
    last_steps: IntArray,
    path: PathStretches,
    angle: FloatArray,
    slew: SlewStroke,
) -> SlewMotion:
    """Reconstruct the quickest slew motion from the result of the dynamic programming.

    The steps are followed back from the last state, at the end of both path and stroke.

    Args:
        last_steps: Last step to each state (second result of `compute_least_times`).
        path: The path, cut into stretches.
        angle: Slew angle at the ends of the parts of the stroke, float64[parts + 1], [rad]. Index
            k: k parts are done.
        slew: Stroke and limits of the slew.

    Returns:
        Slew motion along the whole path, in p steps of the whole arm: path step, duration [s], and
        slew angle at the start and after each step, p + 1 values [rad]. The path step is REST_STEP
        if the slew turns alone.
    """
    _, duration, oil, corner = path
    i, k = len(corner) - 1, len(angle) - 1
    # Path step or REST_STEP, slew angle at its end [rad], duration [s]; the last step first.
    steps: list[tuple[int, float, float]] = []
    while (i, k) != (0, 0):
        turned_by = last_steps[i, k]
        if turned_by == REST_STEP:
            steps.append((REST_STEP, angle[k], _compute_step_time(0.0, 0.0, slew.part, slew)))
            k -= 1
            continue
        first, last = corner[i - 1], corner[i]
        i, k, end = i - 1, k - turned_by, angle[k]
        for s in range(last - 1, first - 1, -1):
            share = _compute_time_share(duration, first, last, s)
            way = turned_by * slew.part * share
            steps.append((s, end, _compute_step_time(duration[s], oil[s], way, slew)))
            end -= share * (angle[k + turned_by] - angle[k])
    step, ends, lasting = (np.array(each) for each in zip(*reversed(steps), strict=True))
    return SlewMotion(step, np.append(angle[0], ends), lasting)
