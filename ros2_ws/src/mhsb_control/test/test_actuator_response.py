"""Curve and delay of an actuator are found from its motion; a solver checks the filter."""

from dataclasses import replace

import numpy as np
import pytest

from mhsb_control.actuator_response import DelayEstimate, InverseCurve, ResponseSettings

SETTINGS = ResponseSettings()
MAX_SPEED, FULL_SPEED = 0.1, 0.2


def build_curve(settings=SETTINGS, full_speed=FULL_SPEED):
    return InverseCurve(full_speed, MAX_SPEED, settings)


def test_it_begins_between_the_straight_and_the_most_bent_curve():
    curve = build_curve()
    for speed in (0.0, 0.01, 0.1, 0.15):
        share = speed / FULL_SPEED
        assert curve.command_at(speed) == pytest.approx(0.5 * (share + share ** (1.0 / 1.8)))
    begun = curve.command_at(0.04)
    assert curve.speeds_at(np.array([0.0, begun])) == pytest.approx([0.0, 0.04])
    assert curve.known_speed == 0.0
    line = build_curve(replace(SETTINGS, max_exponent=1.0))
    for speed in (0.0, 0.013, 0.1, 0.15, 0.3):
        assert line.command_at(speed) == pytest.approx(speed / FULL_SPEED)


def test_precision_is_relative_to_the_command_that_the_speed_limit_needs():
    """A valve four times as large needs a quarter of each command, without a dead band."""
    settings = replace(SETTINGS, dead_band_deviation=0.0, max_exponent=1.0, dead_band_step=1.0)
    small, large = (build_curve(settings, full_speed) for full_speed in (0.2, 0.8))
    for speed in (0.02, 0.07, 0.11):
        small.learn(speed, 4.0 * speed, 0.5, spread=0.04)
        large.learn(speed, speed, 0.5, spread=0.01)
    small.raise_dead_band(0.2, 0.5)
    large.raise_dead_band(0.05, 0.5)
    assert large.commands == pytest.approx(small.commands / 4.0)
    assert large.covariance == pytest.approx(small.covariance / 16.0)
    assert large.known_speed == small.known_speed


def test_the_step_of_the_dead_band_grows_while_the_piston_stands():
    curve, rises = build_curve(full_speed=2.0), []
    first = SETTINGS.bend_deviation * MAX_SPEED / 2.0
    for _ in range(20):
        before = curve.command_at(0.0)
        curve.raise_dead_band(before + 1e-6, 1.0)
        rises.append(curve.command_at(0.0) - before)
    assert rises[0] == pytest.approx(first, rel=1e-3)
    assert max(rises) == pytest.approx(SETTINGS.dead_band_step, rel=1e-3)
    assert np.all(np.diff(rises[:-1]) > -1e-9)
    curve.learn(0.05, curve.command_at(0.05), 1e-9)  # it moves
    before = curve.command_at(0.0)
    curve.raise_dead_band(before + 1e-6, 1.0)
    assert curve.known_speed == 0.0
    assert curve.command_at(0.0) - before == pytest.approx(first, rel=1e-3)


def test_a_known_dead_band_is_raised_by_less():
    curve = build_curve()
    for _ in range(5):
        curve.learn(0.05, 0.5, 1.0)
    assert curve.known_speed > 0.0
    before = curve.command_at(0.0)
    curve.raise_dead_band(before + 1e-6, 1.0)
    least = SETTINGS.known_dead_band_step * MAX_SPEED / FULL_SPEED
    assert curve.command_at(0.0) - before == pytest.approx(least, rel=1e-3)


def test_a_swing_on_the_oil_makes_no_step_of_the_dead_band_smaller():
    curve = build_curve(full_speed=2.0)
    for _ in range(5):
        curve.learn(0.04 * MAX_SPEED, 0.01, 1.0)
    assert curve.known_speed > 0.0
    before = curve.command_at(0.0)
    curve.raise_dead_band(before + 1e-6, 1.0)
    first = SETTINGS.bend_deviation * MAX_SPEED / 2.0
    assert curve.command_at(0.0) - before == pytest.approx(first, rel=1e-3)


def test_a_dead_band_that_was_taken_too_large_gives_way_to_a_measured_command():
    """The valve moves the piston at 5 % of its speed limit by a command below the dead band."""
    curve, slow = build_curve(), 0.05 * MAX_SPEED
    for speed in np.tile([0.2, 0.5, 1.0], 9) * MAX_SPEED:
        curve.learn(speed, 0.3 + speed / FULL_SPEED, 1.0)
    for _ in range(40):
        curve.raise_dead_band(curve.command_at(0.0) + 1e-6, 1.0)
    assert curve.command_at(0.0) > 0.5
    for _ in range(9):
        curve.learn(slow, 0.31, 1.0, lowers_slower_knots=True)
    assert curve.command_at(slow) == pytest.approx(0.31, abs=0.006)
    assert curve.command_at(0.0) < curve.command_at(slow)
    straight = np.diff(curve.speeds) / FULL_SPEED
    assert np.all(np.diff(curve.commands) >= SETTINGS.min_slope_ratio * straight - 1e-12)


def test_the_filter_solves_the_least_squares_problem(fresh_seed):
    """Oracle: minimum of |θ − p|² in P₀⁻¹ plus all weighted residuals, by a linear solver."""
    settings = replace(SETTINGS, speed_deviation=0.0)
    random, curve = np.random.default_rng(fresh_seed), build_curve(settings)
    variance = (settings.command_deviation * MAX_SPEED / FULL_SPEED) ** 2
    prior, start = curve.covariance.copy(), curve.commands.copy()
    matrix = np.linalg.inv(prior)
    right = matrix @ start
    for speed in random.permutation(np.linspace(0.0, 0.14, 100)):  # so that all knots are observed
        command = 0.2 + 4.0 * speed
        weight = random.uniform(0.1, 1.0)
        row = np.array([np.interp(speed, curve.speeds, e) for e in np.eye(len(start))])
        matrix += weight / variance * np.outer(row, row)
        right += weight / variance * command * row
        curve.learn(speed, command, weight)
    expected = np.linalg.solve(matrix, right)
    assert np.all(np.diff(expected) > 0.0)
    assert curve.commands == pytest.approx(expected, abs=0.01)  # it was kept increasing on the way
    assert curve.covariance == pytest.approx(np.linalg.inv(matrix), abs=1e-9)


def test_one_pair_moves_the_whole_curve_and_standstill_raises_its_dead_band():
    curve = build_curve(replace(SETTINGS, speed_deviation=0.0))
    prior, begun = curve.covariance.copy(), curve.commands.copy()
    at = int(np.argmin(np.abs(curve.speeds - 0.02)))
    curve.learn(0.02, 0.5, 1.0)
    assert curve.command_at(0.02) == pytest.approx(0.5, abs=0.02)
    ratio = prior[0, at] / (
        prior[at, at] + (SETTINGS.command_deviation * MAX_SPEED / FULL_SPEED) ** 2
    )
    assert curve.command_at(0.0) == pytest.approx(ratio * (0.5 - begun[at]))
    assert 0.2 < curve.command_at(0.0) < curve.command_at(0.1)
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
        curve.forget(1e-3 * SETTINGS.forgetting_time)
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
