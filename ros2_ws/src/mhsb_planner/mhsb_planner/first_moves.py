"""Paths from a start in which the arm should not be: beyond joint limits, or in an obstacle.

Planners look for paths within the joint limits and clear of obstacles. From a start elsewhere a
first straight move leads to a posture nearby where they can begin; the planner's own paths go on
from there. A joint that is beyond its limits moves back towards them and never out again, and what
the arm is in is left no deeper than it is at the start. The trajectory is checked for both
(`motion.s3_limits.way_out`, `motion.s3_clearance`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import islice

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import clearances
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.errors import DeadlineError, StartError
from mhsb_planner.motion.s3_limits import JOINT_TOLERANCE, joint_excess
from mhsb_planner.planners.legs import PathSource, joined, paths_by_way
from mhsb_planner.planners.path_planner import Candidate, Task
from mhsb_planner.planners.resting import with_rests
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.goal_clearance import start_in
from mhsb_planner.search.s2_step import step_costs
from mhsb_planner.search.search_time import SearchTime
from mhsb_planner.slewing.turned_path import turned, turning_evenly

START_NOISE = 0.01
"""A start no further beyond a joint limit [rad, m] is taken as measurement noise on a valid one:
the planner looks for paths from it as if it were inside."""

NAMED_EXCESS = 1e-3
"""A start that far beyond a joint limit is part of what is said of a plan [rad, m]: more than the
noise of a joint's sensor."""

TRIED_POSTURES = 8
"""Postures of the table to which a first move is tried, at most; each takes about 1 ms."""

ARM_LOOKS = 16
"""Places at which the linkages are looked at between a start and the joint limits."""

CLIMB_STRIDE, CLIMB_HALVINGS = 0.08, 4
"""Longest step by which the arm climbs out of an obstacle [rad], and how often it is halved."""

CLIMB_STEPS = 60
"""Steps after which it is given up: a joint then has turned by 5 rad."""

SLOPE_STEP = 1e-4
"""Change of a joint by which the slope of the clearance is taken [rad]."""

DIRECT_SHARE = 0.5
"""Share of the time until the deadline in which the planner looks for paths from a start in an
obstacle by itself. It finds most of them; the rest of the time is for paths over a first move."""


def beyond_limits(machine: Machine, posture: FloatArray) -> str:
    """Return which joints are beyond their limits in a posture, as a clause; empty if none is.

    Args:
        machine: The arm.
        posture: float64[n], joint positions [rad or m].

    Returns:
        Name, value, excess and limit of each joint whose excess is above NAMED_EXCESS, as in
        "joint_1 at 2.494 rad, 0.02 rad beyond its upper limit of 2.474 rad".
    """
    a, words = machine.arrays, []
    for j, value in enumerate(posture.tolist()):
        unit, low, high = machine.joint_units[j], a.joint_min[j], a.joint_max[j]
        side, limit = ("upper", high) if value > high else ("lower", low)
        excess = max(value - high, low - value)
        if excess > NAMED_EXCESS:
            words.append(
                f"{machine.joint_names[j]} at {value:.4g} {unit}, {excess:.4g} {unit} beyond its "
                f"{side} limit of {limit:.4g} {unit}"
            )
    return " and ".join(words)


def start_remarks(machine: Machine, posture: FloatArray) -> str:
    """Return what is wrong with a start posture, as a clause: joint limits, obstacles; or empty."""
    beyond = beyond_limits(machine, posture)
    clauses = (f"the arm starts with {beyond}" if beyond else "", start_in(machine, posture))
    return "; ".join(filter(None, clauses))


def paths_from_anywhere(
    machine: Machine, source: PathSource, table: PostureTable, task: Task, time: SearchTime
) -> Iterator[Candidate]:
    """Yield paths from the task's departure to its goal, whatever the departure.

    From a departure within the limits and clear of obstacles these are the source's own paths.

    Args:
        machine: The whole arm.
        source: Finds paths of the whole arm from a departure where the arm may be.
        table: Posture table of the arm's plane.
        task: What is asked for.
        time: What the search may take; its `found` tells whether there is a motion.

    Raises:
        StartError: The departure is beyond joint limits, and there is no way back.
        MhsbError: What the source raises.
    """
    excess = float(joint_excess(machine.arrays, task.departure))
    if excess > START_NOISE:
        yield from _over_first_moves(machine, source, table, task, time)
        return
    if excess <= JOINT_TOLERANCE and not start_in(machine, task.departure):
        yield from paths_by_way(source, task, time)
        return
    refused = None
    own = _for_a_share(time)
    try:
        for candidate in paths_by_way(source, task, own):
            yield candidate
            own.reserve, own.found = time.reserve, time.found
            if time.found:
                own.deadline = time.deadline
    except MhsbError as error:
        refused = error
    if not time.found and not time.until.passed:
        with suppress(MhsbError):
            yield from _over_first_moves(machine, source, table, task, time)
    if refused is not None and not time.found:
        raise refused


def _for_a_share(time: SearchTime) -> SearchTime:
    """Return a search time that ends after DIRECT_SHARE of what is left."""
    if not time.ends:
        return SearchTime(time.deadline)
    return SearchTime(time.deadline.less((1.0 - DIRECT_SHARE) * max(0.0, time.deadline.left)))


def _over_first_moves(
    machine: Machine, source: PathSource, table: PostureTable, task: Task, time: SearchTime
) -> Iterator[Candidate]:
    """Yield paths over first moves; raises StartError if no first move is possible."""
    refused: MhsbError | None = None
    for first in _first_moves(machine, table, task):
        bound = 0.0
        try:
            for candidate in paths_by_way(source, task.from_rest(first), time):
                bound = candidate.path.lower_bound
                whole = joined([replace(first, lower_bound=bound), candidate.path])
                yield candidate._replace(path=whole)
                if not time.found:
                    before = np.array([first.steps])[: candidate.path.steps]
                    rested = with_rests(machine, whole, before, task.options.weights)
                    yield candidate._replace(path=rested)
        except DeadlineError:
            raise
        except MhsbError as error:
            refused = refused or error
        if time.found:
            return
    if refused is not None:
        raise refused
    raise StartError(f"the arm starts with {beyond_limits(machine, task.departure)}")


def _first_moves(machine: Machine, table: PostureTable, task: Task) -> Iterator[DiscretePath]:
    """Yield ways from the departure to postures within limits and clear, the nearest ones first."""
    start = task.departure
    if not _is_movable(machine, start):
        return
    ends = (end for end in _postures_nearby(machine, table, start) if _only_leaves(
        machine, np.array([start, end])
    ))
    for end in islice(ends, TRIED_POSTURES):
        if move := _move(machine, task, end):
            yield move
    climb = _way_out(machine, start)
    if climb is not None and (way := _along(machine, task, climb)):
        yield way


def _way_out(machine: Machine, start: FloatArray) -> FloatArray | None:
    """Return postures by which the arm gets out of obstacles, the clearance rising all the way.

    Steps of steepest ascent of the least clearance, within the joint limits. They end where the
    arm keeps the margin of discrete paths.

    Returns:
        float64[k, n], the start first; None if the clearance cannot be raised so far.
    """
    a, rows = machine.arrays, machine.obstacles.path_rows
    if len(rows) == 0:
        return None
    low, high, unit = a.joint_min, a.joint_max, machine.radians
    way, here = [start], float(clearances(a, rows, frozen(start[None, :]))[0][0])
    while here < 0.0 and len(way) <= CLIMB_STEPS:
        aside = way[-1] + np.vstack([np.diag(SLOPE_STEP * unit), np.diag(-SLOPE_STEP * unit)])
        values = clearances(a, rows, frozen(aside))[0]
        slope = values[: len(unit)] - values[len(unit) :]
        steps = CLIMB_STRIDE * 0.5 ** np.arange(CLIMB_HALVINGS)[:, None]
        tried = way[-1] + steps * unit * slope / max(np.abs(slope).max(), 1e-12)
        tried = np.clip(tried, np.minimum(low, way[-1]), np.maximum(high, way[-1]))
        reached = clearances(a, rows, frozen(tried))[0]
        best = int(np.argmax(reached))
        if reached[best] <= here:
            return None
        way.append(tried[best])
        here = float(reached[best])
    return np.array(way) if here >= 0.0 and len(way) > 1 else None


def _along(machine: Machine, task: Task, way: FloatArray) -> DiscretePath | None:
    """Return a path over as few of the postures way[k, n] as possible, to the last; or None."""
    moves, here, at = [], 0, task
    while here < len(way) - 1:
        for there in range(len(way) - 1, here, -1):
            if not _only_leaves(machine, way[[here, there]]):
                continue
            if move := _move(machine, at, way[there]):
                break
        else:
            return None
        moves.append(move)
        here, at = there, at.from_rest(move)
    return joined(moves) if moves else None


def _is_movable(machine: Machine, posture: FloatArray) -> bool:
    """Return whether each linkage moves its joint alike from the posture to the joint limits.

    Beyond a dead centre the moment arm has the other sign, or the linkage cannot be assembled:
    no cylinder moves the joint from there.
    """
    a = machine.arrays
    inside = np.clip(posture, a.joint_min, a.joint_max)
    share = np.linspace(0.0, 1.0, ARM_LOOKS)[:, None]
    arms = np.array([machine.moment_arms(q) for q in inside + share * (posture - inside)])
    return bool(np.all(arms * np.sign(arms[0]) > 0.0))


def _postures_nearby(
    machine: Machine, table: PostureTable, posture: FloatArray
) -> Iterator[FloatArray]:
    """Yield postures within the joint limits, float64[n] each, in the order of the way to them.

    First the posture itself with each joint clipped to its limits, then those of the table with
    all actuators in N, the slew at its clipped angle.
    """
    a = machine.arrays
    inside = np.clip(posture, a.joint_min, a.joint_max)
    if np.any(inside != posture):
        yield inside
    others = table.posture[:, 0][table.feasible]
    if machine.slews:
        others = np.insert(others, 0, inside[0], axis=1)
    others = others[_is_clear(machine, others)]
    way = np.abs(others - posture) * np.abs(machine.moment_arms(inside)) / a.max_piston_speed
    for k in np.argsort(way.max(axis=1), kind="stable"):
        yield others[k]


def _is_clear(machine: Machine, postures: FloatArray) -> np.ndarray:
    """Return which of the postures float64[count, n] keep clear of all obstacles, bool[count]."""
    rows = machine.obstacles.path_rows
    if len(rows) == 0:
        return np.ones(len(postures), dtype=bool)
    return np.asarray(clearances(machine.arrays, rows, frozen(postures))[0] >= 0.0)


def _only_leaves(machine: Machine, ends: FloatArray) -> bool:
    """Return whether a straight move between ends[2, n] gets ever less deep into obstacles."""
    if len(machine.obstacles.rows) == 0:
        return True
    share = np.linspace(0.0, 1.0, ARM_LOOKS)[:, None]
    on_the_way = frozen(ends[0] + share * (ends[1] - ends[0]))
    depth = -clearances(machine.arrays, machine.obstacles.rows, on_the_way)[0]
    return bool(np.all(np.diff(np.maximum(depth, 0.0)) <= 0.0))


def _move(machine: Machine, task: Task, posture: FloatArray) -> DiscretePath | None:
    """Return the cheapest straight move from the departure, of one step; None if there is none."""
    plane, weights, slews = machine.plane, task.options.weights, int(machine.slews)
    begin, end = task.departure[slews:], posture[slews:]
    modes = task.modes.modes[slews:]
    if np.array_equal(begin, end):  # the slew alone is beyond its limits
        tip = plane.tip_position(begin)
        path = DiscretePath.standing(tip, begin, modes, 0.0)
        return turned(machine, task, path, turning_evenly(machine, path, *_slew(task, posture)))
    costs = step_costs(plane, begin, end)
    switches = np.count_nonzero(plane.patterns != modes, axis=1)
    cost = weights.energy * costs.energy + weights.time * costs.duration
    cost = np.where(costs.admissible, cost + weights.switches * switches, np.inf)
    best = int(np.argmin(cost))
    if not np.isfinite(cost[best]):
        return None
    path = DiscretePath(
        tip=np.array([plane.tip_position(begin), plane.tip_position(end)]),
        posture=np.array([begin, end]),
        modes=plane.patterns[[best]],
        duration=costs.duration[[best]],
        energy=costs.energy[[best]],
        energy_series=costs.energy_series[[best]],
        cost=float(cost[best]),
        start_modes=modes,
        lower_bound=0.0,
        statistics=SearchStatistics(0, 0, 0.0),
    )
    if not machine.slews:
        return path
    return turned(machine, task, path, turning_evenly(machine, path, *_slew(task, posture)))


def _slew(task: Task, posture: FloatArray) -> tuple[float, float]:
    """Return the slew's angles at the departure and in a posture [rad]."""
    return float(task.departure[0]), float(posture[0])
