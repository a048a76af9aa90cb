"""`scripts/bench online` over real processes: a few goals, every key there, the sums right."""

import json
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
KEYS = {
    *("goals", "applied", "retried", "lost", "deadline", "superseded", "real_time_factor"),
    *("reference_jump_max_rad", "reference_jump_max_rad_s", "lead_ms", "plan_ms", "rss_growth_mb"),
}


@pytest.mark.slow
@pytest.mark.parametrize(("condition", "stream"), [("idle", 3), ("one_core", 0)])
def test_the_benchmark_counts_every_goal_once(ros_domain, tmp_path, condition, stream):
    output = tmp_path / "online.json"
    run = subprocess.run(
        [ROOT / "scripts" / "bench", "online", "--goals", "4", "--condition", condition]
        + ["--output", output, "--stream", str(stream)],
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert run.returncode == 0, run.stderr
    figures = json.loads(output.read_text())
    measured = figures[condition]
    assert measured.keys() >= KEYS
    assert measured["goals"] == 4
    assert measured["applied"] + measured["superseded"] + measured["lost"] == 4
    assert measured["applied"] > 0
    assert max(measured["reference_jump_max_rad"], measured["reference_jump_max_rad_s"]) <= 1e-6
    assert figures["scipy_dijkstra_p50_ms"] > 0.0
    assert condition in run.stdout
    assert ("stream" in figures) == (stream > 0)
    if stream:
        assert sum(figures["stream"]["verdicts"].values()) == figures["stream"]["goals"]
        assert figures["stream"]["plans_per_s"] > 0.0
