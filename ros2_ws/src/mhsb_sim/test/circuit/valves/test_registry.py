"""The registered kinds of valves."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from mhsb_model.errors import MachineFileError
from mhsb_model.schema import Section
from mhsb_sim.circuit.valves import registry
from mhsb_sim.circuit.valves.piston_seal import PISTON_SEAL
from mhsb_sim.circuit.valves.registry import (
    PORT_VALVE_KINDS,
    VALVE_KINDS,
    compute_port_opening,
    compute_valve_flow,
    read_valve_sections,
)

NUMBERS = np.linspace(0.7e-9, 1.3e-9, 8)


def test_each_kind_has_a_branch_with_its_place_and_another_index_has_no_flow():
    for drop in (-2e6, 3e6):
        for k, kind in enumerate(VALVE_KINDS):
            assert compute_valve_flow(k, NUMBERS, drop) == kind.compute_flow(NUMBERS, drop)
        assert compute_valve_flow(len(VALVE_KINDS), NUMBERS, drop) == (0.0, 0.0)


class PilotedValve(Section):
    """A section with settings of all types."""

    pilot: Literal["line", "tank"] = "line"
    is_vented: bool = False
    settings: tuple[float, ...] = ()


def test_a_section_has_texts_truth_values_and_lists_where_its_kind_declares_them(
    machine, monkeypatch
):
    kind = replace(PISTON_SEAL, name="piloted", section=PilotedValve)
    monkeypatch.setattr(registry, "VALVE_KINDS", (*VALVE_KINDS, kind))
    given = {"pilot": "tank", "is_vented": True, "settings": [1e6, 2e6]}
    changed = machine.with_values({"circuit.valves": {"piloted": given}})
    read = read_valve_sections(changed.changed(payload=1.0))["piloted"]
    assert read == PilotedValve(pilot="tank", is_vented=True, settings=(1e6, 2e6))
    wrong = machine.with_values({"circuit.valves": {"piloted": {"pilot": "rail"}}})
    with pytest.raises(MachineFileError, match=r"piloted\.pilot: must be 'line' or 'tank'"):
        read_valve_sections(wrong)
    for value in ("much", [1e-9], float("nan")):
        seal = {"piston_seal": {"leakage_flow": value}}
        with pytest.raises(MachineFileError, match=r"piston_seal\.leakage_flow: must be"):
            read_valve_sections(machine.with_values({"circuit.valves": seal}))


def test_each_port_valve_has_a_branch_with_its_place_and_another_index_is_open():
    for chamber, pilot in ((0.0, 0.0), (3e6, 1e5)):
        for k, kind in enumerate(PORT_VALVE_KINDS):
            opening = compute_port_opening(k, NUMBERS, chamber, pilot)
            assert opening == kind.compute_opening(NUMBERS, chamber, pilot)
        assert compute_port_opening(len(PORT_VALVE_KINDS), NUMBERS, chamber, pilot) == 1.0
