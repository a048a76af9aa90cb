"""`scripts/soak` over real processes; a whole one takes ten minutes, see docs/studies.md."""

import json
import subprocess
from pathlib import Path

import pytest
from tests.soak.promises import PROMISES

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_every_promise_holds_through_a_ten_minute_soak(ros_domain, tmp_path):
    run = subprocess.run(
        [ROOT / "scripts" / "soak", "--minutes", "10", "--output", tmp_path / "soak"],
        capture_output=True,
        text=True,
        timeout=1400,
    )
    told = json.loads((tmp_path / "soak" / "summary.json").read_text())
    assert {each["promise"] for each in told["promises"]} == set(PROMISES)
    broken = [each for each in told["promises"] if not each["held"]]
    assert run.returncode == 0, (broken, run.stderr)
    assert told["held"]
