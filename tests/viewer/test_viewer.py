"""The live view in a real browser: it loads, the arm moves, goals are typed and dragged, a
recording is played back."""

import math
import os
import re
import signal
import threading
import time
from pathlib import Path

import pytest
from benchmarks.message_watcher import MessageWatcher
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from mhsb_msgs_py.node_process import serve_node
from mhsb_tools.viewer.server import CAMERA_POSITION, FIELD_OF_VIEW, LOOK_AT

PICTURES = os.environ.get("MHSB_VIEWER_PICTURES")
"""Folder for screenshots, where somebody wants to look at them; docs/view_abilities.png is its
abilities.png with MHSB_VIEWER_SIZE=1280x760."""

FRAME = "new Promise(drawn => requestAnimationFrame(() => drawn()))"
"""Promise that is kept with the page's next frame: a move of the mouse is handled by then."""

SLIDER = "document.querySelector('[role=slider]').getAttribute('aria-valuenow')"
TIP = r"tip at x (-?[\d.]+) m, z (-?[\d.]+) m"


def tip_in(page):
    x, z = re.search(TIP, page.text).groups()
    return float(x), float(z)


def until_tip_left(page, place, distance=0.005, timeout=20.0):
    """Wait until the page shows the tip this far from a place [m]."""
    end = time.monotonic() + timeout
    while math.dist(tip_in(page), place) <= distance:
        assert time.monotonic() < end, f"the tip is shown at {place} m for {timeout} s"
        time.sleep(0.1)


def place_of(page, x, z):
    """Where a point of the arm's plane is in the page, by the camera that the view begins with."""
    width, height = page.evaluate("innerWidth"), page.evaluate("innerHeight")
    away = [there - here for here, there in zip(CAMERA_POSITION, LOOK_AT, strict=True)]
    distance = math.hypot(*away)
    y_ahead, z_ahead = away[1] / distance, away[2] / distance
    y, right, up = -CAMERA_POSITION[1], x - CAMERA_POSITION[0], z - CAMERA_POSITION[2]
    depth, high = y * y_ahead + up * z_ahead, up * y_ahead - y * z_ahead
    focal = height / 2 / math.tan(FIELD_OF_VIEW / 2)
    return width / 2 + focal * right / depth, height / 2 - focal * high / depth


def drag(page, start, end, steps=4):
    """By the mouse from a point of the arm's plane to another one."""
    (x, y), (x_end, y_end) = place_of(page, *start), place_of(page, *end)
    page.mouse("Moved", x, y)
    page.evaluate(FRAME)
    page.mouse("Pressed", x, y)
    for k in range(1, steps + 1):
        page.mouse("Moved", x + (x_end - x) * k / steps, y + (y_end - y) * k / steps)
        page.evaluate(FRAME)
    page.mouse("Released", x_end, y_end)


@pytest.fixture
def watcher(arm):
    """Keeps what is heard, while the test does something else."""
    with serve_node(MessageWatcher) as (executor, node):
        thread = threading.Thread(target=executor.spin, daemon=True)
        thread.start()
        yield node
        executor.shutdown()
        thread.join()


def keep(page, name):
    if PICTURES:
        page.screenshot(Path(PICTURES) / f"{name}.png")


def test_goals_are_typed_and_dragged_and_what_was_seen_is_played_back(
    arm, watcher, opened, tmp_path
):
    viewer, page = opened()
    with page:
        page.until_says("tip at")
        before = tip_in(page)
        page.type("input[value='0.55']", "0.5")
        page.type("input[value='0.3']", "-0.2")
        watcher.forget()
        page.press("Go")
        page.until_says("OK (0.500, -0.200) m")
        until_tip_left(page, before)
        keep(page, "live")
        page.tick("where boost is needed")
        counts = r"with 10 kg, of \d+ points in reach \d+ are held in N, \d+ need boost"
        page.until(f"/{counts}/.test(document.body.innerText)")
        page.until(r"/of \d+ J from the pumps: -?\d+ J work/.test(document.body.innerText)")
        time.sleep(1.0)
        keep(page, "abilities")
        page.tick("where boost is needed")
        drag(page, (0.5 + 0.12, -0.2), (0.6 + 0.12, -0.2))
        page.until(r"/OK \(0\.(5[5-9]|6)\d*, -0\.\d+\) m/.test(document.body.innerText)")
        page.press("Stop")
        page.until_says("stop")
    assert viewer.stop(signal.SIGINT) == 0, viewer.output
    watcher.write(tmp_path / "bag")
    viewer, page = opened(tmp_path / "bag")
    with page:
        page.until(f"Number({SLIDER}) > 1.0")
        page.until_says("OK (0.500, -0.200) m")
        keep(page, "playback")
    assert viewer.stop(signal.SIGINT) == 0, viewer.output
    assert "Traceback" not in viewer.output


def test_pages_of_elsewhere_and_a_taken_port_are_refused(start):
    first = start("mhsb_tools", "mhsb", "view", "--port", "0")
    port = first.wait_for(r"ready: \S+:(\d+)").group(1)
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://127.0.0.1:{port}", origin="https://example.org")
    second = start("mhsb_tools", "mhsb", "view", "--port", port)
    assert second.wait() == 1
    assert f"port {port} is in use" in second.output
    assert first.stop() == 0
