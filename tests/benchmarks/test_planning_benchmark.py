"""The benchmark of planning, with little effort: its keys, and that they make sense."""

import json

import numpy as np
import pytest
from benchmarks import planning_benchmark
from benchmarks.planning_benchmark import (
    ANY_MACHINE,
    BenchmarkSize,
    as_text,
    explicit_graph,
    measure,
)
from scipy.sparse.csgraph import dijkstra

from mhsb_model.command_line import UsageError
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_planner.search.s2_search import PathQuery, search

LITTLE = BenchmarkSize(
    moves=4,
    entries=3,
    truths=1,
    growth_moves=2,
    spacings=(0.2, 0.1),
    runs=1,
    repeated=1,
    lines=1,
    boosted=1,
    scenes=2,
    collocations=3,
)


@pytest.fixture(scope="module")
def figures(machine):
    return measure(machine, LITTLE)


@pytest.mark.slow  # the ground truths alone take minutes
def test_the_keys_are_all_there(figures):
    assert set(figures) == {
        *("table", "plan", "scipy_dijkstra", "first_motion_ms", "overrun_ms", "growth"),
        *("stream", "moving_goal", "boosted", "scenes", "time_optimality"),
    }
    assert set(figures["boosted"]) == {"low_pressure", "heavy", "negative_arms"}
    ratios = {f"{quick}ratio_{which}" for quick in ("", "quick_") for which in ("mean", "worst")}
    for row in figures["boosted"].values():
        assert set(row) == {"moves", "quick_found", *ratios, "seconds_mean", "seconds_worst"}
    assert set(figures["scenes"]) == {
        *("scenes", "solved", "compared", "dearer", "cost_ratio_mean", "cost_ratio_worst"),
        *("p50_ms", "p99_ms"),
    }
    assert set(figures["table"]) == {
        *("entries", "build_s", "slsqp_s_per_entry", "speedup_over_slsqp", "worst_area_ratio")
    }
    assert set(figures["plan"]["table"]) == {
        *("p50_ms", "p99_ms", "s2_p99_ms", "s3_p99_ms", "s4_p99_ms", "rebuild_ms")
    }
    assert set(figures["plan"]["integrated"]) == {
        *("p50_ms", "p99_ms", "energy_ratio_geomean", "worst_energy_ratio", "worst_cost_ratio"),
        *("ground_truth_ratio_mean", "ground_truth_ratio_max", "soon"),
    }
    assert set(figures["plan"]["integrated"]["soon"]) == {
        *("deadline_ms", "p50_ms", "p99_ms", "not_found", "worst_energy_ratio"),
        *("worst_cost_ratio", "ground_truth_ratio_mean", "ground_truth_ratio_max"),
    }
    assert set(figures["scipy_dijkstra"]) == {"p50_ms", "p99_ms"}
    for kind in ("table", "integrated"):
        for start in ("rest", "motion"):
            of_start = figures["first_motion_ms"][kind][start]
            assert set(of_start) == {"p50", "p99", "p99_over_dijkstra"}
    distribution = {"p50", "p90", "p99", "max", "asked", "ended_by_deadline", "without_motion"}
    assert set(figures["overrun_ms"]) == {*distribution, "table", "integrated"}
    assert set(figures["overrun_ms"]["integrated"]) == distribution
    assert [row["spacing_m"] for row in figures["growth"]] == [0.2, 0.1]


@pytest.mark.slow  # the ground truths alone take minutes
def test_the_figures_make_sense(figures):
    assert figures["table"]["entries"] == 14766
    assert figures["table"]["worst_area_ratio"] >= 1 - 1e-6
    assert figures["table"]["speedup_over_slsqp"] > 1
    plan = figures["plan"]["table"]
    assert 0 < plan["p50_ms"] <= plan["p99_ms"]
    assert all(value > 0 for value in plan.values())
    integrated = figures["plan"]["integrated"]
    assert 0 < integrated["p50_ms"] <= integrated["p99_ms"]
    assert integrated["energy_ratio_geomean"] < 1
    assert integrated["worst_cost_ratio"] <= 1.0 + 1e-9
    assert integrated["worst_energy_ratio"] <= 1.001
    assert integrated["ground_truth_ratio_mean"] < 1.1
    assert integrated["ground_truth_ratio_max"] < 1.25
    for row in figures["boosted"].values():
        assert 1.0 - 1e-9 <= row["ratio_mean"] <= row["ratio_worst"] < 1.1
        assert 0 <= row["quick_found"] <= row["moves"] == 1
    scenes = figures["scenes"]
    assert 0 <= scenes["dearer"] <= scenes["compared"] <= scenes["scenes"] == 2
    for of_kind in figures["first_motion_ms"].values():
        assert all(0 < value["p50"] <= value["p99"] for value in of_kind.values())
    overrun = figures["overrun_ms"]
    assert overrun["asked"] >= overrun["ended_by_deadline"] >= overrun["without_motion"]
    assert overrun["asked"] == sum(overrun[kind]["asked"] for kind in ("table", "integrated"))
    assert 0 <= overrun["p50"] <= overrun["p99"] <= overrun["max"]
    assert figures["growth"][0]["states"] < figures["growth"][1]["states"]
    assert 0.9 < figures["time_optimality"]["ratio_p50"] < 1.05
    assert figures["time_optimality"]["ratio_max"] < 1.1
    assert len(as_text(figures)) > 4


@pytest.mark.slow  # the ground truths alone take minutes
def test_the_command_writes_them(figures, tmp_path, monkeypatch):
    monkeypatch.setattr(planning_benchmark, "measure", lambda *_: figures)
    planning_benchmark.planning(tmp_path / "new" / "planning.json")
    assert json.loads((tmp_path / "new" / "planning.json").read_text()) == figures


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"moves": 0}, "--moves 0 is below 1"),
        ({"collocations": 0}, "--collocations 0 is below 1"),
        ({"truths": -1}, "--truths -1 is below 0"),
        ({"parts": ["speed"]}, "--parts speed is none of table, plan, .*, time_optimality"),
        ({"parts": ["scenes"], "machine": find_config_file("mhsb_arm4.yaml")}, "scenes is none of"),
    ],
)
def test_what_cannot_be_measured_is_refused_in_a_sentence(tmp_path, options, sentence):
    with pytest.raises(UsageError, match=sentence):
        planning_benchmark.planning(tmp_path / "planning.json", **options)


@pytest.mark.slow
@pytest.mark.timeout(1800)  # a ground truth takes minutes
def test_an_arm_of_four_joints_is_measured_in_the_parts_that_are_of_any_machine():
    kept, arm = [], load_machine(find_config_file("mhsb_arm4.yaml"))
    figures = measure(arm, LITTLE, parts=ANY_MACHINE, keep=lambda so_far: kept.append(len(so_far)))
    assert set(figures) == {*ANY_MACHINE, "scipy_dijkstra"}
    assert kept == [3, 4, 5, 6]
    assert figures["table"]["worst_area_ratio"] >= 0.999
    assert figures["plan"]["integrated"]["worst_cost_ratio"] <= 1.0 + 1e-9
    assert len(as_text(figures)) > 4


def test_without_ground_truths_nothing_is_said_of_them():
    arm = load_machine(find_config_file("excavator.yaml")).with_values({"workspace.spacing": 0.24})
    figures = measure(arm, BenchmarkSize(moves=1, truths=0, runs=1), parts=("plan",))
    assert not any("ground truth" in line for line in as_text(figures))
    assert figures["plan"]["integrated"]["worst_cost_ratio"] <= 1.0 + 1e-9


def test_scipy_is_given_the_graph_that_is_searched(graph):
    """From node to node in state N, where nothing has to be joined to the grid."""
    patterns = len(graph.table.patterns)
    here, there = graph.grid.node_at(0.55, 0.20), graph.grid.node_at(0.65, -0.10)
    costs = dijkstra(explicit_graph(graph), indices=here * patterns)
    reached = costs[there * patterns : (there + 1) * patterns].min()
    goal = tuple(graph.table.nodes[there] * graph.table.spacing)
    path = search(
        graph,
        PathQuery(
            graph.table.posture[here, 0], np.zeros(3), goal, planning_benchmark.ENERGY_OPTIMAL
        ),
    )
    assert path.cost == pytest.approx(reached, rel=1e-9)
