from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_planner.cases.moves import list_case_moves, yield_random_moves
from mhsb_planner.cases.paper_cases import load_paper_cases
from mhsb_planner.planner import Planner


def test_the_cases_have_six_moves_from_postures_at_their_starts(machine):
    moves = list_case_moves(machine)
    assert list(moves) == ["1-1", "2-1", "2-2", "3-1", "3-2", "4-1"]
    cases = load_paper_cases()
    for name, move in moves.items():
        assert move.goal == cases[name].goal
        assert abs(machine.tip_position(move.start) - cases[name].start).max() < 1e-9


def test_an_arm_that_slews_has_no_cases():
    assert list_case_moves(load_machine(find_config_file("excavator.yaml"))) == {}


def test_random_moves_are_the_same_every_time(machine, table):
    planner = Planner(machine, table)
    first, again = (list(yield_random_moves(planner, 3)) for _ in range(2))
    assert [move.goal for move in first] == [move.goal for move in again]
    assert len({move.goal for move in first}) == 3
    assert [move.goal for move in yield_random_moves(planner, 3, seed=1)] != [m.goal for m in first]
