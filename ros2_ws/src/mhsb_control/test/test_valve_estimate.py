import numpy as np
import pytest

from mhsb_control.valve_estimate import (
    EstimatedValve,
    ValveEstimates,
    ValveSettings,
    accumulate_valve_window,
    build_valve_estimates,
    compute_opening,
    shift_opening,
    update_valve_filter,
)
from mhsb_model.circuit.elements import compute_valve_opening
from mhsb_model.records import create_records

STEP, SPEED_GAIN, STIFFNESS = 1e-3, 0.1, 1e7
CROSSING_SPEED, LENGTH_DEVIATION, DRIVING_PRESSURE = 3e-4, 3e-6, 4e5
SETTINGS = ValveSettings()


def build_valve(declared: tuple[float, float] = (0.0, 0.0), count: int = 1) -> ValveEstimates:
    """Return the initial estimates of a single valve, or of several."""
    records = create_records(EstimatedValve, count)
    records["moving_speed"], records["crossing_speed"] = 1e-3, CROSSING_SPEED
    records["length_deviation"] = LENGTH_DEVIATION
    records["min_driving_pressure"] = DRIVING_PRESSURE
    return build_valve_estimates(records, np.zeros((count, 2)), declared)


def hold_opening(valve: np.void, opening: float) -> None:
    """Set the opening of a spool that has reached its command."""
    valve["delayed_opening"] = valve["acting_opening"] = opening


def invert(valve: np.void, overlap: np.ndarray | float, demand: float, ahead: float = 0.0) -> float:
    gain = valve["speed_gain"] * valve["gain"]
    laps = np.broadcast_to(overlap, 2).copy()
    return float(compute_opening(gain, laps, demand, ahead, CROSSING_SPEED))


def moved(
    gain: float, overlap: tuple[float, float], openings: np.ndarray, softness: float = 1.0
) -> ValveEstimates:
    """A valve after windows at these openings, while its cylinder's force rises by 2 N a step."""
    valves = build_valve()
    move(valves, 0, gain, overlap, openings, softness)
    return valves


def move(
    valves: ValveEstimates,
    j: int,
    gain: float,
    overlap: tuple[float, float],
    openings: np.ndarray,
    softness: float = 1.0,
) -> None:
    """Move one of several valves."""
    length, force, valve = 0.5, 0.0, valves.records[j]
    for opening in openings:
        speed = (
            gain * SPEED_GAIN * compute_valve_opening(opening, overlap[0 if opening > 0.0 else 1])
        )
        for _ in range(SETTINGS.window_steps + 1):
            valve["speed_gain"] = SPEED_GAIN
            hold_opening(valve, opening)
            length += speed * STEP - softness * 2.0 / STIFFNESS
            force += 2.0
            accumulate_valve_window(valves, j, speed, length, force, STIFFNESS, STEP)


@pytest.mark.parametrize(
    ("gain", "overlap"), [(1.0, (0.0, 0.0)), (0.8, (0.03, 0.03)), (1.2, (0.01, 0.03))]
)
def test_gain_and_both_overlaps_are_learnt_from_motions_both_ways(
    gain: float, overlap: tuple[float, float]
) -> None:
    random = np.random.default_rng(1)
    openings = random.choice([-1.0, 1.0], 80) * random.uniform(0.06, 0.4, 80)
    valves = moved(gain, overlap, openings)
    laps = np.array(overlap)
    truth = np.array([gain, *(gain * laps / (1.0 - laps)), 1.0])
    deviation = np.sqrt(np.diag(valves.covariance[0, :, 0]))
    assert np.all(np.abs(valves.estimate[0] - truth) < 2.0 * deviation)
    assert deviation[0] < 0.05
    assert np.all(deviation[1:3] < 0.005)


@pytest.mark.parametrize("overlap", [0.16, 0.24])
def test_a_creeping_piston_shows_overlap_and_not_a_valve_without_gain(overlap: float) -> None:
    openings = -overlap - np.linspace(0.011, 0.021, 60)
    valves = moved(1.0, (overlap, overlap), openings)
    assert valves.estimate[0, 0] >= SETTINGS.min_gain
    assert valves.overlap[0, 1] == pytest.approx(overlap, rel=0.15)


@pytest.mark.parametrize("overlap", [0.1, 0.25, 0.45])
def test_a_shut_valve_is_opened_until_its_piston_moves(overlap: float) -> None:
    """A piston 5 mm behind is demanded 50 mm/s; its reference moves at 3 mm/s."""
    valves, length, reference = build_valve(), 0.5, 0.505
    valve = valves.records[0]
    valve["speed_gain"], valve["driving_pressure"] = SPEED_GAIN, 1e6
    for _ in range(1000):
        demand = 10.0 * (reference - length)
        opening = np.clip(invert(valve, valves.overlap[0], demand), -0.99, 0.99)
        hold_opening(valve, opening)
        speed = 3e-3
        accumulate_valve_window(valves, 0, speed, length, 1000.0, STIFFNESS, STEP)
        reference += speed * STEP
        length += SPEED_GAIN * compute_valve_opening(opening, overlap) * STEP
    assert abs(reference - length) < 1e-3
    assert valves.overlap[0, 0] == pytest.approx(overlap, abs=0.03)


def test_a_valve_below_its_load_pressure_tells_nothing_while_the_reference_moves() -> None:
    valves = build_valve()
    valve = valves.records[0]
    valve["speed_gain"] = SPEED_GAIN
    hold_opening(valve, 0.2)
    valve["driving_pressure"] = 0.9 * DRIVING_PRESSURE
    for _ in range(500):
        accumulate_valve_window(valves, 0, 0.01, 0.5, 1000.0, STIFFNESS, STEP)
    np.testing.assert_array_equal(valves.estimate[0], [1.0, 0.0, 0.0, 1.0])


def test_a_declared_overlap_is_crossed_from_the_first_step_on() -> None:
    overlap, speed = 0.3, 0.01
    valves = build_valve((overlap, overlap))
    valve = valves.records[0]
    valve["speed_gain"] = SPEED_GAIN
    opening = invert(valve, valves.overlap[0], speed)
    assert SPEED_GAIN * compute_valve_opening(opening, overlap) == pytest.approx(speed)
    deviation = np.sqrt(valves.covariance[0, 1, 0, 1]) * (1.0 - overlap)
    assert deviation == pytest.approx(SETTINGS.declared_overlap_share * overlap, rel=0.05)


def test_each_direction_crosses_its_own_declared_overlap() -> None:
    overlap, speed = (0.45, 0.1), 0.01
    valves = build_valve(overlap)
    valves.records["speed_gain"] = SPEED_GAIN
    for lap, sign in zip(overlap, (1.0, -1.0), strict=True):
        opening = invert(valves.records[0], valves.overlap[0], sign * speed)
        assert SPEED_GAIN * compute_valve_opening(opening, lap) == pytest.approx(sign * speed)


def test_what_one_direction_shows_of_its_overlap_is_expected_of_the_other() -> None:
    valves = moved(1.0, (0.1, 0.1), np.random.default_rng(1).uniform(0.15, 0.4, 80))
    extending, retracting = valves.overlap[0]
    assert extending == pytest.approx(0.1, abs=0.01)
    assert retracting == pytest.approx(SETTINGS.overlap_correlation * extending, abs=0.02)


def test_what_one_valve_shows_of_its_overlap_is_expected_of_the_others() -> None:
    """It moves only if it is opened beyond its overlap, and its piston is commanded to follow."""
    for openings in (np.random.default_rng(1).uniform(0.15, 0.4, 80), np.linspace(0.01, 0.1, 80)):
        valves = build_valve(count=3)
        move(valves, 1, 1.0, (0.1, 0.1), openings)
        assert valves.overlap[1, 0] == pytest.approx(0.1, abs=0.01)
        expected = SETTINGS.overlap_correlation * valves.overlap[1, 0]
        assert valves.overlap[[0, 2]] == pytest.approx(expected, abs=0.02)


def test_valves_with_unequal_overlaps_learn_their_own() -> None:
    """They take turns, with openings near their overlaps."""
    valves, random, overlaps = build_valve(count=2), np.random.default_rng(1), (0.05, 0.25)
    for _ in range(5):
        for j, overlap in enumerate(overlaps):
            openings = random.choice([-1.0, 1.0], 20) * (overlap + random.uniform(0.02, 0.2, 20))
            move(valves, j, 1.0, (overlap, overlap), openings)
    for j, overlap in enumerate(overlaps):
        assert valves.overlap[j] == pytest.approx(overlap, abs=0.01)


def test_an_opening_without_flow_does_not_make_its_overlap_more_certain() -> None:
    """The piston rests at ever larger openings, while its reference creeps."""
    valves, before = build_valve(), build_valve().covariance
    valve = valves.records[0]
    for opening in np.minimum(np.linspace(0.01, 0.25, 400), 0.2):
        valve["speed_gain"], valve["driving_pressure"] = SPEED_GAIN, 1e6
        hold_opening(valve, opening)
        accumulate_valve_window(valves, 0, 5e-4, 0.5, 1000.0, STIFFNESS, STEP)
    assert valves.overlap[0, 0] == pytest.approx(0.2, abs=0.02)
    assert valves.covariance[0, 1, 0, 1] >= before[0, 1, 0, 1]


def test_at_one_opening_gain_and_overlap_are_not_told_apart() -> None:
    valves = moved(0.8, (0.03, 0.03), np.full(80, 0.1))
    assert np.sqrt(valves.covariance[0, 0, 0, 0]) > 0.05
    valve = valves.records[0]
    speed = 0.8 * SPEED_GAIN * compute_valve_opening(0.1, 0.03)
    assert invert(valve, valves.overlap[0], speed) == pytest.approx(0.1, rel=0.02)


def test_at_rest_nothing_is_learnt() -> None:
    fresh, valves = build_valve(), build_valve()
    valves.records["speed_gain"] = SPEED_GAIN
    for _ in range(500):
        accumulate_valve_window(valves, 0, 0.0, 0.5, 1000.0, STIFFNESS, STEP)
    np.testing.assert_array_equal(valves.covariance, fresh.covariance)


def test_a_piston_that_does_not_move_as_told_tells_of_overlap() -> None:
    """Opened a little further each time, as the inverse does, until its piston would move."""
    valves, overlap = build_valve(), 0.025
    valve = valves.records[0]
    for _ in range(40):
        valve["speed_gain"] = SPEED_GAIN
        opening = invert(valve, valves.overlap[0], 1e-3)
        speed = SPEED_GAIN * compute_valve_opening(opening, overlap)
        length = 0.5
        for _ in range(SETTINGS.window_steps + 1):
            hold_opening(valve, opening)
            accumulate_valve_window(valves, 0, 0.0, length, 1000.0, STIFFNESS, STEP)
            length += speed * STEP
    assert speed > 5e-4
    assert valves.overlap[0, 0] == pytest.approx(overlap, abs=8e-3)


@pytest.mark.parametrize("demand", [-0.012, -CROSSING_SPEED, 2e-3, 0.012])
def test_the_inverse_opens_a_valve_with_overlap_as_far_as_is_demanded(demand: float) -> None:
    valve, gain, overlap = build_valve().records[0], 0.9, 0.025
    valve["gain"] = gain
    valve["speed_gain"] = SPEED_GAIN
    opening = invert(valve, overlap, demand)
    assert gain * SPEED_GAIN * compute_valve_opening(opening, overlap) == pytest.approx(demand)


def test_the_update_is_kalmans() -> None:
    """Oracle: the matrix form of the filter of two valves, with a common part of all overlaps."""
    random, s, count = np.random.default_rng(2), SETTINGS, 2
    valves = build_valve(count=count)
    wanted = np.tile([1.0, 0.0, 0.0, 1.0], count)
    laps = np.tile([False, True, True, False], count)
    deviation = np.where(laps, s.overlap_deviation, s.gain_deviation)
    deviation[3::4] = s.compressibility_deviation
    correlation = np.where(np.outer(laps, laps), s.overlap_correlation, 0.0)
    np.fill_diagonal(correlation, 1.0)
    spread = correlation * np.outer(deviation, deviation)
    drift = s.gain_drift, s.overlap_drift, s.overlap_drift, s.compressibility_drift
    for j in random.integers(0, count, 20):
        own, y = random.normal(0.0, 5e-4, 4), random.normal(0.0, 5e-4)
        noise = np.hypot(LENGTH_DEVIATION, s.stroke_deviation * y)
        update_valve_filter(valves, j, y, tuple(own), noise)
        row, walk = np.zeros(4 * count), np.zeros(4 * count)
        row[4 * j : 4 * j + 4], walk[4 * j : 4 * j + 4] = own, drift
        spread = spread + np.diag(np.square(walk))
        gain = spread @ row / (row @ spread @ row + noise**2)
        wanted = wanted + gain * (y - row @ wanted)
        spread = spread - np.outer(gain, row @ spread)
    np.testing.assert_allclose(valves.estimate.ravel(), wanted, rtol=1e-9)
    found = valves.covariance.reshape(4 * count, 4 * count)
    np.testing.assert_allclose(found, spread, rtol=1e-6, atol=1e-15)


def test_a_spool_follows_its_command_by_the_delay_and_its_lag() -> None:
    delay, lag = 20, 0.01
    valves = build_valve()
    valve, found = valves.records[0], []
    for k in range(100):
        valve["opening"] = 0.5 if k >= 10 else 0.0
        shift_opening(valve, valves.openings[0], delay, lag, STEP)
        found.append(float(valve["acting_opening"]))
    assert found[29] == 0.0
    since = STEP * np.arange(1, 71)
    np.testing.assert_allclose(found[30:], 0.5 * -np.expm1(-since / lag), atol=0.02)


def test_a_spool_that_still_crosses_its_overlap_counts_for_little() -> None:
    """Its piston moves at half the expected speed, the spool at its command or 5 % behind it."""
    gains = []
    for command in (0.1, 0.15):
        valves = build_valve()
        valve = valves.records[0]
        valve["speed_gain"] = SPEED_GAIN
        for k in range(200):
            valve["delayed_opening"], valve["acting_opening"] = command, 0.1
            length = 0.5 + 0.005 * k * STEP
            accumulate_valve_window(valves, 0, 0.01, length, 0.0, STIFFNESS, STEP)
        gains.append(valves.estimate[0, 0])
    settled, crossing = gains
    assert settled < 0.85
    assert crossing > 0.9


@pytest.mark.parametrize("ahead", [0.0, 1e-4, -0.01, 0.01])
def test_the_opening_has_no_jump(ahead: float) -> None:
    valve, overlap = build_valve().records[0], 0.25
    valve["speed_gain"] = SPEED_GAIN
    demands = np.linspace(-2.5, 2.5, 5001) * CROSSING_SPEED
    openings = [invert(valve, overlap, demand, ahead) for demand in demands]
    steepest = 3.0 * overlap / CROSSING_SPEED + 1.0 / SPEED_GAIN
    assert np.all(np.diff(openings) > 0.0)
    assert np.diff(openings).max() < 1.01 * steepest * (demands[1] - demands[0])


def test_the_overlap_is_crossed_before_the_motion_begins() -> None:
    valve, overlap = build_valve().records[0], 0.25
    valve["speed_gain"] = SPEED_GAIN
    assert invert(valve, overlap, 0.0, 0.01) == pytest.approx(overlap)
    assert invert(valve, overlap, 0.0, -0.01) == pytest.approx(-overlap)
    moving = invert(valve, overlap, 0.01)
    assert invert(valve, overlap, 0.01, -0.01) == moving
