from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mhsb_model import command_line
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine, load_machine
from mhsb_planner.cases.moves import Move
from mhsb_planner.planner import ENERGY_OPTIMAL
from mhsb_planner.planners.registry import PLANNER_KINDS
from mhsb_planner.posture.s1_global_search import find_postures_at
from mhsb_tools.comparison import compare_command
from mhsb_tools.comparison.compare_command import (
    as_text,
    draw_proportions,
    list_unreachable_cases,
    summarize,
)
from mhsb_tools.comparison.planner_comparison import (
    ComparedMove,
    Comparison,
    PlannerComparer,
    PlannerResult,
    compute_ratios,
)

RECORD = PlannerResult(229.0, 240.0, 250.0, 260.0, 228.0, 4.0, 1, 0.1, 2.0, 0.04, 0.1, 9.0)


@pytest.fixture(scope="module")
def comparer(machine: Machine) -> PlannerComparer:
    return PlannerComparer(machine, ENERGY_OPTIMAL)


@pytest.fixture(scope="module")
def comparison(comparer: PlannerComparer, machine: Machine) -> Comparison:
    start = find_postures_at(machine, 0.60, 0.10).posture[0]
    return comparer.compare(ComparedMove("near", Move(start, (0.65, 0.20)), True))


def test_every_planner_and_the_ground_truth_have_a_record(comparison: Comparison) -> None:
    assert list(comparison.records) == [*PLANNER_KINDS, "ground truth"]
    assert not comparison.failures


def test_the_simulator_takes_what_was_planned(comparison: Comparison) -> None:
    for record in comparison.records.values():
        assert record.energy_simulated_j == pytest.approx(record.energy_series_j, rel=0.1)
        assert record.tip_error_max_mm < 1.0


def test_no_path_is_cheaper_than_its_lower_bound_or_the_ground_truth(
    comparison: Comparison,
) -> None:
    records = comparison.records
    truth = records["ground truth"].energy_path_j
    for record in records.values():
        assert record.energy_path_j >= record.lower_bound_j * (1.0 - 1e-9)
        assert record.energy_path_j >= truth * 0.99
    assert records["integrated"].energy_j <= records["table"].energy_j * 1.001


def test_a_goal_without_plan_is_a_failure_with_its_reason(
    comparer: PlannerComparer, machine: Machine
) -> None:
    start = find_postures_at(machine, 0.60, 0.10).posture[0]
    found = comparer.compare(ComparedMove("far", Move(start, (3.0, 0.0)), False))
    assert not found.records
    assert all("workspace" in reason for reason in found.failures.values())


def test_arms_that_slew_are_compared_too() -> None:
    arm = load_machine(find_config_file("excavator.yaml"))
    start = np.array([0.3, *arm.config.simulation.start_posture[1:]])
    tip = arm.tip_position(start) + [0.12, 0.10]
    goal = tuple(arm.convert_to_base(tip, -0.2).tolist())
    found = PlannerComparer(arm, ENERGY_OPTIMAL).compare(
        ComparedMove("near", Move(start, goal), True)
    )
    assert not found.failures
    assert list(found.records) == [*PLANNER_KINDS, "ground truth"]
    truth = found.records["ground truth"].energy_path_j
    for record in found.records.values():
        assert record.energy_simulated_j == pytest.approx(record.energy_series_j, rel=0.1)
        assert record.energy_path_j >= truth * 0.99


def test_cases_are_called_unreachable_only_if_they_have_no_move(
    machine: Machine,
) -> None:
    start = np.zeros(3)
    asked = [ComparedMove(name, Move(start, (0.6, 0.1)), True) for name in ("1-1", "2-2", "1")]
    assert list_unreachable_cases(machine, asked) == ["2-1", "3-1", "3-2", "4-1"]
    assert list_unreachable_cases(load_machine(find_config_file("excavator.yaml")), []) == []


def test_ratios_are_taken_of_moves_that_both_planners_have() -> None:
    double = replace(RECORD, energy_j=480.0, energy_series_j=500.0, energy_simulated_j=650.0)
    found = compute_ratios(
        [
            Comparison("1", {"table": RECORD, "integrated": double}, {}),
            Comparison("2", {"table": RECORD}, {"integrated": "no"}),
        ],
        "integrated",
    )
    assert found["energy"].tolist() == [2.0]
    assert found["energy_series"].tolist() == [2.0]
    assert found["energy_simulated"].tolist() == [2.5]
    assert found["simulated_over_planned_ratio"].tolist() == [1.25]


def test_the_summary_has_geometric_means_and_extremes(tmp_path: Path) -> None:
    moves = [
        Comparison(
            str(factor),
            {"table": RECORD, "integrated": replace(RECORD, energy_j=factor * RECORD.energy_j)},
            {"fixed": "no way"},
        )
        for factor in (0.5, 1.0)
    ]
    summary = {
        "unreachable_cases": ["3-1", "3-2"],
        "cases": summarize(moves),
        "random moves": summarize([]),
    }
    energy = summary["cases"]["integrated"]["energy"]
    assert energy["geometric_mean"] == pytest.approx(math.sqrt(0.5))
    assert (energy["least"], energy["largest"]) == (0.5, 1.0)
    text = "\n".join(as_text(moves, summary))
    assert text.startswith("left out, as the arm cannot reach them: cases 3-1, 3-2\ncase  planner ")
    assert "no way" in text
    assert "0.707" in text
    draw_proportions(moves, [], tmp_path / "proportions.png")
    assert (tmp_path / "proportions.png").stat().st_size > 5_000


def test_all_moves_are_planned_and_simulated_with_the_given_payload(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    seen: list[float] = []

    def note_payload(machine: Machine, *others: object) -> list:
        seen.append(machine.config.payload.mass)
        return []

    monkeypatch.setattr(compare_command, "list_compared_moves", note_payload)
    monkeypatch.setattr(compare_command, "compare_all", note_payload)
    words = ["--moves", "0", "--output", str(tmp_path), "--payload"]
    assert command_line.run(compare_command.compare, [*words, "14"]) == 0
    assert seen == [14.0, 14.0]
    assert command_line.run(compare_command.compare, [*words, "-1"]) == 2
    assert "--payload must be from 0 to 10000 (is -1.0)" in capsys.readouterr().err
