"""The command writes every table and figure, and they agree with each other."""

import csv
import itertools
import json

import matplotlib.image
import numpy as np
import pytest

from mhsb_planner.cluster import WorkArguments
from mhsb_tools.commands import reproduce_command
from mhsb_tools.reproduction.expectations import judge_expectations
from mhsb_tools.reproduction.runs import (
    HEURISTIC_SCALES,
    Runs,
    area_settings,
    evaluate,
    integrated_run,
    integrated_settings,
    published_run,
    published_settings,
)

FIGURES = (
    *(f"figure_{number}" for number in (3, 5, 6, 7, 8, 9, 10)),
    *("area_energy", "operating_point"),
)

pytestmark = pytest.mark.slow  # what the runs claim is tested quickly beside this


@pytest.fixture(scope="module")
def weighed(machine, runs):
    """The runs of Case 4 with more and more weight on the area."""
    asked = {integrated_run("4-1"): integrated_settings()[integrated_run("4-1")]}
    return evaluate(machine, asked | area_settings(), known=runs)


@pytest.fixture(scope="module")
def published(machine, runs):
    """The runs with the published search."""
    asked = {}
    for scale in HEURISTIC_SCALES:
        asked |= published_settings(scale=scale)
    return evaluate(machine, asked, known=runs)


@pytest.fixture(scope="module")
def folder(runs, weighed, published, tmp_path_factory):
    """What the command writes, with the runs that are there already."""
    every = Runs(runs.machine, runs.tables, {**runs.runs, **weighed.runs, **published.runs})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduce_command, "evaluate", lambda *_: every)
        folder = tmp_path_factory.mktemp("reproduce") / "new"
        reproduce_command.reproduce(folder, work=WorkArguments())
    return folder


def rows(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_summary_has_a_record_for_every_expectation(folder, runs, published):
    summary = json.loads((folder / "summary.json").read_text())
    found = summary["expectations"]
    assert [(each["id"], each["met"]) for each in found] == [
        (each.id, each.met) for each in judge_expectations(published.by_published_search())
    ]
    assert [(each["id"], each["exact"]["met"]) for each in found] == [
        (each.id, each.met) for each in judge_expectations(runs)
    ]
    assert summary["met"] == sum(each["met"] for each in found)
    assert summary["met_exact"] == sum(each["exact"]["met"] for each in found)
    assert summary["met_by_heuristic_scale"]["1"] == summary["met"]
    assert len(summary["met_by_heuristic_scale"]) == len(HEURISTIC_SCALES)


def test_published_numbers_are_those_of_the_published_search(folder, runs, published):
    found = json.loads((folder / "summary.json").read_text())["expectations"]
    case_4 = next(each for each in found if each["id"] == "e.4-1")
    own = published[published_run("4-1")].path
    assert case_4["own"]["4-1"]["energy_discrete_j"] == pytest.approx(own.energy.sum())
    exact = case_4["exact"]["own"]["4-1"]
    assert exact["energy_discrete_j"] == pytest.approx(runs["4-1"].path.energy.sum())
    assert "energy_fitted_j" in exact
    for name, run in runs.runs.items():
        other = published[published_run(name)]
        if run.path is not None and run.setting.search == "exact":
            assert other.path.cost >= (1.0 - 1e-9) * run.path.cost


def test_the_table_has_a_row_for_every_run(folder, runs, weighed):
    found = {row["run"]: row for row in rows(folder / "table.csv")}
    assert set(found) > {*runs.runs, *weighed.runs}
    for name, run in runs.runs.items():
        if run.path is not None:
            assert float(found[name]["energy_discrete_j"]) == pytest.approx(run.path.energy.sum())
    assert all(found[name]["energy_fitted_j"] for name in ("1-1", "2-1", "4-2"))


@pytest.mark.parametrize("name", FIGURES)
def test_each_figure_is_drawn_and_its_data_are_beside_it(folder, name):
    picture = matplotlib.image.imread(folder / f"{name}.png")[..., :3]
    assert np.mean(np.any(picture < 0.97, axis=2)) > 0.02
    data = sorted(folder.glob(f"{name}*.csv"))
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


def test_with_the_weight_of_the_area_less_of_it_is_given_up_for_more_energy(folder, weighed):
    found = {row["run"]: row for row in rows(folder / "area_energy.csv")}
    assert list(found) == [*weighed.runs, "4-1", "4-2", "4-3"]
    front = [found[name] for name in weighed.runs]
    for before, after in itertools.pairwise(front):
        assert float(after["w4_per_m"]) > float(before["w4_per_m"])
        assert float(after["energy_discrete_j"]) > 0.995 * float(before["energy_discrete_j"])
        assert float(after["shortfall_discrete_m"]) < 1.005 * float(before["shortfall_discrete_m"])
    assert float(front[-1]["area_discrete_m2_s2"]) > 1.05 * float(front[0]["area_discrete_m2_s2"])
    assert float(front[-1]["area_m2_s2"]) > 1.05 * float(front[0]["area_m2_s2"])
    for name in ("4-1", "4-2", "4-3"):
        assert float(found[name]["energy_j"]) > float(front[0]["energy_j"])
        assert float(found[name]["area_m2_s2"]) < float(front[0]["area_m2_s2"])


def test_the_best_operating_points_are_the_cheapest_of_their_curves(folder):
    best = json.loads((folder / "summary.json").read_text())["operating_points"]
    curves = rows(folder / "operating_point.csv")
    assert len(best) == 4
    for name, point in best.items():
        curve = [row for row in curves if row["run"] == name]
        assert len(curve) == point["looked_at"] > 25
        assert point["cost"] == min(float(row["cost"]) for row in curve)
        kept = "v_max_m_s" if ".ps" in name else "supply_pressure_pa"
        assert len({row[kept] for row in curve}) == 1


def test_nothing_half_written_is_left(folder):
    assert not list(folder.glob("*.part"))
