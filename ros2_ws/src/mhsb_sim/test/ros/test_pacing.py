from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.trajectory import SECOND_NS
from mhsb_sim.ros.pacing import CATCH_UP, LARGEST_LAG_NS, LONGEST_WAKE_NS, Pacer

MS = SECOND_NS // 1000
START_NS = 1_700_000_000 * SECOND_NS


def pacer(factor: float = 1.0) -> Pacer:
    each = Pacer(factor)
    each.restart(5 * SECOND_NS, START_NS)
    return each


def test_in_time_every_wake_brings_the_simulation_up_to_date() -> None:
    each, sim_ns = pacer(3.0), START_NS
    for wake in range(1, 100):
        sim_ns = each.compute_due_ns(5 * SECOND_NS + 2 * MS * wake, sim_ns)
        assert sim_ns == START_NS + 6 * MS * wake
    assert not each.lags


def test_a_freeze_is_made_up_at_a_bounded_pace() -> None:
    each, clock_ns = pacer(), 5 * SECOND_NS + 1500 * MS
    sim_ns = each.compute_due_ns(clock_ns, START_NS)
    assert sim_ns - START_NS == LONGEST_WAKE_NS * CATCH_UP
    assert each.lags
    steps = []
    while each.lag_ns > 2 * MS:
        clock_ns += 2 * MS
        steps.append(each.compute_due_ns(clock_ns, sim_ns) - sim_ns)
        sim_ns += steps[-1]
    assert max(steps) == 2 * MS * CATCH_UP
    assert clock_ns < 13 * SECOND_NS
    assert not each.lags


def test_what_lies_too_far_back_is_given_up() -> None:
    each, clock_ns = pacer(), 65 * SECOND_NS
    sim_ns = each.compute_due_ns(clock_ns, START_NS)
    assert each.lag_ns == LARGEST_LAG_NS
    for _ in range(10_000):
        clock_ns += 2 * MS
        sim_ns = each.compute_due_ns(clock_ns, sim_ns)
    behind_ns = clock_ns - 5 * SECOND_NS - (sim_ns - START_NS)
    assert behind_ns == 60 * SECOND_NS - LARGEST_LAG_NS
    assert not each.lags


def test_a_simulation_that_is_too_slow_lags_and_never_leaps() -> None:
    each, clock_ns, sim_ns = pacer(), 5 * SECOND_NS, START_NS
    for _ in range(3000):
        clock_ns += 2 * MS
        due_ns = each.compute_due_ns(clock_ns, sim_ns)
        assert due_ns - sim_ns <= 2 * MS * CATCH_UP
        sim_ns = min(due_ns, sim_ns + 1 * MS)
    assert each.lags
    assert each.lag_ns <= LARGEST_LAG_NS


@given(
    st.lists(st.tuples(st.integers(0, 3 * SECOND_NS), st.floats(0.0, 1.0)), max_size=60),
    st.sampled_from([0.01, 1.0, 50.0]),
)
def test_whatever_happens_time_neither_leaps_nor_runs_ahead(
    wakes: list[tuple[int, float]], factor: float
) -> None:
    """Wakes at any distance, each of which does a part of what is due."""
    each, clock_ns, sim_ns = pacer(factor), 5 * SECOND_NS, START_NS
    for passed_ns, share in wakes:
        clock_ns += passed_ns
        due_ns = each.compute_due_ns(clock_ns, sim_ns)
        assert sim_ns <= due_ns + 1
        assert due_ns - sim_ns <= LONGEST_WAKE_NS * factor * CATCH_UP + 1
        assert due_ns - START_NS <= (clock_ns - 5 * SECOND_NS) * factor + 1
        assert 0 <= each.lag_ns + 1 <= LARGEST_LAG_NS + 1
        sim_ns += round(share * max(0, due_ns - sim_ns))


def test_a_restart_counts_from_there() -> None:
    each = pacer()
    each.compute_due_ns(10 * SECOND_NS, START_NS)
    each.factor = 2.0
    each.restart(10 * SECOND_NS, 7)
    assert not each.lags
    assert each.compute_due_ns(10 * SECOND_NS + 2 * MS, 7) == 7 + 4 * MS


@pytest.mark.parametrize("factor", [0.5, 1.0])
def test_a_warning_does_not_flicker(factor: float) -> None:
    each, clock_ns, sim_ns = pacer(factor), 5 * SECOND_NS + 150 * MS, START_NS
    warned = []
    while each.lag_ns > 1 * MS or not warned:
        sim_ns = each.compute_due_ns(clock_ns, sim_ns)
        warned.append(each.lags)
        clock_ns += 1 * MS
    assert warned == sorted(warned, reverse=True)
    assert warned[0]
    assert not warned[-1]
