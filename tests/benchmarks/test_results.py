from itertools import pairwise

import numpy as np
from benchmarks.results import demo_moves, energy_figures, energy_lines, table

from mhsb_model.machine import load_machine
from mhsb_planner.planner import ENERGY_OPTIMAL
from mhsb_tools.comparison.planner_comparison import compare_all


def test_the_demo_s_moves_follow_one_another():
    machine = load_machine()
    moves = [each.move for each in demo_moves(machine)]
    assert len(moves) == 11
    for before, after in pairwise(moves):
        tip = machine.tip_position(after.start)
        np.testing.assert_allclose(tip, before.goal, atol=1e-6)


def test_energies_of_a_move_stand_beside_the_table_planners():
    machine = load_machine()
    found = list(compare_all(machine, ENERGY_OPTIMAL, demo_moves(machine)[:1], jobs=1))
    figures = energy_figures(machine, found)
    planners = figures["planners"]
    assert figures["moves"] == 1
    assert planners["table"]["ratio"] == 1.0
    assert planners["integrated"]["lower_bound_j"] <= planners["integrated"]["energy_j"]
    head, _, *rows, bound, end = energy_lines("demo", figures)
    assert head.startswith("| demo, 1 moves |")
    assert [row.split("|")[1].strip() for row in rows] == [f"`{kind}`" for kind in planners]
    assert bound.startswith("| lower bound of any plan |")
    assert end == ""


def test_a_table_has_as_many_columns_as_its_head():
    assert table("a", ("b",), {"c": (1,)}) == ["| a | b |", "|---|---|", "| c | 1 |", ""]
