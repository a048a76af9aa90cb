"""Check of a joint motion against all limits (`limits.registry`).

Each limit bounds a quantity of the motion, such as the largest ratio of a piston's speed to the
speed that it can have. Speeds are checked under gravity alone, pressures under gravity and inertia.
What an actuator can do depends on its mode, so a motion is checked together with its mode schedule.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import tip_position
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import (
    MAX_POINT_SPACING_NS,
    SECOND_NS,
    Trajectory,
    sample_states_at_shares,
    standstill,
)
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_model.workspace import compute_workspace_excess
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.motion.limits.joint_range import (
    JOINT_TOLERANCE,
    bound_joint_excess,
)
from mhsb_planner.motion.limits.limit import (
    LimitInputs,
    StateLimit,
    TimeScaling,
    Violation,
    select_instant,
)
from mhsb_planner.motion.limits.node_set import TIP_TOLERANCE
from mhsb_planner.motion.limits.obstacles import find_obstacle_violation
from mhsb_planner.motion.limits.registry import STATE_LIMITS, measure_limits
from mhsb_planner.motion.motion_profile import (
    MotionProfile,
    compute_middle_profile,
    compute_motion_profile,
    compute_profile_arrays,
)
from mhsb_planner.motion.s3_clearance import find_first_contact

CHECK_SPACING = 1e-3
"""Spacing of the instants at which a motion is checked [s]."""

ROWS_AT_ONCE = 32
"""Number of intervals that are checked at close instants between two looks at the clock."""

CHECK_TASK = "checking the trajectory"
"""Name of the work in the message of a `DeadlineError`."""

# Kernels take the numbers of the limits as tuples, in the order of the registry.
_LIMIT_COUNT = len(STATE_LIMITS)
_SCALES_WITH_SPEED = tuple(each.time_scaling is TimeScaling.SPEED for each in STATE_LIMITS)
_LIMIT = tuple(each.limit for each in STATE_LIMITS)
_BROKEN_ABOVE = tuple(each.broken_above for each in STATE_LIMITS)
_PROVEN_BELOW = tuple(each.proven_below for each in STATE_LIMITS)
_CLEAR_BELOW = tuple(each.clear_below for each in STATE_LIMITS)


@kernel(borrows=True, forceinline=True)
def repeats_previous_row(modes: ModeArray, k: int) -> bool:
    """Return whether the modes of a row equal the modes of the row before.

    Args:
        modes: Mode codes (N, DB, SB), shape (rows, n).
        k: Index of the row.

    Returns:
        True if they are equal; False for row 0.
    """
    same = k > 0
    for j in range(modes.shape[1]):
        same = same and modes[k, j] == modes[k - 1, j]
    return same


class LimitValues(NamedTuple):
    """Quantities that the limits of `STATE_LIMITS` bound, along a motion.

    Attributes:
        values: Quantities, shape (limits, k): one row for each limit in the order of
            `STATE_LIMITS`, one column for each of k instants.
    """

    values: FloatArray

    @classmethod
    def from_profile(
        cls, machine: Machine, profile: MotionProfile, modes: ModeArray
    ) -> LimitValues:
        """Compute the quantity of each limit in `STATE_LIMITS` at k motion states.

        Args:
            machine: Machine with its hydraulics.
            profile: Profile (piston speeds, forces, tip and joint positions) with k rows.
            modes: Mode codes at each state, shape (k, n).

        Returns:
            Quantities at the k states.
        """
        p = profile
        return cls(
            _measure_states(machine.arrays, p.position, p.speed, p.force, p.inertia, p.tip, modes)
        )

    def of(self, limit: StateLimit) -> FloatArray:
        """Return the quantity of one limit at each of the k instants.

        Args:
            limit: One of `STATE_LIMITS`.

        Returns:
            Quantity in the limit's unit, shape (k,).
        """
        values: FloatArray = self.values[STATE_LIMITS.index(limit)]
        return values


@kernel
def _measure_states(
    m: MachineArrays,
    position: FloatArray,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    tip: FloatArray,
    modes: ModeArray,
) -> FloatArray:
    """Compute the quantity of each limit in `STATE_LIMITS` at k motion states.

    Each state has its own modes. Tested against the methods of `Machine`.

    Args:
        m: Arrays of the machine.
        position: Joint positions, shape (k, n) [rad or m].
        speed: Piston speeds, shape (k, n) [m/s].
        force: Piston forces under gravity, shape (k, n) [N].
        inertia: Piston forces from inertia, shape (k, n) [N].
        tip: Tip positions (x, z), shape (k, 2) [m].
        modes: Mode codes (N, DB, SB), shape (k, n).

    Returns:
        Quantities in the order of `STATE_LIMITS`, shape (limits, k).
    """
    values, scratch = np.empty((_LIMIT_COUNT, len(speed))), np.empty(speed.shape[1])
    q = position.copy()  # writable like the other arrays: `_fill_states` is then compiled once
    _fill_states(m, LimitInputs(q, speed, force, inertia, tip, modes, scratch), values)
    return values


@kernel(borrows=True)
def _fill_states(m: MachineArrays, motion: LimitInputs, values: FloatArray) -> None:
    """Compute the quantity of each limit in `STATE_LIMITS` at k motion states.

    Args:
        m: Arrays of the machine.
        motion: The motion: arrays and modes with a row for each of k states. Its `scratch` is
            overwritten.
        values: Quantities in the order of `STATE_LIMITS`, shape (limits, k). Written in place.
    """
    for k in range(len(motion.speed)):
        _store_column(values, k, measure_limits(m, select_instant(motion, k, k)))


@kernel(borrows=True, forceinline=True)
def _store_column(values: FloatArray, k: int, column: tuple[float, ...]) -> None:
    """Write the quantities of all limits at one instant into column k of `values`.

    Args:
        values: Quantities, one row for each limit, shape (limits, instants). Written in place.
        k: Index of the instant.
        column: Quantities at this instant, one for each limit.
    """
    for i in range(_LIMIT_COUNT):
        values[i, k] = column[i]


@kernel
def _measure_ends(
    m: MachineArrays,
    position: FloatArray,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    tip: FloatArray,
    modes: ModeArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the quantity of each limit in `STATE_LIMITS` at both ends of k intervals.

    Each interval has its own modes, so a point between two intervals may have two values.

    Args:
        m: Arrays of the machine.
        position: Joint positions at the points, shape (k + 1, n) [rad or m].
        speed: Piston speeds at the points, shape (k + 1, n) [m/s].
        force: Piston forces under gravity at the points, shape (k + 1, n) [N].
        inertia: Piston forces from inertia at the points, shape (k + 1, n) [N].
        tip: Tip positions (x, z) at the points, shape (k + 1, 2) [m].
        modes: Mode codes of the intervals, shape (k, n).

    Returns:
        Three arrays. The first two have the quantities at the beginnings and at the ends of the
        intervals, in the limits' units. Their shape is (limits, k), in the order of `STATE_LIMITS`.
        The third, shape (k,), has the largest share of a speed limit (`TimeScaling.SPEED`) that
        each interval uses [-]. Above 1, the interval is too fast.
    """
    begin, end = np.empty((_LIMIT_COUNT, len(modes))), np.empty((_LIMIT_COUNT, len(modes)))
    scratch = np.empty(speed.shape[1])
    _fill_ends(m, LimitInputs(position, speed, force, inertia, tip, modes, scratch), begin, end)
    uses = np.zeros(len(modes))
    for i in range(_LIMIT_COUNT):
        if _SCALES_WITH_SPEED[i]:
            for k in range(len(modes)):
                uses[k] = max(uses[k], begin[i, k], end[i, k])
    return begin, end, uses


@kernel(borrows=True)
def _fill_ends(m: MachineArrays, motion: LimitInputs, begin: FloatArray, end: FloatArray) -> None:
    """Compute the quantity of each limit in `STATE_LIMITS` at both ends of k intervals.

    Each interval has its own modes. If two adjacent intervals have equal modes, the values at their
    common point are computed once.

    Args:
        m: Arrays of the machine.
        motion: The motion: arrays with k + 1 rows for the points, and modes with k rows for the
            intervals. Its `scratch` is overwritten.
        begin: Quantities at the beginnings, in the order of `STATE_LIMITS`, shape (limits, k).
            Written in place.
        end: Quantities at the ends, shape (limits, k). Written in place.
    """
    for k in range(len(motion.modes)):
        first = 0
        if repeats_previous_row(motion.modes, k):
            first = 1
            for i in range(_LIMIT_COUNT):
                begin[i, k] = end[i, k - 1]
        for side in range(first, 2):
            into = begin if side == 0 else end
            _store_column(into, k, measure_limits(m, select_instant(motion, k + side, k)))


class EndValues(NamedTuple):
    """Quantities that the limits of `STATE_LIMITS` bound, at both ends of k intervals.

    Attributes:
        begin: Quantities at the beginnings of the intervals, in each interval's modes.
        end: Quantities at the ends of the intervals, in each interval's modes.
        modes: Mode codes of the intervals, shape (k, n).
        speed_uses: Share of the speed limits that each interval uses, shape (k,) [-]: the largest
            quantity of a limit with TimeScaling.SPEED at the interval's ends. The limits are kept
            up to 1. If the interval lasts f times as long, the share is divided by f. inf means
            that no duration keeps the limits.
    """

    begin: LimitValues
    end: LimitValues
    modes: ModeArray
    speed_uses: FloatArray

    @classmethod
    def from_profile(cls, machine: Machine, profile: MotionProfile, modes: ModeArray) -> EndValues:
        """Compute the quantity of each limit in `STATE_LIMITS` at both ends of k intervals.

        Args:
            machine: Machine with its hydraulics.
            profile: Profile (piston speeds, forces, tip and joint positions) with k + 1 rows, one
                for each point between the intervals and at both ends.
            modes: Mode codes of the intervals, shape (k, n).

        Returns:
            Quantities at the ends of the k intervals, with the modes.
        """
        p = profile
        begin, end, speed_uses = _measure_ends(
            machine.arrays, p.position, p.speed, p.force, p.inertia, p.tip, modes
        )
        return cls(LimitValues(begin), LimitValues(end), modes, speed_uses)


def keeps_position_limits(machine: Machine, trajectory: Trajectory) -> bool:
    """Return whether a trajectory keeps joint limits, workspace and clearance from obstacles.

    Joint limits and the tip's workspace are checked at the trajectory's points only. Obstacles are
    checked at every instant, without the margin of discrete paths. A motion that starts in an
    obstacle may leave it. Pumps, valves and modes are not checked.

    Args:
        machine: Machine with its obstacles.
        trajectory: Joint trajectory.

    Returns:
        True if all three are kept.
    """
    joint, tip = compute_position_excess(machine.arrays, trajectory.position)
    if joint > JOINT_TOLERANCE or tip > TIP_TOLERANCE:
        return False
    return find_first_contact(machine, trajectory) is None


@kernel(borrows=True)
def compute_position_excess(m: MachineArrays, position: FloatArray) -> tuple[float, float]:
    """Compute how far postures are beyond the joint limits, and their tips outside the workspace.

    Args:
        m: Arrays of the machine.
        position: Joint positions, shape (k, n) [rad or m].

    Returns:
        Largest excess of a joint [rad or m] and of a tip [m]; negative if all limits are kept.
    """
    joint = tip = -math.inf
    for k in range(len(position)):
        q = position[k]
        x, z = tip_position(m, q)
        tip = max(tip, compute_workspace_excess(m, x, z))
        for j in range(len(q)):
            joint = max(joint, m.joint_min[j] - q[j], q[j] - m.joint_max[j])
    return joint, tip


def find_first_violation(
    machine: Machine,
    trajectory: Trajectory,
    schedule: ModeSchedule,
    deadline: Deadline = NO_DEADLINE,
) -> Violation | None:
    """Find the first limit that a trajectory breaks under its mode schedule.

    Of all limits except obstacles, the violation that is first in time is returned. Obstacles are
    checked only if no other limit is broken, so an earlier contact may go unreported.

    Args:
        machine: Machine with its obstacles.
        trajectory: Joint trajectory of k points.
        schedule: Modes over time. They must change at the trajectory's points only.
        deadline: Instant at which the work is given up.

    Returns:
        Broken limit, time from the trajectory's start [s], and excess over the limit in its unit.
        None if no limit is broken.

    Raises:
        DeadlineError: The deadline passed.
    """
    modes = schedule.modes_at_many(trajectory.offset_ns[:-1] + schedule.stamp_ns)
    profile = compute_motion_profile(machine, *trajectory.points)
    ends, middles = (
        EndValues.from_profile(machine, profile, modes),
        compute_middle_profile(machine, trajectory),
    )
    return find_violation_between(machine, trajectory, ends, middles, deadline)


def find_violation_between(
    machine: Machine,
    trajectory: Trajectory,
    ends: EndValues,
    middles: MotionProfile,
    deadline: Deadline,
) -> Violation | None:
    """Find the first limit that a trajectory breaks at or between its points.

    The limits concern booster modules, joint positions, the tip's workspace, pumps and valves, and
    pressures. An interval between two points is skipped if bounds prove that it keeps all limits.
    All other intervals are checked at instants at most CHECK_SPACING apart. Obstacles are checked
    last, and only if no other limit is broken.

    Args:
        machine: Machine with its obstacles.
        trajectory: Joint trajectory of k points.
        ends: Quantities of the limits at the ends of the intervals between the points, with the
            modes of the intervals.
        middles: Profile (piston speeds and forces) at the middles of the intervals, from
            `compute_middle_profile`.
        deadline: Instant at which the work is given up.

    Returns:
        Broken limit, time from the trajectory's start [s], and excess over the limit in its unit.
        None if no limit is broken.

    Raises:
        DeadlineError: The deadline passed.
    """
    m, time = machine.arrays, trajectory.offset_ns / SECOND_NS
    points = trajectory.points
    middle = LimitValues.from_profile(machine, middles, ends.modes)
    quantities = ends.begin.values, middle.values, ends.end.values
    doubtful = _find_unproven_intervals(m, time, *points, *quantities)
    deadline.check(CHECK_TASK)
    for first in range(0, len(doubtful), ROWS_AT_ONCE):
        rows = doubtful[first : first + ROWS_AT_ONCE]
        found = _find_violation_within(machine, trajectory, ends.modes, rows)
        deadline.check(CHECK_TASK)
        if found is not None:
            return found
    return find_obstacle_violation(machine, trajectory)


def warm_up(machine: Machine) -> None:
    """Compile the kernels that check a motion between its points, at closely spaced instants.

    Args:
        machine: Machine for which a short motion at rest is checked once.
    """
    still = standstill(machine.arrays.joint_min).with_rest(MAX_POINT_SPACING_NS)
    normal = np.zeros((1, machine.joint_count), dtype=np.uint8)
    _find_violation_within(machine, still, normal, np.array([0]))


@kernel  # arrays, not one record: numba takes 1 µs to recognize a record, 3 % of the check
def _find_unproven_intervals(
    m: MachineArrays,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    begin: FloatArray,
    middle: FloatArray,
    end: FloatArray,
) -> IntArray:
    """Find the intervals between trajectory points that are not proven to keep all limits.

    An interval is proven under two conditions. First, an upper bound shows that no joint passes its
    limits by more than JOINT_TOLERANCE. Second, the bounded quantities satisfy one of these:

    - At both ends, every quantity is below `StateLimit.clear_below`, its limit minus a reserve.
    - Every quantity has an upper bound, computed from ends and middle, below
      `StateLimit.proven_below`.

    Args:
        m: Arrays of the machine.
        time: Times of the points, shape (k,) [s].
        position: Joint positions at the points, shape (k, n) [rad or m].
        velocity: Joint velocities at the points, shape (k, n) [rad/s or m/s].
        acceleration: Joint accelerations at the points, shape (k, n) [rad/s² or m/s²].
        begin: Quantities of the limits at the beginnings of the k - 1 intervals, one row for each
            limit of `STATE_LIMITS`, shape (limits, k - 1).
        middle: Quantities at the middles of the intervals, in the same shape.
        end: Quantities at the ends of the intervals, in the same shape.

    Returns:
        Indices of the intervals that are not proven, in ascending order.
    """
    beyond = bound_joint_excess(m, time, position, velocity, acceleration)
    rows, count = np.empty(len(beyond), dtype=np.int64), 0
    for k in range(len(beyond)):
        bounded = clear = True
        for i in range(_LIMIT_COUNT):
            bound = _bound_parabola(begin[i, k], middle[i, k], end[i, k])
            bounded &= bound < _PROVEN_BELOW[i]
            clear &= begin[i, k] < _CLEAR_BELOW[i] and end[i, k] < _CLEAR_BELOW[i]
        if not ((bounded or clear) and beyond[k] <= JOINT_TOLERANCE):
            rows[count] = k
            count += 1
    return rows[:count]


@kernel(borrows=True, forceinline=True)
def _bound_parabola(begin: float, middle: float, end: float) -> float:
    """Compute an upper bound on a quantity that varies nearly as a parabola over an interval.

    Let d be the distance of the middle value from the mean of the end values. A parabola through
    the three values exceeds the highest value by at most d/4. The bound is the highest value plus
    d, which allows for curves that are no parabola.

    Args:
        begin: Value at the beginning.
        middle: Value at the middle.
        end: Value at the end.

    Returns:
        Upper bound; inf or NaN if one of the values is infinite or NaN.
    """
    return max(begin, end, middle) + abs(middle - 0.5 * (begin + end))


def _find_violation_within(
    machine: Machine, trajectory: Trajectory, modes: ModeArray, rows: IntArray
) -> Violation | None:
    """Find the first violation of a limit within some intervals; obstacles are not checked.

    Each interval is checked at instants at most CHECK_SPACING (1 ms) apart.

    Args:
        machine: Machine with its hydraulics.
        trajectory: Joint trajectory of k points.
        modes: Mode codes of all intervals, shape (k - 1, n).
        rows: Indices of the intervals to check, in ascending order.

    Returns:
        Broken limit, time from the trajectory's start [s], and excess over the limit in its unit.
        None if no limit is broken.
    """
    time = trajectory.offset_ns / SECOND_NS
    motion = trajectory.points
    limit, at, amount = _find_first_broken_limit(machine.arrays, time, *motion, modes, rows)
    return None if limit < 0 else Violation(STATE_LIMITS[limit], at, amount)


@kernel
def _find_first_broken_limit(
    m: MachineArrays,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    modes: ModeArray,
    rows: IntArray,
) -> tuple[int, float, float]:
    """Find the first limit that is broken within some intervals between trajectory points.

    The limits of `STATE_LIMITS` are checked at instants at most CHECK_SPACING apart. If several
    limits are broken at one instant, the first of them in `STATE_LIMITS` is returned.

    Args:
        m: Arrays of the machine.
        time: Times of the points, shape (k,) [s].
        position: Joint positions at the points, shape (k, n) [rad or m].
        velocity: Joint velocities at the points, shape (k, n) [rad/s or m/s].
        acceleration: Joint accelerations at the points, shape (k, n) [rad/s² or m/s²].
        modes: Mode codes of all intervals, shape (k - 1, n).
        rows: Indices of the intervals to check, in ascending order.

    Returns:
        Index in `STATE_LIMITS`, time [s] and excess over the limit in its unit; (-1, 0, 0) if no
        limit is broken.
    """
    motion = position, velocity, acceleration
    for row in rows:
        h = time[row + 1] - time[row]
        looks = math.ceil(h / CHECK_SPACING) + 1
        shares = np.linspace(0.0, 1.0, looks)
        q, qd, qdd = sample_states_at_shares(time, *motion, np.full(looks, row), shares)
        held = np.empty((looks, modes.shape[1]), dtype=np.uint8)
        for k in range(looks):
            copy_row(held[k], modes[row])
        speed, force, tip, inertia = compute_profile_arrays(m, q, qd, qdd)
        values = _measure_states(m, q, speed, force, inertia, tip, held)
        for k in range(looks):
            for i in range(_LIMIT_COUNT):
                if values[i, k] > _BROKEN_ABOVE[i]:
                    return i, time[row] + shares[k] * h, values[i, k] - _LIMIT[i]
    return -1, 0.0, 0.0
