"""The live view of arms other than the suite's own, in a real browser."""

import os
import signal
from pathlib import Path

import pytest

from mhsb_model.files.config_files import find_config_file

PICTURES = os.environ.get("MHSB_VIEWER_PICTURES")


@pytest.mark.parametrize("name", ["mhsb_arm4", "telescope_arm"])
def test_the_view_shows_the_arm_and_where_it_needs_boost(start_simulator, opened, name):
    machine = find_config_file(f"{name}.yaml")
    simulator = start_simulator("--ros-args", "-p", f"machine:={machine}")
    viewer, page = opened("--machine", machine)
    with page:
        page.until_says("tip at")
        page.tick("where boost is needed")
        counts = r"with 8 kg, of \d+ points in reach \d+ are held in N"
        page.until(f"/{counts}/.test(document.body.innerText)", 60.0)
        page.until(r"/of \d+ J from the pumps: -?\d+ J work/.test(document.body.innerText)")
        if PICTURES:
            page.screenshot(Path(PICTURES) / f"{name}.png")
    assert viewer.stop(signal.SIGINT) == 0, viewer.output
    assert simulator.stop(signal.SIGINT) == 0, simulator.output
    assert "Traceback" not in viewer.output
