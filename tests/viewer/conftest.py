"""A page in headless Chromium, driven over its DevTools protocol; for tests of the viewer."""

from __future__ import annotations

import base64
import itertools
import json
import os
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
from websockets.sync.client import connect

NAMES = ("chromium", "chromium-browser", "google-chrome")
SIZE = tuple(map(int, os.environ.get("MHSB_VIEWER_SIZE", "860x560").split("x")))
"""Of the window [px]; a small one, since processors draw it, not a graphics card."""

START_TIMEOUT = 20.0  # s
PAGE_TIMEOUT = 60.0
"""Time within which a page shows what a test waits for [s]; processors draw it."""

FEWER_FRAMES = """
window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 100);
window.cancelAnimationFrame = clearTimeout;
"""
"""Ten in a second: processors draw them, and are needed for what the test is about."""

WITHOUT_NOTES = "document.querySelectorAll('[role=alert]').forEach(each => each.remove())"
"""Takes away the note that processors draw the page."""

THROTTLE = 0.2
"""Time within which the page sends what was typed or dragged [s]; a button may overtake it."""

OPTIONS = (
    "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--no-first-run",
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--mute-audio",
    "--disable-background-networking", "--disable-component-update", "--remote-debugging-port=0",
    f"--window-size={SIZE[0]},{SIZE[1]}",
)  # fmt: skip


def chromium() -> str | None:
    """Where Chromium is, None where it is not installed."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Page:
    """One page, for the length of a `with` block."""

    def __init__(self, executable: str, profile: Path, url: str) -> None:
        self._numbers = itertools.count()
        self._process = subprocess.Popen(
            [executable, *OPTIONS, f"--user-data-dir={profile}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            self._socket = connect(_address(profile), max_size=None)
            self.ask("Page.addScriptToEvaluateOnNewDocument", source=FEWER_FRAMES)
            self.ask("Page.navigate", url=url)
        except BaseException:
            self._process.kill()
            raise

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._process.terminate()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to a command of the protocol."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv(timeout=90.0))
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return dict(answer["result"])

    def evaluate(self, script: str) -> Any:
        """The value of an expression in the page, or of its promise."""
        answer = self.ask(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        return answer["result"].get("value")

    @property
    def text(self) -> str:
        """All that can be read in the page."""
        return str(self.evaluate("document.body.innerText"))

    def until(self, script: str, timeout: float = PAGE_TIMEOUT) -> Any:
        """Wait until an expression is true, and give its value; fails where it is not in time."""
        end = time.monotonic() + timeout
        while not (value := self.evaluate(script)):
            assert time.monotonic() < end, f"not within {timeout} s: {script}\n{self.text}"
            time.sleep(0.1)
        return value

    def until_says(self, words: str, timeout: float = PAGE_TIMEOUT) -> None:
        """Wait until words can be read in the page."""
        self.until(f"document.body.innerText.includes({json.dumps(words)})", timeout)

    def press(self, label: str) -> None:
        """Press the button with this label."""
        self.until(
            "(() => {const found = [...document.querySelectorAll('button')]"
            f".find(each => each.innerText.trim() === {json.dumps(label)});"
            " if (found) found.click(); return Boolean(found)})()"
        )

    def tick(self, label: str) -> None:
        """Press the box that stands beside this label."""
        self.until(
            "(() => {const found = [...document.querySelectorAll('label')]"
            f".find(each => each.innerText.trim() === {json.dumps(label)});"
            " if (found) found.click(); return Boolean(found)})()"
        )

    def type(self, selector: str, text: str) -> None:
        """Replace what is in an input by a text, and confirm it."""
        self.until(
            f"(() => {{const found = document.querySelector({json.dumps(selector)});"
            " if (found) {found.focus(); found.select()}; return Boolean(found)})()"
        )
        self.ask("Input.insertText", text=text)
        for kind in ("keyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key="Enter", windowsVirtualKeyCode=13)
        time.sleep(THROTTLE)

    def mouse(self, kind: str, x: float, y: float) -> None:
        """Press, move or release the left button at a place in the page [px].

        A release waits until the page has sent the moves before: it would overtake the last one.
        """
        if kind == "Released":
            time.sleep(THROTTLE)
        self.ask(
            "Input.dispatchMouseEvent",
            type=f"mouse{kind}", x=x, y=y, button="left", buttons=1, clickCount=1,
        )  # fmt: skip

    def screenshot(self, file: Path) -> bytes:
        """A picture of the page, PNG, written to a file."""
        self.evaluate(WITHOUT_NOTES)
        content = base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"])
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
        return content


def _address(profile: Path) -> str:
    """Web socket of the browser's page, as soon as it tells it."""
    end = time.monotonic() + START_TIMEOUT
    while time.monotonic() < end:
        try:
            port = (profile / "DevToolsActivePort").read_text(encoding="ascii").split()[0]
            with urlopen(f"http://127.0.0.1:{port}/json", timeout=5.0) as answer:
                for target in json.load(answer):
                    if target["type"] == "page":
                        return str(target["webSocketDebuggerUrl"])
        except (OSError, IndexError):
            pass
        time.sleep(0.05)
    raise AssertionError(f"Chromium showed no page within {START_TIMEOUT} s")


@pytest.fixture
def opened(start: Callable[..., Any], tmp_path: Path) -> Callable[..., tuple[Any, Page]]:
    """Function (arguments...) that starts a viewer and opens its page; both."""
    browser = chromium()
    if browser is None:
        pytest.skip("Chromium is not installed: the view was not tried in a browser")

    def run(*arguments: object) -> tuple[Any, Page]:
        viewer = start("mhsb_tools", "mhsb", "view", "--port", "0", *arguments)
        url = viewer.wait_for(r"ready: (\S+)").group(1)
        return viewer, Page(browser, tmp_path / f"profile_{len(arguments)}", url)

    return run
