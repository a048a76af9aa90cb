"""The command around the measurement; that it runs is tested over processes."""

from __future__ import annotations

import pytest
from benchmarks.online_benchmark import CONDITIONS, as_text, online

from mhsb_model.command_line import UsageError

SPREAD = {"p50": 40.0, "p99": None, "max": None}
FIGURES = {
    "scipy_dijkstra_p50_ms": 0.8,
    "idle": {
        **dict.fromkeys(("goals", "applied", "retried", "lost", "deadline", "superseded"), 1),
        **dict.fromkeys(("real_time_factor", "reference_jump_max_rad", "rss_growth_mb"), 1.0),
        "reference_jump_max_rad_s": None,
        "lead_ms": SPREAD,
        "plan_ms": SPREAD,
    },
}


def test_the_figures_are_told_as_a_table_with_dashes_for_what_is_not_known():
    header, columns, *rows = as_text(FIGURES)
    assert "0.80 ms" in header
    assert len(rows) == 1
    assert rows[0].startswith("idle")
    assert rows[0].count("–") == 3
    assert len(rows[0]) < len(columns) + 10


def test_what_cannot_be_measured_is_refused_with_what_can():
    with pytest.raises(UsageError, match="busy is not one of idle, loaded, one_core"):
        online(condition=("idle", "busy"))
    with pytest.raises(UsageError, match="--goals is 0"):
        online(goals=0)


def test_on_one_processor_the_simulator_is_the_clock():
    assert CONDITIONS["one_core"].one_core
    assert CONDITIONS["one_core"].simulated_time
    assert [each.busy_loops for each in CONDITIONS.values()] == [0, 2, 1]
