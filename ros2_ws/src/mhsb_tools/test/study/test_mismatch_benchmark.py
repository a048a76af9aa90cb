"""The mismatch benchmark: its file, its runs, its numbers."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from mhsb_control import select_controllers
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine
from mhsb_planner.kernel_parts import compile_planner
from mhsb_tools.errors import ScenarioError, VariationError
from mhsb_tools.study.draws import DrawRecord
from mhsb_tools.study.mismatch_benchmark import (
    BENCHMARK_FILE,
    Protocol,
    as_markdown,
    load_protocol,
    run_benchmark,
    summarize,
)
from mhsb_tools.study.study_command import study_benchmark


@pytest.fixture
def content() -> dict:
    """Of the benchmark's file, free to be spoiled."""
    return yaml.safe_load(find_config_file(BENCHMARK_FILE).read_text(encoding="utf-8"))


@pytest.fixture
def short(machine: Machine) -> Protocol:
    """A protocol of one sequence of one goal near the start."""
    compile_planner()
    protocol = load_protocol(machine)
    tip = machine.tip_position(np.array(machine.config.simulation.start_posture))
    moves = protocol.file.sequences[0].model_copy(
        update={"goals": ((round(tip[0], 3) + 0.02, round(tip[1], 3), 0.5),)}
    )
    return replace(protocol, file=protocol.file.model_copy(update={"sequences": (moves,)}))


def test_the_shipped_protocol_has_all_variations_at_once_and_goals_in_the_workspace(
    machine: Machine,
) -> None:
    protocol = load_protocol(machine)
    assert len(protocol.file.sequences) == 10
    for moves in protocol.file.sequences:
        assert len(moves.goals) == 6
        for x, z, interval in moves.goals:
            assert x >= 0.0
            assert 0.25 <= np.hypot(x, z) <= 1.029
            assert 0.4 <= interval <= 5.0
    assert len({moves.weights for moves in protocol.file.sequences}) == 2
    assert {"payload", "delay", "supply_sag", "overlap"} < set(protocol.variations)


def test_the_same_bits_come_from_one_process_and_from_two(
    machine: Machine, short: Protocol
) -> None:
    alone, shared = (
        {
            (exact, record.draw, record.controller): asdict(record)
            for exact, records in run_benchmark(machine, short, 2, jobs)
            for record in records
        }
        for jobs in (1, 2)
    )
    assert alone == shared
    assert len(alone) == 3 * len(select_controllers(machine))
    for (exact, *_), record in alone.items():
        assert record["failure"] == ""
        assert (record["varied"] == {}) is exact
        assert 0.0 < record["tip_error_rms_mm"] <= record["tip_error_max_mm"]
        assert 0.0 < record["energy_hydraulic_j"] < record["energy_shaft_j"]
        # 2 cm within a second or a few: a tip speed between 1 cm/s and 1 m/s.
        assert (
            1e-3 * record["tip_error_max_mm"] < record["rho_s"] < 0.1 * record["tip_error_max_mm"]
        )


def test_the_command_writes_records_summary_and_the_table(
    machine: Machine, short: Protocol, tmp_path: Path
) -> None:
    lines = study_benchmark(machine, short, 1, 1, tmp_path)
    records = json.loads((tmp_path / "records.json").read_text(encoding="utf-8"))
    assert [len(records[part]) for part in ("exact", "draws")] == [
        len(select_controllers(machine))
    ] * 2
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert summary["version"] == short.file.version
    assert summary["draws"]["coordinated"]["runs"] == 1
    table = (tmp_path / "results.md").read_text(encoding="utf-8")
    assert "| ρ [ms] | " in table
    assert "\n".join(lines).startswith(table.strip())


def test_summaries_count_what_is_lost_and_fails_and_tell_quantiles() -> None:
    base = DrawRecord("coordinated", 0, {}, 1.0, 2.0, 0.1, False, 0.0, 0, 0.004, 100.0, 120.0)
    records = [
        base,
        replace(base, draw=1, tip_error_max_mm=30.0, relief_opened=True),
        DrawRecord("coordinated", 2, {}, failure="it diverged"),
    ]
    found = summarize(records, 0.02)["coordinated"]
    assert (found["runs"], found["failed"], found["lost"], found["relief_opened"]) == (3, 1, 1, 1)
    assert found["max [mm]"] == [16.0, 28.6, 30.0]
    assert found["ρ [ms]"] == [4.0, 4.0, 4.0]
    lines = as_markdown({"draws": summarize(records, 0.02)})
    assert "| max [mm] | 16 / 28.6 / 30 |" in lines


@pytest.mark.parametrize(
    ("change", "error", "sentence"),
    [
        ({"seed": -1}, ScenarioError, "seed: must be at least 0"),
        ({"sequences": []}, ScenarioError, "sequences: "),
        ({"extra": 1}, ScenarioError, "extra: "),
        ({"variations": {"payload": {"keys": ["payload.mass"]}}}, VariationError, "payload"),
    ],
)
def test_a_protocol_that_is_wrong_is_refused_by_the_path_of_what_is(
    machine: Machine, content: dict, tmp_path: Path, change: dict, error: type, sentence: str
) -> None:
    file = tmp_path / "protocol.yaml"
    file.write_text(yaml.safe_dump(content | change), encoding="utf-8")
    with pytest.raises(error, match=sentence):
        load_protocol(machine, file)
