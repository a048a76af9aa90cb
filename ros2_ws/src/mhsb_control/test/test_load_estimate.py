import numpy as np
import pytest

from mhsb_control.load_estimate import (
    LoadEstimate,
    LoadSettings,
    accumulate_load_window,
    build_load_estimate,
    update_load_filter,
)
from mhsb_model.records import create_record

SETTINGS = LoadSettings()
RECORD = create_record(SETTINGS)[0]
WINDOW_STEPS = SETTINGS.window_steps
SUPPLY_TORQUE = 88.0
DEVIATION = SETTINGS.torque_deviation * SUPPLY_TORQUE


def build_load(count: int, *, is_estimated: bool = True) -> LoadEstimate:
    """Return the initial estimates for a payload of 10 kg."""
    torque = np.full(count, SUPPLY_TORQUE)
    return build_load_estimate(10.0, torque, is_estimated=is_estimated)


def test_payload_and_friction_are_learnt_from_motions_both_ways() -> None:
    """Two joints; what a joint lacks is r F less what is believed by then."""
    random, load = np.random.default_rng(1), build_load(2)
    payload, friction = 12.5, np.array([1.8, 0.6])
    for _ in range(200):
        load.weight[:] = random.uniform(-9.0, 9.0, 2)
        rubbing = random.choice([-1.0, 1.0], 2) * random.uniform(2.0, 4.0, 2)
        for j in range(2):
            for _ in range(WINDOW_STEPS):
                lack = (payload - load.estimate[0]) * load.weight[j]
                lack += (friction[j] - load.estimate[1 + j]) * rubbing[j]
                accumulate_load_window(
                    load, j, True, lack + random.normal(0.0, 1.0), rubbing[j], RECORD
                )
    deviation = np.sqrt(np.diag(load.covariance))
    assert np.all(np.abs(load.estimate - [payload, *friction]) < 2.0 * deviation)
    assert deviation[0] < 0.2
    assert np.all(deviation[1:] < 0.15)


def test_from_one_posture_and_one_way_they_are_not_told_apart() -> None:
    load = build_load(1)
    load.weight[0] = 4.0
    for _ in range(200 * WINDOW_STEPS):
        lack = 2.0 * 4.0 - (load.estimate[0] - 10.0) * 4.0 - (load.estimate[1] - 1.0) * 3.0
        accumulate_load_window(load, 0, True, lack, 3.0, RECORD)
    assert load.estimate[0] < 12.5
    assert np.sqrt(load.covariance[0, 0]) > 0.3


def test_a_short_spell_is_dropped_and_what_is_not_to_be_learnt_stays() -> None:
    load = build_load(1)
    for k in range(10 * WINDOW_STEPS):
        assert not accumulate_load_window(load, 0, k % WINDOW_STEPS != 0, 50.0, 3.0, RECORD)
    assert load.estimate[0] == 10.0
    assert not build_load(1, is_estimated=False).covariance.any()


def test_the_update_is_kalmans() -> None:
    """Oracle: the matrix form of the filter."""
    random, load = np.random.default_rng(2), build_load(3)
    wanted, spread = load.estimate.copy(), load.covariance.copy()
    for _ in range(30):
        j = int(random.integers(3))
        load.weight[:] = random.uniform(-9.0, 9.0, 3)
        torque, rubbing = random.normal(0.0, 1.0), random.uniform(2.0, 4.0)
        row = np.zeros(4)
        row[0], row[1 + j] = load.weight[j], rubbing
        update_load_filter(load, j, torque, rubbing, RECORD)
        spread[0, 0] += (SETTINGS.payload_drift * 10.0) ** 2
        spread[1 + j, 1 + j] += SETTINGS.friction_drift**2
        gain = spread @ row / (row @ spread @ row + DEVIATION**2)
        wanted = wanted + gain * torque
        spread = spread - np.outer(gain, row @ spread)
    assert load.estimate == pytest.approx(wanted)
    np.testing.assert_allclose(load.covariance, spread, rtol=1e-7, atol=1e-12)
