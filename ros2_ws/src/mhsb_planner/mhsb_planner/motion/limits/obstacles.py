"""Limit of the clearance from obstacles, checked along the whole motion (`s3_clearance`).

The clearance c of the arm, without margin, stays positive: c > 0. A motion that starts in an
obstacle may leave it.
"""

from mhsb_model.machine import Machine
from mhsb_model.trajectory import Trajectory
from mhsb_planner.motion.limits.limit import Limit, Violation
from mhsb_planner.motion.s3_clearance import find_first_contact

OBSTACLE_LIMIT = Limit(
    name="obstacles",
    describe=lambda broken: f"the arm gets to {broken.name}",
)
"""Limit of the clearance. The amount of a violation is the depth in the obstacle [m].

The amount is negative if the arm is outside, but too close to exclude a contact."""


def find_obstacle_violation(machine: Machine, trajectory: Trajectory) -> Violation | None:
    """Find the first obstacle that the arm touches along a trajectory.

    The margin that discrete paths keep does not count. If the arm comes so close that a contact
    cannot be excluded, this counts as a contact. A motion that starts in an obstacle may leave it.

    Args:
        machine: Machine with its obstacles.
        trajectory: Joint trajectory.

    Returns:
        The violation, with time, depth [m] and name of the obstacle. None if the arm touches no
        obstacle.
    """
    contact = find_first_contact(machine, trajectory)
    if contact is None:
        return None
    return Violation(OBSTACLE_LIMIT, contact.time, -contact.clearance, contact.name)
