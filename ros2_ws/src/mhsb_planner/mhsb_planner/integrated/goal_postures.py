"""Sampled postures in which a motion may end, at one or several tip positions.

At one tip position, an arm of three joints keeps one degree of freedom: the end-link angle ψ, on
two elbow branches (`s1_psi_intervals_3r`). For longer chains the angles of the first n − 3 joints
are sampled evenly, and the intervals of ψ are found for each sample. If the chain has telescopes,
all joints except the two that close the chain are sampled evenly. If ψ is prescribed for such a
chain, values of ψ are sampled instead.
"""

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
from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_lengths
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

PSI_SPACING = math.radians(1.0)
"""Default spacing of the samples of ψ [rad]."""
MIN_INTERVAL_SAMPLES = 8
"""Smallest number of samples of an interval of ψ [-]. With m free coordinates, the m-th root of
this number applies.
"""
MAX_TURNS = 2
"""Number of whole turns by which an end-link angle may differ from the prescribed ψ [-]."""
MAX_RANGES = (2 * MAX_TURNS + 1) * MAX_INTERVALS
"""Largest number of admissible ranges of ψ."""
FIRST_ROWS = 128
"""Number of postures for which a table has room at first; the room is doubled as needed."""


@dataclass(frozen=True, eq=False)
class GoalPostures:
    """Sampled postures with the tip at an admissible end position.

    Attributes:
        tip: Goal (x, z) [m].
        tips: Tip position of each posture, shape (count, 2) [m].
        posture: The postures, shape (count, n) [rad or m].
        length: Cylinder lengths in each posture, shape (count, n) [m].
        elbow: Elbow branch (sign of the second-last joint's angle) of each posture, −1 or 1, shape
            (count,). With telescopes: sign of the last turning joint's angle.
        free: Free coordinates of each posture, shape (count, n - 2) [rad or m]: the first n − 3
            joint angles and ψ. With telescopes: the positions of all joints except the last two
            turning joints.
        free_units: Unit of each free coordinate (1 rad, or range/π of a telescope), shape (n - 2,)
            [rad or m]. 0 means that local changes must keep the coordinate.
        psi_range: Least and greatest admissible ψ [rad]; None if ψ is free.
    """

    tip: tuple[float, float]
    tips: FloatArray
    posture: FloatArray
    length: FloatArray
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

    The postures at a tip position have m = n − 2 free coordinates, or m = n − 3 if ψ must have one
    value. For m = 1, successive samples of ψ differ by at most `spacing`, and include the ends of
    each feasible interval. For larger m, each coordinate is sampled at intervals of spacing^(1/m),
    in rad. With k tip positions, `spacing` is first multiplied by k. The number of samples
    therefore hardly grows with m or k. Postures too near to obstacles are left out, as are tip
    positions without any posture.

    Args:
        machine: The arm without a slewing joint.
        x: Goal position of the tip, forward [m].
        z: Goal position of the tip, upward [m].
        psi: End-link angle ψ at the goal, or the pair (least, greatest) [rad]; None leaves it free.
        spacing: Largest distance of two samples of ψ for m = 1 and one tip position [rad].
        region: Other admissible tip positions; None means the goal alone.

    Returns:
        The postures, at least one, sorted by tip position in the order of `tip_positions`, the goal
        first.

    Raises:
        OutOfWorkspaceError: No tip position has a posture, and the goal is outside the workspace.
        InfeasibleGoalError: No tip position has a posture, and none at the goal is within joint
            limits.
        ZoneError: No tip position has a posture, and obstacles prevent all postures at the goal.
    """
    points = [(x, z)] if region is None else tip_positions((x, z), region).tolist()
    between, found, refused = angle_range(psi), [], None
    for point in points:
        try:
            at = point[0], point[1]
            found.append(_sample_at_tip(machine, *at, between, spacing * len(points)))
        except MhsbError as error:
            refused = refused or error
    if refused is not None and not found:
        raise refused
    tip, posture, elbow, free = (np.concatenate(part) for part in zip(*found, strict=True))
    posture = frozen(posture)
    return GoalPostures(
        (x, z),
        frozen(tip),
        posture,
        frozen(cylinder_lengths(machine.arrays.linkage, posture)),
        frozen(elbow),
        frozen(free),
        frozen(_free_coordinate_units(machine, between)),
        between,
    )


def _free_coordinate_units(machine: Machine, between: tuple[float, float] | None) -> FloatArray:
    """Return the unit of each free coordinate of a goal posture: the change that counts as 1.

    Free coordinates are the first n − 3 joint angles and the end-link angle ψ. With telescopes they
    are the positions of all joints except the last two turning joints, which close the chain.

    The unit is 1 rad for an angle, and the joint's range divided by π [m] for a telescope. 0 means
    that local changes must keep the coordinate. If `between` is given, the unit of ψ is 0. With
    telescopes all units are then 0, because each coordinate would change ψ.

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


def find_elbows_and_free_coordinates(
    machine: Machine, postures: FloatArray
) -> tuple[np.ndarray, FloatArray]:
    """Return elbow branches and free coordinates of postures, as `GoalPostures` stores them.

    Without telescopes the elbow branch is 1 if the second-last joint's angle is positive, else −1.
    The free coordinates are the first n − 3 joint angles and the end-link angle ψ. With telescopes
    the elbow branch is the sign of the last turning joint's angle (`find_closure_side`). The free
    coordinates are then the positions of all joints except the last two turning joints, which close
    the chain.

    Args:
        machine: The arm without a slewing joint.
        postures: Postures, shape (k, n) [rad or m].

    Returns:
        Elbow branches, −1 or 1, shape (k,), and free coordinates, shape (k, n - 2) [rad or m].
    """
    a, n = machine.arrays, machine.joint_count
    if machine.has_telescope:
        i, j = find_closing_joints(a)
        sides = np.array([find_closure_side(a, q, i, j) for q in postures], dtype=np.int64)
        return sides, postures[:, held_joints(machine)]
    elbow = np.where(postures[:, n - 2] > 0.0, 1, -1)
    return elbow, np.column_stack([postures[:, : n - 3], postures.sum(axis=1)])


def _sample_at_tip(
    machine: Machine, x: float, z: float, between: tuple[float, float] | None, spacing: float
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """Sample the postures at one tip position, without postures too near to obstacles.

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
          positions of all joints except the last two turning joints.

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
    return np.full((kept.sum(), 2), (x, z)), posture[kept], elbow[kept], free[kept]


def _sample_telescopic_chain(
    machine: Machine, x: float, z: float, between: tuple[float, float] | None, spacing: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Sample the postures of a chain with telescopes at one tip position, obstacles ignored.

    If `between` is given, evenly spaced end-link angles ψ are tried; each may give no posture or
    several. Otherwise all joints except the last two turning joints are sampled on a grid over
    their ranges. The last two turning joints then follow from the tip, in up to two ways (sides).

    Args:
        machine: The arm without a slewing joint.
        x: Tip position forward [m].
        z: Tip position upward [m].
        between: Least and greatest admissible ψ [rad]; None if ψ is free.
        spacing: Largest distance of two samples of ψ [rad]. With s for the number `spacing`, a grid
            over m joints has the spacing s^(1/m) rad in each joint. The number of grid points is
            then proportional to 1/s for every m. For a telescope, range/π stands for 1 rad.

    Returns:
        Three arrays, one row for each posture within limits:

        - Postures, shape (count, n) [rad or m].
        - Signs of the last turning joint's angle, −1 or 1, shape (count,).
        - Positions of all joints except the last two turning joints, shape (count, n - 2) [rad or
          m].
    """
    a, held = machine.arrays, held_joints(machine)
    if between is not None:
        count = math.ceil((between[1] - between[0]) / spacing) + 1
        posture = machine.postures(x, z, np.linspace(*between, count))
        return posture, *find_elbows_and_free_coordinates(machine, posture)
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
        m: Arrays of the machine.
        x: Tip position forward [m].
        z: Tip position upward [m].
        free: Free joint coordinates, shape (count, n - 2) [rad or m]: the first n − 3 joint angles
            and the end-link angle ψ. With telescopes: the positions of all joints except the last
            two turning joints.
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
    """Sample the postures of a chain of turning joints at one tip position, obstacles ignored.

    The inner joints (the first n − 3) are sampled on a grid. For each grid point the feasible
    end-link angles ψ of the last three joints are sampled. Each interval of ψ gets at least
    MIN_INTERVAL_SAMPLES^(1/(n − 2)) samples and at least 2, both ends included.

    Args:
        machine: The arm without a slewing joint.
        x: Tip position forward [m].
        z: Tip position upward [m].
        between: Least and greatest admissible ψ [rad]; None if ψ is free.
        spacing: Largest distance of two samples of ψ with three joints [rad]. With m free
            coordinates, the distance is spacing^(1/m) for ψ and on the grid. If both ends of
            `between` are equal, this angle is the only sample of ψ, and m is smaller by 1.

    Returns:
        Three arrays, one row for each posture within limits:

        - Postures, shape (count, n) [rad].
        - Elbow branches (sign of the second-last joint's angle), −1 or 1, shape (count,).
        - Angles of the first n − 3 joints and ψ, shape (count, n - 2) [rad].
    """
    a, n = machine.arrays, machine.joint_count
    low, high = between or (-math.inf, math.inf)
    apart = spacing ** (1.0 / max(1, n - 3 if low == high else n - 2))
    widest = max((a.joint_max - a.joint_min)[: n - 3], default=0.0)
    samples = math.ceil(widest / apart) + 1
    fewest = 1 if low == high else max(2, round(MIN_INTERVAL_SAMPLES ** (1.0 / (n - 2))))
    table = _tabulate_postures(a, x, z, (float(low), float(high)), apart, samples, fewest)
    return table[:, :n], table[:, n].astype(np.int64), table[:, n + 1 :]


@kernel
def _tabulate_postures(
    m: MachineArrays,
    x: float,
    z: float,
    between: tuple[float, float],
    apart: float,
    samples: int,
    fewest: int,
) -> FloatArray:
    """List the postures on a grid of inner joint angles and end-link angles ψ, for turning joints.

    Tested against the same samples in plain Python.

    Args:
        m: Arrays of the machine.
        x: Tip position forward [m].
        z: Tip position upward [m].
        between: Least and greatest admissible ψ [rad]; −inf and inf if ψ is free.
        apart: Largest distance of two samples of ψ [rad].
        samples: Number of evenly spaced angles over the range of each of the first n − 3 joints.
        fewest: Least number of samples in an interval of ψ.

    Returns:
        A row for each posture within limits, shape (count, 2 n - 1). Its columns are the posture
        [rad], the elbow branch, the angles of the first n − 3 joints [rad], and ψ [rad].
    """
    n, count = len(m.link_length), 0
    q, ranges = np.empty(n), np.empty((MAX_RANGES, 3))
    table = np.empty((FIRST_ROWS, 2 * n - 1))
    for number in range(samples ** (n - 3)):
        write_inner_angles(m, number, samples, q)
        ahead, up, heading = transform_tip_to_outer_frame(m.link_length, x, z, q)
        admissible = between[0] - heading, between[1] - heading
        for i in range(_find_psi_ranges(m, ahead, up, admissible, ranges)):
            low, width = ranges[i, 1], ranges[i, 2] - ranges[i, 1]
            last = max(fewest, math.ceil(width / apart) + 1) - 1
            for k in range(last + 1):
                psi = ranges[i, 2] if k == last else low + k * (width / last)
                if not solve_posture_at_psi(m, ahead, up, psi, np.int64(ranges[i, 0]), q):
                    continue
                if count == len(table):
                    short, table = table, np.empty((2 * count, 2 * n - 1))
                    for row in range(count):
                        copy_row(table[row], short[row])
                for j in range(n):
                    table[count, j] = q[j]
                table[count, n] = ranges[i, 0]
                for j in range(n - 3):
                    table[count, n + 1 + j] = q[j]
                table[count, 2 * n - 2] = psi + heading
                count += 1
    return table[:count]


@kernel(inline="always")
def _find_psi_ranges(
    m: MachineArrays, x: float, z: float, between: tuple[float, float], ranges: FloatArray
) -> int:
    """Find the admissible ranges of ψ in which the last three joints reach a position.

    Args:
        m: Arrays of the machine.
        x: Tip position forward in the frame of the last three joints [m].
        z: Tip position upward in the frame of the last three joints [m].
        between: Least and greatest admissible end-link angle ψ in the same frame [rad]; angles that
            differ from these by up to 2 whole turns are also admissible. −inf and inf if ψ is free.
            If both are equal, this ψ is returned for each elbow branch, even if it does not reach
            the position.
        ranges: Written in place, shape (MAX_RANGES, 3): elbow branch (sign of the second-last
            joint's angle), least and greatest ψ [rad] of each range.

    Returns:
        Number of ranges.
    """
    low, high = between
    if low == high:
        for i in range(len(ELBOW_BRANCHES)):
            ranges[i, 0], ranges[i, 1], ranges[i, 2] = ELBOW_BRANCHES[i], low, high
        return len(ELBOW_BRANCHES)
    interval, count = np.empty((MAX_INTERVALS, 3)), 0
    most_turns = MAX_TURNS if low > -math.inf else 0
    for i in range(find_feasible_intervals(m, x, z, interval)):
        for turn in range(-most_turns, most_turns + 1):
            least = max(interval[i, 1], low + 2.0 * math.pi * turn)
            most = min(interval[i, 2], high + 2.0 * math.pi * turn)
            if least <= most:
                ranges[count, 0], ranges[count, 1], ranges[count, 2] = interval[i, 0], least, most
                count += 1
    return count
