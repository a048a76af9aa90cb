"""Braking: how a motion comes to rest, smoothly and without leaving its way.

Both ways of braking are continuous up to the acceleration. For a planned stop and for a new plan
whose start has to reverse.
"""

from __future__ import annotations

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.trajectory import (
    POINT_SPACING_NS,
    SECOND_NS,
    MotionState,
    Trajectory,
    standstill,
)
from mhsb_model.types import FloatArray, IntArray

DECELERATION = 0.05
"""Peak deceleration of the pistons [m/s²]; from 12 mm/s the arm then stops within 0.36 s."""

SHORTEST_BRAKING_NS = 60_000_000
"""Shortest duration of a braking motion."""

CLOSEST_POINTS_NS = 1_000_000
"""Points closer than this make the quintic between them numerically useless."""


def brake_along(machine: Machine, trajectory: Trajectory, at_ns: int) -> Trajectory:
    """Come to rest on the way of a trajectory, from its state at the absolute time `at_ns`.

    q(t) = Q(σ(t)) with the trajectory Q and σ̇ falling from 1 to 0 as 1 − 3u² + 2u³, u = t/T, so
    that σ(T) = T/2: every posture is one of the trajectory, passed no faster than there, and the
    acceleration Q″σ̇² + Q′σ̈ is continuous. Where the trajectory itself rests sooner, it is kept.
    The result's stamp is `at_ns`. Source: path-velocity decomposition, Siciliano et al.,
    Robotics, Section 4.3.
    """
    start = trajectory.sample(at_ns)
    if not (start.velocity.any() or start.acceleration.any()):
        return standstill(start.position, at_ns)
    duration_ns = _braking_ns(machine, start)
    left_ns = trajectory.end_ns - at_ns
    if left_ns < CLOSEST_POINTS_NS:
        return brake_from(machine, start, at_ns)
    if left_ns <= duration_ns:
        offset = _offsets_left(trajectory, at_ns)
        q, qd, qdd = trajectory.sample_many(at_ns + offset)
        qd[-1] = 0.0
        return Trajectory(at_ns, offset, q, qd, qdd)
    offset = _offsets(duration_ns)
    duration = duration_ns / SECOND_NS
    u = offset / duration_ns
    passed = duration * (u - u**3 + 0.5 * u**4)
    rate, slope = 1 - 3 * u**2 + 2 * u**3, 6 * (u**2 - u) / duration
    return slowed_along(trajectory, at_ns, offset, passed, rate, slope)


def slowed_along(
    trajectory: Trajectory,
    at_ns: int,
    offset_ns: IntArray,
    passed: FloatArray,
    rate: FloatArray,
    slope: FloatArray,
) -> Trajectory:
    """Follow the path of a trajectory at another pace and come to rest on it.

    With the trajectory Q(σ), q = Q(σ), q̇ = Q′σ̇ and q̈ = Q″σ̇² + Q′σ̈. Source: path-velocity
    decomposition, Siciliano et al., Robotics, Section 4.3.

    Args:
        trajectory: The motion Q whose path is followed.
        at_ns: Absolute time at which the trajectory is left; σ is 0 there [ns].
        offset_ns: Times of the result's points after `at_ns`, the first is 0, int64[k] [ns].
        passed: σ at these times, float64[k] [s].
        rate: σ̇ at these times, float64[k]; the result rests at the last one.
        slope: σ̈ at these times, float64[k] [1/s].

    Returns:
        The slowed motion, with the stamp `at_ns`.
    """
    passed_ns = np.rint(passed * SECOND_NS).astype(np.int64)
    q, qd, qdd = trajectory.sample_many(at_ns + passed_ns)
    qd, qdd = qd * rate[:, None], qdd * rate[:, None] ** 2 + qd * slope[:, None]
    qd[-1] = qdd[-1] = 0.0
    return Trajectory(at_ns, offset_ns, q, qd, qdd)


def rest_of(trajectory: Trajectory, at_ns: int) -> Trajectory | None:
    """What is left of a trajectory from the absolute time `at_ns` on, with stamp 0; the same curve.

    None where hardly anything is left.
    """
    if trajectory.end_ns - at_ns < CLOSEST_POINTS_NS:
        return None
    offset = _offsets_left(trajectory, at_ns)
    return Trajectory(0, offset, *trajectory.sample_many(at_ns + offset))


def brake_from(machine: Machine, state: MotionState, at_ns: int) -> Trajectory:
    """Come to rest from a state whose way is not known, each joint on its own.

    q̇ = q̇₀ (1 − 3u² + 2u³) + q̈₀ T (u − 2u² + u³), u = t/T: velocity and acceleration start from
    the state and end at zero, after q̇₀ T/2 + q̈₀ T²/12. T is halved, down to
    `SHORTEST_BRAKING_NS`, until joint limits and workspace hold. The result's stamp is `at_ns`.
    """
    if not (state.velocity.any() or state.acceleration.any()):
        return standstill(state.position, at_ns)
    duration_ns = _braking_ns(machine, state)
    braking = _joint_braking(state, at_ns, duration_ns)
    while duration_ns > SHORTEST_BRAKING_NS and not _within(machine, braking.position):
        duration_ns = max(SHORTEST_BRAKING_NS, duration_ns // 2)
        braking = _joint_braking(state, at_ns, duration_ns)
    return braking


def _joint_braking(state: MotionState, at_ns: int, duration_ns: int) -> Trajectory:
    offset = _offsets(duration_ns)
    duration = duration_ns / SECOND_NS
    u = (offset / duration_ns)[:, None]
    q0, v0, a0 = state.position, state.velocity, state.acceleration * duration
    q = q0 + duration * (
        v0 * (u - u**3 + 0.5 * u**4) + a0 * (u**2 / 2 - 2 * u**3 / 3 + u**4 / 4)
    )
    qd = v0 * (1 - 3 * u**2 + 2 * u**3) + a0 * (u - 2 * u**2 + u**3)
    qdd = (v0 * (6 * u**2 - 6 * u) + a0 * (1 - 4 * u + 3 * u**2)) / duration
    qd[-1] = qdd[-1] = 0.0
    return Trajectory(at_ns, offset, q, qd, qdd)


def _braking_ns(machine: Machine, state: MotionState) -> int:
    """Duration at which the fastest piston brakes with DECELERATION: 1.5 |v| at the middle."""
    arms = machine.moment_arms(state.position)
    fastest = float(np.max(np.abs(arms * state.velocity)))
    return max(SHORTEST_BRAKING_NS, round(1.5 * fastest / DECELERATION * SECOND_NS))


def _within(machine: Machine, position: FloatArray) -> bool:
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
    """Evenly spaced times from 0 to the duration, at most POINT_SPACING_NS apart."""
    count = max(1, -(-duration_ns // POINT_SPACING_NS))
    return np.rint(np.linspace(0.0, duration_ns, count + 1)).astype(np.int64)


def _offsets_left(trajectory: Trajectory, at_ns: int) -> IntArray:
    """Times after `at_ns` of the points that are left, so that the curve remains the very same."""
    left = trajectory.stamp_ns + trajectory.offset_ns - at_ns
    left = left[left >= CLOSEST_POINTS_NS]
    if left[0] > POINT_SPACING_NS:
        left = np.concatenate([[left[0] // 2], left])
    return np.concatenate([[0], left])
