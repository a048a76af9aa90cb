import itertools

import numpy as np

from mhsb_control.governor.guarded_modes import combine_modes
from mhsb_model.modes import BOOSTED_MODES, MODE_RANKS, Mode, count_modules, list_mode_patterns

PER_MODE = (0, 1, 2)
ENOUGH = 0.5e6


def test_whatever_is_asked_for_the_modules_suffice_and_nobody_is_given_more_than_that() -> None:
    random = np.random.default_rng(0)
    for modules in (1, 2, 4):
        for scheduled in list_mode_patterns(3, modules, PER_MODE):
            for asks in itertools.product((Mode.N, Mode.DB), repeat=3):
                asked, reserve = np.array(asks, dtype=np.uint8), random.uniform(-2e6, 2e6, 3)
                modes = combine_modes(scheduled, asked, reserve, ENOUGH, modules, PER_MODE)
                assert count_modules(modes, PER_MODE) <= modules
                most = np.maximum(MODE_RANKS[scheduled], MODE_RANKS[asked])
                assert np.all(MODE_RANKS[modes] <= most)
                if count_modules(np.maximum(scheduled, asked), PER_MODE) <= modules:
                    np.testing.assert_array_equal(MODE_RANKS[modes], most)
                if not asked.any():
                    np.testing.assert_array_equal(modes, scheduled)
                let_go = BOOSTED_MODES[scheduled] & ~BOOSTED_MODES[modes]
                assert np.all(reserve[let_go] > ENOUGH)


def test_modules_come_from_where_the_main_pump_leaves_most() -> None:
    three = np.array([1, 1, 1], np.uint8)
    np.testing.assert_array_equal(
        combine_modes(np.array([2, 2, 0], np.uint8), np.array([0, 0, 1], np.uint8),
                      np.array([2e6, 3e6, -1e5]), ENOUGH, 4, PER_MODE),
        [2, 0, 1],
    )  # fmt: skip
    np.testing.assert_array_equal(
        combine_modes(np.array([2, 2, 0], np.uint8), np.array([0, 0, 1], np.uint8),
                      np.array([-2e6, -1e6, -1e5]), ENOUGH, 4, PER_MODE),
        [2, 1, 1],
    )  # fmt: skip
    np.testing.assert_array_equal(
        combine_modes(three, three, np.full(3, -1e6), ENOUGH, 4, PER_MODE), three
    )


def test_where_there_are_too_few_those_that_lack_most_are_boosted() -> None:
    nobody, everybody = np.zeros(3, np.uint8), np.ones(3, np.uint8)
    reserve = np.array([-1e5, -4e5, -3e5])
    modes = combine_modes(nobody, everybody, reserve, ENOUGH, 2, PER_MODE)
    np.testing.assert_array_equal(modes, [0, 1, 1])


def test_where_modules_are_lost_those_with_most_reserve_get_less() -> None:
    boosted, nobody = np.array([2, 1, 1], np.uint8), np.zeros(3, np.uint8)
    reserve = np.array([-3e5, -1e5, -2e5])
    for modules, left in ((4, [2, 1, 1]), (3, [1, 1, 1]), (2, [1, 0, 1]), (1, [1, 0, 0])):
        modes = combine_modes(boosted, nobody, reserve, ENOUGH, modules, PER_MODE)
        np.testing.assert_array_equal(modes, left)
