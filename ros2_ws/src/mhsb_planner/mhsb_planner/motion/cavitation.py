"""Loads that empty inlet chambers (`mhsb_model.cavitation`) along motions and discrete paths."""

from __future__ import annotations

import numpy as np

from mhsb_model.cavitation import Cavitation, cavitating, cavitations
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_planner.motion.motion_profile import motion_profile
from mhsb_planner.motion.s3_limits import DEAD_BAND
from mhsb_planner.search.discrete_path import DiscretePath


def cavitations_of(machine: Machine, motion: Trajectory) -> tuple[Cavitation, ...]:
    """Of a motion under its static loads, at its points; one for each actuator that has any."""
    profile = motion_profile(machine, motion.position, motion.velocity)
    time = motion.offset_ns / SECOND_NS
    return cavitations(machine, time, profile.force, profile.speed, DEAD_BAND)


def cavitating_steps(machine: Machine, path: DiscretePath) -> np.ndarray:
    """In which of a path's k steps which actuator's inlet empties, bool[k, n].

    Looked at in the start, the middle and the end of every step in joint space.
    """
    start, end = path.posture[:-1], path.posture[1:]
    velocity = (end - start) / path.duration[:, None]
    empty = np.zeros(start.shape, dtype=bool)
    for share in (0.0, 0.5, 1.0):
        profile = motion_profile(machine, start + share * (end - start), velocity)
        empty |= cavitating(machine, profile.force, profile.speed, DEAD_BAND)
    return empty
