"""Clearance of a joint motion from all obstacles, at every instant.

Conservative advancement: with clearance c and all points of the arm slower than V, nothing is
touched for c/V. Where that is less than a millisecond, the clearance is looked at every
millisecond, and must be at least half of what any point moves in it; then it is positive in
between, too. Source: Mirtich, Impulse-based Dynamic Simulation, 1996, Section 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import clearance, leeway_from
from mhsb_model.trajectory import SECOND_NS, Trajectory, quintic_hermite
from mhsb_model.types import FloatArray, frozen

CLOSEST_LOOKS = 1e-3  # s

START_LEEWAY = 1e-3
"""A motion that starts less than this from an obstacle, or in it, may get no nearer to it than
this, until it is farther away [m]."""

SLOWEST = 1e-9
"""Taken for an arm that rests [m/s]."""


@dataclass(frozen=True)
class Contact:
    """Where a motion gets to an obstacle, or too close to it to tell.

    time       s from the motion's start
    clearance  m then, negative in the obstacle
    name       of the obstacle
    """

    time: float
    clearance: float
    name: str


def first_contact(machine: Machine, trajectory: Trajectory) -> Contact | None:
    """The first contact of a trajectory with an obstacle, or None.

    A start in an obstacle may be left, but no deeper into it; see START_LEEWAY.
    """
    rows = machine.obstacles.rows
    if len(rows) == 0:
        return None
    time = trajectory.offset_ns / SECOND_NS
    motion = trajectory.position, trajectory.velocity, trajectory.acceleration
    at, distance, nearest = _first_contact(machine.arrays, rows, time, *motion)
    return None if nearest < 0 else Contact(at, distance, machine.obstacles.name(nearest))


def contact_ahead(machine: Machine, trajectory: Trajectory, now_ns: int) -> Contact | None:
    """The first contact in what is left of a trajectory at an absolute time, or None.

    It begins at the last point before; times are from there on.
    """
    here = int(np.searchsorted(trajectory.offset_ns, now_ns - trajectory.stamp_ns, "right")) - 1
    rest = slice(max(0, here), None)
    offset = trajectory.offset_ns[rest]
    motion = (trajectory.position, trajectory.velocity, trajectory.acceleration)
    left = Trajectory(now_ns, offset - offset[0], *(values[rest] for values in motion))
    return first_contact(machine, left)


def warm_up(machine: Machine) -> None:
    """Compile the kernels of this module, whether there are obstacles or not."""
    still = frozen(np.zeros((2, machine.joint_count)))
    _first_contact(
        machine.arrays, machine.obstacles.rows, np.array([0.0, 1.0]), still, still, still
    )


@kernel(borrows=True)
def _fastest(
    m: MachineArrays, h: float, i: int, position: FloatArray, velocity: FloatArray,
    acceleration: FloatArray,
) -> float:  # fmt: skip
    """No point of the arm is faster in interval i, of h seconds, of a trajectory [m/s].

    A quintic's speed is at most 5/h times the largest difference of its control points.
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
    return max(fastest, SLOWEST)


@kernel
def _first_contact(
    m: MachineArrays,
    rows: FloatArray,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
) -> tuple[float, float, int]:
    """Kernel of `first_contact`: time [s], clearance [m] and row, −1 where there is none.

    Oracle: clearances at instants a fifth of a millisecond apart.
    """
    leeway = leeway_from(m, rows, position[0], START_LEEWAY)
    inside = np.any(leeway > 0.0)
    n = position.shape[1]
    q = np.empty(n)
    free, needed = 0.0, 0.0  # way until the next look, least clearance there [m]
    for i in range(len(time) - 1):
        h = time[i + 1] - time[i]
        speed = _fastest(m, h, i, position, velocity, acceleration)
        since = 0.0
        while since + free / speed < h:
            since += free / speed
            for j in range(n):
                start = (position[i, j], velocity[i, j], acceleration[i, j])
                end = (position[i + 1, j], velocity[i + 1, j], acceleration[i + 1, j])
                q[j], _, _ = quintic_hermite(since, h, start, end)
            if inside:  # an obstacle that has been left may not be entered again
                still = leeway_from(m, rows, q, START_LEEWAY)
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
