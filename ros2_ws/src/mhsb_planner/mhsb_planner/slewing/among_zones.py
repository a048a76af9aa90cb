"""When the plane turns along a path in it, so that the arm keeps clear of zones in space.

The path is cut into stretches and the slew's way into even parts; a state is a corner between two
stretches and how far the slew is. From it the plane's joints go on by a stretch, the slew turning
by some parts in the same time or resting, or the slew turns by one part while they rest. Every step
that is taken is clear (`move_is_clear`, in all steps of the path that the stretch consists of), and
none leads back: the least time to each state follows from those before. Between the ends of a
stretch the slew's way grows with the path's time, and each of its steps lasts as long as

    max(tᵢ, sᵢ/V_max, (Vᵢ + A sᵢ)/Q)

with the symbols of `sharing_out`. The oil that all this takes is the same whenever the slew turns,
so that the shortest is the cheapest, too.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import move_is_clear
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.slewing.sharing_out import path_oil, slew_way
from mhsb_planner.slewing.turned_path import RESTS, Turning, turning_evenly

STRETCHES = 24
"""Into so many a path is cut, at most."""

PART, MOST_PARTS = 0.06, 32
"""The slew's way is cut into parts of so many rad, but at most into so many."""

AT_ONCE = 5
"""Parts that the slew may turn by while the path goes on by one stretch."""


def turning_among_zones(
    machine: Machine, path: DiscretePath, began: float, ended: float
) -> Turning | None:
    """A turning from one angle to the other [rad] that keeps clear; None: there is none.

    path  in the plane

    The even one where that is clear, else the quickest over the states above.
    """
    rows = _rows_in_space(machine)
    even = turning_evenly(machine, path, began, ended)
    posture = np.column_stack([even.angle, path.posture[even.places]])
    if way_is_clear(machine.arrays, rows, posture):
        return even
    return quickest_turning(machine, path, began, ended)


def quickest_turning(
    machine: Machine, path: DiscretePath, began: float, ended: float
) -> Turning | None:
    """The turning of least time over the states above, as `turning_among_zones`."""
    m, rows = machine.arrays, _rows_in_space(machine)
    parts = min(MOST_PARTS, math.ceil(abs(ended - began) / PART - 1e-9))
    way = slew_way(machine, began, ended) / max(1, parts)
    evenly = np.linspace(0, path.steps, min(STRETCHES, path.steps) + 1)
    corner = np.unique(evenly.round().astype(np.int64))
    posture = np.column_stack([np.zeros(path.steps + 1), path.posture])
    oil = path_oil(machine.plane, path.posture)
    angle = np.linspace(began, ended, parts + 1)
    flow = m.main_pump_flow - machine.joint_count * m.leakage_flow
    slew = np.array([way, m.max_piston_speed[0], flow, m.cap_area[0]])
    least, came = least_times(m, rows, posture, path.duration, oil, corner, angle, slew)
    if least[-1, -1] == math.inf:
        return None
    return _followed_back(came, corner, angle, path.duration, oil, slew)


def _rows_in_space(machine: Machine) -> FloatArray:
    """Of the obstacles, those of zones in space, with the margin of paths."""
    obstacles = machine.obstacles
    return frozen(obstacles.path_rows[obstacles.in_space])


def warm_up(machine: Machine) -> None:
    """Compile the kernels of this module, whether the machine slews or not."""
    plane = machine.plane
    posture = np.tile(0.5 * (plane.arrays.joint_min + plane.arrays.joint_max), (2, 1))
    modes, nothing = np.zeros((1, plane.joint_count), dtype=np.uint8), np.zeros(1)
    path = DiscretePath(
        tip=plane.tip_positions(posture),
        posture=posture,
        modes=modes,
        duration=nothing,
        energy=nothing,
        energy_series=nothing,
        cost=0.0,
        start_modes=modes[0],
        lower_bound=0.0,
        statistics=SearchStatistics(0, 0, 0.0),
    )
    for turning in (turning_among_zones, quickest_turning):
        turning(machine.without_obstacles(), path, 0.0, 0.0)


@kernel
def way_is_clear(m: MachineArrays, rows: FloatArray, posture: FloatArray) -> bool:
    """Whether all moves from each of the postures float64[k + 1, n] to the next are clear."""
    for i in range(len(posture) - 1):
        if not move_is_clear(m, rows, posture[i], posture[i + 1], False):
            return False
    return True


@kernel
def _step_time(duration: float, oil: float, way: float, slew: FloatArray) -> float:
    """How long a step of the path lasts in which the slew's piston goes so far [m]; [s]."""
    _, fastest, flow, area = slew
    return max(duration, max(way / fastest, (oil + area * way) / flow))


@kernel
def _share(duration: FloatArray, first: int, last: int, s: int) -> float:
    """Of a stretch's time, that of its step s; an equal one where it takes none."""
    whole = duration[first:last].sum()
    return duration[s] / whole if whole > 0.0 else 1.0 / (last - first)


@kernel
def _is_clear(
    m: MachineArrays,
    rows: FloatArray,
    posture: FloatArray,
    duration: FloatArray,
    first: int,
    last: int,
    begin: float,
    end: float,
) -> bool:
    """Whether a stretch keeps clear while the slew turns from `begin` to `end` [rad]."""
    here, there = posture[first].copy(), posture[first].copy()
    here[0] = begin
    for s in range(first, last):
        there[:] = posture[s + 1]
        there[0] = here[0] + _share(duration, first, last, s) * (end - begin)
        if not move_is_clear(m, rows, here, there, False):
            return False
        here[:] = there
    return True


@kernel
def least_times(
    m: MachineArrays,
    rows: FloatArray,
    posture: FloatArray,
    duration: FloatArray,
    oil: FloatArray,
    corner: IntArray,
    angle: FloatArray,
    slew: FloatArray,
) -> tuple[FloatArray, IntArray]:
    """Least time to every state, float64[corners, parts + 1] s; inf where there is no way.

    And in how many parts the slew turned with the stretch before, int64 likewise; RESTS where the
    plane's joints rested.

    rows      of the zones in space
    posture   float64[k + 1, n], the slew's angle being free
    duration, oil  of the path's steps, float64[k] s, m³
    corner    int64[corners], numbers of postures
    angle     float64[parts + 1], of the slew [rad]
    slew      its piston's way within a part, V_max, the flow that it shares, its area

    Oracle: scipy.sparse.csgraph.dijkstra over the same states and steps.
    """
    corners, parts = len(corner), len(angle) - 1
    least = np.full((corners, parts + 1), math.inf)
    came = np.zeros((corners, parts + 1), dtype=np.int64)
    least[0, 0] = 0.0
    alone = _step_time(0.0, 0.0, slew[0], slew)
    begin = np.empty(posture.shape[1])
    end = np.empty(posture.shape[1])
    for i in range(corners):
        for k in range(parts + 1):
            if least[i, k] == math.inf:
                continue
            if k < parts and least[i, k] + alone < least[i, k + 1]:
                begin[:] = posture[corner[i]]
                end[:] = begin
                begin[0], end[0] = angle[k], angle[k + 1]
                if move_is_clear(m, rows, begin, end, False):
                    least[i, k + 1] = least[i, k] + alone
                    came[i, k + 1] = RESTS
            if i == corners - 1:
                continue
            first, last = corner[i], corner[i + 1]
            for more in range(min(AT_ONCE, parts - k) + 1):
                there = least[i, k]
                for s in range(first, last):
                    way = more * slew[0] * _share(duration, first, last, s)
                    there += _step_time(duration[s], oil[s], way, slew)
                if there >= least[i + 1, k + more]:
                    continue
                ends = angle[k], angle[k + more]
                if _is_clear(m, rows, posture, duration, first, last, ends[0], ends[1]):
                    least[i + 1, k + more] = there
                    came[i + 1, k + more] = more
    return least, came


def _followed_back(
    came: IntArray,
    corner: IntArray,
    angle: FloatArray,
    duration: FloatArray,
    oil: FloatArray,
    slew: FloatArray,
) -> Turning:
    """The turning that led to the last state; arguments as of `least_times`."""
    i, k = len(corner) - 1, len(angle) - 1
    steps: list[tuple[int, float, float]] = []  # of the path, angle at its end, how long it lasts
    while (i, k) != (0, 0):
        turned_by = came[i, k]
        if turned_by == RESTS:
            steps.append((RESTS, angle[k], _step_time(0.0, 0.0, slew[0], slew)))
            k -= 1
            continue
        first, last = corner[i - 1], corner[i]
        i, k, end = i - 1, k - turned_by, angle[k]
        for s in range(last - 1, first - 1, -1):
            share = _share(duration, first, last, s)
            way = turned_by * slew[0] * share
            steps.append((s, end, _step_time(duration[s], oil[s], way, slew)))
            end -= share * (angle[k + turned_by] - angle[k])
    step, ends, lasting = (np.array(each) for each in zip(*reversed(steps), strict=True))
    return Turning(step, np.append(angle[0], ends), lasting)
