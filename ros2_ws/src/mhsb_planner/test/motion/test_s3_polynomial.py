"""The published fit: boundary conditions, least squares, shape."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mhsb_model.trajectory import MotionState
from mhsb_planner.motion.s3_polynomial import (
    CHECK_INSTANTS,
    POLYNOMIAL_DEGREE,
    compute_node_times,
    fit_polynomial,
)


def moving_start(path, random):
    first = path.posture[0] + random.uniform(-0.05, 0.05, 3)
    return MotionState(first, random.uniform(-0.2, 0.2, 3), random.uniform(-0.3, 0.3, 3))


def least_squares_with_conditions(path, start, delay, duration, moving):
    """Coefficients in powers of t/T from the KKT system of the constrained least squares."""
    times = (
        np.concatenate([[0.0], delay + compute_node_times(path)])
        if delay
        else compute_node_times(path)
    )
    nodes = np.vstack([start.position, path.posture]) if delay else path.posture
    times = times * duration / times[-1]
    t = CHECK_INSTANTS * duration
    position = np.column_stack([np.interp(t, times, nodes[:, j]) for j in range(3)])
    step = np.searchsorted(times, t, "right") - 1
    velocity = (np.diff(nodes, axis=0) / np.diff(times)[:, None])[step]

    def powers(s, order=0):
        rows = np.zeros((len(s), POLYNOMIAL_DEGREE + 1))
        for i in range(order, POLYNOMIAL_DEGREE + 1):
            factor = np.prod(np.arange(i, i - order, -1.0))
            rows[:, i] = factor * s ** (i - order)
        return rows

    rows = np.vstack([powers(CHECK_INSTANTS), powers(CHECK_INSTANTS, 1)])
    wanted = np.vstack([position, duration * velocity])
    ends = np.array([0.0]), np.array([1.0])
    fixed = [powers(ends[0]), powers(ends[0], 1), powers(ends[1]), powers(ends[1], 1)]
    given = [start.position, start.velocity * duration, path.posture[-1], np.zeros(3)]
    if moving:
        fixed.append(powers(ends[0], 2))
        given.append(start.acceleration * duration**2)
    conditions = np.vstack(fixed)
    count = len(conditions)
    system = np.block([[rows.T @ rows, conditions.T], [conditions, np.zeros((count, count))]])
    solution = np.linalg.solve(system, np.vstack([rows.T @ wanted, np.array(given)]))
    return solution[: POLYNOMIAL_DEGREE + 1]


@settings(max_examples=15)
@given(st.integers(0, 2**32), st.booleans())
def test_the_fit_is_the_constrained_least_squares_solution(walk, seed, moving):
    random = np.random.default_rng(seed)
    path = walk(random, 6)
    start = moving_start(path, random) if moving else MotionState.at_rest(path.posture[0])
    delay = 0.15 if moving else 0.0
    curve = fit_polynomial(path, start, delay, 1.3)
    oracle = least_squares_with_conditions(path, start, delay, curve.node_time[-1], moving)
    s = np.linspace(0, 1, 50)[:, None] ** np.arange(POLYNOMIAL_DEGREE + 1)
    assert s @ curve.coefficient == pytest.approx(s @ oracle, abs=1e-8)


@settings(max_examples=15)
@given(st.integers(0, 2**32))
def test_a_moving_start_is_matched_up_to_its_acceleration_and_the_end_is_at_rest(walk, seed):
    random = np.random.default_rng(seed)
    path = walk(random, 5)
    start = moving_start(path, random)
    curve = fit_polynomial(path, start, 0.2, 1.0)
    q, qd, qdd = curve.sample(np.array([0.0, curve.node_time[-1]]))
    assert q[0] == pytest.approx(start.position, abs=1e-12)
    assert qd[0] == pytest.approx(start.velocity, abs=1e-12)
    assert qdd[0] == pytest.approx(start.acceleration, abs=1e-10)
    assert q[1] == pytest.approx(path.posture[-1], abs=1e-10)
    assert qd[1] == pytest.approx(np.zeros(3), abs=1e-10)


def test_samples_are_derivatives_of_each_other(walk):
    path = walk(np.random.default_rng(3), 5)
    curve = fit_polynomial(path, MotionState.at_rest(path.posture[0]), 0.0, 1.0)
    t = np.linspace(0.1, curve.duration - 0.1, 40)
    before, now, after = (curve.sample(t + d) for d in (-1e-4, 0.0, 1e-4))
    assert now[1] == pytest.approx((after[0] - before[0]) / 2e-4, abs=1e-6)
    assert now[2] == pytest.approx((after[1] - before[1]) / 2e-4, abs=1e-6)


def test_a_single_straight_step_is_passed_at_little_more_than_its_mean_speed(walk):
    path = walk(np.random.default_rng(5), 1)
    curve = fit_polynomial(path, MotionState.at_rest(path.posture[0]), 0.0, 1.0)
    speed = np.abs(curve.sample(np.linspace(0, curve.duration, 1000))[1]).max(axis=0)
    mean = np.abs(path.posture[1] - path.posture[0]) / curve.duration
    moves = mean > 1e-6
    assert np.all(speed[moves] / mean[moves] == pytest.approx(1.25, abs=0.06))


def test_stretching_scales_time_and_keeps_the_shape_from_rest(walk):
    path = walk(np.random.default_rng(8), 6)
    start = MotionState.at_rest(path.posture[0])
    curve, slower = (fit_polynomial(path, start, 0.0, stretch) for stretch in (1.0, 1.7))
    assert slower.duration == pytest.approx(1.7 * curve.duration)
    assert slower.coefficient == pytest.approx(curve.coefficient, abs=1e-9)
