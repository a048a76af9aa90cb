"""Mode patterns and the module budget, against the paper and by enumeration."""

import numpy as np
import pytest

from mhsb_model.modes import (
    BOOSTED_MODES,
    MODE_COUNT,
    MODE_PROPERTIES,
    MODE_RANKS,
    RAIL_MODES,
    Mode,
    any_boosted,
    assign_modules,
    choose_stronger_modes,
    count_modules,
    find_strongest_modes,
    format_pattern,
    list_mode_patterns,
)

PER_MODE = (0, 1, 2)


def test_three_joints_and_four_modules_have_the_23_patterns_of_the_paper():
    patterns = list_mode_patterns(3, 4, PER_MODE)
    names = {format_pattern(pattern) for pattern in patterns}
    assert len(names) == 23
    assert not names & {"SB-SB-SB", "SB-SB-DB", "SB-DB-SB", "DB-SB-SB"}
    assert format_pattern(patterns[0]) == "N-N-N"


def test_patterns_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        list_mode_patterns(3, 4, PER_MODE)[0, 0] = 1


@pytest.mark.parametrize("pattern", list(list_mode_patterns(3, 4, PER_MODE)))
def test_every_pattern_gets_its_modules_and_no_module_serves_two(pattern):
    serves = assign_modules(pattern, 4, PER_MODE)
    for actuator, mode in enumerate(pattern):
        assert np.sum(serves == actuator) == PER_MODE[mode]
        assert mode == Mode.N or serves[actuator] == actuator
    assert count_modules(pattern, PER_MODE) == np.sum(serves >= 0)


def test_shared_boost_takes_its_own_module_then_the_spare_then_idle_ones():
    assert assign_modules((2, 0, 0), 4, PER_MODE).tolist() == [0, -1, -1, 0]
    assert assign_modules((2, 2, 0), 4, PER_MODE).tolist() == [0, 1, 1, 0]
    assert assign_modules((2, 0, 2), 4, PER_MODE).tolist() == [0, 2, 2, 0]


def test_a_pattern_beyond_the_budget_is_refused_with_the_numbers():
    with pytest.raises(ValueError, match="SB-SB-SB needs 6 modules, 4 are there"):
        assign_modules((2, 2, 2), 4, PER_MODE)


def test_who_has_lost_its_own_module_is_served_by_a_spare_or_by_who_leaves_it_idle():
    assert assign_modules((1, 0, 0), 4, PER_MODE, [0]).tolist() == [-1, -1, -1, 0]
    assert assign_modules((2, 0, 1), 4, PER_MODE, [3]).tolist() == [0, 0, 2, -1]
    with pytest.raises(ValueError, match="SB-DB-DB needs 4 modules, 3 are there"):
        assign_modules((2, 1, 1), 4, PER_MODE, [2])


def test_fewer_modules_than_actuators_are_shared_as_far_as_they_go():
    assert assign_modules((0, 0, 1), 2, PER_MODE).tolist() == [2, -1]
    assert len(list_mode_patterns(3, 0, PER_MODE)) == 1


def test_the_table_of_modes_has_one_row_for_each_and_its_columns_follow_the_codes():
    assert list(MODE_PROPERTIES) == list(Mode) == list(range(MODE_COUNT))
    for mode, row in MODE_PROPERTIES.items():
        assert (BOOSTED_MODES[mode], RAIL_MODES[mode], MODE_RANKS[mode]) == row
    assert sorted(MODE_RANKS) == list(range(MODE_COUNT))  # no two modes are of one rank


def test_the_stronger_pattern_has_the_stronger_mode_of_each_actuator():
    one, other = np.array([0, 2, 1], np.uint8), np.array([1, 1, 1], np.uint8)
    assert (
        choose_stronger_modes(one, other).tolist()
        == choose_stronger_modes(other, one).tolist()
        == [1, 2, 1]
    )
    assert choose_stronger_modes(one, other).dtype == np.uint8


def test_the_strongest_mode_and_boost_are_told_pattern_by_pattern():
    patterns = np.array([[0, 0, 0], [0, 1, 0], [2, 1, 0]], np.uint8)
    assert find_strongest_modes(patterns).tolist() == [0, 1, 2]
    assert any_boosted(patterns).tolist() == [False, True, True]
    assert find_strongest_modes(patterns[1]) == Mode.DB
