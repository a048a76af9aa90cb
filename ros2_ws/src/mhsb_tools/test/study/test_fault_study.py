"""The study of faults: records, figures, and what nobody can run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mhsb_model.machine import Machine
from mhsb_sim.errors import FaultError
from mhsb_tools.study.fault_study import STUDIED_FAULTS
from mhsb_tools.study.study_command import study_faults


def test_each_fault_has_a_record_and_a_figure(
    machine: Machine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    faults = ["none", "valve_hard_over:actuator_3"]
    lines = study_faults(machine, faults, 1, tmp_path)
    healthy, faulty = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert healthy["found_after_s"] is None
    assert healthy["at_goal_mm"] < 1.0
    assert not healthy["stopped"]
    assert faulty["stopped"]
    assert faulty["found_after_s"] < 0.1
    assert "actuator_3" in faulty["sentence"]
    assert {path.name for path in tmp_path.glob("*.png")} == {
        "none.png",
        "valve_hard_over_actuator_3.png",
    }
    assert any("valve_hard_over:actuator_3" in line for line in lines)


def test_a_fault_that_is_not_there_is_refused_before_anything_runs(
    machine: Machine, tmp_path: Path
) -> None:
    with pytest.raises(FaultError, match="there is no fault 'gremlins'"):
        study_faults(machine, ["none", "gremlins"], 1, tmp_path)
    assert len(STUDIED_FAULTS) == len(set(STUDIED_FAULTS))
