"""Curve and delay of an actuator are found from its motion; a solver checks the filter."""

import numpy as np
import pytest

from mhsb_control.actuator_response import DelayEstimate, InverseCurve, ResponseSettings

SETTINGS = ResponseSettings()
MAX_SPEED, FULL_SPEED = 0.1, 0.2


def build_curve():
    return InverseCurve(FULL_SPEED, MAX_SPEED, SETTINGS)


def test_it_begins_with_the_assumed_line():
    curve = build_curve()
    for speed in (0.0, 0.013, 0.1, 0.15, 0.3):
        assert curve.command_at(speed) == pytest.approx(speed / FULL_SPEED)
    assert curve.speeds_at(np.array([0.0, 0.25])) == pytest.approx([0.0, 0.05])
    assert curve.known_speed == 0.0


def test_the_filter_solves_the_least_squares_problem(fresh_seed):
    """Oracle: minimum of |θ − p|² in P₀⁻¹ plus all weighted residuals, by a linear solver."""
    random, curve = np.random.default_rng(fresh_seed), build_curve()
    prior, start = curve.covariance.copy(), curve.commands.copy()
    matrix = np.linalg.inv(prior)
    right = matrix @ start
    for speed in random.uniform(0.0, 0.14, 40):
        command = 0.2 + 4.0 * speed
        weight = random.uniform(0.1, 1.0)
        row = np.array([np.interp(speed, curve.speeds, e) for e in np.eye(len(start))])
        matrix += weight / SETTINGS.command_deviation**2 * np.outer(row, row)
        right += weight / SETTINGS.command_deviation**2 * command * row
        curve.learn(speed, command, weight)
    expected = np.linalg.solve(matrix, right)
    assert np.all(np.diff(expected) > 0.0)
    assert curve.commands == pytest.approx(expected, abs=0.01)  # it was kept increasing on the way
    assert curve.covariance == pytest.approx(np.linalg.inv(matrix), abs=1e-9)


def test_one_pair_moves_the_whole_curve_and_standstill_raises_its_dead_band():
    curve = build_curve()
    curve.learn(0.02, 0.5, 1.0)
    assert curve.command_at(0.02) == pytest.approx(0.5, abs=0.02)
    assert 0.25 < curve.command_at(0.0) < curve.command_at(0.1)
    before = curve.commands.copy()
    curve.raise_dead_band(0.1, 1.0)
    assert np.array_equal(curve.commands, before)
    curve.raise_dead_band(0.48, 1.0)
    assert curve.command_at(0.0) > before[0]
    assert np.all(np.diff(curve.commands) > 0.0)


def test_a_wide_dead_band_is_crossed_in_few_steps():
    """A command that moves nothing says that the dead band is larger, not how large it is."""
    curve, steps = build_curve(), 0
    before = curve.covariance.copy()
    while (command := curve.command_at(0.0) + 1e-3) < 0.45:
        for _ in range(20):  # the windows of one second overlap
            curve.raise_dead_band(command, 1.0 / 20)
        steps += 1
    assert steps <= 12
    assert np.array_equal(curve.covariance, before)


def test_uncertainty_returns_in_time_and_not_beyond_its_first_value():
    curve = build_curve()
    prior = curve.covariance.copy()
    for _ in range(50):
        curve.learn(0.1, 0.5, 1.0)
    assert curve.known_speed >= 0.1
    for _ in range(10_000):
        curve.forget(0.1)
    assert curve.covariance == pytest.approx(prior, rel=1e-3)
    assert curve.known_speed >= 0.1  # a plan is not slowed a second time


@pytest.mark.parametrize("delay", [0.07, 0.25, 0.5])
def test_the_delay_is_found_whatever_the_gain(delay):
    estimate = DelayEstimate(0.2, MAX_SPEED, SETTINGS)
    for time in np.arange(0.0, 20.0, 0.02):
        expected = 0.05 * np.sin(time - estimate.candidates)
        estimate.learn(expected, 1.7 * 0.05 * np.sin(time - delay), 0.02)
    assert estimate.is_known
    assert estimate.delay == pytest.approx(delay, abs=0.005)


def test_without_motion_the_delay_stays_as_expected():
    estimate = DelayEstimate(0.2, MAX_SPEED, SETTINGS)
    for _ in range(1000):
        estimate.learn(np.full(len(estimate.candidates), 0.01), 0.0, 0.02)
    assert not estimate.is_known
    assert estimate.delay == 0.2
