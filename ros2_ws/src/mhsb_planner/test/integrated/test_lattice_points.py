"""Rows and states of lattice points that a search reaches, against Python's dictionaries."""

import numpy as np

from mhsb_planner.integrated.lattice_points import (
    create_lattice_points,
    find_slot,
    find_state,
    with_more_rows,
)
from mhsb_planner.search.open_list import NO_STATE


def test_the_hash_table_gives_each_point_the_row_that_a_dictionary_gives_it():
    random, known, expected = np.random.default_rng(5), create_lattice_points(2, 4, 4), {}
    for number in random.integers(0, 40, 200).tolist() + random.integers(0, 2**26, 300).tolist():
        if len(expected) == len(known.records):
            known = with_more_rows(known)
        slot = find_slot(known.table, known.records, number)
        assert known.table[slot] == expected.get(number, -1) + 1
        if number not in expected:
            row = expected[number] = len(expected)
            known.table[slot], known.records["number"][row] = row + 1, number
            known.counts[0] = len(expected)
    for number, row in expected.items():
        assert known.table[find_slot(known.table, known.records, number)] == row + 1


def test_a_state_is_created_once_for_each_point_and_mode_combination():
    random, known, expected = np.random.default_rng(6), create_lattice_points(2, 5, 40), {}
    known.records["newest"] = NO_STATE
    for row, pattern in random.integers(0, (5, 8), (200, 2)).tolist():
        state = expected.setdefault((row, pattern), len(expected))
        assert find_state(known, row, pattern) == state
        assert known.states[state]["row"] == row
        assert known.states[state]["pattern"] == pattern
    assert known.counts[1] == len(expected)
