"""Figures of goals that stream, against a tip whose distance is known."""

import numpy as np
from benchmarks.tracking_figures import _compute_goal_distances

from mhsb_model.trajectory import SECOND_NS


def test_a_tip_that_lags_by_a_constant_time_is_behind_by_speed_times_lag():
    sent_ns = np.arange(0, 4 * SECOND_NS, SECOND_NS // 50)
    way = 0.1 * sent_ns / SECOND_NS
    goals = np.column_stack([0.6 * way, 0.8 * way])
    time_ns = np.arange(SECOND_NS, 3 * SECOND_NS, SECOND_NS // 100)
    late = 0.1 * (time_ns / SECOND_NS - 0.05)
    behind = _compute_goal_distances(
        sent_ns, goals, time_ns, np.column_stack([0.6 * late, 0.8 * late])
    )
    np.testing.assert_allclose(behind, 0.1 * 0.05, atol=1e-9)


def test_turning_points_and_half_a_second_after_them_do_not_count():
    sent_ns = np.arange(0, 4 * SECOND_NS, SECOND_NS // 50)
    time = sent_ns / SECOND_NS
    x = np.where(time < 2.0, time, 4.0 - time)
    goals = np.column_stack([x, 0 * x])
    tip = np.zeros((len(sent_ns), 2))
    counted = len(_compute_goal_distances(sent_ns, goals, sent_ns, tip))
    assert abs(counted - 2 * 1.5 * 50) <= 3
