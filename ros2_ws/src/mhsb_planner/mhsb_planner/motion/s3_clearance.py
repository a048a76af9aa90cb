"""Clearance of a joint motion from all obstacles, at every instant.

The method is conservative advancement. With the clearance c and all points of the arm slower than
V, nothing is touched for the time c/V. If that is less than a millisecond, the clearance is
checked every millisecond. It must then be at least half of the distance that any point moves in
this time, so that it is positive in between, too.
Source: Mirtich, Impulse-based Dynamic Simulation, 1996, Section 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import clearance, compute_leeway
from mhsb_model.trajectory import SECOND_NS, Trajectory, quintic_hermite
from mhsb_model.types import FloatArray, frozen

CLOSEST_LOOKS = 1e-3
"""Shortest time between two checks of the clearance [s]."""

START_LEEWAY = 1e-3
"""Clearance below which a start counts as in or at an obstacle [m].

A motion that starts so may get nearer to the obstacle, or deeper into it, by at most this distance.
The exception ends for good when the clearance is greater."""

REST_SPEED_LIMIT = 1e-9
"""Bound on the speed of the arm's points that is used for an arm at rest [m/s]."""


@dataclass(frozen=True)
class Contact:
    """First contact of a motion with an obstacle, or first possible contact.

    Attributes:
        time: Time from the start of the motion [s].
        clearance: Clearance at that time, negative inside the obstacle [m].
        name: Name of the obstacle.
    """

    time: float
    clearance: float
    name: str


def find_first_contact(machine: Machine, trajectory: Trajectory) -> Contact | None:
    """Find the first contact of a trajectory with an obstacle.

    An approach so close that a contact cannot be excluded counts as a contact. A motion that starts
    in an obstacle, or nearer to it than START_LEEWAY, may leave the obstacle. On the way out its
    clearance (negative inside) may fall by at most START_LEEWAY.

    Args:
        machine: Machine with its obstacles. They count without the margin that discrete paths keep.
        trajectory: Joint trajectory.

    Returns:
        Time of the contact from the trajectory's start [s], clearance then [m] and name of the
        obstacle. None if the motion is clear or there are no obstacles.
    """
    rows = machine.obstacles.rows
    if len(rows) == 0:
        return None
    time = trajectory.offset_ns / SECOND_NS
    motion = trajectory.position, trajectory.velocity, trajectory.acceleration
    at, distance, nearest = _first_contact(machine.arrays, rows, time, *motion)
    return None if nearest < 0 else Contact(at, distance, machine.obstacles.name(nearest))


def find_contact_ahead(machine: Machine, trajectory: Trajectory, now_ns: int) -> Contact | None:
    """Find the first contact with an obstacle in the remaining part of a trajectory.

    The check begins at the trajectory's last point at or before the given time. If this time is
    before the trajectory, the check begins at the first point. If it is after the end, nothing is
    left to check. Obstacles count without margin. If the arm is in an obstacle when the check
    begins, it may leave that obstacle.

    Args:
        machine: Machine with its obstacles.
        trajectory: Joint trajectory.
        now_ns: Absolute time, on the clock of the trajectory's stamp [ns].

    Returns:
        The contact, or None if there is none. Its time counts from the point where the check
        began.
    """
    here = int(np.searchsorted(trajectory.offset_ns, now_ns - trajectory.stamp_ns, "right")) - 1
    rest = slice(max(0, here), None)
    offset = trajectory.offset_ns[rest]
    motion = (trajectory.position, trajectory.velocity, trajectory.acceleration)
    left = Trajectory(now_ns, offset - offset[0], *(values[rest] for values in motion))
    return find_first_contact(machine, left)


def warm_up(machine: Machine) -> None:
    """Compile the kernels of this module, whether the machine has obstacles or not.

    Args:
        machine: Machine whose number of joints gives the argument types.
    """
    still = frozen(np.zeros((2, machine.joint_count)))
    _first_contact(
        machine.arrays, machine.obstacles.rows, np.array([0.0, 1.0]), still, still, still
    )


@kernel(borrows=True)
def _bound_point_speed(
    m: MachineArrays, h: float, i: int, position: FloatArray, velocity: FloatArray,
    acceleration: FloatArray,
) -> float:  # fmt: skip
    """Compute an upper bound on the speed of all points of the arm in one interval.

    Each joint moves as a quintic over h seconds. Its speed is at most 5/h times the largest
    difference of adjacent control points. For a turning joint this value is multiplied by the
    length of the stretched arm beyond the joint. The values of all joints are added.

    Args:
        m: Arrays of the machine.
        h: Duration of the interval [s].
        i: Index of the interval, from point i to point i + 1.
        position: Joint positions at the points, shape (k, n) [rad or m].
        velocity: Joint velocities, shape (k, n) [rad/s or m/s].
        acceleration: Joint accelerations, shape (k, n) [rad/s² or m/s²].

    Returns:
        Upper bound on the speed, at least REST_SPEED_LIMIT [m/s].
    """
    reach, fastest = 0.0, 0.0
    for j in range(position.shape[1] - 1, -1, -1):
        q0, q5 = position[i, j], position[i + 1, j]
        turn0, turn5 = 0.2 * h * velocity[i, j], 0.2 * h * velocity[i + 1, j]
        q1, q4 = q0 + turn0, q5 - turn5
        q2 = q0 + 2.0 * turn0 + 0.05 * h * h * acceleration[i, j]
        q3 = q5 - 2.0 * turn5 + 0.05 * h * h * acceleration[i + 1, j]
        apart = max(abs(q1 - q0), abs(q2 - q1), abs(q3 - q2), abs(q4 - q3), abs(q5 - q4))
        reach += m.link_length[j]
        if j == 0 and m.slews:
            reach += abs(m.slew_offset)
        if m.slides[j]:
            reach += max(q0, q1, q2, q3, q4, q5)
            fastest += 5.0 / h * apart
        else:
            fastest += 5.0 / h * apart * reach
    return max(fastest, REST_SPEED_LIMIT)


@kernel
def _first_contact(
    m: MachineArrays,
    rows: FloatArray,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
) -> tuple[float, float, int]:
    """Find the first contact of a joint motion with an obstacle by conservative advancement.

    An approach so close that a contact cannot be excluded counts as a contact. A motion may leave
    an obstacle if the start is in it, or nearer to it than START_LEEWAY. Until the clearance first
    exceeds START_LEEWAY, it may fall by at most START_LEEWAY.

    Test oracle: clearances at instants 0.2 ms apart.

    Args:
        m: Arrays of the machine.
        rows: Rows of the obstacles, `Obstacles.rows`.
        time: Times of the points, shape (k,) [s].
        position: Joint positions at the points, shape (k, n) [rad or m].
        velocity: Joint velocities, shape (k, n) [rad/s or m/s].
        acceleration: Joint accelerations, shape (k, n) [rad/s² or m/s²].

    Returns:
        Time of the contact [s], clearance at that time [m] and row of the obstacle; (0, 0, -1) if
        there is none. The clearance is negative inside the obstacle, and positive if the approach
        is only too close.
    """
    leeway = compute_leeway(m, rows, position[0], START_LEEWAY)
    inside = np.any(leeway > 0.0)
    n = position.shape[1]
    q = np.empty(n)
    free, needed = 0.0, 0.0  # distance until the next check; least clearance there [m]
    for i in range(len(time) - 1):
        h = time[i + 1] - time[i]
        speed = _bound_point_speed(m, h, i, position, velocity, acceleration)
        since = 0.0
        while since + free / speed < h:
            since += free / speed
            for j in range(n):
                start = (position[i, j], velocity[i, j], acceleration[i, j])
                end = (position[i + 1, j], velocity[i + 1, j], acceleration[i + 1, j])
                q[j], _, _ = quintic_hermite(since, h, start, end)
            if inside:  # an obstacle that has been left may not be entered again
                still = compute_leeway(m, rows, q, START_LEEWAY)
                for k in range(len(leeway)):
                    leeway[k] = leeway[k] if still[k] > 0.0 else 0.0
                inside = np.any(leeway > 0.0)
            distance, nearest = clearance(m, rows, q, leeway)
            shortest = speed * CLOSEST_LOOKS
            if distance < max(needed, 0.5 * shortest):
                return time[i] + since, distance - leeway[nearest], nearest
            free, needed = (distance, 0.0) if distance > shortest else (shortest, 0.5 * shortest)
        free -= speed * (h - since)
    return 0.0, 0.0, -1
