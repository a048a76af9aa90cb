"""Sampled postures in which a motion may end, at one or several tip positions.

An arm of three joints has one degree of freedom left there: the end-link angle ψ, on two elbow
branches (`s1_psi_intervals_3r`). For longer chains the inner joints' angles are sampled evenly, and
the intervals of ψ are found for each sample. If joints slide, all joints but the two that close the
chain are sampled evenly. If joints slide and ψ is given, ψ is sampled instead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.errors import MhsbError
from mhsb_model.inverse_kinematics.closed_form_3r import ELBOW_BRANCHES
from mhsb_model.inverse_kinematics.tip_postures import (
    find_closing_joints,
    find_closure_side,
    solve_posture,
    transform_tip_to_outer_frame,
    write_inner_angles,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.errors import InfeasibleGoalError
from mhsb_planner.goal_region import Angle, Region, angle_range, tip_positions
from mhsb_planner.posture.s1_psi_intervals_3r import (
    MAX_INTERVALS,
    find_feasible_intervals,
    solve_posture_at_psi,
)
from mhsb_planner.search.goal_clearance import check_tip_clearance, find_clear_postures
from mhsb_planner.search.s2_step import Postures, describe_postures

PSI_SPACING = math.radians(1.0)
"""Default spacing of the samples of ψ [rad]."""
MIN_INTERVAL_SAMPLES = 8
"""Smallest number of samples of an interval of ψ; with m free coordinates its m-th root."""


@dataclass(frozen=True, eq=False)
class GoalPostures:
    """Sampled postures with the tip at an admissible end position.

    Attributes:
        tip: Goal (x, z) [m].
        tips: Tip position of each posture, shape (count, 2) [m].
        postures: The postures, with cylinder lengths and piston forces.
        elbow: Elbow branch of each posture, ∓1, shape (count,); with telescopes the number of the
            solution (`side`) of `close_chain`, which moves two joints so that the tip is reached.
        free: Free joint coordinates of each posture as in `tip_postures`, shape (count, n - 2) [rad
            or m].
        free_units: Unit of each free coordinate (1 rad, or range/π of a telescope), shape (n - 2,)
            [rad or m]; 0 if the coordinate must not change.
        psi_range: Least and greatest admissible ψ [rad]; None if ψ is free.
    """

    tip: tuple[float, float]
    tips: FloatArray
    postures: Postures
    elbow: IntArray
    free: FloatArray
    free_units: FloatArray
    psi_range: tuple[float, float] | None


def sample_goal_postures(
    machine: Machine,
    x: float,
    z: float,
    psi: Angle = None,
    spacing: float = PSI_SPACING,
    region: Region | None = None,
) -> GoalPostures:
    """Sample the postures at a goal and at the other tip positions of its region.

    The postures at a tip position have m = n − 2 free coordinates, one less if ψ must have one
    value. For m = 1 successive samples differ by at most `spacing`, and the ends of each feasible
    interval are among them. For larger m the distance is spacing^(1/m). With k tip positions,
    `spacing` is first multiplied by k. Both limit the number of samples. Postures that come too
    near to obstacles are dropped, and so are tip positions without any posture.

    Args:
        machine: The arm without a slewing joint.
        x: Goal position of the tip, forward [m].
        z: Goal position of the tip, upward [m].
        psi: End-link angle ψ at the goal, or the pair (least, greatest) [rad]; None leaves it free.
        spacing: Largest distance of two samples of ψ for m = 1 and one tip position [rad].
        region: Other admissible tip positions; None means the goal alone.

    Returns:
        The postures, at least one.

    Raises:
        OutOfWorkspaceError: No tip position has a posture, and the goal is outside the workspace.
        InfeasibleGoalError: No tip position has a posture, and none at the goal is within joint
            limits.
        ZoneError: No tip position has a posture, and obstacles prevent all postures at the goal.
    """
    points, between, refused = tip_positions((x, z), region), angle_range(psi), None
    found = []
    for point in points.tolist():
        try:
            found.append(
                _sample_at_tip(machine, point[0], point[1], between, spacing * len(points))
            )
        except MhsbError as error:
            refused = refused or error
    if refused is not None and not found:
        raise refused
    tip, postures, elbow, free = (np.concatenate(part) for part in zip(*found, strict=True))
    return GoalPostures(
        (x, z),
        frozen(tip),
        describe_postures(machine.arrays, postures),
        frozen(elbow),
        frozen(free),
        frozen(_free_coordinate_units(machine, between)),
        between,
    )


def _free_coordinate_units(machine: Machine, between: tuple[float, float] | None) -> FloatArray:
    """Return the unit of each free joint coordinate, by which changes are compared.

    Free coordinates are the first n − 3 joint angles and the end-link angle ψ. With telescopes they
    are the positions of all joints but the last two turning ones, which close the chain.

    The unit is 1 rad for an angle, and the joint's range divided by π [m] for a telescope. 0 means
    that the coordinate must not change. If `between` is given, this is so for ψ, and with
    telescopes for all coordinates, because each would change ψ.

    Args:
        machine: The arm without a slewing joint.
        between: Least and greatest admissible ψ [rad]; None if ψ is free.

    Returns:
        Units, shape (n - 2,) [rad or m].
    """
    if machine.has_telescope:
        unit = machine.radian_equivalents[held_joints(machine)]
        return unit if between is None else np.zeros(len(unit))
    turns = np.ones(machine.joint_count - 2)
    turns[-1] = 1.0 if between is None else 0.0
    return turns


def held_joints(machine: Machine) -> IntArray:
    """Return the indices of the joints that do not close the chain, for a chain with telescopes.

    The last two turning joints close the chain: they move so that the tip reaches its position.
    """
    return np.delete(np.arange(machine.joint_count), find_closing_joints(machine.arrays))


def _sample_at_tip(
    machine: Machine, x: float, z: float, between: tuple[float, float] | None, spacing: float
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """Sample the postures at one tip position and drop those too near to obstacles.

    Args:
        machine: The arm without a slewing joint.
        x: Tip position forward [m].
        z: Tip position upward [m].
        between: Least and greatest admissible ψ [rad], equal for one angle; None if ψ is free.
        spacing: Largest distance of two samples if one coordinate is sampled [rad]. If m
            coordinates are sampled, the distance is spacing^(1/m).

    Returns:
        Four arrays, one row for each sample:

        - Tip positions, all equal, shape (count, 2) [m].
        - Postures, shape (count, n) [rad or m].
        - Elbow branches (sign of the second-last joint's angle), −1 or 1, shape (count,). With
          telescopes: sign of the last turning joint's angle.
        - Free coordinates, shape (count, n - 2) [rad or m]: q₁ … q₍ₙ₋₃₎ and ψ. With telescopes:
          positions of all joints but the last two turning ones.

    Raises:
        OutOfWorkspaceError: The tip position is outside the workspace.
        InfeasibleGoalError: No posture is within limits.
        ZoneError: The tip, or the arm in every posture, would be too near to an obstacle.
    """
    machine.check_in_workspace((x, z))
    check_tip_clearance(machine, (x, z))
    sampled = _sample_telescopic_chain if machine.has_telescope else _sample_turning_chain
    posture, elbow, free = sampled(machine, x, z, between, spacing)
    if len(posture) == 0:
        raise InfeasibleGoalError(x, z, between)
    kept = find_clear_postures(machine, x, z, posture)
    tip = np.tile([x, z], (int(kept.sum()), 1))
    return tip, posture[kept], elbow[kept], free[kept]


def _sample_telescopic_chain(
    machine: Machine, x: float, z: float, between: tuple[float, float] | None, spacing: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Sample the postures of a chain with telescopes at one tip position.

    If `between` is given, evenly spaced end-link angles ψ are tried; each may give no posture or
    several. Otherwise all joints but the last two turning ones are sampled on a grid over their
    ranges. The last two turning joints then follow from the tip, in up to two ways (sides).

    Args:
        machine: The arm without a slewing joint.
        x: Tip position forward [m].
        z: Tip position upward [m].
        between: Least and greatest admissible ψ [rad]; None if ψ is free.
        spacing: Largest distance of two samples of ψ [rad]. A grid over m joints has the spacing
            spacing^(1/m) [rad] in each, so that its size hardly depends on m. For a telescope,
            range/π stands for 1 rad.

    Returns:
        Postures within limits, shape (count, n) [rad or m]; sign of the last turning joint's angle,
        −1 or 1, shape (count,); and positions of all joints but the last two turning ones, shape
        (count, n - 2) [rad or m].
    """
    a, held = machine.arrays, held_joints(machine)
    i, j = find_closing_joints(a)
    if between is not None:
        count = math.ceil((between[1] - between[0]) / spacing) + 1
        posture = machine.postures(x, z, np.linspace(*between, count))
        elbow = np.array([find_closure_side(a, q, i, j) for q in posture], dtype=np.int64)
        return posture, elbow, posture[:, held]
    apart = spacing ** (1.0 / len(held)) * machine.radian_equivalents[held]
    counts = np.ceil((a.joint_max - a.joint_min)[held] / apart).astype(int) + 1
    ends = zip(a.joint_min[held], a.joint_max[held], counts, strict=True)
    grids = np.meshgrid(*(np.linspace(*each) for each in ends), indexing="ij")
    free = np.repeat(np.stack([grid.ravel() for grid in grids], axis=-1), 2, axis=0)
    elbow = np.tile(np.array(ELBOW_BRANCHES, dtype=np.int64), len(free) // 2)
    posture = np.empty((len(free), machine.joint_count))
    kept = _compute_postures(a, x, z, free, elbow, posture)
    return posture[kept], elbow[kept], free[kept]


@kernel
def _compute_postures(
    m: MachineArrays, x: float, z: float, free: FloatArray, elbow: IntArray, posture: FloatArray
) -> np.ndarray:
    """Compute the postures with given free joint coordinates at one tip position.

    Args:
        m: Numeric description of the machine.
        x: Tip position forward [m].
        z: Tip position upward [m].
        free: Free joint coordinates, shape (count, n - 2) [rad or m]: the first n − 3 joint angles
            and the end-link angle ψ. With telescopes: the positions of all joints but the last two
            turning ones.
        elbow: Elbow branches (sign of the second-last joint's angle), −1 or 1, shape (count,). With
            telescopes the sign of the last turning joint's angle.
        posture: Written in place, shape (count, n) [rad or m]; rows without a posture are
            undefined.

    Returns:
        True for each row with a posture within the joint limits, bool, shape (count,).
    """
    within = np.empty(len(free), dtype=np.bool_)
    for k in range(len(free)):
        within[k] = solve_posture(m, x, z, free[k], elbow[k], posture[k])
    return within


def _sample_turning_chain(
    machine: Machine, x: float, z: float, between: tuple[float, float] | None, spacing: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Sample the postures of a chain of turning joints at one tip position.

    The inner joints, the first n − 3, are sampled on a grid. For each grid point the feasible
    end-link angles ψ of the last three joints are sampled.

    Args:
        machine: The arm without a slewing joint.
        x: Tip position forward [m].
        z: Tip position upward [m].
        between: Least and greatest admissible ψ [rad]; None if ψ is free.
        spacing: Largest distance of two samples of ψ with three joints [rad]. With m free
            coordinates the distance is spacing^(1/m), also on the grid. ψ is no free coordinate if
            `between` is one angle.

    Returns:
        Postures within limits, shape (count, n) [rad]; elbow branches (sign of the second-last
        joint's angle), −1 or 1, shape (count,); and inner joints' angles and ψ, shape (count, n -
        2) [rad].
    """
    a, n = machine.arrays, machine.joint_count
    given = between is not None and between[0] == between[1]
    apart = spacing ** (1.0 / max(1, n - 3 if given else n - 2))
    widest = max((a.joint_max - a.joint_min)[: n - 3], default=0.0)
    samples = math.ceil(widest / apart) + 1
    numbers = np.arange(samples ** (n - 3))
    if n > 3 and not given:  # leaving out what reaches nothing is faster than trying it
        numbers = _reachable_inner_samples(a, x, z, samples)
        if len(numbers) == 0:
            return np.empty((0, n)), np.empty(0, dtype=np.int64), np.empty((0, n - 2))
    found = []
    for number in numbers:
        q = np.empty(n)
        write_inner_angles(a, number, samples, q)
        found.append(_sample_outer_joints(machine, x, z, q, between, apart))
    posture, elbow, angle = (np.concatenate(part) for part in zip(*found, strict=True))
    return posture, elbow, np.column_stack([posture[:, : n - 3], angle])


@kernel
def _reachable_inner_samples(m: MachineArrays, x: float, z: float, samples: int) -> IntArray:
    """List the angles of the inner joints with which the last three joints reach a tip position.

    Args:
        m: Numeric description of the machine.
        x: Tip position forward [m].
        z: Tip position upward [m].
        samples: Number of evenly spaced angles of each of the first n − 3 joints.

    Returns:
        Numbers of the combinations of inner angles, in ascending order. `write_inner_angles` writes
        the angles of such a number.
    """
    n, count = len(m.link_length), 0
    q, interval = np.empty(n), np.empty((MAX_INTERVALS, 3))
    numbers = np.empty(samples ** (n - 3), dtype=np.int64)
    for number in range(len(numbers)):
        write_inner_angles(m, number, samples, q)
        ahead, up, _ = transform_tip_to_outer_frame(m.link_length, x, z, q)
        if find_feasible_intervals(m, ahead, up, interval) > 0:
            numbers[count] = number
            count += 1
    return numbers[:count]


def _sample_outer_joints(
    machine: Machine,
    x: float,
    z: float,
    q: FloatArray,
    between: tuple[float, float] | None,
    spacing: float,
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Sample the postures at one tip position with the inner joints fixed.

    The arm must have no telescopes.

    Args:
        machine: The arm without a slewing joint.
        x: Tip position forward [m].
        z: Tip position upward [m].
        q: Posture that gives the inner joints' angles, shape (n,) [rad]; the last three are
            ignored.
        between: Least and greatest admissible ψ [rad]; None if ψ is free.
        spacing: Largest distance of two samples of ψ [rad]. If `between` is one angle, it is the
            only sample.

    Returns:
        Postures within limits, shape (count, n) [rad]; elbow branches (sign of the second-last
        joint's angle), −1 or 1, shape (count,); and ψ, shape (count,) [rad].
    """
    ahead, up, heading = transform_tip_to_outer_frame(machine.arrays.link_length, x, z, q)
    seen = None if between is None else (between[0] - heading, between[1] - heading)
    if seen is not None and seen[0] == seen[1]:
        elbow, angle = _both_elbows(seen[0])
    else:
        elbow, angle = _sample_psi_intervals(machine, ahead, up, spacing, seen)
    postures = np.tile(q, (len(angle), 1))
    kept = _solve_outer_joints(machine.arrays, ahead, up, elbow, angle, postures)
    return postures[kept], elbow[kept], angle[kept] + heading


@kernel
def _solve_outer_joints(
    m: MachineArrays,
    x: float,
    z: float,
    elbow: IntArray,
    angle: FloatArray,
    posture: FloatArray,
) -> np.ndarray:
    """Solve the last three joints for given elbow branches and end-link angles.

    Args:
        m: Numeric description of the machine.
        x: Tip position forward in the frame of the last three joints [m].
        z: Tip position upward in the frame of the last three joints [m].
        elbow: Elbow branches (sign of the second-last joint's angle), −1 or 1, shape (count,).
        angle: End-link angles in the frame of the last three joints, shape (count,) [rad].
        posture: Postures, shape (count, n) [rad]. The last three columns are written in place; the
            others must be set.

    Returns:
        True for each row whose posture exists and is within the joint limits, bool, shape (count,).
    """
    within = np.empty(len(angle), dtype=np.bool_)
    for i in range(len(angle)):
        within[i] = solve_posture_at_psi(m, x, z, angle[i], elbow[i], posture[i])
    return within


def _sample_psi_intervals(
    machine: Machine, x: float, z: float, spacing: float, between: tuple[float, float] | None
) -> tuple[IntArray, FloatArray]:
    """Sample the end-link angles ψ at which the last three joints reach a position.

    Args:
        machine: The arm without a slewing joint.
        x: Tip position forward in the frame of the last three joints [m].
        z: Tip position upward in the frame of the last three joints [m].
        spacing: Largest distance of two samples [rad]. Each feasible interval gets at least
            MIN_INTERVAL_SAMPLES^(1/(n − 2)) samples and at least 2, its ends included.
        between: Least and greatest admissible ψ in the same frame [rad]; None if ψ is free.

    Returns:
        Elbow branches (sign of the second-last joint's angle), −1 or 1, shape (count,), and angles
        ψ, shape (count,) [rad]. Both are empty if no interval is feasible.
    """
    interval = np.empty((MAX_INTERVALS, 3))
    fewest = max(2, round(MIN_INTERVAL_SAMPLES ** (1.0 / (machine.joint_count - 2))))
    elbows, angles = [np.empty(0, dtype=np.int64)], [np.empty(0)]
    for elbow, least, most in interval[: find_feasible_intervals(machine.arrays, x, z, interval)]:
        for low, high in _intersect_psi_range(least, most, between):
            count = max(fewest, math.ceil((high - low) / spacing) + 1)
            elbows.append(np.full(count, int(elbow)))
            angles.append(np.linspace(low, high, count))
    return np.concatenate(elbows), np.concatenate(angles)


def _intersect_psi_range(
    low: float, high: float, between: tuple[float, float] | None
) -> list[tuple[float, float]]:
    """Intersect an interval of the angle ψ with a range of angles, modulo whole turns.

    Args:
        low: Lower end of the interval [rad].
        high: Upper end of the interval [rad].
        between: Range of admissible ψ [rad]; ψ plus up to 2 turns in either direction is
            admissible, too. None: no restriction.

    Returns:
        Lower and upper end of each admissible part of the interval [rad]; empty if there is none.
    """
    if between is None:
        return [(low, high)]
    turns = 2.0 * math.pi * np.arange(-2, 3)
    parts = [(max(low, between[0] + turn), min(high, between[1] + turn)) for turn in turns]
    return [(a, b) for a, b in parts if a <= b]


def _both_elbows(psi: float) -> tuple[IntArray, FloatArray]:
    """Return both elbow branches, ∓1, each with the same end-link angle ψ [rad]."""
    return np.array(ELBOW_BRANCHES, dtype=np.int64), np.full(len(ELBOW_BRANCHES), psi)
