"""Braking along the path of a motion, ever harder, up to the machine's limits.

q(t) = Q(σ(t)) with the motion Q in force; its pace σ̇ falls from 1 to 0 by a ramp (`s3_ramps`), so
that σ(T) = T/2. The pistons then decelerate by about |v|/T₁ and jerk by |v|/(T₁T₂), v being the
fastest piston's speed. `mhsb_model.braking` brakes by another curve, with a low deceleration.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mhsb_model.braking import CLOSEST_POINTS_NS, slowed_along
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_planner.motion.motion_profile import motion_profile
from mhsb_planner.motion.s3_ramps import SHARE, Ramp, ramp_at, shortest_ramp
from mhsb_planner.motion.trajectory_points import point_times

SHARES = (0.5, 0.75, 1.0)
"""Shares of the machine's acceleration and jerk that are tried one after the other.

At least `s3_ramps.SHARE`. Finer steps brake a little softer and take longer to try.
"""

ROUNDS = 6
"""How often a ramp is made slower before it is given up."""

TOLERANCE = 1.01
"""Accelerations and jerks beyond their limits by less come from their numerical differences."""

LOOK_NS = 4_000_000
"""Spacing of the speeds from whose differences accelerations and jerks are taken [ns]."""


def ever_harder_brakings(
    machine: Machine, trajectory: Trajectory, at_ns: int
) -> Iterator[Trajectory]:
    """Yield motions that come to rest along a trajectory's path, each sooner than the one before.

    No piston accelerates or jerks more than the machine allows, or than the trajectory itself
    does on the same stretch, as a polynomial may. If no braking keeps that, since the trajectory
    takes all that is allowed already, a ramp's `SHARE` comes on top. Pressures and obstacles are
    not looked at.

    Args:
        machine: Its piston accelerations and jerks are the limits.
        trajectory: The motion in force.
        at_ns: Absolute time at which it is left [ns].

    Yields:
        Braking motions with the stamp `at_ns`, which rest before the trajectory ends; none where
        it ends at once or rests.
    """
    left = (trajectory.end_ns - at_ns) / SECOND_NS
    start = trajectory.sample(at_ns)
    if left * SECOND_NS < CLOSEST_POINTS_NS or not start.velocity.any():
        return
    speed = np.abs(machine.moment_arms(start.position) * start.velocity).max()
    way = left
    for slack in (0.0, SHARE):
        for share in SHARES:
            ramp = shortest_ramp(machine, speed * SHARE / share)
            found = _slow_enough(machine, trajectory, at_ns, ramp, slack)
            if found is not None and 0.5 * found.duration_ns / SECOND_NS < way:
                way = 0.5 * found.duration_ns / SECOND_NS
                yield found
        if way < left:
            return


def _slow_enough(
    machine: Machine, trajectory: Trajectory, at_ns: int, ramp: Ramp, slack: float
) -> Trajectory | None:
    """Return the braking by a ramp, made slower until it keeps the limits; None if none does.

    Args:
        machine: Its piston accelerations and jerks are the limits.
        trajectory: The motion in force.
        at_ns: Absolute time at which it is left [ns].
        ramp: The first ramp to be tried.
        slack: Share of the machine's limits that is allowed on top.
    """
    for _ in range(ROUNDS):
        braking = _braking(trajectory, at_ns, ramp)
        limits = _limits(machine, trajectory, at_ns, braking.duration_ns // 2, slack)
        peaks = _peaks(machine, braking, at_ns, braking.duration_ns)
        acceleration, jerk = peaks[0] / limits[0], peaks[1] / limits[1]
        if max(acceleration, jerk) <= TOLERANCE:
            return braking
        ramp = ramp.slower(max(1.0, acceleration), max(1.0, jerk / max(1.0, acceleration)))
    return None


def _braking(trajectory: Trajectory, at_ns: int, ramp: Ramp) -> Trajectory:
    """Return the motion along a trajectory's path whose pace falls from 1 to 0 by a ramp."""
    breaks = np.unique([0.0, ramp.blend, ramp.rise, ramp.duration])
    offset_ns = point_times(breaks)
    time = offset_ns / SECOND_NS
    lost, share, rate = np.array([ramp_at(ramp.rise, ramp.blend, t) for t in time]).T
    return slowed_along(trajectory, at_ns, offset_ns, time - lost, 1.0 - share, -rate)


def _limits(
    machine: Machine, trajectory: Trajectory, at_ns: int, duration_ns: int, slack: float
) -> tuple[float, float]:
    """Return the largest acceleration [m/s²] and jerk [m/s³] that braking pistons may have.

    They are the machine's, or those of the trajectory in `duration_ns` after `at_ns` where these
    are larger: what follows the same stretch cannot begin gentler than what it leaves. `slack`
    times the machine's come on top.
    """
    m, own = machine.arrays, _peaks(machine, trajectory, at_ns, duration_ns)
    highest, steepest = m.max_piston_acceleration, m.max_piston_jerk
    return max(highest, own[0]) + slack * highest, max(steepest, own[1]) + slack * steepest


def _peaks(
    machine: Machine, motion: Trajectory, at_ns: int, duration_ns: int
) -> tuple[float, float]:
    """Return the largest acceleration [m/s²] and jerk [m/s³] of a piston in a stretch of a motion.

    Args:
        machine: Gives the pistons' motion.
        motion: The motion of the joints.
        at_ns: Absolute time at which the stretch begins [ns].
        duration_ns: How long it lasts [ns].
    """
    looks = max(3, duration_ns // LOOK_NS)
    offset_ns = np.linspace(0, duration_ns, looks, dtype=np.int64)
    position, velocity, _ = motion.sample_many(at_ns + offset_ns)
    speed = motion_profile(machine, position, velocity).speed
    step = duration_ns / SECOND_NS / (looks - 1)
    acceleration = np.abs(np.diff(speed, axis=0)).max() / step
    jerk = np.abs(np.diff(speed, n=2, axis=0)).max() / step**2
    return float(acceleration), float(jerk)
