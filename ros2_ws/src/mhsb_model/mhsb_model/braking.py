"""Braking: motions that come to rest smoothly.

There are two methods: braking along a known path, and braking from a state without a path. Both are
continuous up to the acceleration. Braking is used for a planned stop, and for a new plan that must
first reverse the present motion.
"""

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.trajectory import (
    MAX_POINT_SPACING_NS,
    SECOND_NS,
    MotionState,
    Trajectory,
    standstill,
)
from mhsb_model.types import FloatArray, IntArray

PEAK_DECELERATION = 0.05
"""Peak deceleration of the pistons [m/s²]; from 12 mm/s the arm then stops within 0.36 s."""

MIN_BRAKING_NS = 60_000_000
"""Shortest duration of a braking motion [ns]."""

MIN_POINT_SPACING_NS = 1_000_000
"""Shortest time between two points [ns]. The quintic of a shorter piece is numerically useless."""


def brake_along(machine: Machine, trajectory: Trajectory, at_ns: int) -> Trajectory:
    """Compute a motion that comes to rest on the path of a trajectory.

        q(t) = Q(σ(t)),  σ̇ = 1 − 3u² + 2u³,  u = t/T

    Q is the trajectory, and t the time since `at_ns`. σ is the time that has passed on Q; it slows
    down from the rate σ̇ = 1 to 0 within the braking time T. So the arm passes only postures of Q,
    and passes none of them faster than Q does. The arm comes to rest at σ(T) = T/2. Position,
    velocity and acceleration are continuous. T is chosen so that the fastest piston decelerates by
    at most about `PEAK_DECELERATION`.

    There are three special cases:

    - If velocity and acceleration of Q are 0 at `at_ns`, the result stands still.
    - If less than `MIN_POINT_SPACING_NS` is left of Q, each joint brakes on its own (`brake_from`).
    - If at least `MIN_POINT_SPACING_NS`, but at most T, is left of Q, the arm does not brake. The
      result is then the rest of Q, with velocity 0 at its last point.

    Args:
        machine: The machine, for the moment arms of its cylinders.
        trajectory: The motion Q to brake on.
        at_ns: Absolute time at which braking begins [ns].

    Returns:
        The braking motion; its stamp is `at_ns`.

    Source:
        Path-velocity decomposition, Siciliano et al., Robotics, section 4.3.
    """
    start = trajectory.sample(at_ns)
    if not (start.velocity.any() or start.acceleration.any()):
        return standstill(start.position, at_ns)
    duration_ns = _braking_ns(machine, start)
    left_ns = trajectory.end_ns - at_ns
    if left_ns < MIN_POINT_SPACING_NS:
        return brake_from(machine, start, at_ns)
    if left_ns <= duration_ns:
        offset = _find_remaining_point_times(trajectory, at_ns)
        q, qd, qdd = trajectory.sample_many(at_ns + offset)
        qd[-1] = 0.0
        return Trajectory(at_ns, offset, q, qd, qdd)
    offset = _offsets(duration_ns)
    duration = duration_ns / SECOND_NS
    u = offset / duration_ns
    passed = duration * (u - u**3 + 0.5 * u**4)
    rate, slope = 1 - 3 * u**2 + 2 * u**3, 6 * (u**2 - u) / duration
    return retime_along(trajectory, at_ns, offset, passed, rate, slope)


def retime_along(
    trajectory: Trajectory,
    at_ns: int,
    offset_ns: IntArray,
    path_time: FloatArray,
    path_rate: FloatArray,
    path_rate_slope: FloatArray,
) -> Trajectory:
    """Compute a motion that follows the path of a trajectory with a new timing and ends at rest.

        q(t) = Q(σ(t)),  q̇ = Q′ σ̇,  q̈ = Q″ σ̇² + Q′ σ̈

    Q is the trajectory, and σ the time that has passed on it. A prime is a derivative with respect
    to σ, a dot one with respect to the time t since `at_ns`.

    Args:
        trajectory: The motion Q whose path is followed.
        at_ns: Absolute time at which the new timing begins; σ is 0 at this time [ns].
        offset_ns: Time t of each point of the result, the first is 0, shape (k,) [ns].
        path_time: σ at these points, shape (k,) [s].
        path_rate: σ̇ at these points, shape (k,) [-].
        path_rate_slope: σ̈ at these points, shape (k,) [1/s].

    Returns:
        The retimed motion; its stamp is `at_ns`. Velocity and acceleration of its last point are
        set to 0, whatever the arguments give.

    Source:
        Path-velocity decomposition, Siciliano et al., Robotics, section 4.3.
    """
    passed_ns = np.rint(path_time * SECOND_NS).astype(np.int64)
    q, qd, qdd = trajectory.sample_many(at_ns + passed_ns)
    qd, qdd = qd * path_rate[:, None], qdd * path_rate[:, None] ** 2 + qd * path_rate_slope[:, None]
    qd[-1] = qdd[-1] = 0.0
    return Trajectory(at_ns, offset_ns, q, qd, qdd)


def extract_remainder(trajectory: Trajectory, at_ns: int) -> Trajectory | None:
    """Return the part of a trajectory after an absolute time, as a trajectory with stamp 0.

    Args:
        trajectory: The motion. It is not changed.
        at_ns: Absolute time at which the part begins [ns].

    Returns:
        The part of the trajectory. Its stamp 0 stands for `at_ns`. None if less than
        `MIN_POINT_SPACING_NS` is left.
    """
    if trajectory.end_ns - at_ns < MIN_POINT_SPACING_NS:
        return None
    offset = _find_remaining_point_times(trajectory, at_ns)
    return Trajectory(0, offset, *trajectory.sample_many(at_ns + offset))


def brake_from(machine: Machine, state: MotionState, at_ns: int) -> Trajectory:
    """Compute a motion that comes to rest from a state whose path is unknown.

    Each joint brakes on its own, and all need the same time T:

        q̇ = q̇₀ (1 − 3u² + 2u³) + q̈₀ T (u − 2u² + u³),  u = t/T

    q̇₀ and q̈₀ are velocity and acceleration of the state, and t is the time since `at_ns`. Each
    joint moves by q̇₀ T/2 + q̈₀ T²/12. T is first 1.5 times the fastest piston's speed divided by
    `PEAK_DECELERATION`. It is halved until all points are within the joint limits and the
    workspace, but it is at least `MIN_BRAKING_NS`. The motion with this least T is returned even if
    it leaves the limits.

    Args:
        machine: The machine.
        state: Position, velocity and acceleration at the beginning.
        at_ns: Absolute time at which braking begins [ns].

    Returns:
        The braking motion; its stamp is `at_ns`. It stands still if velocity and acceleration of
        the state are 0.
    """
    if not (state.velocity.any() or state.acceleration.any()):
        return standstill(state.position, at_ns)
    duration_ns = _braking_ns(machine, state)
    braking = _joint_braking(state, at_ns, duration_ns)
    while duration_ns > MIN_BRAKING_NS and not _is_within_limits(machine, braking.position):
        duration_ns = max(MIN_BRAKING_NS, duration_ns // 2)
        braking = _joint_braking(state, at_ns, duration_ns)
    return braking


def _joint_braking(state: MotionState, at_ns: int, duration_ns: int) -> Trajectory:
    """Compute the motion in which each joint brakes on its own, all in a given time T.

        q̇ = q̇₀ (1 − 3u² + 2u³) + q̈₀ T (u − 2u² + u³),  u = t/T

    t is the time since braking began. Limits are not checked.

    Args:
        state: Position, velocity q̇₀ and acceleration q̈₀ at the beginning.
        at_ns: Absolute time at which braking begins [ns].
        duration_ns: Duration T of the motion [ns].

    Returns:
        The braking motion; its stamp is `at_ns`. Velocity and acceleration of its last point are 0.
    """
    offset = _offsets(duration_ns)
    duration = duration_ns / SECOND_NS
    u = (offset / duration_ns)[:, None]
    q0, v0, a0 = state.position, state.velocity, state.acceleration * duration
    q = q0 + duration * (v0 * (u - u**3 + 0.5 * u**4) + a0 * (u**2 / 2 - 2 * u**3 / 3 + u**4 / 4))
    qd = v0 * (1 - 3 * u**2 + 2 * u**3) + a0 * (u - 2 * u**2 + u**3)
    qdd = (v0 * (6 * u**2 - 6 * u) + a0 * (1 - 4 * u + 3 * u**2)) / duration
    qd[-1] = qdd[-1] = 0.0
    return Trajectory(at_ns, offset, q, qd, qdd)


def _braking_ns(machine: Machine, state: MotionState) -> int:
    """Choose the duration of a braking motion from the speed of the fastest piston.

        T = 1.5 max |r q̇| / PEAK_DECELERATION

    r is the moment arm of a joint, so r q̇ is the speed of its piston. The speed profile 1 − 3u² +
    2u³ with u = t/T has its largest slope, 1.5/T, in the middle.

    Args:
        machine: The machine, for the moment arms of its cylinders.
        state: State at the beginning; its acceleration has no influence.

    Returns:
        Duration T, at least `MIN_BRAKING_NS` [ns].
    """
    arms = machine.moment_arms(state.position)
    fastest = float(np.max(np.abs(arms * state.velocity)))
    return max(MIN_BRAKING_NS, round(1.5 * fastest / PEAK_DECELERATION * SECOND_NS))


def _is_within_limits(machine: Machine, position: FloatArray) -> bool:
    """Return whether all postures are within the joint limits and all their tips in the workspace.

    Args:
        machine: The machine.
        position: Joint positions, one posture per row, shape (k, n) [rad or m].

    Returns:
        True if no posture exceeds a limit.
    """
    limits, area = machine.arrays, machine.config.workspace
    if np.any(position < limits.joint_min) or np.any(position > limits.joint_max):
        return False
    tips = np.array([machine.tip_position(q) for q in position])
    radius = np.hypot(tips[:, 0], tips[:, 1])
    return bool(
        np.all(tips[:, 0] >= area.min_x)
        and np.all(radius >= area.min_radius)
        and np.all(radius <= area.max_radius)
    )


def _offsets(duration_ns: int) -> IntArray:
    """Return evenly spaced times from 0 to a duration [ns].

    They include both ends, and are at most `MAX_POINT_SPACING_NS` apart.
    """
    count = max(1, -(-duration_ns // MAX_POINT_SPACING_NS))
    return np.rint(np.linspace(0.0, duration_ns, count + 1)).astype(np.int64)


def _find_remaining_point_times(trajectory: Trajectory, at_ns: int) -> IntArray:
    """Choose the point times for the part of a trajectory after an absolute time.

    The first point time is 0. The others are the trajectory's own later points, so that the quintic
    pieces between them stay the same. There are two exceptions. Points less than
    `MIN_POINT_SPACING_NS` after `at_ns` are removed, which changes the first interval slightly. If
    the first remaining point is more than `MAX_POINT_SPACING_NS` after `at_ns`, another point is
    inserted half-way to it.

    Args:
        trajectory: The motion; it must end at least `MIN_POINT_SPACING_NS` after `at_ns`.
        at_ns: Absolute time [ns].

    Returns:
        Times after `at_ns`, increasing, the first is 0, int64 [ns].
    """
    left = trajectory.stamp_ns + trajectory.offset_ns - at_ns
    left = left[left >= MIN_POINT_SPACING_NS]
    if left[0] > MAX_POINT_SPACING_NS:
        left = np.concatenate([[left[0] // 2], left])
    return np.concatenate([[0], left])
