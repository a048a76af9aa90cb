"""Detection of cavitation along motions and discrete paths.

A cylinder cavitates if its load drives the piston faster than oil can fill the chamber behind it.
The criterion is in `mhsb_model.feasibility.cavitation`.
"""

import numpy as np

from mhsb_model.feasibility.cavitation import Cavitation, find_cavitating, summarize_cavitation
from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_planner.motion.motion_profile import compute_motion_profile
from mhsb_planner.search.discrete_path import DiscretePath


def find_cavitations(machine: Machine, motion: Trajectory) -> tuple[Cavitation, ...]:
    """Find the actuators that cavitate during a trajectory.

    An actuator cavitates if the load drives the piston faster than oil at the main pump's pressure
    fills the inlet chamber. Boost is neglected. Loads are gravity forces without inertia. Only the
    trajectory's points are checked, not the times between them. A piston up to the
    speed MAX_HELD_SPEED does not cavitate, since its closed valve holds it.

    Args:
        machine: Machine with its payload and hydraulics.
        motion: Joint trajectory.

    Returns:
        One entry for each actuator that cavitates; empty if none does. Times count from the start
        of the trajectory [s].
    """
    profile = compute_motion_profile(machine, motion.position, motion.velocity)
    time = motion.offset_ns / SECOND_NS
    return summarize_cavitation(machine, time, profile.force, profile.speed, MAX_HELD_SPEED)


def find_cavitating_steps(machine: Machine, path: DiscretePath) -> np.ndarray:
    """Find the steps of a discrete path in which an actuator cavitates.

    An actuator cavitates if the load drives the piston faster than oil at the main pump's pressure
    fills the inlet chamber. Boost is neglected. Loads are gravity forces without inertia. Joint
    velocities are taken as constant within a step. Each step is checked at three postures: start,
    middle and end. A piston up to the speed MAX_HELD_SPEED does not cavitate, since its closed
    valve holds it.

    Args:
        machine: Machine with its payload and hydraulics.
        path: Discrete path of k steps.

    Returns:
        Boolean array, shape (k, n), one row for each step and one column for each actuator. True if
        the actuator cavitates in at least one of the three postures.
    """
    start, end = path.posture[:-1], path.posture[1:]
    velocity = (end - start) / path.duration[:, None]
    empty = np.zeros(start.shape, dtype=bool)
    for share in (0.0, 0.5, 1.0):
        profile = compute_motion_profile(machine, start + share * (end - start), velocity)
        empty |= find_cavitating(machine, profile.force, profile.speed, MAX_HELD_SPEED)
    return empty
