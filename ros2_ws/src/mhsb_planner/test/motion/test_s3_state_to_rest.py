"""Steering from a state of motion straight to a rest near by: end, limits, and how soon."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from mhsb_model.trajectory import MotionState
from mhsb_planner.motion.s3_state_to_rest import JERK_SHARE, compute_steered_motion
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics

V_MAX, A_MAX, J_MAX = 0.012, 0.2, 4.0


def motion_of(machine, seed, shortest=0.0):
    """A steered motion from a random state, with the piston speeds and accelerations it begins in.

    The acceleration is one that leads to no speed beyond V_max.
    """
    random = np.random.default_rng(seed)
    limits = machine.arrays
    assert limits.max_piston_speed.tolist() == [V_MAX] * 3
    assert (limits.max_piston_acceleration, limits.max_piston_jerk) == (A_MAX, J_MAX)
    q = random.uniform(limits.joint_min + 0.2, limits.joint_max - 0.2)
    speed = random.uniform(-0.8, 0.8, 3) * V_MAX
    acceleration = random.uniform(-0.3, 0.3, 3) * A_MAX * random.choice([0.0, 1.0])
    arm = machine.moment_arms(q)
    slope = (machine.moment_arms(q + 1e-6) - machine.moment_arms(q - 1e-6)) / 2e-6
    qd = speed / arm
    start = MotionState(q, qd, (acceleration - slope * qd**2) / arm)
    end = q + random.uniform(-0.05, 0.05, 3)
    return compute_steered_motion(machine, straight(machine, q, end, shortest), start, 1.0), end


def test_each_piston_is_steered_within_its_own_v_max(machine):
    slower = machine.with_values({"joints.1.actuator.max_piston_speed": 0.004})
    q = np.array([0.3, -1.4, -1.0])
    end = q + 0.3
    motion = compute_steered_motion(
        slower, straight(slower, q, end, 0.0), MotionState.at_rest(q), 1.0
    )
    position, velocity, _ = motion.sample(np.linspace(0.0, motion.end, 2001))
    arms = np.array([machine.moment_arms(each) for each in position])
    fastest = np.abs(arms * velocity).max(axis=0)
    assert fastest[1] == pytest.approx(0.004, rel=1e-6)
    assert np.all(fastest <= V_MAX * (1 + 1e-9))
    np.testing.assert_allclose(position[-1], end, atol=1e-8)


def straight(machine, start, end, duration):
    return DiscretePath(
        tip=np.array([machine.tip_position(q) for q in (start, end)]),
        posture=np.array([start, end]),
        modes=np.zeros((1, 3), dtype=np.uint8),
        duration=np.array([max(duration, 1e-3)]),
        energy=np.zeros(1),
        energy_series=np.zeros(1),
        cost=0.0,
        start_modes=np.zeros(3, dtype=np.uint8),
        statistics=SearchStatistics(0, 0, 0.0),
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([0.0, 0.1, 0.8]))
def test_it_begins_in_the_state_rests_at_the_end_and_keeps_all_limits(machine, seed, shortest):
    motion, end = motion_of(machine, seed, shortest)
    t = np.linspace(0.0, motion.end, 4001)
    q, qd, _ = motion.sample(t)
    np.testing.assert_allclose(qd[0], motion.speed / machine.moment_arms(q[0]), atol=1e-12)
    np.testing.assert_allclose(q[-1], end, atol=1e-8)
    np.testing.assert_allclose(qd[-1], 0.0, atol=1e-8)
    length = np.array([machine.cylinder_lengths(row) for row in q])
    h = t[1]
    speed = np.diff(length, axis=0) / h
    acceleration = np.diff(speed, axis=0) / h
    jerk = np.diff(acceleration, axis=0) / h
    assert np.abs(speed).max() <= V_MAX * 1.001
    assert np.abs(acceleration).max() <= A_MAX * 1.001
    assert np.abs(jerk).max() <= JERK_SHARE * J_MAX + 0.2  # rounding, of third differences
    assert motion.end >= shortest - 1e-9


@pytest.mark.parametrize("seed", range(12))
def test_it_takes_hardly_longer_than_the_best_piecewise_constant_jerk(machine, seed):
    motion, _ = motion_of(machine, seed)
    ends = motion.length + way_of(motion)
    best = max(
        least_time(motion.length[i], motion.speed[i], motion.acceleration[i], ends[i])
        for i in range(3)
    )
    assert motion.end <= 1.1 * best


def way_of(motion):
    """How far each piston goes, by its phases [m]."""
    way = np.zeros(3)
    for i in range(3):
        v, a = motion.speed[i], motion.acceleration[i]
        for t, j in zip(motion.phase[i], motion.jerk[i], strict=True):
            way[i] += v * t + a * t**2 / 2 + j * t**3 / 6
            v, a = v + a * t + j * t**2 / 2, a + j * t
    return way


def least_time(length, speed, acceleration, end, intervals=48):
    """Least time from a state to rest at `end` with so many intervals of constant jerk."""

    def possible(duration):
        h, n = duration / intervals, intervals
        low = np.tril(np.ones((n, n)))
        a_of = h * low
        before_a = np.vstack([np.zeros(n), a_of[:-1]])
        v_of = np.cumsum(h * 0.5 * (before_a + a_of), axis=0)
        before_v = np.vstack([np.zeros(n), v_of[:-1]])
        x_of = np.cumsum(h * before_v + h**2 / 2 * before_a + h**3 / 6 * np.eye(n), axis=0)
        t = h * np.arange(1, n + 1)
        a0, v0 = acceleration + 0 * t, speed + acceleration * t
        x0 = length + speed * t + acceleration * t**2 / 2
        answer = linprog(
            np.zeros(n),
            A_ub=np.vstack([a_of, -a_of, v_of, -v_of]),
            b_ub=np.concatenate([A_MAX - a0, A_MAX + a0, V_MAX - v0, V_MAX + v0]),
            A_eq=1e3 * np.vstack([a_of[-1], v_of[-1], x_of[-1]]),
            b_eq=1e3 * np.array([-a0[-1], -v0[-1], end - x0[-1]]),
            bounds=(-JERK_SHARE * J_MAX, JERK_SHARE * J_MAX),
        )
        return answer.status == 0

    shortest, longest = 0.0, 2.0
    for _ in range(9):
        middle = 0.5 * (shortest + longest)
        shortest, longest = (shortest, middle) if possible(middle) else (middle, longest)
    return longest
