import math

import numpy as np

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_planner.cases.moves import list_case_moves, list_distinct_cases, yield_random_moves
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


def list_cases_within(radius):
    """Names of the distinct cases whose start and goal are at most so far from joint 1."""
    return [
        name
        for name, case in list_distinct_cases().items()
        if max(math.hypot(*case.start), math.hypot(*case.goal)) <= radius
    ]


def test_cases_outside_the_workspace_are_left_out(machine):
    near = list_cases_within(0.9)
    assert 0 < len(near) < len(list_distinct_cases())
    assert list(list_case_moves(machine.with_values({"workspace.max_radius": 0.9}))) == near


def test_cases_without_a_posture_are_left_out(machine):
    bent = machine.with_values({"joints.1.limits.upper": -1.4})
    lower, upper = bent.arrays.joint_min, bent.arrays.joint_max
    reach = max(
        np.linalg.norm(bent.tip_position(np.array([0.0, q2, q3])))
        for q2 in np.linspace(lower[1], upper[1], 50)
        for q3 in np.linspace(lower[2], upper[2], 50)
    )
    near = list_cases_within(reach)
    assert 0 < len(near) < len(list_distinct_cases())
    assert list(list_case_moves(bent)) == near


def test_random_moves_are_the_same_every_time(machine, table):
    planner = Planner(machine, table)
    first, again = (list(yield_random_moves(planner, 3)) for _ in range(2))
    assert [move.goal for move in first] == [move.goal for move in again]
    assert len({move.goal for move in first}) == 3
    assert [move.goal for move in yield_random_moves(planner, 3, seed=1)] != [m.goal for m in first]
