import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mhsb_control.spools.lag_estimate import (
    LAG_EXCESSES,
    LagEstimates,
    accumulate_lag_window,
    advance_spools,
    build_lag_estimates,
    describe_lag_uncertainty,
    finish_lag_step,
)
from mhsb_control.valve_estimate import EstimatedValve, ValveEstimates, build_valve_estimates
from mhsb_model.records import create_records

STEP, SPEED_GAIN, STIFFNESS, DAMPING, FILE_LAG = 1e-3, 0.1, 1e7, 0.8, 2.5e-3
FASTEST = np.array([0.012])
STEPS = 1500
TURN = 2.0 * np.pi / 0.2  # rad/s, of the command


def compute_command(time: float, centre: float = 0.06) -> float:
    return centre + 0.05 * np.sin(TURN * time)


def move_spool(lag: float, centre: float = 0.06) -> np.ndarray:
    """Opening of a spool of second order after each step, by another integration."""
    frequency = 2.0 * DAMPING / lag
    return solve_ivp(
        lambda t, y: [
            y[1],
            frequency**2 * (compute_command(t, centre) - y[0]) - 2.0 * DAMPING * frequency * y[1],
        ],
        (0.0, STEPS * STEP), [0.0, 0.0], t_eval=STEP * np.arange(STEPS), rtol=1e-8,
    ).y[0]  # fmt: skip


def build() -> tuple[LagEstimates, ValveEstimates]:
    records = create_records(EstimatedValve, 1)
    records["speed_gain"] = SPEED_GAIN
    valves = build_valve_estimates(records, np.zeros((1, 2)))
    return build_lag_estimates(FILE_LAG, DAMPING, STEP, FASTEST), valves


def learn(
    lags: LagEstimates, valves: ValveEstimates, opening: np.ndarray, centre: float = 0.06,
    overlap: float = 0.0, noise: float = 0.0, delay: int = 0,
) -> None:  # fmt: skip
    """Feed the estimator with a piston that moves by a valve with the given openings."""
    random, length, steps = np.random.default_rng(1), 0.5, lags.settings["window_steps"][0]
    for k in range(len(opening)):
        x = abs(opening[k])
        passed = max(x - overlap, 0.0) / (1.0 - overlap)
        length += STEP * SPEED_GAIN * np.sign(opening[k]) * passed
        measured = length + noise * random.standard_normal()
        valves.records["delayed_opening"] = compute_command(STEP * k, centre)
        ends = lags.record["steps"][0] == steps
        advance_spools(lags, valves, 0, measured, 0.0, STEP)
        used = ends and accumulate_lag_window(lags, valves, 0, measured, 0.0, STIFFNESS)
        finish_lag_step(lags, used, delay)


@pytest.mark.parametrize("excess", [0.015, 0.02, 0.025])
def test_a_slow_spool_shows_its_lag(excess: float) -> None:
    lags, valves = build()
    learn(lags, valves, move_spool(FILE_LAG + excess), noise=2e-6)
    assert lags.record["lag"][0] == pytest.approx(FILE_LAG + excess, abs=2.6e-3)
    assert describe_lag_uncertainty(lags) < 0.5 * max(LAG_EXCESSES)


@pytest.mark.parametrize("gain", [0.8, 1.0, 1.2])
def test_a_valve_of_another_gain_keeps_the_lag_of_the_file(gain: float) -> None:
    lags, valves = build()
    learn(lags, valves, gain * move_spool(FILE_LAG), noise=2e-6)
    assert lags.record["lag"][0] == FILE_LAG


def test_a_valve_within_an_unknown_overlap_tells_nothing() -> None:
    lags, valves = build()
    learn(lags, valves, move_spool(FILE_LAG), overlap=0.2)
    assert lags.record["lag"][0] == FILE_LAG
    assert not lags.squares[:6].any()
    assert describe_lag_uncertainty(lags) == pytest.approx(max(LAG_EXCESSES))


def test_windows_with_a_shut_valve_are_discarded() -> None:
    lags, valves = build()
    opening = move_spool(FILE_LAG + 0.02)
    learn(lags, valves, opening[:5])
    valves.records["delayed_opening"] = 0.0
    for _ in range(lags.settings["window_steps"][0]):
        advance_spools(lags, valves, 0, 0.5, 0.0, STEP)
        finish_lag_step(lags, False, 0)
    assert lags.windows["is_usable"][0] == 0.0
    assert not accumulate_lag_window(lags, valves, 0, 0.6, 0.0, STIFFNESS)


@pytest.mark.parametrize("cause", ["delay", "overlap"])
def test_another_delay_or_overlap_sets_the_sums_to_zero_and_keeps_the_lag(cause: str) -> None:
    lags, valves = build()
    learn(lags, valves, move_spool(FILE_LAG + 0.02))
    lag = lags.record["lag"][0]
    assert lag > FILE_LAG
    assert lags.squares[:6].any()
    if cause == "delay":
        finish_lag_step(lags, False, 3)
    else:
        valves.overlap[0, 1] = 0.05
        lags.windows["is_usable"] = 0.0
        accumulate_lag_window(lags, valves, 0, 0.5, 0.0, STIFFNESS)
    assert not lags.squares[:6].any()
    assert lags.record["lag"][0] == lag
