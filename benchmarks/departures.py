"""Instants at which each executed plan branches off the one before it, from the messages alone."""

from __future__ import annotations

import numpy as np

from mhsb_model.trajectory import Trajectory, standstill
from mhsb_tools.recording.recording import Recording

SAME_POSITION = 1e-9
"""Largest difference of two joint positions that count as equal [rad or m]."""


def find_branch_time(old: Trajectory, new: Trajectory) -> int:
    """Return the instant at which a new trajectory branches off an old one.

    The points of the new trajectory are compared with the old one at the same times. The instant is
    the last point before the first one that differs by more than SAME_POSITION.

    Args:
        old: Trajectory that is followed before.
        new: Trajectory that follows `old` first and then leaves it.

    Returns:
        Absolute time [ns]. It is the first point of `new` if already that differs, and its last
        point if none does.
    """
    points_ns = new.stamp_ns + new.offset_ns
    apart = np.abs(new.position - old.sample_many(points_ns)[0]).max(axis=1) > SAME_POSITION
    first = int(np.argmax(apart)) if apart.any() else len(apart)
    return int(points_ns[max(0, first - 1)])


def find_branch_times(recording: Recording) -> dict[int, int]:
    """Return the instants at which executed plans branched off the plans executed before them.

    Before the first plan, and after the end of each plan, the arm holds its position. Plans that
    were in force but whose trajectory was not recorded are left out.

    Args:
        recording: The recording.

    Returns:
        Absolute time [ns] by the stamp of each executed plan, in the order of execution.
    """
    published = {each.stamp_ns: each for each in recording.trajectories}
    executed = [
        published[each.value] for each in recording.plans_in_force if each.value in published
    ]
    found: dict[int, int] = {}
    old = None
    for new in executed:
        found.setdefault(
            new.stamp_ns, find_branch_time(old or standstill(new.position[0], new.stamp_ns), new)
        )
        old = new
    return found
