"""The registered kinds of valves."""

import numpy as np

from mhsb_sim.circuit.valves.registry import VALVE_KINDS, compute_valve_flow

NUMBERS = np.linspace(0.7e-9, 1.3e-9, 8)


def test_each_kind_has_a_branch_with_its_place_and_another_index_has_no_flow():
    for drop in (-2e6, 3e6):
        for k, kind in enumerate(VALVE_KINDS):
            assert compute_valve_flow(k, NUMBERS, drop) == kind.compute_flow(NUMBERS, drop)
        assert compute_valve_flow(len(VALVE_KINDS), NUMBERS, drop) == (0.0, 0.0)
