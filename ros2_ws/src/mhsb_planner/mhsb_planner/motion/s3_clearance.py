"""Clearance of a joint motion from all obstacles, at every instant.

The method is conservative advancement. If the clearance is c and no point of the arm is faster than
V, the arm touches nothing for the time c/V. The clearance is computed again after this time, but at
most once per millisecond. If c/V is shorter than a millisecond, c must be at least half of the
distance V · 1 ms. The clearance is then also positive between the checks.

Source: Mirtich, Impulse-based Dynamic Simulation, 1996, Section 2.
"""

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
"""Clearance below which an arm at the start counts as touching an obstacle [m].

The motion may then get nearer to this obstacle, or deeper into it, by at most this distance. As
soon as the clearance exceeds this distance, the obstacle counts like any other."""

REST_SPEED_LIMIT = 1e-9
"""Least bound on the speed of the arm's points [m/s], to avoid a division by 0 at rest."""


@dataclass(frozen=True)
class Contact:
    """First contact of a motion with an obstacle, or an approach too close to exclude a contact.

    Attributes:
        time: Time from the start of the motion [s].
        clearance: Distance between arm and obstacle at this time [m]. Negative inside the obstacle,
            positive if the approach is only too close.
        name: Name of the obstacle.
    """

    time: float
    clearance: float
    name: str


def find_first_contact(machine: Machine, trajectory: Trajectory) -> Contact | None:
    """Find the first contact of a trajectory with an obstacle.

    An approach so close that a contact cannot be excluded counts as a contact. A motion that starts
    in an obstacle, or nearer to it than START_LEEWAY, may leave the obstacle. Until it has left,
    the clearance (negative inside the obstacle) may fall by at most START_LEEWAY.

    Args:
        machine: Machine with its obstacles. The margin that discrete paths keep does not count.
        trajectory: Joint trajectory.

    Returns:
        Time of the contact from the trajectory's start [s], clearance at this time [m] and name of
        the obstacle. None if there is no contact.
    """
    rows = machine.obstacles.rows
    if len(rows) == 0:
        return None
    time = trajectory.offset_ns / SECOND_NS
    motion = trajectory.position, trajectory.velocity, trajectory.acceleration
    at, distance, nearest = _search_first_contact(machine.arrays, rows, time, *motion)
    return None if nearest < 0 else Contact(at, distance, machine.obstacles.name(nearest))


def find_contact_ahead(machine: Machine, trajectory: Trajectory, now_ns: int) -> Contact | None:
    """Find the first contact with an obstacle in the remaining part of a trajectory.

    The check begins at the trajectory's last point at or before `now_ns`, or else at its first
    point. After the end of the trajectory the result is None. The margin that discrete paths keep
    does not count. An arm that is in an obstacle when the check begins may leave the obstacle.

    Args:
        machine: Machine with its obstacles.
        trajectory: Joint trajectory.
        now_ns: Absolute time, on the clock of the trajectory's stamp [ns].

    Returns:
        The contact, or None if there is none. Its time counts from the point at which the check
        begins.
    """
    here = int(np.searchsorted(trajectory.offset_ns, now_ns - trajectory.stamp_ns, "right")) - 1
    rest = slice(max(0, here), None)
    offset = trajectory.offset_ns[rest]
    motion = (trajectory.position, trajectory.velocity, trajectory.acceleration)
    left = Trajectory(now_ns, offset - offset[0], *(values[rest] for values in motion))
    return find_first_contact(machine, left)


def warm_up(machine: Machine) -> None:
    """Compile the kernels of this module, even for a machine without obstacles.

    Args:
        machine: Machine whose number of joints gives the argument types.
    """
    still = frozen(np.zeros((2, machine.joint_count)))
    _search_first_contact(
        machine.arrays, machine.obstacles.rows, np.array([0.0, 1.0]), still, still, still
    )


@kernel(borrows=True)
def _bound_point_speed(
    m: MachineArrays, h: float, i: int, position: FloatArray, velocity: FloatArray,
    acceleration: FloatArray,
) -> float:  # fmt: skip
    """Compute an upper bound on the speed of all points of the arm in one interval.

    Each joint follows a polynomial of degree 5 over h seconds. Its speed is at most 5/h times the
    largest difference of adjacent Bézier control points. For a turning joint this speed is
    multiplied by the length of the stretched arm beyond the joint. The speeds of all joints are
    added.

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
def _search_first_contact(
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

    Tested against clearances at instants 0.2 ms apart.

    Args:
        m: Arrays of the machine.
        rows: One row of numbers for each obstacle, `Obstacles.rows`.
        time: Times of the points in ascending order, shape (k,) [s].
        position: Joint positions at the points, shape (k, n) [rad or m].
        velocity: Joint velocities, shape (k, n) [rad/s or m/s].
        acceleration: Joint accelerations, shape (k, n) [rad/s² or m/s²].

    Returns:
        Time of the contact [s], clearance at this time [m] and index of the obstacle's row;
        (0, 0, -1) if there is no contact. The clearance is negative inside the obstacle, and
        positive if the approach is only too close.
    """
    leeway = compute_leeway(m, rows, position[0], START_LEEWAY)
    inside = False
    for each in leeway:
        inside = inside or each > 0.0
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
                inside = False
                for k in range(len(leeway)):
                    leeway[k] = leeway[k] if still[k] > 0.0 else 0.0
                    inside = inside or leeway[k] > 0.0
            distance, nearest = clearance(m, rows, q, leeway)
            shortest = speed * CLOSEST_LOOKS
            if distance < max(needed, 0.5 * shortest):
                return time[i] + since, distance - leeway[nearest], nearest
            free, needed = (distance, 0.0) if distance > shortest else (shortest, 0.5 * shortest)
        free -= speed * (h - since)
    return 0.0, 0.0, -1
