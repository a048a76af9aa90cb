from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from mhsb_control.reference import ReferencePreview
from mhsb_control.speed_scaling import (
    ScalingSettings,
    build_full_speed_scaling,
    update_rate,
)
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.records import create_record
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory

STEP, MAX_SLOWING = 1e-3, 8.0
SETTINGS = ScalingSettings()
RECORD = create_record(SETTINGS)[0]
STEP_NS = SECOND_NS // 1000


@pytest.fixture
def wanted() -> np.ndarray:
    """Rates as they may be wanted: down, to a hold, up again, at random."""
    random = np.random.default_rng(3)
    parts = [np.ones(50), np.full(300, 0.4), np.zeros(300), np.ones(900)]
    return np.concatenate([*parts, np.repeat(random.uniform(0.0, 1.2, 20), 60), np.ones(1000)])


def test_the_rate_is_smooth_within_its_limits_and_comes_back_to_one(wanted: np.ndarray) -> None:
    pace, rows = build_full_speed_scaling(), []
    for each in wanted:
        update_rate(pace[0], min(each, 1.0), STEP, MAX_SLOWING, RECORD)
        rows.append(pace[0].copy())
    rate, change, delay = (np.array([row[i] for row in rows]) for i in range(3))
    assert rate.min() >= 0.0
    assert rate.max() <= 1.0
    assert rate[640] < 1e-3
    assert change.min() >= -MAX_SLOWING
    assert change.max() <= SETTINGS.max_recovery * MAX_SLOWING
    np.testing.assert_allclose(np.diff(rate), STEP * change[1:], atol=1e-3)
    turns = np.abs(np.diff(change))[(rate[1:] > 0.0) & (rate[1:] < 1.0)]
    assert turns.max() <= MAX_SLOWING / SETTINGS.slowing_time * STEP * (1.0 + 1e-9)
    assert rate[-1] == 1.0
    assert change[-1] == 0.0
    lost = cumulative_trapezoid(1.0 - np.concatenate([[1.0], rate]), dx=STEP)
    np.testing.assert_allclose(delay / SECOND_NS, lost, atol=1e-9)


def test_full_pace_is_exactly_that() -> None:
    pace = build_full_speed_scaling()
    for _ in range(100):
        update_rate(pace[0], 1.0, STEP, MAX_SLOWING, RECORD)
    assert pace.tolist() == build_full_speed_scaling().tolist()


def test_at_rest_the_delay_is_made_up_twice_as_fast_as_time_goes() -> None:
    pace = build_full_speed_scaling()
    pace["delay"], pace["rests"] = 2.5 * STEP_NS, 1.0
    left = []
    for _ in range(4):
        update_rate(pace[0], 0.3, STEP, MAX_SLOWING, RECORD)
        left.append(pace["delay"][0])
    assert left == [1.5 * STEP_NS, 0.5 * STEP_NS, 0.0, 0.0]
    assert pace["rate"][0] == 1.0


def test_a_slowed_reference_stays_on_its_way_and_is_its_own_derivative(
    motion: Callable[..., tuple[Trajectory, ModeSchedule]], wanted: np.ndarray
) -> None:
    start = np.array([0.3, -1.4, -1.5])
    trajectory, schedule = motion(MotionState.at_rest(start), start + 0.3)
    values, states = np.zeros((6, 3, 3)), np.zeros((2, 3, 3))
    reference = ReferencePreview(values, 0.06, states, np.array([0.0, 0.023]))
    reference.follow(trajectory, schedule, planned=True)
    rows, own = [], []
    for k, each in enumerate(wanted):
        reference.update(k * STEP_NS)
        rows.append(values[0].copy())
        own.append(reference.compute_trajectory_time_ns(k * STEP_NS))
        at_full = reference.sample_at_full_speed(k * STEP_NS)
        np.testing.assert_allclose(reference.full_speed_velocity, at_full.velocity, atol=1e-9)
        ahead = trajectory.sample(
            own[-1] + round(0.06 * SECOND_NS * reference.speed_scaling["rate"][0])
        )
        np.testing.assert_allclose(values[2, 0], ahead.position, atol=1e-8)
        rate, change = (float(reference.speed_scaling[name][0]) for name in ("rate", "change"))
        np.testing.assert_array_equal(states[0], values[0])
        late = trajectory.sample(own[-1] + round(0.023 * SECOND_NS * rate))
        np.testing.assert_allclose(states[1, 0], late.position, atol=1e-8)
        np.testing.assert_allclose(states[1, 1], rate * late.velocity, atol=1e-6)
        slowed = rate**2 * late.acceleration + change * late.velocity
        np.testing.assert_allclose(states[1, 2], slowed, atol=1e-4)
        update_rate(reference.speed_scaling[0], min(each, 1.0), STEP, MAX_SLOWING, RECORD)
    q, qd, qdd = np.array(rows).transpose(1, 0, 2)
    np.testing.assert_allclose(q, trajectory.sample_many(np.array(own))[0], atol=1e-9)
    np.testing.assert_allclose(np.gradient(q, STEP, axis=0)[2:-2], qd[2:-2], atol=2e-4)
    np.testing.assert_allclose(np.gradient(qd, STEP, axis=0)[2:-2], qdd[2:-2], atol=0.2)
    assert np.abs(qdd).max() < 2.0 * np.abs(trajectory.acceleration).max() + 4.0
    assert not reference.has_ended
