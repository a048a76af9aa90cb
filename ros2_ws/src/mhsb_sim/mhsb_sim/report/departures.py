"""When each plan left the one before it, as anybody who hears both can tell."""

from __future__ import annotations

import numpy as np

from mhsb_model.trajectory import Trajectory, standstill
from mhsb_sim.recording.recording import Recording

SAME_POSITION = 1e-9
"""Positions of two curves that are this close are the same [rad]."""


def departure_ns(old: Trajectory, new: Trajectory) -> int:
    """Absolute time [ns] of the last point of `new` up to which it is the same curve as `old`."""
    points_ns = new.stamp_ns + new.offset_ns
    apart = np.abs(new.position - old.sample_many(points_ns)[0]).max(axis=1) > SAME_POSITION
    first = int(np.argmax(apart)) if apart.any() else len(apart)
    return int(points_ns[max(0, first - 1)])


def departures(recording: Recording) -> dict[int, int]:
    """Absolute times [ns] at which executed plans left the executed ones before them, by stamp.

    Before the first plan, and after each one's end, the arm holds its position.
    """
    published = {each.stamp_ns: each for each in recording.trajectories}
    executed = [
        published[each.value] for each in recording.plans_in_force if each.value in published
    ]
    found: dict[int, int] = {}
    old = None
    for new in executed:
        found.setdefault(
            new.stamp_ns, departure_ns(old or standstill(new.position[0], new.stamp_ns), new)
        )
        old = new
    return found
