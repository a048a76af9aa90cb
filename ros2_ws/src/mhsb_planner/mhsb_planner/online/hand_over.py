"""Plan hand-over: the message of a new plan begins with what is left of the old one.

The stamp is the planner's now, the new part begins one lead later. Until then the
message repeats the old curve, so that the receiver can take it over at any moment in between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.braking import CLOSEST_POINTS_NS
from mhsb_model.command import Command
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import POINT_SPACING_NS, MotionState, Trajectory
from mhsb_model.types import IntArray

LARGEST_JUMP = 1e-6
"""Between the old command and the new one, of rounding [rad] and [rad/s]."""


@dataclass(frozen=True)
class ChangeOver:
    """When a new command begins (its stamp) and when it leaves the old one, absolute ns."""

    stamp_ns: int
    change_ns: int


def change_over(in_force: Command, now_ns: int, lead_ns: int) -> ChangeOver:
    """Times of a hand-over that begins now, or a few milliseconds later.

    Later where an old point would lie within CLOSEST_POINTS_NS after the stamp (the stamp then is
    that point's time) or before the change, and where the stamp would not increase.
    """
    if lead_ns < CLOSEST_POINTS_NS:
        raise ValueError(f"a lead of {lead_ns} ns is too short for a hand-over")
    old = in_force.trajectory
    points = old.stamp_ns + old.offset_ns
    stamp = max(now_ns, old.stamp_ns + CLOSEST_POINTS_NS)
    while True:
        wait = _wait(points, stamp, lead_ns)
        if wait == 0:
            return ChangeOver(stamp, stamp + lead_ns)
        stamp += wait


def hand_over(in_force: Command, times: ChangeOver, new: Command) -> Command:
    """The command that repeats `in_force` from the stamp to the change and then does `new`.

    new: starts with the old trajectory's state at the change; its own stamp does not matter.
    The old modes stay in force up to the change. After the old trajectory's end it holds.
    Raises ValueError where the new one starts elsewhere.
    """
    old = in_force.trajectory
    _check_continuity(old.sample(times.change_ns), new.trajectory)
    prefix_ns = _prefix_times(old, times)
    q, qd, qdd = old.sample_many(prefix_ns)
    late_ns = times.change_ns - times.stamp_ns
    trajectory = Trajectory(
        times.stamp_ns,
        np.concatenate([prefix_ns - times.stamp_ns, late_ns + new.trajectory.offset_ns]),
        np.vstack([q, new.trajectory.position]),
        np.vstack([qd, new.trajectory.velocity]),
        np.vstack([qdd, new.trajectory.acceleration]),
    )
    return Command(trajectory, _joined_schedule(in_force.schedule, times, new.schedule))


def _check_continuity(left: MotionState, new: Trajectory) -> None:
    jump = max(
        float(np.abs(new.position[0] - left.position).max()),
        float(np.abs(new.velocity[0] - left.velocity).max()),
    )
    if not jump <= LARGEST_JUMP:
        raise ValueError(f"the new command starts {jump:.3g} rad or rad/s from where it leaves")


def _wait(points: IntArray, stamp_ns: int, lead_ns: int) -> int:
    """How much later the stamp should be, ns; 0 where it is well apart from all old points."""
    after = points[np.searchsorted(points, stamp_ns, "left") :]
    if len(after) > 0 and 0 < after[0] - stamp_ns < CLOSEST_POINTS_NS:
        return int(after[0] - stamp_ns)
    change_ns = stamp_ns + lead_ns
    before = points[: np.searchsorted(points, change_ns, "left")]
    if len(before) > 0 and change_ns - before[-1] < CLOSEST_POINTS_NS:
        return int(CLOSEST_POINTS_NS - (change_ns - before[-1]))
    return 0


def _prefix_times(old: Trajectory, times: ChangeOver) -> IntArray:
    """The stamp, the old points up to the change, and where they have ended, points of the hold."""
    points = old.stamp_ns + old.offset_ns
    inside = points[(points > times.stamp_ns) & (points < times.change_ns)]
    kept = np.concatenate([[times.stamp_ns], inside])
    begin_ns = max(times.stamp_ns, old.end_ns)
    held_ns = max(0, times.change_ns - begin_ns)
    intervals = -(-held_ns // POINT_SPACING_NS)
    hold = begin_ns + held_ns * np.arange(1, intervals) // max(1, intervals)
    return np.concatenate([kept, hold]).astype(np.int64)


def _joined_schedule(
    old: ModeSchedule, times: ChangeOver, new: ModeSchedule
) -> ModeSchedule:
    rows = old.stamp_ns + old.offset_ns
    rows = rows[(rows > times.stamp_ns) & (rows < times.change_ns)]
    at_ns = np.concatenate([[times.stamp_ns], rows]).astype(np.int64)
    return ModeSchedule(
        times.stamp_ns,
        np.concatenate([at_ns, times.change_ns + new.offset_ns]) - times.stamp_ns,
        np.vstack([old.modes_at_many(at_ns), new.modes]),
        old.switched_ns(times.stamp_ns),
    )
