import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mhsb_model.machine import Machine
from mhsb_sim.mechanics import render


def test_without_opengl_it_says_so_and_draws_nothing(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(render, "choose_backend", lambda: None)
    assert render.draw_arm(machine, [np.zeros(3)]) is None
    assert capsys.readouterr().err.startswith("no picture: neither EGL nor OSMesa is installed")


def test_the_users_choice_of_opengl_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert render.choose_backend() == "osmesa"


def test_the_picture_shows_an_arm(tmp_path: Path) -> None:
    file = tmp_path / "arm.png"
    environment = {k: v for k, v in os.environ.items() if k != "MUJOCO_GL"}
    run = subprocess.run(
        [sys.executable, "-m", "mhsb_sim.mechanics.render", str(file)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    if run.returncode != 0:
        assert run.stderr.startswith("no picture: ")
        pytest.skip(run.stderr)
    from PIL import Image

    pixels = np.asarray(Image.open(file).convert("RGB"), dtype=int)
    assert pixels.shape == (720, 960, 3)
    yellow = (pixels[..., 0] > 150) & (pixels[..., 2] < 120)
    assert yellow.sum() > 2000
    assert file.stat().st_size < 200_000
