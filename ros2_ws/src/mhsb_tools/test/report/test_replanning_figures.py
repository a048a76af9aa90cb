"""Figures of replanning online, of a recording whose numbers are known."""

from __future__ import annotations

import pytest
from benchmarks.replanning_figures import compute_replanning_figures


@pytest.fixture(scope="module")
def figures(run):
    return compute_replanning_figures(run.recording)


def test_goals_are_counted_once_each(figures):
    assert figures["goals"] == 6
    assert figures["applied"] + figures["superseded"] + figures["lost"] == figures["goals"]
    assert (figures["lost"], figures["deadline"], figures["retried"]) == (2, 0, 0)
    assert figures["lost_because"] == [
        "it was refused with OUT_OF_WORKSPACE: a sentence",
        "it was refused with NOT_FINITE: a sentence",
    ]


def test_times_and_jumps_are_those_of_the_recording(figures):
    assert figures["real_time_factor"] == pytest.approx(2.0)
    assert figures["reference_jump_max_rad"] == 2e-7
    assert figures["reference_jump_max_rad_s"] == 4e-7
    assert figures["plan_ms"]["p50"] == 20.0


def test_leads_are_seen_in_the_messages_where_nobody_tells_them(figures):
    # Sent 50 ms before they were planned; one plan goes on along the old curve to its end.
    assert figures["lead_ms"]["p50"] is None
    assert figures["lead_seen_ms"]["p50"] == pytest.approx(50.0, abs=1.0)
    assert figures["lead_seen_ms"]["max"] == pytest.approx(2050.0, abs=1.0)
