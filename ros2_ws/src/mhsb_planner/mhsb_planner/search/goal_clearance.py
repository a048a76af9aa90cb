"""Obstacle checks of start and goal.

A goal is refused if the arm would be in an obstacle at the goal, or nearer to an obstacle than the
margin. A start in an obstacle is only described.
"""

import numpy as np

from mhsb_model.goal import format_distance
from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import (
    clearances,
    tip_clearance,
    tip_clearance_in_space,
)
from mhsb_model.obstacles.zones import Zones
from mhsb_model.types import FloatArray, Position, frozen
from mhsb_planner.errors import ZoneError, place_text

CONTACT_CLEARANCE = 5e-4
"""Largest clearance at which the arm touches an obstacle, and least depth at which it is inside
[m].

Motions that keep clear of obstacles stay farther away than this.
"""


def describe_start_contact(machine: Machine, posture: FloatArray) -> str:
    """Describe the obstacle that the arm touches or intersects in its start posture.

    A start in an obstacle is allowed, because a zone may be set where the arm is. The arm may then
    leave the zone.

    Args:
        machine: Machine with its obstacles.
        posture: Joint positions, shape (n,) [rad or m].

    Returns:
        A clause such as "the arm touches zone 1 at the start" or "the arm starts 0.1 m deep in zone
        1". Empty if the clearance is greater than CONTACT_CLEARANCE.
    """
    if len(machine.obstacles.rows) == 0:
        return ""
    clearance, name = machine.clearance(posture)
    if clearance > CONTACT_CLEARANCE:
        return ""
    return (
        f"the arm starts {format_distance(-clearance)} deep in {name}"
        if clearance < -CONTACT_CLEARANCE
        else (f"the arm touches {name} at the start")
    )


def check_tip_clearance(machine: Machine, goal: Position) -> None:
    """Check that the tip alone keeps the margin from all obstacles at a goal.

    No posture is needed for this check. Without obstacles it does nothing. If the arm slews, zones
    in space are checked in addition to obstacles in the arm's plane.

    Args:
        machine: Machine with its obstacles and margin.
        goal: Tip position in `base_link`, (x, z) or, if the arm slews, (x, y, z) [m].

    Raises:
        OutOfWorkspaceError: The slew's limits do not allow the goal.
        ZoneError: The tip is nearer to an obstacle than the margin. For obstacles that hold for the
            whole arm, the radius of the last link is added to the margin.
    """
    rows, margin = machine.obstacles.path_rows, machine.config.keep_out.margin
    if len(rows) == 0:
        return
    n = machine.joint_count
    beyond, nearest = tip_clearance(rows, n, *machine.convert_to_plane(goal, 0.0).tip)
    if machine.slews:
        x, y, z = goal
        in_space = tip_clearance_in_space(rows, n, x, y, z)
        beyond, nearest = min((beyond, nearest), in_space)
    if beyond < 0.0:
        distance = beyond + margin
        where = f"{format_distance(abs(distance))} {'deep in' if distance < 0.0 else 'from'}"
        raise ZoneError(
            f"at {place_text(goal)} the tip is {where} {machine.obstacles.name(nearest)}; "
            f"a goal must leave it {format_distance(margin)} away",
        )


def find_clear_postures(machine: Machine, x: float, z: float, posture: FloatArray) -> np.ndarray:
    """Find the postures at a goal in which the arm keeps the margin from all obstacles.

    Args:
        machine: Machine with its obstacles and margin.
        x: Tip position of all postures, forward [m]; only for the error message.
        z: Tip position of all postures, upward [m]; only for the error message.
        posture: Joint positions of at least one posture, shape (count, n) [rad or m].

    Returns:
        True for each posture that keeps the margin, bool, shape (count,). All True if the machine
        has no obstacles.

    Raises:
        ZoneError: No posture keeps the margin.
    """
    rows = machine.obstacles.path_rows
    if len(rows) == 0:
        return np.ones(len(posture), dtype=bool)
    distance, nearest = clearances(machine.arrays, rows, frozen(posture))
    clear = distance >= 0.0
    if not clear.any():
        best = nearest[np.argmax(distance)]
        raise ZoneError(
            f"in every posture that this planner takes with the tip at ({x:.4g}, {z:.4g}) m "
            f"the arm is less than {format_distance(machine.config.keep_out.margin)} from an "
            f"obstacle, at best from {machine.obstacles.name(best)}; give another goal",
        )
    return clear


def warm_up(machine: Machine) -> None:
    """Compile the clearance kernels and the check of zones, even for a machine without obstacles.

    Args:
        machine: Machine whose number of joints gives the argument types.
    """
    rows, n = machine.obstacles.path_rows, machine.joint_count
    tip_clearance(rows, n, 0.0, 0.0)
    tip_clearance_in_space(rows, n, 0.0, 0.0, 0.0)
    clearances(machine.arrays, rows, frozen(np.zeros((1, n))))
    machine.changed(zones=Zones(circles=((0.5, 0.5, 0.01),)))  # checks its place
