"""MHSB against other supplies over several moves and motions."""

from __future__ import annotations

import numpy as np
import pytest

from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_tools.comparison.supply_comparison import (
    ONE_PRESSURE,
    PLANNED_SYSTEM,
    Supplied,
    as_markdown,
    compute_supply_energies,
    format_energy_by_move,
    sum_supply_energies,
)
from mhsb_tools.moves.supply_systems import SupplyEnergy, baselines, remove_leakage

RIVAL = "constant pressure"


def given(machine: Machine, needed: float, mhsb: float | None, rival: float) -> Supplied:
    taken = dict.fromkeys(baselines(machine), SupplyEnergy(rival, 2.0 * rival))
    if mhsb is not None:
        taken |= {PLANNED_SYSTEM: SupplyEnergy(mhsb, 2.0 * mhsb)}
    return Supplied(needed, 1e-5, 2.0, taken, taken)


def test_each_supply_takes_its_best_motion_and_all_take_the_same_moves(machine: Machine) -> None:
    moves = [
        {"table": given(machine, 5e6, 10.0, 8.0), "straight": given(machine, 6e6, None, 3.0)},
        {"table": given(machine, 7e6, 4.0, 6.0)},
        {"straight": given(machine, 9e6, None, 1.0)},  # nothing that MHSB can do
    ]
    found = sum_supply_energies(machine, moves)
    assert (found["moves"], found["one_pressure_pa"]) == (2, 7e6)
    systems = found["systems"]
    assert systems[PLANNED_SYSTEM]["leaking"]["hydraulic_j"] == 14.0
    assert systems[RIVAL]["leaking"]["hydraulic_j"] == 9.0
    assert systems[RIVAL]["tight"]["shaft_j"] == 18.0
    assert systems[RIVAL]["leaking"]["cheaper_than_mhsb_hydraulic"] == 1
    # One pressure for all: 7 MPa times the oil, of which 10 cm³ drive the pistons of each.
    assert systems[ONE_PRESSURE]["tight"]["hydraulic_j"] == pytest.approx(2 * 7e6 * 1e-5)
    m = machine.arrays
    more = np.sqrt((7e6 - m.tank_pressure) / (m.supply_pressure - m.tank_pressure))
    leaked = 2 * 2.0 * 3 * m.leakage_flow * more
    assert systems[ONE_PRESSURE]["leaking"]["hydraulic_j"] == pytest.approx(7e6 * (2e-5 + leaked))


def test_a_motion_is_told_with_every_supply(machine: Machine, motion) -> None:
    start = MotionState.at_rest(np.array([0.3, -1.4, -1.5]))
    trajectory, schedule = motion(start, [0.35, -1.35, -1.45])
    moves = [
        {"planned": compute_supply_energies(machine, remove_leakage(machine), trajectory, schedule)}
    ]
    found = sum_supply_energies(machine, moves)
    mhsb = found["systems"][PLANNED_SYSTEM]
    assert mhsb["tight"]["hydraulic_j"] < mhsb["leaking"]["hydraulic_j"]
    assert mhsb["leaking"]["hydraulic_j"] < mhsb["leaking"]["shaft_j"]
    for lines in (
        as_markdown({"moves": found, "none": {}}),
        format_energy_by_move(["1-1"], moves, machine),
    ):
        assert all(
            any(name in line for line in lines) for name in (PLANNED_SYSTEM, *baselines(machine))
        )


def test_nothing_that_mhsb_can_do_gives_nothing(machine: Machine) -> None:
    assert sum_supply_energies(machine, [{}]) == {}
    assert as_markdown({"none": {}}) == []
