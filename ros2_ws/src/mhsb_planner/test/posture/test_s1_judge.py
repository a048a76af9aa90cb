"""A table judged by SLSQP: its own machine's, and one that was made worse."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import binom

from mhsb_planner.posture.s1_judge import CONFIDENCE_LEVEL, TableComparison, compare_with_slsqp


def test_the_tables_entries_are_not_short_and_are_judged_alike_again(machine, table):
    done = []
    first = compare_with_slsqp(machine, table, 6, seed=1, progress=done.append)
    assert first.short_entries == 0
    assert first.worst_ratio >= 1.0 - 1e-6
    assert done == [1, 2, 3, 4, 5, 6]
    assert compare_with_slsqp(machine, table, 6, seed=1) == first


def test_a_table_with_smaller_polytopes_is_found_out(machine, table):
    worse = dataclasses.replace(table, area=0.99 * table.area)
    judgement = compare_with_slsqp(machine, worse, 4)
    assert judgement.short_entries == 4
    assert judgement.worst_ratio == pytest.approx(0.99, abs=1e-6)
    assert judgement.short_share_bound == 1.0
    assert "of 4 random entries 4 are short" in judgement.sentence


@pytest.mark.parametrize("short", [0, 1, 7])
def test_a_table_with_as_many_short_entries_as_said_shows_so_few_as_seldom_as_said(short):
    share = TableComparison(200, short, 0.9).short_share_bound
    assert binom.cdf(short, 200, share) == pytest.approx(1.0 - CONFIDENCE_LEVEL)
    if short == 0:
        assert share == pytest.approx(1.0 - 0.05 ** (1.0 / 200.0))
    assert np.isfinite(share)
