"""Holding modes against the law of need, and what happens where modules are too few."""

import numpy as np
import pytest

from mhsb_model.holding import HoldingError, choose_holding_modes, choose_stop_modes
from mhsb_model.hydraulics import needs_boost
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.schema import MachineConfig

N, DB, SB = Mode.N, Mode.DB, Mode.SB
LIGHT, HEAVY = 500.0, 3000.0  # N, against extension: below and above what P_S carries
PULLED = -3000.0


@pytest.fixture
def poor(content):
    """The suite's arm with a single module."""
    content["hydraulics"]["modules"]["count"] = 1
    return Machine.from_config(MachineConfig.model_validate(content))


def test_the_holding_modes_boost_only_what_the_supply_pressure_cannot_hold(machine):
    assert choose_holding_modes(machine, np.array([HEAVY, LIGHT, -LIGHT])).tolist() == [DB, N, N]
    assert choose_holding_modes(machine, np.array([LIGHT, PULLED, 0.0])).tolist() == [N, DB, N]


def test_the_need_is_that_of_the_planners_law(machine):
    random = np.random.default_rng(1)
    for force in random.uniform(-4000.0, 4000.0, (100, 3)):
        boosted = [needs_boost(machine.arrays, j, force[j], 0.0) for j in range(3)]
        assert (choose_holding_modes(machine, force) != N).tolist() == boosted


def test_too_few_modules_are_an_error_that_tells_the_modes_and_both_numbers(poor):
    assert choose_holding_modes(poor, np.array([LIGHT, HEAVY, LIGHT])).tolist() == [N, DB, N]
    with pytest.raises(HoldingError, match="DB-N-DB needs 2 booster modules, 1 are fitted"):
        choose_holding_modes(poor, np.array([HEAVY, LIGHT, PULLED]))


def test_a_stop_keeps_the_modes_in_force_where_modules_are_too_few(poor):
    in_force = [N, DB, N]
    heavy, light = np.array([HEAVY, LIGHT, PULLED]), np.full(3, LIGHT)
    assert choose_stop_modes(poor, heavy, in_force).tolist() == in_force
    assert choose_stop_modes(poor, light, in_force).tolist() == [N, N, N]
