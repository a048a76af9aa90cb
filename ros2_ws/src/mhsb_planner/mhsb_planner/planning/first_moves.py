"""Paths from a start that is not admissible: beyond joint limits, or in an obstacle.

Planners look for paths within the joint limits and clear of obstacles. From any other start, a
first move leads to a nearby admissible posture, and the planner's path begins there. On the first
move, a joint beyond its limits only moves back towards them. The arm gets no deeper into an
obstacle than it is at the start. Both rules are also checked on the trajectory
(`motion.limits.joint_range.compute_outward_excess`, `motion.s3_clearance`).
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import clearances
from mhsb_model.types import FloatArray, frozen
from mhsb_model.workspace import compute_joint_excess
from mhsb_planner.errors import DeadlineError, StartError
from mhsb_planner.motion.limits.joint_range import JOINT_TOLERANCE
from mhsb_planner.motion.resting import insert_rests
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planners.path_planner import PathProposal, PathRequest
from mhsb_planner.planners.path_sources import PathSource
from mhsb_planner.planners.priced_path import price_path
from mhsb_planner.planners.via_paths import join_paths, paths_through_via_points
from mhsb_planner.planning.remarks import describe_limit_excess, suggest_unit_of_start
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.goal_clearance import describe_start_contact
from mhsb_planner.slewing.turned_path import combine_with_slew, compute_even_turning

START_NOISE = 0.01
"""Largest distance of a start beyond a joint limit that counts as measurement noise [rad or m].
Such a start is treated as if it were within the limits.
"""

TRIED_POSTURES = 8
"""Largest number of postures to which a first move is tried; each takes about 1 ms."""

ARM_LOOKS = 16
"""Number of samples of a straight move at which moment arms or clearances are checked [-]."""

CLIMB_STRIDE, CLIMB_HALVINGS = 0.08, 4
"""Largest change of a joint in one step out of an obstacle [rad], and number of step sizes tried
[-]. Each step size is half of the previous step size. For a telescope, range/π stands for 1 rad.
"""

CLIMB_STEPS = 60
"""Number of steps after which climbing out is given up; they can turn a joint by 5 rad."""

SLOPE_STEP = 1e-4
"""Change of a joint by which the gradient of the clearance is computed [rad]. For a telescope,
range/π stands for 1 rad.
"""

FIRST_MOVE = "after a first move"
"""End of a proposer's name in the log, for paths that begin with a first move."""

DIRECT_SHARE = 0.5
"""Share of the remaining time for a search directly from a start in an obstacle [-]. Most paths are
found in this time; the rest is for paths with a first move.
"""


def paths_from_anywhere(
    source: PathSource, request: PathRequest, progress: PlanProgress
) -> Iterator[PathProposal]:
    """Yield paths from any departure to the goal, with a first move if the departure needs one.

    The departure is the posture at rest where the path begins. Three cases:

    - Within the joint limits and clear of obstacles: the source's paths through the via points.
    - More than START_NOISE beyond a limit: all paths begin with a first move, which leads to a
      nearby admissible posture.
    - Otherwise (slightly beyond a limit, or in an obstacle): the source plans directly. With a
      deadline, it has DIRECT_SHARE of the time (`progress.trial_deadline`), or all the time once
      there is a motion. If there is no motion then, paths with a first move follow.

    Args:
        source: Source of paths of the whole arm from an admissible departure.
        request: The request.
        progress: State of the planning loop.

    Yields:
        Path proposals.

    Raises:
        StartError: The departure is more than START_NOISE beyond a joint limit, and no first move
            is possible.
        MhsbError: The source has failed, and there is no motion.
    """
    excess = float(compute_joint_excess(source.machine.arrays, request.departure))
    if excess > START_NOISE:
        yield from _paths_over_first_moves(source, request, progress)
        return
    if excess <= JOINT_TOLERANCE and not describe_start_contact(source.machine, request.departure):
        yield from paths_through_via_points(source, request, progress)
        return
    refused = None
    if progress.has_deadline:
        later = (1.0 - DIRECT_SHARE) * max(0.0, progress.deadline.remaining)
        progress.trial_deadline = progress.deadline.earlier_by(later)
    try:
        for candidate in paths_through_via_points(source, request, progress):
            yield candidate
            if progress.has_motion:
                progress.trial_deadline = None
    except MhsbError as error:
        refused = error
        progress.log.add_failure(request.options.planner, error)
    progress.trial_deadline = None
    if not progress.has_motion and not progress.search_deadline.has_passed:
        with progress.log.record_failure(FIRST_MOVE):
            yield from _paths_over_first_moves(source, request, progress)
    if refused is not None and not progress.has_motion:
        raise refused


def _paths_over_first_moves(
    source: PathSource, request: PathRequest, progress: PlanProgress
) -> Iterator[PathProposal]:
    """Yield paths that begin with a first move and lead to the goal.

    First moves are tried one after the other until there is a motion. From the end of each first
    move, the source plans to the goal. While there is no motion, each path is also proposed with a
    rest after its first move.

    Args:
        source: Source of paths of the whole arm from an admissible departure.
        request: The request.
        progress: State of the planning loop.

    Yields:
        Path proposals.

    Raises:
        StartError: No first move is possible, or none led to a motion although no search failed.
        DeadlineError: The time was up during a search.
        MhsbError: No first move led to a motion, and a search failed; the error of the first such
            search is raised.
    """
    machine = source.machine
    refused: MhsbError | None = None
    for first in _first_moves(source, request):
        try:
            for candidate in paths_through_via_points(
                source, request.continued_from(first), progress
            ):
                whole = join_paths([first, candidate.path])
                candidate = candidate._replace(proposer=f"{candidate.proposer} {FIRST_MOVE}")
                yield candidate._replace(path=whole)
                if not progress.has_motion:
                    before = np.array([first.steps])[: candidate.path.steps]
                    rested = insert_rests(machine, whole, before, request.options.weights)
                    yield candidate._replace(path=rested)
        except DeadlineError:
            raise
        except MhsbError as error:
            refused = refused or error
            progress.log.add_failure(FIRST_MOVE, error)
        if progress.has_motion:
            return
    if refused is not None:
        raise refused
    excess = describe_limit_excess(machine, request.departure)
    hint = suggest_unit_of_start(machine, request.departure)
    raise StartError(f"the arm starts with {excess}{hint}")


def _first_moves(source: PathSource, request: PathRequest) -> Iterator[DiscretePath]:
    """Yield paths that lead from an inadmissible departure to a nearby posture, and end there.

    The departure is the posture at rest where the path begins. Straight moves come first: to the
    departure clipped to the joint limits, then to nearby postures of the table. At most
    TRIED_POSTURES of these moves are planned. A move is skipped if the arm would get deeper into an
    obstacle on the way, or if no mode combination can do it. The last of the first moves leads out
    of the obstacles by steepest ascent of the clearance.

    Nothing is yielded if a linkage passes a dead centre on the straight move from the departure to
    the clipped departure.

    Args:
        source: Source of paths of the whole arm; gives machine and posture table.
        request: The request.

    Yields:
        Paths of one or more steps from the departure, each move with its cheapest mode combination.
    """
    machine, start = source.machine, request.departure
    if not _is_movable(machine, start):
        return
    ends = (
        end
        for end in _postures_nearby(source, start)
        if _never_gets_deeper(machine, np.array([start, end]))
    )
    for end in islice(ends, TRIED_POSTURES):
        if move := _plan_first_move(machine, request, end):
            yield move
    climb = _climb_out_of_obstacles(machine, start)
    if climb is not None and (way := _connect_postures(machine, request, climb)):
        yield way


def _climb_out_of_obstacles(machine: Machine, start: FloatArray) -> FloatArray | None:
    """Find postures on a way out of obstacles along which the clearance increases.

    Each step follows the gradient of the clearance from the nearest obstacle. No joint gets beyond
    its limits, or further beyond them than it is already. Among CLIMB_HALVINGS step sizes, the one
    with the greatest clearance is taken. The way
    ends as soon as the arm keeps the margin of discrete paths. The search is given up after
    CLIMB_STEPS steps.

    Args:
        machine: The whole arm.
        start: Start posture, shape (n,) [rad or m].

    Returns:
        Postures, shape (k, n) [rad or m], the start first. None if the start already keeps the
        margin, there are no obstacles, or no way is found.
    """
    a, rows = machine.arrays, machine.obstacles.path_rows
    if len(rows) == 0:
        return None
    low, high, unit = a.joint_min, a.joint_max, machine.radian_equivalents
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


def _connect_postures(
    machine: Machine, request: PathRequest, way: FloatArray
) -> DiscretePath | None:
    """Connect the first and the last posture of a way by few straight moves.

    From each posture, the move leads to the farthest later posture to which a straight move is
    admissible. A move is admissible if the arm gets no deeper into obstacles and a mode combination
    can do it.

    Args:
        machine: The whole arm.
        request: The request; its departure is the first posture.
        way: Postures, shape (k, n) [rad or m].

    Returns:
        The path to the last posture. None if no admissible move leads on from a posture, or if the
        way has only one posture.
    """
    moves, here, at = [], 0, request
    while here < len(way) - 1:
        for there in range(len(way) - 1, here, -1):
            if not _never_gets_deeper(machine, way[[here, there]]):
                continue
            if move := _plan_first_move(machine, at, way[there]):
                break
        else:
            return None
        moves.append(move)
        here, at = there, at.continued_from(move)
    return join_paths(moves) if moves else None


def _is_movable(machine: Machine, posture: FloatArray) -> bool:
    """Return whether no linkage meets a dead centre on the way back within the joint limits.

    On the straight way to the nearest posture within the limits, each moment arm (cylinder stroke
    per joint angle) must keep its sign. A sign change means a dead centre, over which no cylinder
    can move the joint. The way is sampled at ARM_LOOKS postures.

    Args:
        machine: The whole arm.
        posture: Joint positions, shape (n,) [rad or m].

    Returns:
        True if all moment arms keep their sign. Whether linkages can be assembled on the way is not
        checked.
    """
    a = machine.arrays
    inside = np.clip(posture, a.joint_min, a.joint_max)
    share = np.linspace(0.0, 1.0, ARM_LOOKS)[:, None]
    arms = np.array([machine.moment_arms(q) for q in inside + share * (posture - inside)])
    return bool(np.all(arms * np.sign(arms[0]) > 0.0))


def _postures_nearby(source: PathSource, posture: FloatArray) -> Iterator[FloatArray]:
    """Yield postures within the joint limits, in ascending order of the time of a straight move.

    If the given posture is beyond joint limits, the posture clipped to the limits comes first, even
    if it is in an obstacle. Then come the table's postures for mode N (main pump alone) of all
    actuators, except those too near to obstacles. If the arm slews, these get the clipped slew
    angle. The time of a move is estimated for its slowest joint, from moment arm and V_max (allowed
    piston speed).

    Args:
        source: Source of paths of the whole arm; gives machine and posture table.
        posture: Joint positions, shape (n,) [rad or m].

    Yields:
        Postures, shape (n,) [rad or m].
    """
    machine, table = source.machine, source.graph.table
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
    """Find the postures that keep clear of all obstacles by the margin of discrete paths.

    Args:
        machine: The whole arm.
        postures: Postures, shape (count, n) [rad or m].

    Returns:
        True for each posture that is clear, bool, shape (count,).
    """
    rows = machine.obstacles.path_rows
    if len(rows) == 0:
        return np.ones(len(postures), dtype=bool)
    return np.asarray(clearances(machine.arrays, rows, frozen(postures))[0] >= 0.0)


def _never_gets_deeper(machine: Machine, ends: FloatArray) -> bool:
    """Return whether the arm gets no deeper into obstacles on a straight move in joint space.

    Args:
        machine: The whole arm.
        ends: First and last posture, shape (2, n) [rad or m].

    Returns:
        True if the depth in the obstacles does not increase from any of ARM_LOOKS samples to the
        next. The depth is 0 outside all obstacles; the margin does not count.
    """
    if len(machine.obstacles.rows) == 0:
        return True
    share = np.linspace(0.0, 1.0, ARM_LOOKS)[:, None]
    on_the_way = frozen(ends[0] + share * (ends[1] - ends[0]))
    depth = -clearances(machine.arrays, machine.obstacles.rows, on_the_way)[0]
    return bool(np.all(np.diff(np.maximum(depth, 0.0)) <= 0.0))


def _plan_first_move(
    machine: Machine, request: PathRequest, posture: FloatArray
) -> DiscretePath | None:
    """Plan one straight move from the request's departure to a posture, in its cheapest modes.

    The move is one step of the path. If only the slew moves, the path contains the slew's motion
    alone.

    Args:
        machine: The whole arm.
        request: The request; gives departure (posture at rest where the path begins), modes in
            force, weights and energy reading.
        posture: End of the move, shape (n,) [rad or m].

    Returns:
        The path, slew included. None if no mode combination is admissible.
    """
    plane, slews, modes = machine.planar_arm, int(machine.slews), request.modes
    begin, end = request.departure[slews:], posture[slews:]
    in_plane = replace(request, modes=StartModes(modes.modes[slews:], modes.age[slews:]))
    path: DiscretePath | None
    if np.array_equal(begin, end):  # the slew alone is beyond its limits
        tip = plane.tip_position(begin)
        path = DiscretePath.create_without_steps(tip, begin, in_plane.modes.modes, 0.0)
    else:
        path = price_path(plane, in_plane, np.array([begin, end]), PlanProgress())
    if path is None or not machine.slews:
        return path
    turning = compute_even_turning(machine, path, float(request.departure[0]), float(posture[0]))
    return combine_with_slew(machine, request, path, turning)
