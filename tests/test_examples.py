"""The examples run as they are, each in a process of its own, and the notebook without Jupyter."""

import json
import sys
from functools import partial
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
MAX_LINES = 60
OUTPUT = {
    "01_one_move": ("actuator_1: ", ["move.csv", "move.png"]),
    "02_compare_planners": ("integrated", []),
    "03_velocity_polytope": ("SB-N-N: ", ["polytopes.png"]),
    "04_own_planner": ("straight <Plan: ", []),
    "05_own_machine": ("in bar or MPa? 40 bar are 4e+06 Pa", ["my_arm.yaml"]),
    "06_zones": ("deep in the keep-out box", ["zones.png"]),
    "07_streaming_goals": ("velocity jumps by 0.0e+00 rad/s", []),
    "08_simulate_and_record": ("at rest", ["signals.csv", "simulated.png"]),
    "09_servo_on_recorded_signals": ("payload : 12.5 ± ", []),
    "10_study": ("  20 kg at 6 MPa: ", ["study.csv"]),
}
"""Words that each example prints, and the files that it writes."""
FRESH = "01_one_move", "10_study"
"""Examples in a fresh Python: the first one, and the one that starts processes itself."""


def test_every_example_is_run_and_listed():
    names = {file.stem for file in EXAMPLES.glob("*.py")}
    assert names == set(OUTPUT)
    page = (EXAMPLES / "README.md").read_text()
    assert all(f"[{name}.py]({name}.py)" in page for name in names)


@pytest.mark.parametrize("name", OUTPUT)
def test_an_example_prints_and_writes_what_it_says(
    name, start_process, start_script, tmp_path, monkeypatch
):
    file = EXAMPLES / f"{name}.py"
    assert len(file.read_text().splitlines()) < MAX_LINES
    words, files = OUTPUT[name]
    monkeypatch.chdir(tmp_path)
    start = partial(start_process, sys.executable) if name in FRESH else start_script
    run = start(file, *([tmp_path / "new"] if files else []))
    assert run.wait(240) == 0, run.output
    assert words in run.output
    assert sorted(each.name for each in tmp_path.rglob("*") if each.is_file()) == sorted(files)
    assert all(each.stat().st_size > 0 for each in tmp_path.rglob("*"))


def test_the_cells_of_the_notebook_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    cells = json.loads((EXAMPLES / "01_one_move.ipynb").read_text())["cells"]
    names: dict = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None
            exec("".join(cell["source"]), names)
    assert "above the lower bound of" in capsys.readouterr().out
    assert (tmp_path / "move.csv").exists()
    assert (tmp_path / "move.png").exists()
    shown = eval(cells[-1]["source"][-1], names)._repr_png_()  # as Jupyter shows the last value
    assert shown.startswith(b"\x89PNG")
