"""The command writes every table and figure, and they agree with each other."""

import csv
import json

import matplotlib.image
import numpy as np
import pytest

from mhsb_planner import reproduce_command
from mhsb_planner.reproduction.expectations import records

FIGURES = ("3", "5", "6", "7", "8", "9", "10")


@pytest.fixture(scope="module")
def folder(runs, tmp_path_factory):
    """What the command writes, with the runs that are there already."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduce_command, "evaluate", lambda *_: runs)
        folder = tmp_path_factory.mktemp("reproduce") / "new"
        reproduce_command.reproduce(folder)
    return folder


def rows(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_summary_has_a_record_for_every_expectation(folder, runs):
    summary = json.loads((folder / "summary.json").read_text())
    found = summary["expectations"]
    assert [(each["id"], each["met"]) for each in found] == [
        (each.id, each.met) for each in records(runs)
    ]
    assert summary["met"] == sum(each["met"] for each in found)
    case_4 = next(each for each in found if each["id"] == "e.4-1")
    assert {"energy_discrete_j", "energy_fitted_j"} <= set(case_4["own"]["4-1"])


def test_the_table_has_a_row_for_every_run(folder, runs):
    found = {row["run"]: row for row in rows(folder / "table.csv")}
    assert list(found) == list(runs.runs)
    for name, run in runs.runs.items():
        if run.path is not None:
            assert float(found[name]["energy_discrete_j"]) == pytest.approx(run.path.energy.sum())
    assert all(found[name]["energy_fitted_j"] for name in ("1-1", "2-1", "4-2"))


@pytest.mark.parametrize("number", FIGURES)
def test_each_figure_is_drawn_and_its_data_are_beside_it(folder, number):
    picture = matplotlib.image.imread(folder / f"figure_{number}.png")[..., :3]
    assert np.mean(np.any(picture < 0.97, axis=2)) > 0.02
    data = sorted(folder.glob(f"figure_{number}*.csv"))
    assert data
    assert all(rows(path) for path in data)


def test_the_figures_data_are_the_runs(folder, runs):
    path = runs["1-1"].path
    drawn = [
        (float(row["x_m"]), float(row["z_m"]))
        for row in rows(folder / "figure_5_paths.csv")
        if (row["case"], row["path"]) == ("1-1", "discrete")
    ]
    assert np.array(drawn) == pytest.approx(path.tip)
    areas = [float(row["area_m2_s2"]) for row in rows(folder / "figure_9.csv")]
    assert len(areas) == sum(runs[name].path.steps for name in ("4-1", "4-2", "4-3"))


def test_nothing_half_written_is_left(folder):
    assert not list(folder.glob("*.part"))
