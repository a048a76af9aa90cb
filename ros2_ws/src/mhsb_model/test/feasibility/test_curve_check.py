"""The curve of a trajectory is checked as dense sampling of SciPy's polynomials judges it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly

from mhsb_model.curve_limits import CurveLimits, find_least_inertias
from mhsb_model.feasibility.curve_check import (
    Quantity,
    compute_slowing_factor,
    describe_curve_problem,
    find_curve_excess,
)
from mhsb_model.statics import mass_matrix
from mhsb_model.trajectory import SECOND_NS, Trajectory

SAMPLES = 2001
"""Of each piece; a polynomial of degree 5 is missed between them by less than `BAND`."""

BAND = 1e-4
"""Share of a limit within which the sampled extremum and the limit may be too near to tell."""

LIMITS = CurveLimits(
    *(np.array(each) for each in ([-1.0, -2.0], [1.0, 0.5], [3.0, 2.0], [60.0, 90.0], [9e3, 6e3]))
)


def sampled_extrema(trajectory):
    """Largest positions beyond LIMITS and magnitudes of three derivatives, float64[4, n].

    Made of SciPy's Bernstein polynomials, sampled densely, and of nothing that is checked.
    """
    seconds = trajectory.offset_ns / SECOND_NS
    worst = np.full((4, trajectory.joint_count), -math.inf)
    for j in range(trajectory.joint_count):
        values = np.stack(
            [trajectory.position[:, j], trajectory.velocity[:, j], trajectory.acceleration[:, j]], 1
        )
        for k in range(len(seconds) - 1):
            h = seconds[k + 1] - seconds[k]
            piece = BPoly.from_derivatives([0.0, 1.0], values[k : k + 2] * h ** np.arange(3))
            u = np.linspace(0.0, 1.0, SAMPLES)
            q = piece(u)
            beyond = max(q.max() - LIMITS.upper[j], LIMITS.lower[j] - q.min())
            rates = [np.abs(piece.derivative(n)(u)).max() / h**n for n in (1, 2, 3)]
            worst[:, j] = np.maximum(worst[:, j], [beyond, *rates])
    return worst


def random_trajectory(random, count):
    """Points of two joints, some within all limits, some of them with wild derivatives."""
    h = np.exp(random.uniform(np.log(1e-3), np.log(1.0), count - 1))
    offset = np.concatenate([[0.0], np.cumsum(h)])
    scale = np.exp(random.uniform(-4.0, 1.5))
    begin = random.uniform(LIMITS.lower, LIMITS.upper)
    steps = scale * random.uniform(-1.0, 1.0, (count - 1, 2)) * np.minimum(h, 0.3)[:, None]
    position = begin + np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    velocity = scale * random.uniform(-2.0, 2.0, (count, 2))
    acceleration = scale * random.uniform(-30.0, 30.0, (count, 2))
    return Trajectory(
        0, np.round(offset * SECOND_NS).astype(np.int64), position, velocity, acceleration
    )


def check_against_sampling(seed, count):
    """Compare verdicts of random trajectories; returns how many keep the limits."""
    random, kept = np.random.default_rng(seed), 0
    for number in range(count):
        trajectory = random_trajectory(random, int(random.integers(2, 6)))
        beyond, *rates = sampled_extrema(trajectory)
        of_limits = [
            (each / limit).max()
            for each, limit in zip(
                rates, (LIMITS.speed, LIMITS.acceleration, LIMITS.jerk), strict=True
            )
        ]
        excess = find_curve_excess(LIMITS, trajectory)
        where = seed, number, beyond, of_limits, excess
        if beyond.max() < 0.0 and max(of_limits) < 1.0 - BAND:
            assert excess is None, where
            kept += 1
        elif beyond.max() > BAND or max(of_limits) > 1.0 + BAND:
            assert excess is not None, where
            if excess.quantity is Quantity.POSITION:
                assert beyond.max() > 0.0, where
            else:
                reached = rates[excess.quantity - 1][excess.joint]
                assert excess.value == pytest.approx(reached, rel=1e-3), where
    return kept


def test_a_sample_of_random_curves_is_judged_as_dense_sampling_judges_it(fresh_seed):
    assert 20 < check_against_sampling(fresh_seed, 300) < 280


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_ten_thousand_random_curves_are_judged_as_dense_sampling_judges_them(part, fresh_seed):
    kept = check_against_sampling(fresh_seed, 1000)
    print(f"part {part}: {kept} of 1000 keep the limits")


@pytest.mark.parametrize("size", [1e3, 1e4, 1e6, 1e150, 1e300])
def test_points_that_are_right_with_accelerations_between_them_are_refused(machine, size):
    count = 101
    position = np.tile(machine.config.simulation.start_posture, (count, 1))
    swing = size * (-1.0) ** np.arange(count)
    swing[[0, -1]] = 0.0
    offset = 10_000_000 * np.arange(count)
    path = Trajectory(0, offset, position, 0 * position, np.tile(swing[:, None], (1, 3)))
    assert describe_curve_problem(machine, path) is not None


@pytest.mark.parametrize("joint", range(3))
def test_a_saw_tooth_of_a_milliradian_is_refused(machine, joint):
    count = 101
    position = np.tile(machine.config.simulation.start_posture, (count, 1))
    position[:, joint] += 1e-3 * (-1.0) ** np.arange(count)
    path = Trajectory(0, 10_000_000 * np.arange(count), position, 0 * position, 0 * position)
    problem = describe_curve_problem(machine, path)
    assert problem is not None
    assert machine.joint_names[joint] in problem


@pytest.mark.parametrize("faster", [1.05, 1.5, 4.0, 30.0])
def test_a_curve_that_is_slowed_as_told_keeps_its_limits(faster):
    random = np.random.default_rng(3)
    for _ in range(20):
        path = random_trajectory(random, 4)
        path = Trajectory(
            0,
            np.round(path.offset_ns / faster).astype(np.int64),
            path.position,
            faster * path.velocity,
            faster**2 * path.acceleration,
        )
        k = compute_slowing_factor(LIMITS, path)
        assert k == 0.0 or k > 1.0
        if k:
            k *= 1.0 + 1e-6
            slower = Trajectory(
                0,
                np.round(k * path.offset_ns).astype(np.int64),
                path.position,
                path.velocity / k,
                path.acceleration / k**2,
            )
            assert compute_slowing_factor(LIMITS, slower) < 1.0 + 1e-5


@given(st.floats(0.01, 0.5), st.floats(-0.2, 0.2))
@settings(max_examples=60)
def test_a_joint_that_begins_outside_may_come_back_but_not_go_further_out(excess, step):
    offset = np.array([0, SECOND_NS, 2 * SECOND_NS])
    position = np.array([[1.0 + excess, 0.0], [1.0 + excess + step, 0.0], [0.9, 0.0]])
    path = Trajectory(0, offset, position, 0 * position, 0 * position)
    found = find_curve_excess(LIMITS, path)
    if step > 2e-5:
        assert found.quantity is Quantity.POSITION
        assert found.value == pytest.approx(1.0 + excess + step)
    elif step <= 0.0:
        assert found is None


def test_the_least_inertias_are_those_of_mass_matrices(machine):
    arrays, random = machine.arrays, np.random.default_rng(1)
    least = find_least_inertias(arrays)
    found = np.full(3, math.inf)
    while np.isinf(found).any() or random.random() < 0.999:
        posture = random.uniform(arrays.joint_min, arrays.joint_max)
        radius = np.hypot(*machine.tip_position(posture))
        if arrays.min_radius <= radius <= arrays.max_radius:
            found = np.minimum(found, np.diag(mass_matrix(arrays, posture)))
    np.testing.assert_allclose(least, found, rtol=0.15)
    assert (least < 1.05 * found).all()
