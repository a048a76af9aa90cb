import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from docs import arm_picture
from PIL import Image


def test_without_opengl_it_says_so_and_draws_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arm_picture, "choose_backend", lambda: None)
    monkeypatch.setattr(arm_picture, "draw_arm", lambda machine: pytest.fail("was drawn"))
    with pytest.raises(SystemExit, match="no picture: neither EGL nor OSMesa is installed"):
        arm_picture.main()


def test_the_users_choice_of_opengl_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert arm_picture.choose_backend() == "osmesa"


def test_the_picture_shows_an_arm(tmp_path: Path) -> None:
    file = tmp_path / "arm.png"
    environment = {k: v for k, v in os.environ.items() if k != "MUJOCO_GL"}
    run = subprocess.run(
        [sys.executable, arm_picture.__file__, str(file)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    if run.returncode != 0:
        assert run.stderr.startswith("no picture: ")
        pytest.skip(run.stderr)
    pixels = np.asarray(Image.open(file).convert("RGB"), dtype=int)
    assert pixels.shape == (720, 960, 3)
    yellow = (pixels[..., 0] > 150) & (pixels[..., 2] < 120)
    assert yellow.sum() > 2000
    assert file.stat().st_size < 200_000
