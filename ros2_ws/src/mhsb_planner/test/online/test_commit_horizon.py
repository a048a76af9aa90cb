"""The lead: a recent quantile of what planning and the way to the arm take."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_planner.online.commit_horizon import (
    HALF_LIFE,
    CommitHorizonEstimator,
    compute_recent_quantile,
)

samples = st.lists(st.floats(0.0, 2.0), min_size=1, max_size=50)


@given(samples)
def test_the_quantile_is_the_least_sample_that_so_much_of_the_weight_does_not_exceed(samples):
    weight = [0.5 ** (age / HALF_LIFE) for age in reversed(range(len(samples)))]
    found = compute_recent_quantile(np.array(samples), 0.95)
    assert found in samples

    def share(limit: float) -> float:
        pairs = zip(samples, weight, strict=True)
        return sum(w for s, w in pairs if s <= limit) / sum(weight)

    assert share(found) >= 0.95 - 1e-9
    smaller = [s for s in samples if s < found]
    assert not smaller or share(max(smaller)) < 0.95 + 1e-9


@given(samples)
def test_twenty_quick_plans_make_slow_ones_forgotten(slow):
    assert compute_recent_quantile(np.array([*slow, *[0.01] * 20]), 0.95) == 0.01


def test_what_is_assumed_before_the_first_plan_is_forgotten_after_nine():
    estimate = CommitHorizonEstimator()
    for _ in range(9):
        assert estimate.horizon == pytest.approx(0.03)
        estimate.add_first_motion(0.004)
        estimate.add_transport_time(0.003)
    assert estimate.horizon == pytest.approx(0.007)


def test_the_lead_is_first_motion_plus_flight():
    estimate = CommitHorizonEstimator()
    for _ in range(30):
        estimate.add_first_motion(0.04)
        estimate.add_transport_time(0.008)
    assert estimate.horizon == pytest.approx(0.048)
    assert estimate.choose_horizon(0.03, 1.0, 0.0, 1.0) == pytest.approx((0.048, 0.008, False))


def test_where_plans_take_long_more_is_kept_for_their_way():
    estimate = CommitHorizonEstimator()
    for _ in range(30):
        estimate.add_first_motion(0.6)
        estimate.add_transport_time(0.008)
    lead = estimate.choose_horizon(0.03, 1.0, 0.0, 1.0)
    assert lead == pytest.approx((0.69, 0.09, False))
    assert lead.total - lead.transport_reserve == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("lower_bound", "reserve"),
    [(0.03, 0.01), (0.035, 0.015), (0.04, 0.02), (0.05, 0.025), (0.1, 0.03)],
)
def test_what_a_lower_bound_leaves_is_kept_for_the_longest_way_of_late(lower_bound, reserve):
    estimate = CommitHorizonEstimator()
    estimate.add_transport_time(0.03)
    for _ in range(30):
        estimate.add_first_motion(0.02)
        estimate.add_transport_time(0.01)
    lead = estimate.choose_horizon(lower_bound, 1.0, 0.0, 1.0)
    assert lead == pytest.approx((lower_bound, reserve, False))


def test_it_stays_between_its_bounds_and_is_fixed_where_asked_for():
    estimate = CommitHorizonEstimator()
    estimate.add_first_motion(0.06)
    assert estimate.choose_horizon(0.2, 1.0, 0.0, 1.0).total == 0.2
    longest = estimate.choose_horizon(0.03, 0.06, 0.0, 1.0)
    assert (longest.total, longest.is_longest) == (0.06, True)
    assert estimate.choose_horizon(0.03, 1.0, 0.3, 1.5).total == 0.3
    assert estimate.choose_horizon(0.03, 1.0, 0.0, 1.5).total == pytest.approx(
        1.5 * estimate.horizon
    )
