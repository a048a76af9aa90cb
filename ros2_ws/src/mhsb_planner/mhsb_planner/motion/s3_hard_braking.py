"""Ever harder braking along the path of a motion, up to the machine's limits.

The braking is q(t) = Q(σ(t)) with the motion Q in force. The rate σ̇ falls from 1 to 0 by a ramp
(`s3_ramps`) of the duration T = T₁ + T₂, so that σ(T) = T/2. The pistons then have about the
deceleration |v|/T₁ and the jerk |v|/(T₁T₂), with the speed v of the fastest piston. The softer
braking of `mhsb_model.braking` uses another curve.
"""

from collections.abc import Iterator

import numpy as np

from mhsb_model.braking import MIN_POINT_SPACING_NS, retime_along
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_planner.motion.motion_profile import compute_motion_profile
from mhsb_planner.motion.s3_ramps import (
    RAMP_LIMIT_SHARE,
    Ramp,
    compute_shortest_ramp,
    evaluate_ramp,
)
from mhsb_planner.motion.trajectory_points import choose_point_times

LIMIT_SHARES = (0.5, 0.75, 1.0)
"""Shares of the allowed acceleration and jerk that are tried one after the other [-].

No share is below `s3_ramps.RAMP_LIMIT_SHARE`. More shares would allow slightly softer braking, but
take more time."""

MAX_SLOWING_ROUNDS = 6
"""Number of times that a ramp is made slower before the trial is given up."""

DIFFERENCE_TOLERANCE = 1.01
"""Factor on the limits; an excess up to this factor counts as an error of numerical differences
[-].
"""

LOOK_NS = 4_000_000
"""Sampling time of the piston speeds, whose differences give accelerations and jerks [ns]."""


def iterate_harder_brakings(
    machine: Machine, trajectory: Trajectory, at_ns: int
) -> Iterator[Trajectory]:
    """Yield motions that brake along a trajectory's path, each harder than the previous motion.

    The pistons keep the machine's limits of acceleration and jerk. If the trajectory itself exceeds
    a limit on the same stretch of its path, its own peak is the limit. One braking is computed for
    each share in LIMIT_SHARES, with about this share of the machine's limits. It is
    yielded if it stops on a shorter stretch of the path than all before. If no braking keeps the
    limits, they are raised by RAMP_LIMIT_SHARE of the machine's limits for a second trial.
    Pressures and obstacles are not checked.

    Args:
        machine: Machine whose piston acceleration and jerk are the limits.
        trajectory: Motion in force.
        at_ns: Absolute time at which the braking begins [ns].

    Yields:
        Braking motions with the stamp `at_ns`, at which they begin. They come to rest before the
        end of the trajectory's path. Nothing is yielded if the trajectory has ended or the arm
        rests at `at_ns`, or if no braking keeps the raised limits.
    """
    left = (trajectory.end_ns - at_ns) / SECOND_NS
    start = trajectory.sample(at_ns)
    if left * SECOND_NS < MIN_POINT_SPACING_NS or not start.velocity.any():
        return
    speed = np.abs(machine.moment_arms(start.position) * start.velocity).max()
    way = left
    for slack in (0.0, RAMP_LIMIT_SHARE):
        for share in LIMIT_SHARES:
            ramp = compute_shortest_ramp(machine, speed * RAMP_LIMIT_SHARE / share)
            found = _find_braking_within_limits(machine, trajectory, at_ns, ramp, slack)
            if found is not None and 0.5 * found.duration_ns / SECOND_NS < way:
                way = 0.5 * found.duration_ns / SECOND_NS
                yield found
        if way < left:
            return


def _find_braking_within_limits(
    machine: Machine, trajectory: Trajectory, at_ns: int, ramp: Ramp, slack: float
) -> Trajectory | None:
    """Compute a braking motion along a trajectory, within the limits of acceleration and jerk.

    Each limit is the larger of two values: the machine's limit, and the trajectory's own peak on
    the stretch where the arm brakes.

    Args:
        machine: Machine whose piston acceleration and jerk are the limits.
        trajectory: Motion in force.
        at_ns: Absolute time at which the braking begins [ns].
        ramp: First ramp by which the rate along the path falls from 1 to 0. It is made slower until
            the limits are kept.
        slack: Share of the machine's limits that is added to the limits [-].

    Returns:
        The braking motion, or None if the limits are still exceeded after MAX_SLOWING_ROUNDS ramps.
    """
    for _ in range(MAX_SLOWING_ROUNDS):
        braking = _compute_braking(trajectory, at_ns, ramp)
        limits = _determine_limits(machine, trajectory, at_ns, braking.duration_ns // 2, slack)
        peaks = _measure_peaks(machine, braking, at_ns, braking.duration_ns)
        acceleration, jerk = peaks[0] / limits[0], peaks[1] / limits[1]
        if max(acceleration, jerk) <= DIFFERENCE_TOLERANCE:
            return braking
        ramp = ramp.scale(max(1.0, acceleration), max(1.0, jerk / max(1.0, acceleration)))
    return None


def _compute_braking(trajectory: Trajectory, at_ns: int, ramp: Ramp) -> Trajectory:
    """Compute the braking along a trajectory's path whose rate falls from 1 to 0 by a ramp.

    Args:
        trajectory: Motion in force.
        at_ns: Absolute time at which the braking begins [ns].
        ramp: Ramp by which the rate falls. The rate is the speed along the path as a multiple of
            the trajectory's speed.

    Returns:
        Motion with the stamp `at_ns` that lasts as long as the ramp.
    """
    breaks = np.unique([0.0, ramp.blend, ramp.rise, ramp.duration])
    offset_ns = choose_point_times(breaks)
    time = offset_ns / SECOND_NS
    lost, share, rate = np.array([evaluate_ramp(ramp.rise, ramp.blend, t) for t in time]).T
    return retime_along(trajectory, at_ns, offset_ns, time - lost, 1.0 - share, -rate)


def _determine_limits(
    machine: Machine, trajectory: Trajectory, at_ns: int, duration_ns: int, slack: float
) -> tuple[float, float]:
    """Determine the acceleration and jerk that braking pistons may have.

    Each limit is the larger of the machine's limit and the trajectory's own peak during a time
    span. `slack` times the machine's limit is added to each.

    Args:
        machine: Machine whose limits apply.
        trajectory: Motion in force.
        at_ns: Absolute time at which the time span begins [ns].
        duration_ns: Duration of the time span [ns].
        slack: Share of the machine's limit that is added to each limit [-].

    Returns:
        Largest acceleration [m/s²] and jerk [m/s³].
    """
    m, own = machine.arrays, _measure_peaks(machine, trajectory, at_ns, duration_ns)
    highest, steepest = m.max_piston_acceleration, m.max_piston_jerk
    return max(highest, own[0]) + slack * highest, max(steepest, own[1]) + slack * steepest


def _measure_peaks(
    machine: Machine, motion: Trajectory, at_ns: int, duration_ns: int
) -> tuple[float, float]:
    """Compute the largest piston acceleration and jerk in a stretch of a motion.

    The peaks are those of first and second differences of piston speeds, sampled about every
    LOOK_NS.

    Args:
        machine: Machine that converts joint to piston motion.
        motion: Motion of the joints.
        at_ns: Absolute time at which the time span begins [ns].
        duration_ns: Duration of the time span [ns].

    Returns:
        Largest acceleration [m/s²] and jerk [m/s³] over all pistons.
    """
    looks = max(3, duration_ns // LOOK_NS)
    offset_ns = np.linspace(0, duration_ns, looks, dtype=np.int64)
    position, velocity, _ = motion.sample_many(at_ns + offset_ns)
    speed = compute_motion_profile(machine, position, velocity).speed
    step = duration_ns / SECOND_NS / (looks - 1)
    acceleration = np.abs(np.diff(speed, axis=0)).max() / step
    jerk = np.abs(np.diff(speed, n=2, axis=0)).max() / step**2
    return float(acceleration), float(jerk)
