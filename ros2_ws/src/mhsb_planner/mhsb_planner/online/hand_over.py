"""Plan hand-over: the message of a new plan begins with what is left of the old one.

A command is a joint trajectory with its mode schedule. The stamp of the new command is the
planner's present time. Its new part begins one commit horizon later, at the change. Until then it
repeats the old curve, so that the receiver can take it over at any moment in between. All times are
in the time of plans: the arm's clock less the delay by which speed scaling has slowed plans.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.braking import MIN_POINT_SPACING_NS
from mhsb_model.command import MAX_HAND_OVER_JUMP, Command
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import MAX_POINT_SPACING_NS, MotionState, Trajectory
from mhsb_model.types import IntArray


@dataclass(frozen=True)
class HandOverTimes:
    """Times of a hand-over.

    Attributes:
        stamp_ns: Absolute time at which the new command begins [ns].
        change_ns: Absolute time at which it leaves the old command [ns].
    """

    stamp_ns: int
    change_ns: int


def choose_hand_over_times(in_force: Command, now_ns: int, commit_horizon_ns: int) -> HandOverTimes:
    """Choose the times of a hand-over that begins now or a few milliseconds later.

    The change comes `commit_horizon_ns` after the stamp. Points of a trajectory that are closer
    than `MIN_POINT_SPACING_NS` spoil the quintic between them. If an old point follows the stamp
    more closely, the stamp moves to that point. If an old point precedes the change more closely,
    stamp and change move on until it does not. The stamp is at least `MIN_POINT_SPACING_NS` after
    that of the old command.

    Args:
        in_force: Command that is to be replaced.
        now_ns: Earliest stamp, in the time of plans [ns].
        commit_horizon_ns: Commit horizon [ns].

    Returns:
        Stamp and change, in the time of plans [ns].

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
    """Build the command that repeats the one in force up to the change, then follows the new one.

    The old modes stay in force up to the change. If the old trajectory ends before, its last
    position is held until then.

    Args:
        in_force: Command that is replaced.
        times: Stamp of the result, and time at which it leaves `in_force`.
        new: Command that starts with the state of the old trajectory at the change. Its stamp is
            ignored.

    Returns:
        Joined command with the stamp `times.stamp_ns`.

    Raises:
        ValueError: Position or velocity of `new` differ from the old ones by more than
            `MAX_HAND_OVER_JUMP`.
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
    """Raise ValueError if a trajectory does not start in the state at which the old one is left.

    Position and velocity of each joint may differ by `MAX_HAND_OVER_JUMP`. Acceleration is not
    compared.

    Args:
        left: State of the old trajectory at the change.
        new: The new trajectory; its first point counts.
    """
    jump = max(
        float(np.abs(new.position[0] - left.position).max()),
        float(np.abs(new.velocity[0] - left.velocity).max()),
    )
    if not jump <= MAX_HAND_OVER_JUMP:
        raise ValueError(f"the new command starts {jump:.3g} rad or rad/s from where it leaves")


def _compute_stamp_delay(points: IntArray, stamp_ns: int, commit_horizon_ns: int) -> int:
    """Return by how much a stamp must be delayed to keep away from the old points.

    Args:
        points: Absolute times of the old trajectory's points, increasing, int64[k], [ns].
        stamp_ns: Proposed stamp [ns].
        commit_horizon_ns: Time from the stamp to the change [ns].

    Returns:
        Delay [ns]; 0 if the stamp can stay. After a delay the check must be repeated.
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
    """Return the times of the points that repeat the old command, before its change.

    They are the stamp and the points of the old trajectory between stamp and change. If the old
    trajectory ends before the change, its last position is held from there. Evenly spaced points,
    at most `MAX_POINT_SPACING_NS` apart, then fill the time of the hold.

    Args:
        old: Trajectory that is repeated.
        times: Stamp and change.

    Returns:
        Absolute times, increasing, int64[k], [ns]; the first is the stamp, the change is not
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
    """Join the old mode schedule up to the change with the new one.

    The result also has the time of each actuator's last mode switch before the stamp, from `old`.

    Args:
        old: Schedule that is in force up to the change.
        times: Stamp of the result, and change.
        new: Schedule whose first row begins at the change.

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
