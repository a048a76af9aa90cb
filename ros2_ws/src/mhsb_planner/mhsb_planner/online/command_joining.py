"""Hand-over of plans: a new command first repeats the old command, then deviates from it.

A command is a joint trajectory with its mode schedule. The new command begins at its stamp, the
planner's present time. One commit horizon later, at the change, it deviates from the old command.
Until the change, the new command repeats the old motion. So the arm can switch to the new command
at any time between stamp and change. All times are in the time of plans: the arm's clock minus the
delay that speed scaling has caused.
"""

from dataclasses import dataclass

import numpy as np

from mhsb_model.braking import MIN_POINT_SPACING_NS
from mhsb_model.command import MAX_HAND_OVER_JUMP, Command
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import MAX_POINT_SPACING_NS, MotionState, Trajectory
from mhsb_model.types import IntArray


@dataclass(frozen=True)
class HandOverTimes:
    """Times at which a new command takes over from an old command.

    Attributes:
        stamp_ns: Absolute time at which the new command begins, by repeating the old command [ns].
        change_ns: Absolute time from which on the new command deviates from the old command [ns].
    """

    stamp_ns: int
    change_ns: int


def choose_hand_over_times(in_force: Command, now_ns: int, commit_horizon_ns: int) -> HandOverTimes:
    """Choose the stamp and the change of a command that takes over from another command.

    The new command begins at its stamp and repeats the old command for `commit_horizon_ns`. The
    instant at which it leaves the old command is the change. Two trajectory points must not be
    closer than `MIN_POINT_SPACING_NS`, or the quintic between them is inaccurate. The stamp is
    therefore chosen in steps:

    1. The stamp is `now_ns`, but at least `MIN_POINT_SPACING_NS` after the old stamp.
    2. If an old point follows the stamp by less than this spacing, the stamp moves to this point.
    3. If an old point precedes the change by less than this spacing, stamp and change are delayed.

    Steps 2 and 3 are repeated until no old point is too near.

    Args:
        in_force: Command that is to be replaced. Only `trajectory` is read.
        now_ns: Earliest stamp, by the clock of the stamp of `in_force` [ns].
        commit_horizon_ns: Commit horizon (time from stamp to change) [ns].

    Returns:
        Stamp and change, by the same clock [ns].

    Raises:
        ValueError: The commit horizon is shorter than `MIN_POINT_SPACING_NS`.
    """
    if commit_horizon_ns < MIN_POINT_SPACING_NS:
        raise ValueError(f"a lead of {commit_horizon_ns} ns is too short for a hand-over")
    old = in_force.trajectory
    points = old.stamp_ns + old.offset_ns
    stamp = max(now_ns, old.stamp_ns + MIN_POINT_SPACING_NS)
    while True:
        wait = _compute_stamp_delay(points, stamp, commit_horizon_ns)
        if wait == 0:
            return HandOverTimes(stamp, stamp + commit_horizon_ns)
        stamp += wait


def join_commands(in_force: Command, times: HandOverTimes, new: Command) -> Command:
    """Build a command that repeats the command in force, then follows a new command.

    The change is the time between both parts. The old modes stay in force up to the change. If the
    old trajectory ends before the change, its last position is held until the change.

    Args:
        in_force: Command that is replaced.
        times: Stamp of the result, and change (time at which it deviates from `in_force`).
        new: Command for the time from the change on. It must start with the state of the old
            trajectory at the change. The stamp of `new` is ignored.

    Returns:
        Joined command with the stamp `times.stamp_ns`.

    Raises:
        ValueError: Position or velocity at the change differ by more than `MAX_HAND_OVER_JUMP`.
    """
    old = in_force.trajectory
    _check_continuity(old.sample(times.change_ns), new.trajectory)
    prefix_ns = _compute_prefix_times(old, times)
    q, qd, qdd = old.sample_many(prefix_ns)
    late_ns = times.change_ns - times.stamp_ns
    trajectory = Trajectory(
        times.stamp_ns,
        np.concatenate([prefix_ns - times.stamp_ns, late_ns + new.trajectory.offset_ns]),
        np.vstack([q, new.trajectory.position]),
        np.vstack([qd, new.trajectory.velocity]),
        np.vstack([qdd, new.trajectory.acceleration]),
    )
    return Command(trajectory, _join_schedules(in_force.schedule, times, new.schedule))


def _check_continuity(left: MotionState, new: Trajectory) -> None:
    """Check that a trajectory starts with a given position and velocity.

    Args:
        left: State of the old trajectory at the change.
        new: The new trajectory; its first point is compared. Accelerations are not compared.

    Raises:
        ValueError: Position or velocity of a joint differ by more than `MAX_HAND_OVER_JUMP`.
    """
    jump = max(
        float(np.abs(new.position[0] - left.position).max()),
        float(np.abs(new.velocity[0] - left.velocity).max()),
    )
    if not jump <= MAX_HAND_OVER_JUMP:
        raise ValueError(f"the new command starts {jump:.3g} rad or rad/s from where it leaves")


def _compute_stamp_delay(points: IntArray, stamp_ns: int, commit_horizon_ns: int) -> int:
    """Compute the delay of a stamp that keeps old trajectory points away from stamp and change.

    No old point may be less than `MIN_POINT_SPACING_NS` after the stamp or before the change. The
    change is the time at which the new command deviates from the old command.

    Args:
        points: Absolute times of the old trajectory's points, increasing, int64[k], [ns].
        stamp_ns: Proposed stamp [ns].
        commit_horizon_ns: Time from the stamp to the change [ns].

    Returns:
        Delay [ns]; 0 if the stamp can stay. A delayed stamp must be checked again.
    """
    after = points[np.searchsorted(points, stamp_ns, "left") :]
    if len(after) > 0 and 0 < after[0] - stamp_ns < MIN_POINT_SPACING_NS:
        return int(after[0] - stamp_ns)
    change_ns = stamp_ns + commit_horizon_ns
    before = points[: np.searchsorted(points, change_ns, "left")]
    if len(before) > 0 and change_ns - before[-1] < MIN_POINT_SPACING_NS:
        return int(MIN_POINT_SPACING_NS - (change_ns - before[-1]))
    return 0


def _compute_prefix_times(old: Trajectory, times: HandOverTimes) -> IntArray:
    """Compute the times of the points at which a new command repeats the old command.

    The times are the stamp, and those of all points of the old trajectory between stamp and change.
    If the old trajectory ends before the change, its last position is held until the change, with
    evenly spaced points at most `MAX_POINT_SPACING_NS` apart.

    Args:
        old: Trajectory that is repeated.
        times: Stamp of the new command, and change (time at which it deviates from the old
            command).

    Returns:
        Absolute times in ascending order, int64[k], [ns]. The first is the stamp. The change is not
        included.
    """
    points = old.stamp_ns + old.offset_ns
    inside = points[(points > times.stamp_ns) & (points < times.change_ns)]
    kept = np.concatenate([[times.stamp_ns], inside])
    begin_ns = max(times.stamp_ns, old.end_ns)
    held_ns = max(0, times.change_ns - begin_ns)
    intervals = -(-held_ns // MAX_POINT_SPACING_NS)
    hold = begin_ns + held_ns * np.arange(1, intervals) // max(1, intervals)
    return np.concatenate([kept, hold]).astype(np.int64)


def _join_schedules(old: ModeSchedule, times: HandOverTimes, new: ModeSchedule) -> ModeSchedule:
    """Join an old mode schedule up to the change with a new mode schedule from the change on.

    The result also stores the time of each actuator's last switch before the stamp, from `old`.

    Args:
        old: Schedule that is in force up to the change.
        times: Stamp of the result, and change (time at which the new command deviates from the old
            command).
        new: Schedule whose first row begins at the change; its stamp is ignored.

    Returns:
        Joined schedule with the stamp `times.stamp_ns`.
    """
    rows = old.stamp_ns + old.offset_ns
    rows = rows[(rows > times.stamp_ns) & (rows < times.change_ns)]
    at_ns = np.concatenate([[times.stamp_ns], rows]).astype(np.int64)
    return ModeSchedule(
        times.stamp_ns,
        np.concatenate([at_ns, times.change_ns + new.offset_ns]) - times.stamp_ns,
        np.vstack([old.modes_at_many(at_ns), new.modes]),
        old.find_last_switches(times.stamp_ns),
    )
