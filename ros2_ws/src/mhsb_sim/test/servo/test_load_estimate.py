import numpy as np
import pytest

from mhsb_sim.servo.load_estimate import (
    FRICTION_WANDER,
    PAYLOAD_WANDER,
    SPELL,
    TORQUE,
    load_of,
    update,
    weigh,
)


def test_payload_and_friction_are_learnt_from_motions_both_ways() -> None:
    """Two joints; what a joint lacks is r F less what is believed by then."""
    random, load = np.random.default_rng(1), load_of(10.0, 2, learns=True)
    payload, friction = 12.5, np.array([1.8, 0.6])
    for _ in range(200):
        load.weight[:] = random.uniform(-9.0, 9.0, 2)
        rubbing = random.choice([-1.0, 1.0], 2) * random.uniform(2.0, 4.0, 2)
        for j in range(2):
            for _ in range(SPELL):
                lack = (payload - load.believed[0]) * load.weight[j]
                lack += (friction[j] - load.believed[1 + j]) * rubbing[j]
                weigh(load, j, True, lack + random.normal(0.0, 1.0), rubbing[j])
    deviation = np.sqrt(np.diag(load.covariance))
    assert np.all(np.abs(load.believed - [payload, *friction]) < 2.0 * deviation)
    assert deviation[0] < 0.2
    assert np.all(deviation[1:] < 0.15)


def test_from_one_posture_and_one_way_they_are_not_told_apart() -> None:
    load = load_of(10.0, 1, learns=True)
    load.weight[0] = 4.0
    for _ in range(200 * SPELL):
        lack = 2.0 * 4.0 - (load.believed[0] - 10.0) * 4.0 - (load.believed[1] - 1.0) * 3.0
        weigh(load, 0, True, lack, 3.0)
    assert load.believed[0] < 12.5
    assert np.sqrt(load.covariance[0, 0]) > 0.3


def test_a_short_spell_is_dropped_and_what_is_not_to_be_learnt_stays() -> None:
    load = load_of(10.0, 1, learns=True)
    for k in range(10 * SPELL):
        assert not weigh(load, 0, k % SPELL != 0, 50.0, 3.0)
    assert load.believed[0] == 10.0
    assert not load_of(10.0, 1, learns=False).covariance.any()


def test_the_update_is_kalmans() -> None:
    """Oracle: the matrix form of the filter."""
    random, load = np.random.default_rng(2), load_of(10.0, 3, learns=True)
    wanted, spread = load.believed.copy(), load.covariance.copy()
    for _ in range(30):
        j = int(random.integers(3))
        load.weight[:] = random.uniform(-9.0, 9.0, 3)
        torque, rubbing = random.normal(0.0, 1.0), random.uniform(2.0, 4.0)
        row = np.zeros(4)
        row[0], row[1 + j] = load.weight[j], rubbing
        update(load, j, torque, rubbing)
        spread[0, 0] += (PAYLOAD_WANDER * 10.0) ** 2
        spread[1 + j, 1 + j] += FRICTION_WANDER**2
        gain = spread @ row / (row @ spread @ row + TORQUE**2)
        wanted = wanted + gain * torque
        spread = spread - np.outer(gain, row @ spread)
    assert load.believed == pytest.approx(wanted)
    np.testing.assert_allclose(load.covariance, spread, rtol=1e-7, atol=1e-12)
